"""Our entry to the settled-gate benchmark: one network of one axis, flown three times.

It sees its axis' angle, rate and last commands, never a fault. So a reversed axis, which training knows, is
known beside another one, which training never meets. `campaigns.settled_gate_agent` is the network.

``python -m campaigns.settled_gate_entry RUN`` trains it on a processor's core, and ``python -m campaigns
settled-gate RUN`` flies it, and prints the table with the benchmark's oracles and its published rows.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import tyro
from safetensors.torch import load_file, save_file
from tyro.conf import Positional

from campaigns.settled_gate import (
    CLASSES,
    DWELL,
    GATE,
    MOMENTS,
    Class,
    Faults,
    Oracle,
    battery,
    nozzles,
    settled,
    turns,
)
from campaigns.settled_gate_agent import Agent, Axes, Memory, flown, trained
from rans.evaluation.measure.statistics import Estimate, share
from rans.flight import Controller, fly
from rans.terminal import Terminal

AGENT = "agent.safetensors"
GAINS = (0.3, 0.4, 0.5, 1.0, 1.5, 2.0)
BIASES = (0.0, 0.1, 0.2, 0.25, 0.3)
"""Of the table of single axes."""
PUBLISHED = {
    "end-to-end GRU + PPO": (0.0, 0.0, 0.0, 0.0),
    "RMA student": (97.8, 94.4, 0.0, 0.0),
    "RMA + disturbance observer": (97.2, 96.8, 59.4, 0.0),
}
"""% settled by class (paper/benchmark/tables/tab_battery.tex)."""


class ThreeAxes:
    """One agent of one axis for each of three."""

    def __init__(self, agent: Agent, name: str = "by axis") -> None:
        self.name = name
        self._agent = agent
        self._memory = None

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._memory = None

    @torch.no_grad()
    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`: the turn so far is shared out by its rotation vector."""
        angle, spin = (
            torch.from_numpy(np.concatenate(x)).float()
            for x in (turns(state, goal), state.w.columns())
        )
        self._memory = (
            Memory.begin(spin) if self._memory is None else self._agent(self._memory, angle, spin)
        )
        return nozzles(self._memory.command.numpy().reshape(3, -1).T)


@dataclass(frozen=True)
class Train:
    """Train an agent of one axis into RUN/agent.safetensors."""

    run_folder: Annotated[Path, Positional, tyro.conf.arg(metavar="RUN")]
    iterations: int = 660
    """Of 1,024 new axes for 64 s each."""
    seed: int = 0

    def run(self) -> None:
        """Says how far it is."""
        agent = trained(
            self.iterations,
            self.seed,
            report=lambda done, loss: sys.stderr.write(
                f"\r{done + 1} of {self.iterations} iterations; loss {loss:.3f} "
            ),
        )
        self.run_folder.mkdir(parents=True, exist_ok=True)
        save_file(agent.state_dict(), self.run_folder / AGENT)


@dataclass(frozen=True)
class Fly:
    """Fly agents and oracles from every start with every fault of every class."""

    run_folders: Annotated[tuple[Path, ...], Positional, tyro.conf.arg(metavar="RUN")] = ()
    faults: int = 50
    seeds: int = 10
    drake: bool = False
    """Whether Drake moves, which takes an hour for all."""

    def measured(self) -> dict[str, Any]:
        """Share of settled flights by controller and class, and of single axes."""
        move = fly
        if self.drake:
            from rans.reference.flight import (
                fly_in_drake as move,
            )  # Drake is imported where it flies
        result: dict[str, dict[Class, Estimate]] = {}
        for kind in CLASSES:
            each, begun = battery(kind, self.faults, self.seeds)
            for one in self._controllers(each):
                found = settled(one, each, begun, move)
                result.setdefault(one.name, {})[kind] = share(found).scaled(100.0)
        rows = [(name, *(x.text(".1f") for x in row.values())) for name, row in result.items()]
        rows += [
            (f"{name} (published)", *map("{:.1f}".format, numbers))
            for name, numbers in PUBLISHED.items()
        ]
        Terminal().show("", ("% settled", *CLASSES), rows)
        return {
            "settled": {
                name: {kind: vars(x) for kind, x in row.items()} for name, row in result.items()
            },
            "alone": {
                str(folder): alone(saved(folder), self.faults * self.seeds)
                for folder in self.run_folders
            },
        }

    def _controllers(self, each: Faults) -> Iterator[Controller]:
        yield Oracle(sound(each), "proportional-derivative")
        yield Oracle(each, "gain oracle")
        yield Oracle(each, "gain and bias oracle", knows_bias=True)
        for folder in self.run_folders:
            yield ThreeAxes(saved(folder), str(folder))


def saved(folder: Path) -> Agent:
    """The one that was trained into a folder."""
    agent = Agent()
    agent.load_state_dict(load_file(folder / AGENT))
    return agent


def alone(agent: Agent, count: int) -> list[list[float]]:
    """% of single axes that end behind the gate, by gain and bias, from so many starts a cell.

    Of moments and starts of the benchmark's test, and either sign of both.
    """
    torch.manual_seed(0)
    gain, bias = (
        x.flatten().repeat_interleave(count)
        for x in torch.meshgrid(torch.tensor(GAINS), torch.tensor(BIASES), indexing="ij")
    )
    unit = torch.rand(3, len(gain))
    sign = 2.0 * torch.randint(2, (2, len(gain))) - 1.0
    least = 0.7 * min(MOMENTS)
    most = 2.3 * max(MOMENTS)
    axes = Axes(least + (most - least) * unit[0], sign[0] * gain, sign[1] * bias)
    angles = flown(agent, axes, 1.17 * (2.0 * unit[1] - 1.0), 0.05 * (2.0 * unit[2] - 1.0))
    behind = (angles[-DWELL:].abs() <= GATE).all(dim=0).double()
    return (100.0 * behind.view(len(GAINS), len(BIASES), count).mean(dim=2)).tolist()


def cells(evidence: Any) -> Iterator[list[str]]:
    """Rows of the table of single axes by gain and bias, of the first agent."""
    shares = next(iter(evidence["alone"].values()))
    for gain, row in zip(GAINS, shares, strict=True):
        yield [f"{gain:g}", *(f"{x:.1f}" for x in row)]


def sound(faults: Faults) -> Faults:
    """What a controller believes that knows of no fault."""
    return Faults(
        np.ones_like(faults.inertia), np.ones_like(faults.gain), np.zeros_like(faults.bias)
    )


if __name__ == "__main__":
    tyro.cli(Train).run()
