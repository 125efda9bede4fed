"""RAFT's protocol of thruster faults: up to four of a platform degraded, dead or stuck, and 5 cm held for 5 s.

The protocol is that of snt-spacer/RAFT (2026): k = 0 to 4 of eight thrusters fail, each degraded to a share
U(0, 1), dead, or stuck open by a share U(0.1, 1), with odds 0.33, 0.33 and 0.34; from the start on or after step
100; a flight succeeds if it stays within 5 cm of its goal's position for 50 consecutive steps at 10 Hz. Its figures
are published as pictures only. Here episodes are split by what is possible: a set of faults is recoverable if what
is left of the thrusters, and the wheel, can hold the craft still and push and turn it every way from there.

Contestants fly the platform and the rate that they are made for; the dwell is 5 s for all. Those that go to a pose
hold its heading too, which is not judged.

``python -m benchmarks.raft --output raft.json`` flies them all, as RAFT 512 episodes of each cell and seed, and
prints the table; ``--quick`` flies 32.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rans.episode import Setup, World
from rans.errors import ConfigError
from rans.evaluation.fly.contestants import contestant
from rans.files import write_json
from rans.flight import Flight, fly
from rans.model.body import Body
from rans.model.spacecraft import Spacecraft, wrenches_either_way
from rans.scenario import scenarios
from rans.terminal import Terminal, table

MODES = ("degraded", "dead", "stuck")
ODDS = (0.33, 0.33, 0.34)
TOLERANCE = 0.05
"""m from the goal."""
DWELL = 5.0
"""s for which it is held: 50 steps at 10 Hz."""
INJECTED = 10.0
"""s after which faults begin that come in flight: 100 steps at 10 Hz."""
SECONDS = 40.0
"""s of a flight."""
SEEDS = (42, 1337, 7)
"""Seeds of starts and faults that RAFT reports."""
CONTESTANTS = {
    "plain PPO, shared supply": "pretrained:go-to-position-2d-shared",
    "plain PPO, shared supply and wheel": "pretrained:go-to-pose-2d-roboran-platform",
    "plain PPO": "pretrained:go-to-pose-2d",
    "history": "pretrained:go-to-pose-2d-faults",
    "filters": "pretrained:go-to-pose-2d-robust",
    "LQR": "lqr:go-to-pose-2d@floating-platform",
    "switching": "switching:go-to-pose-2d@floating-platform",
}
"""Who flies, by what tables call it."""
SEVERITIES = (0.0, 0.2, 0.4, 0.6, 0.8)
"""Shares to which two thrusters are degraded in a sweep."""
_MARGIN = 1e-6


@dataclass(frozen=True)
class Faults:
    """Gain and leak of N craft's thrusters, each (N, thrusters), see `rans.model.body.Body`."""

    gain: np.ndarray
    leak: np.ndarray


def drawn(count: int, thrusters: int, failed: int, random: np.random.Generator) -> Faults:
    """Faults of so many thrusters of each of N craft, each in a way of its own."""
    gain = np.ones((count, thrusters))
    leak = np.zeros((count, thrusters))
    for row in range(count):
        for index in random.permutation(thrusters)[:failed]:
            mode = random.choice(MODES, p=ODDS)
            gain[row, index] = random.uniform(0.0, 1.0) if mode == "degraded" else 0.0
            leak[row, index] = random.uniform(0.1, 1.0) if mode == "stuck" else 0.0
    return Faults(gain, leak)


def degraded(
    count: int, thrusters: int, failed: int, left: float, random: np.random.Generator
) -> Faults:
    """So many thrusters of each craft that give this share of their force."""
    gain = np.ones((count, thrusters))
    for row in range(count):
        gain[row, random.permutation(thrusters)[:failed]] = left
    return Faults(gain, np.zeros((count, thrusters)))


def recoverable(craft: Spacecraft, faults: Faults) -> np.ndarray:
    """(N,) whether the craft can still push and turn every way.

    As `rans.randomization.faults.margin`, for thrusters that fail in different ways: the wrenches that are left
    have full rank, and some shares strictly between shut and open balance what is stuck.
    """
    from scipy.optimize import linprog

    table = wrenches_either_way(craft).T
    scale = np.linalg.norm(table, axis=0)
    thrusters = len(craft.thrusters)
    found = np.zeros(len(faults.gain), dtype=bool)
    for row, (gain, leak) in enumerate(zip(faults.gain, faults.leak, strict=True)):
        left = np.append(gain, np.ones(len(table) - thrusters))
        sound = ((table * left[:, None])[left > 0.0] / scale).T
        stuck = leak @ (table[:thrusters] / scale)
        if np.linalg.matrix_rank(sound, tol=1e-9) < craft.degrees_of_freedom:
            continue
        # The largest m with m <= u <= 1 - m and stuck + sound u = 0.
        count = sound.shape[1]
        rows = np.vstack(
            [
                np.column_stack([-np.eye(count), np.ones(count)]),
                np.column_stack([np.eye(count), np.ones(count)]),
            ]
        )
        best = linprog(
            np.append(np.zeros(count), -1.0),
            A_ub=rows,
            b_ub=np.append(np.zeros(count), np.ones(count)),
            A_eq=np.column_stack([sound, np.zeros(len(sound))]),
            b_eq=-stuck,
            bounds=[(None, None)] * count + [(None, 0.5)],
        )
        found[row] = best.success and -best.fun > _MARGIN
    return found


def succeeded(distance: np.ndarray, period: float) -> np.ndarray:
    """(N,) whether distances (T, N), m, seen once a period (s), stay within the tolerance for the dwell."""
    needed = round(DWELL / period)
    within = distance <= TOLERANCE
    run = np.zeros(within.shape[1], dtype=int)
    longest = run.copy()
    for row in within:
        run = np.where(row, run + 1, 0)
        longest = np.maximum(longest, run)
    return longest >= needed


def flown(spec: str, faults: Faults, seed: int, after: float) -> tuple[Flight, float]:
    """Flights with these faults from a time on, s, and their control period."""
    run = contestant(spec)
    timing = replace(run.timing, episode_steps=round(SECONDS / run.timing.control_period))
    task = run.task.for_evaluation()
    body = Body.of(run.craft)
    broken = replace(body, gain=tuple(faults.gain.T), leak=tuple(faults.leak.T))
    starts = scenarios(task, run.craft, seed, len(faults.gain))
    if after == 0.0:
        return fly(
            run.craft, task, run.controller, starts, timing, body=broken
        ), timing.control_period
    world = World(Setup(run.craft, task, timing))
    begins = round(after / timing.control_period)
    steps = iter(range(timing.episode_steps))

    def move(state: Any, inputs: Any) -> tuple[Any, ...]:
        now = broken if next(steps) >= begins else body
        return world.move(state, replace(inputs, body=now))

    found = fly(run.craft, task, run.controller, starts, timing, move=move)
    return found, timing.control_period


@dataclass(frozen=True)
class Raft:
    """Fly RAFT's protocol."""

    episodes: int = 512
    """Episodes flown for each number of failed thrusters and each seed."""
    seeds: tuple[int, ...] = SEEDS[:1]
    """Seeds from which starts and faults are drawn."""
    only: tuple[str, ...] = ()
    """Names of the contestants to fly, keys of `CONTESTANTS`; by default all."""
    quick: bool = False
    """32 episodes a cell."""
    output: Path | None = None
    """Write the counts here, as JSON."""

    def run(self) -> int:
        """Fly, print the table, and write the counts if asked for."""
        episodes = 32 if self.quick else self.episodes
        found = {"episodes": episodes, "seeds": list(self.seeds), "cells": {}}
        console = Terminal()
        for name in self.only or CONTESTANTS:
            if name not in CONTESTANTS:
                raise ConfigError(f"contestants are {', '.join(CONTESTANTS)}, got {name!r}.")
            spec = CONTESTANTS[name]
            found["cells"][name] = {cell: counts for cell, counts in self._cells(spec, episodes)}
            console.say(f"{name}: flown")
        console.print(table("RAFT's protocol: held, %", _HEADINGS, _rows(found)))
        if self.output is not None:
            write_json(self.output, found)
        return 0

    def _cells(self, spec: str, episodes: int) -> Iterator[tuple[str, list[int]]]:
        """Counts of flights of one contestant, for every cell of the table.

        A cell has four numbers: recoverable flights that held, recoverable flights, other flights that held, and
        other flights.
        """
        craft = contestant(spec).craft
        count = len(craft.thrusters)
        for failed in range(5):
            for moment, after in (("start", 0.0), ("flight", INJECTED)):
                if failed == 0 and after > 0.0:
                    continue
                draws = [
                    (seed, drawn(episodes, count, failed, np.random.default_rng([seed, failed])))
                    for seed in self.seeds
                ]
                yield f"{failed} {moment}", _counts(spec, craft, draws, after)
        for left in SEVERITIES:
            draws = [
                (seed, degraded(episodes, count, 2, left, np.random.default_rng([seed, 9])))
                for seed in self.seeds
            ]
            yield f"2 at {left:g}", _counts(spec, craft, draws, 0.0)


def _counts(
    spec: str, craft: Spacecraft, draws: Sequence[tuple[int, Faults]], after: float
) -> list[int]:
    total = np.zeros(4, dtype=int)
    for seed, faults in draws:
        flight, period = flown(spec, faults, seed, after)
        begins = round(after / period)
        held = succeeded(np.asarray(flight.errors()["position"])[begins:], period)
        able = recoverable(craft, faults)
        total += [(held & able).sum(), able.sum(), (held & ~able).sum(), (~able).sum()]
    return [int(x) for x in total]


_FAILED = [
    f"{k} {moment}" for k in range(5) for moment in ("start", "flight") if k or moment == "start"
]
_HEADINGS = (
    "contestant",
    *(
        "none"
        if cell == "0 start"
        else cell.replace(" ", ", from the ", 1)
        if cell.endswith("start")
        else cell.replace(" flight", ", in flight")
        for cell in _FAILED
    ),
    *(f"2 at {left:g}" for left in SEVERITIES),
)


def _rows(found: dict[str, Any]) -> list[tuple[str, ...]]:
    """Share of recoverable episodes that hold, and in brackets of the others."""
    rows = []
    for name, cells in found["cells"].items():
        texts = []
        for held, able, lucky, unable in cells.values():
            text = "–" if able == 0 else f"{100.0 * held / able:.1f}"  # noqa: RUF001
            texts.append(text + (f" ({100.0 * lucky / unable:.0f})" if unable else ""))
        rows.append((name, *texts))
    return rows


def main(arguments: list[str] | None = None) -> int:
    """Parse and run."""
    import tyro

    return tyro.cli(Raft, args=arguments).run()


if __name__ == "__main__":
    from validation.command import ended

    raise SystemExit(ended("python -m benchmarks.raft", main))
