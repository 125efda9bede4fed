"""Our entry to the settled-gate benchmark: one network of one axis, flown three times.

It sees its axis' angle, rate and last torques, never a fault. So a reversed axis, which training knows, is
known beside another one, which training never meets.

``python -m validation.settled_gate_entry train RUN`` trains it in the plane, on a GPU if there is one, and
``... fly RUN`` prints the table with the benchmark's oracles and its published rows.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import tyro
from torch import Tensor
from tyro.conf import Positional

from rans.evaluation.measure.statistics import Estimate, share
from rans.fast.engine import Engine
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.member import begin
from rans.fast.learn.network import Network
from rans.fast.learn.selection import likeliest
from rans.fast.policy import write_policy
from rans.fast.saved import read_policy
from rans.fast.step import Step
from rans.files import environment, write_json
from rans.flight import Controller, fly
from rans.model.conditions import BodyConditions, Conditions
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.tasks import base
from validation.settled_gate import (
    CLASSES,
    MOMENTS,
    TIMING,
    Class,
    Faults,
    Oracle,
    Point,
    applied,
    battery,
    one_axis,
    settled,
    turns,
)

PUBLISHED = {"end-to-end GRU + PPO": (0.0, 0.0, 0.0, 0.0), "RMA student": (97.8, 94.4, 0.0, 0.0),
             "RMA + disturbance observer": (97.2, 96.8, 59.4, 0.0)}
"""% settled by class (paper/benchmark/tables/tab_battery.tex)."""


class FaultyEngine(Engine):
    """Bodies of one axis whose torque is faulty within the benchmark's training ranges, anew each episode.

    A third each has a sign, a gain, a gain and a bias. Half are reversed: with the quarter that a body with
    at most one such axis has on average, agents learn to live with losing these.
    """

    def step(self, action: Tensor) -> Step:
        """See `Engine.step`; the fault is upstream of the nozzles."""
        number = self._world.number(self.episode.clock, self._draws)
        random = self._draws.random(2, number, 40 * 256)
        kind, sign, size, bias = (torch.as_tensor(random.unit()).to(self.dtype) for _ in range(4))
        size = torch.where(kind < 1 / 3, torch.ones_like(size), 0.5 + size)
        gain = torch.where(sign < 0.5, -size, size)
        bias = torch.where(kind < 2 / 3, torch.zeros_like(bias), 0.4 * bias - 0.2)
        return super().step(applied(action.to(self.dtype), gain[:, None], bias[:, None]))


TRAINED_IN = Conditions(BodyConditions(inertia=(0.8 * MOMENTS[2] / MOMENTS[0], 2.0)))
"""f from 0.8 to 2 of every axis."""
_SMALL = PPOSettings(n_envs=256, n_steps=64, batch_size=4096, gamma=0.98, max_learning_rate=3e-3, anneal=0.7,
                     zoom=16.0, symmetric=False, memory="history", history=16)
_LARGE = replace(_SMALL, n_envs=8192, n_steps=32, batch_size=16384, n_epochs=2, layers=(256, 256))


def settings_on(device: str, history: int = 16) -> PPOSettings:
    """Those of a training on this device."""
    return replace(_SMALL if device == "cpu" else _LARGE, history=history)


def trained(steps: int, device: str, settings: PPOSettings, seed: int = 0,
            report: Callable[[int, float], object] = lambda *_: None) -> Network:
    """An agent of one axis after so many steps.

    Reported is, once an update, how many are done and how many episodes have just ended behind the gate.
    """
    engine = FaultyEngine(one_axis(), Point(), settings.n_envs, TIMING, seed=seed, device=device,
                          conditions=TRAINED_IN)
    learner, batch = begin(engine, [settings], [seed]), settings.n_envs * settings.n_steps
    for done in range(batch, steps + batch, batch):
        learner.slow_down(max(0.0, 1.0 - done / steps))
        learner.collect()
        learner.update()
        report(done, float(learner.rollout.reached))
    return learner.network


class ThreeAxes:
    """One network of one axis for each of three."""

    def __init__(self, network: Network, name: str = "by axis") -> None:
        self.name, self._network, self._task = name, network, Point()

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._memory = self._network.blank(3 * count)

    @torch.no_grad()
    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`: the turn so far is shared out by its rotation vector."""
        turned = turns(state, goal).ravel()
        spin, zero = np.concatenate(state.w.columns()), turned * 0.0
        still = Vec2(zero, zero)
        own = base.observation(self._task, PlanarState(still, Heading(turned), still, spin),
                               PlanarState(still, Heading(zero), still, zero))
        rows = torch.from_numpy(np.stack(own, axis=1).astype(np.float32))
        command, self._memory = likeliest(self._network, rows, self._memory)
        return command.numpy().reshape(3, -1, 2).transpose(1, 0, 2).reshape(-1, 6)


@dataclass(frozen=True)
class Train:
    """Train an agent of one axis into RUN/policy.zip."""

    run_folder: Annotated[Path, Positional, tyro.conf.arg(metavar="RUN")]
    steps: int = 200_000_000
    history: int = 16
    """Last observations and commands that it is shown."""
    seed: int = 0

    def run(self) -> None:
        """Says how far it is."""
        device = "cuda" if torch.cuda.is_available() else "cpu"
        settings = settings_on(device, self.history)
        network = trained(self.steps, device, settings, self.seed, lambda done, found: sys.stderr.write(
            f"\r{done:,} steps; of the last episodes {found:g} ended behind the gate "))
        self.run_folder.mkdir(parents=True, exist_ok=True)
        write_policy(self.run_folder / "policy.zip", network.architecture, network.member(0),
                     settings, self.steps)


@dataclass(frozen=True)
class Fly:
    """Fly agents and oracles from every start with every fault of every class; write the table."""

    run_folders: Annotated[tuple[Path, ...], Positional, tyro.conf.arg(metavar="RUN")] = ()
    faults: int = 50
    seeds: int = 10
    drake: bool = False
    """Whether Drake moves, which takes an hour for all."""
    output: Path = Path("docs/validation/settled-gate.json")

    def run(self) -> dict[str, dict[Class, Estimate]]:
        """Share of settled flights by controller and class."""
        from rich.console import Console
        from rich.table import Table

        move = fly
        if self.drake:
            from rans.reference.flight import fly_in_drake as move  # Drake is imported where it flies
        result: dict[str, dict[Class, Estimate]] = {}
        for kind in CLASSES:
            each, begun = battery(kind, self.faults, self.seeds)
            for one in self._controllers(each):
                found = settled(one, each, begun, move)
                result.setdefault(one.name, {})[kind] = share(found).scaled(100.0)
        table = Table("% settled", *CLASSES)
        for name, row in result.items():
            table.add_row(name, *(x.text(".1f") for x in row.values()))
        for name, numbers in PUBLISHED.items():
            table.add_row(f"{name} (published)", *map("{:.1f}".format, numbers))
        Console().print(table)
        write_json(self.output, {"settled": {name: {kind: vars(x) for kind, x in row.items()}
                                             for name, row in result.items()},
                                 "faults": self.faults, "seeds": self.seeds, "environment": environment()})
        return result

    def _controllers(self, each: Faults) -> Iterator[Controller]:
        yield Oracle(sound(each), "proportional-derivative")
        yield Oracle(each, "gain oracle")
        yield Oracle(each, "gain and bias oracle", knows_bias=True)
        for folder in self.run_folders:
            yield ThreeAxes(read_policy(folder / "policy.zip", one_axis(), Point()).network, str(folder))


def sound(faults: Faults) -> Faults:
    """What a controller believes that knows of no fault."""
    return Faults(np.ones_like(faults.inertia), np.ones_like(faults.gain), np.zeros_like(faults.bias))


def main() -> None:
    """Train or fly."""
    tyro.extras.subcommand_cli_from_dict({"train": Train, "fly": Fly}).run()


if __name__ == "__main__":
    main()
