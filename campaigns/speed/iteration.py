"""How long an iteration of a recipe's training takes: its rollout and its update, gradients by hand or not.

``python -m campaigns.speed.iteration go-to-pose-2d-robust [--autograd]`` prints a table, of a GPU after some
40 s of compiling for each row.
"""

from __future__ import annotations

import argparse
import sys
from typing import NamedTuple
from unittest import mock

import torch

from rans.fast.engine import Engine
from rans.fast.learn.config import TrainConfig
from rans.fast.learn.fused_gradient import FusedGradient
from rans.fast.learn.member import begin
from rans.fast.learn.recipes import RECIPES, recipe
from validation.speed.measurement import Clock


class Iteration(NamedTuple):
    """Of one training."""

    backend: str
    """In which gradients are made."""
    rollout: float
    update: float
    """Milliseconds."""
    rate: float
    """M steps/s, flown and learned from."""


def iteration(config: TrainConfig, clock: Clock, with_backend: bool = True) -> Iteration:
    """Of a training without curriculum and reports, with gradients by hand where there are such."""
    given = config.ppo
    conditions = config.conditions.or_none
    engine = Engine(
        config.spacecraft,
        config.settings,
        given.n_envs,
        config.timing,
        device=clock.device,
        conditions=conditions,
        remember=given.privileged_critic,
    )
    made = FusedGradient.made if with_backend else lambda *_: None
    with mock.patch.object(FusedGradient, "made", made):
        learner = begin(engine, [given], [0])

    def both() -> None:
        learner.collect()
        learner.update()

    whole, rollout = (1e3 * clock.time(function)[0] for function in (both, learner.collect))
    backend = learner.backend.description if learner.backend else "autograd"
    return Iteration(backend, rollout, whole - rollout, given.n_envs * given.n_steps / whole / 1e3)


def table(found: list[Iteration]) -> str:
    """In Markdown."""
    rows = [("gradients", "rollout, ms", "update, ms", "M steps/s"), ("---",) * 4]
    rows += [
        (one.backend, f"{one.rollout:.2f}", f"{one.update:.2f}", f"{one.rate:.1f}") for one in found
    ]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recipe", choices=RECIPES)
    parser.add_argument("--autograd", action="store_true", help="and by autograd")
    parser.add_argument("--repeats", type=int, default=7)
    given = parser.parse_args()
    clock = Clock("cuda" if torch.cuda.is_available() else "cpu", given.repeats)
    config = recipe(given.recipe, clock.device)
    found = [
        iteration(config, clock, with_backend)
        for with_backend in ((True, False) if given.autograd else (True,))
    ]
    sys.stdout.write(f"{table(found)}\n")


if __name__ == "__main__":
    main()
