"""What agents hold in a world that is not perfect: under every trouble alone, and under all of `lab`.

``python -m validation.robustness AGENT...`` flies run folders and ``pretrained:NAME`` on 10,000 episodes a
row, on a GPU if there is one, prints the table and writes docs/validation/robustness.json; with ``--lqr``
the LQR beside them.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from tyro.conf import Positional

from rans.evaluation.fly.controllers import controller
from rans.evaluation.fly.protocols import Setup
from rans.evaluation.measure.metrics import last_fifth, settling_times, solved
from rans.evaluation.measure.statistics import share
from rans.fast.engine import Engine
from rans.fast.learn.network import Network
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.selection import likeliest
from rans.fast.learn.troubles import TROUBLES
from rans.fast.saved import read_policy
from rans.files import environment, write_json
from rans.flight import fly
from rans.model.conditions import BodyConditions, Conditions
from rans.model.conditions_file import load_conditions
from rans.pretrained import pretrained_folder
from rans.scenario import EVALUATION_SEED, draws, scenarios

_LQR_EPISODES = 256


def rows() -> dict[str, Conditions]:
    """What is flown in: a perfect world, `lab`, every trouble over its range and at its end."""
    worst = {f"{name}, worst": _at_worst(found) for name, found in TROUBLES.items()
             if name not in ("least on-time", "inertia")}
    halved = Conditions(body=BodyConditions(inertia=0.5))
    return {"none": Conditions(), "lab": load_conditions("lab"), **TROUBLES, **worst,
            "inertia halved": halved}


def _at_worst(given: Any) -> Any:
    """The same with every range at its largest."""
    values = {one.name: getattr(given, one.name) for one in fields(given)}
    return replace(given, **{name: _at_worst(x) if is_dataclass(x) else x[1] for name, x in values.items()
                             if is_dataclass(x) or (isinstance(x, tuple) and set(map(type, x)) == {float})})


class Found(NamedTuple):
    """Of N episodes, each (N,)."""

    held: np.ndarray
    """Within all tolerances at every step of the last fifth, in truth."""
    settled: np.ndarray
    """Time to enter them for good, s; infinite if never."""
    duty: np.ndarray
    """Share of open thrusters over the last fifth."""


@torch.no_grad()
def flown(network: Network, setup: Setup, conditions: Conditions, episodes: int, seed: int,
          device: str) -> Found:
    """An agent's flights in the fast engine."""
    steps, period = setup.timing.episode_steps, setup.timing.control_period
    engine = Engine(setup.craft, setup.task, episodes, setup.timing, seed=seed, device=device,
                    conditions=conditions.or_none)
    observation, memory = engine.observe(), network.blank(episodes)
    ended = torch.zeros(episodes, dtype=torch.bool, device=device)
    outside, duty = torch.zeros(episodes, device=device), torch.zeros(episodes, device=device)
    for t in range(steps):
        command, memory = likeliest(network, observation, memory)
        step = engine.step(command)
        observation, kept = step.observation, step.reached & ~ended
        outside = torch.where(kept, outside, t + 1.0)
        ended |= step.terminated
        if t >= steps - steps // 5:
            duty += command.mean(dim=1) / (steps // 5)
    last: Tensor = torch.where(outside < steps, (outside + 1.0) * period, torch.inf)
    return Found(*(x.cpu().numpy() for x in (outside <= steps - steps // 5, last, duty)))


def flown_by_lqr(setup: Setup, conditions: Conditions, seed: int) -> Found:
    """The same of the LQR with its default weights, which is slower to fly."""
    starts = scenarios(setup.task, setup.craft, seed, _LQR_EPISODES)
    flight = fly(*setup[:2], controller("lqr", setup), starts, setup.timing, conditions=conditions.or_none,
                 draws=draws(seed, _LQR_EPISODES))
    return Found(solved(flight), settling_times(flight), last_fifth(flight.commands).mean(axis=(0, 2)))


@dataclass(frozen=True)
class Robustness:
    """Fly agents under every trouble; write the table."""

    agents: Positional[tuple[str, ...]]
    """Run folders, or pretrained:NAME; all of one task and spacecraft."""
    lqr: bool = False
    """Whether the LQR flies too, 256 episodes a row."""
    episodes: int = 10_000
    seed: int = EVALUATION_SEED
    output: Path = Path("docs/validation/robustness.json")

    def run(self) -> dict[str, dict[str, dict[str, Any]]]:
        """By agent and row.

        Raises:
            ConfigError: there is no such agent.
        """
        device = "cuda" if torch.cuda.is_available() else "cpu"
        result: dict[str, dict[str, dict[str, Any]]] = {}
        for name in self.agents:
            network, setup = _loaded(name, device)
            result[name] = {row: _said(flown(network, setup, found, self.episodes, self.seed, device))
                            for row, found in rows().items()}
            if self.lqr and "lqr" not in result:
                result["lqr"] = {row: _said(flown_by_lqr(setup, found, self.seed))
                                 for row, found in rows().items()}
        write_json(self.output, {"episodes": self.episodes, "seed": self.seed, "agents": result,
                                 "environment": environment()})
        return result


def _loaded(name: str, device: str) -> tuple[Network, Setup]:
    kind, _, own = name.rpartition(":")
    run = RunFolder(pretrained_folder(own) if kind else Path(own))
    config, craft = run.config(), run.spacecraft()
    saved = read_policy(run.policy_file, craft, config.settings).network
    network = Network.stacked(saved.architecture, [saved.tensors], torch.device(device), torch.float32)
    timing = replace(config.timing, substeps=None)
    return network, Setup(craft, config.settings.for_evaluation(), timing)


def _said(found: Found) -> dict[str, Any]:
    return {"held": {key: 100.0 * x for key, x in asdict(share(found.held)).items()},
            "settling time": float(np.median(found.settled)),
            "duty at rest": 100.0 * float(found.duty.mean())}


def main() -> None:
    """Print the table: held in % with its 95 % interval, median settling time in s, duty at rest in %."""
    import tyro
    from rich.console import Console
    from rich.table import Table

    result = tyro.cli(Robustness).run()
    table = Table("trouble", *result)
    for row in rows():
        cells = [result[name][row] for name in result]
        table.add_row(row, *(f"{x['held']['value']:.2f} ({x['held']['low']:.2f} to {x['held']['high']:.2f}), "
                             f"{x['settling time']:.1f} s, {x['duty at rest']:.1f}" for x in cells))
    Console().print(table)


if __name__ == "__main__":
    main()
