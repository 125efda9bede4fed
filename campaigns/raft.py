"""RAFT's protocol of thruster faults: up to four of a platform degraded, dead or stuck, and 5 cm held for 5 s.

The protocol is that of snt-spacer/RAFT (2026): k = 0 to 4 of eight thrusters fail, each degraded to a share
U(0, 1), dead, or stuck open by a share U(0.1, 1), with odds 0.33, 0.33 and 0.34; from the start on or after step
100; a flight succeeds if it stays within 5 cm of its goal's position for 50 consecutive steps at 10 Hz. The
platform shares one newton among its open thrusters, and may have a reaction wheel. RAFT's figures are published as
pictures only. Here episodes are split by what is possible (`possible`).

``rans train campaigns/raft_recipes/filters.toml --output runs/raft/filters`` trains a contestant, and so do the
other recipes; agents whose name ends in -wheel need ``--spacecraft roboran-platform`` too. Then
``python -m campaigns RAFT`` flies all, 512 episodes of each cell and of ten seeds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from campaigns.raft_oracle import Oracle, balanced_reach, effects
from rans.episode import Setup, World
from rans.errors import ConfigError
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.measure.statistics import share
from rans.files import environment
from rans.flight import Controller, Flight, fly
from rans.model.body import Body
from rans.model.spacecraft import Spacecraft, controls_every_direction
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.processes import Workers, nothing
from rans.randomization.faults import margin_left
from rans.scenario import Scenario, scenarios
from rans.tasks import GoToPosition

MODES = ("degraded", "dead", "stuck")
ODDS = (0.33, 0.33, 0.34)
TOLERANCE = 0.05
"""m from the goal."""
DWELL = 5.0
"""s for which it is held: 50 steps at 10 Hz."""
INJECTED = 10.0
"""s after which faults begin that come in flight: 100 steps at 10 Hz."""
TIMING = Timing(control_period=0.1, substeps=1, episode_steps=400)
"""10 Hz, 40 s."""
TASK = GoToPosition().for_evaluation()
"""From 3 to 4 m away, at rest; an episode fails 8 m away from its goal."""
SEEDS = (42, 1337, 7, 101, 102, 103, 104, 105, 106, 107)
"""Seeds of starts and faults: the three that RAFT reports, and seven others."""
SEVERITIES = (0.0, 0.2, 0.4, 0.6, 0.8)
"""Shares to which two thrusters are degraded in a sweep."""
PLATFORM = "floating-platform-shared"
WHEELED = "roboran-platform"
_MARGIN = 1e-6

Class = Literal["still", "spinning", "neither"]


class Contestant(NamedTuple):
    """Who flies."""

    name: str
    """By which tables call it."""
    spacecraft: str
    """What it flies."""
    spec: str
    """Folder of a trained agent below `Raft.agents`, name of a controller, or "oracle..."."""
    most: int | None = None
    """Episodes of each cell, of the first seed, of who takes long; None: all episodes of all seeds."""


CONTESTANTS = (
    Contestant("PPO, no memory", PLATFORM, "plain"),
    Contestant("PPO, history", PLATFORM, "history"),
    Contestant("PPO, history and filters", PLATFORM, "both"),
    Contestant("PPO, filters", PLATFORM, "filters"),
    Contestant("oracle", PLATFORM, "oracle"),
    Contestant("LQR", PLATFORM, "lqr"),
    Contestant("switching", PLATFORM, "switching"),
    Contestant("MPC (16 episodes a cell)", PLATFORM, "mpc", 16),
    Contestant("PPO, no memory", WHEELED, "plain-wheel"),
    Contestant("PPO, recurrent", WHEELED, "recurrent-wheel"),
    Contestant("PPO, history", WHEELED, "history-wheel"),
    Contestant("oracle", WHEELED, "oracle-wheel"),
)


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
    """(N,) whether the craft can still push and turn every way, see `rans.randomization.faults.margin_left`."""
    # Weak thrusters push the same ways as sound ones.
    found = (faults.gain > 0.0).all(axis=1) & (faults.leak == 0.0).all(axis=1)
    found &= controls_every_direction(craft)
    for row in np.flatnonzero(~found):
        found[row] = margin_left(craft, faults.gain[row], faults.leak[row]) > _MARGIN
    return found


def possible(craft: Spacecraft, faults: Faults) -> np.ndarray:
    """(N,) what the craft can still do, a `Class`.

    "still": it can push and turn every way from rest, see `recoverable`. "spinning": it cannot, but it can be
    turned either way, and pushed differently while its spin stays as it is. A steady force that spins with the
    body is zero on average, so that such a craft can hold a position, and no heading. "neither": the rest.
    """
    wheel = abs(craft.wheel_map[0][0]) / craft.inertia[2][2] if craft.wheels else 0.0
    still = recoverable(craft, faults)
    found = np.where(still, "still", "neither").astype("U8")
    for row in np.flatnonzero(~still):
        effect = effects(craft, faults.gain[[row]], faults.leak[[row]])[0]
        turns = effect[:, 2].min() - wheel < -_MARGIN and effect[:, 2].max() + wheel > _MARGIN
        reach = balanced_reach(effect, wheel)
        width = reach + np.roll(reach, len(reach) // 2)
        if turns and width.max() > _MARGIN:
            found[row] = "spinning"
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


def flown(
    craft: Spacecraft, controller: Controller, starts: Scenario, faults: Faults, after: float
) -> Flight:
    """Flights from these starts with these faults from a time on, s."""
    body = Body.of(craft)
    broken = replace(body, gain=tuple(faults.gain.T), leak=tuple(faults.leak.T))
    if after == 0.0:
        return fly(craft, TASK, controller, starts, TIMING, body=broken)
    world = World(Setup(craft, TASK, TIMING))
    begins = round(after / TIMING.control_period)
    steps = iter(range(TIMING.episode_steps))

    def move(state: Any, inputs: Any) -> tuple[Any, ...]:
        now = broken if next(steps) >= begins else body
        return world.move(state, replace(inputs, body=now))

    return fly(craft, TASK, controller, starts, TIMING, move=move)


def ready(who: Contestant, agents: Path, faults: Faults, after: float) -> Controller:
    """The contestant, to fly craft with these faults from a time on, s.

    Raises:
        ConfigError: an agent has not been trained.
    """
    craft = load_spacecraft(who.spacecraft)
    if who.spec.startswith("oracle"):
        begins = round(after / TIMING.control_period)
        return Oracle(craft, faults.gain, faults.leak, begins)
    if who.spec in ("lqr", "switching", "mpc"):
        setup = Setup(craft, TASK, TIMING)
        return contestant(who.spec, default_setup=setup).controller
    folder = agents / who.spec
    if not folder.exists():
        raise ConfigError(
            f"there is no agent {folder}: train it with rans train campaigns/raft_recipes/"
            f"{who.spec.removesuffix('-wheel')}.toml --spacecraft {who.spacecraft} --output {folder}."
        )
    return contestant(str(folder)).controller


class Cell(NamedTuple):
    """Episodes of one seed in a row of the table."""

    name: str
    """By which the row is called."""
    seed: int
    """Seed of the starts."""
    faults: Faults
    after: float
    """s after which the faults begin."""


def cells(episodes: int, seeds: tuple[int, ...]) -> list[Cell]:
    """Every number of failed thrusters from the start on and in flight, and a sweep of two weak thrusters.

    The sweep has a quarter of the episodes, of the first seed.
    """
    found = []
    for failed in range(5):
        draws = [
            drawn(episodes, 8, failed, np.random.default_rng([seed, failed])) for seed in seeds
        ]
        pairs = list(zip(seeds, draws, strict=True))
        found += [Cell(f"{failed} start", seed, faults, 0.0) for seed, faults in pairs]
        if failed:
            found += [Cell(f"{failed} flight", seed, faults, INJECTED) for seed, faults in pairs]
    first = seeds[0]
    some = max(1, episodes // 4)
    for left in SEVERITIES:
        faults = degraded(some, 8, 2, left, np.random.default_rng([first, 9]))
        found.append(Cell(f"2 at {left:g}", first, faults, 0.0))
    return found


def _classes(spacecraft: str, every: list[Cell], workers: Workers[None]) -> list[np.ndarray]:
    """What is possible in the episodes of every cell; the same faults at another time are as possible."""
    different = list({id(cell.faults): cell.faults for cell in every}.values())
    craft = load_spacecraft(spacecraft)
    found = workers.ordered(_possible, [(craft, faults) for faults in different])
    known = {id(faults): able for faults, able in zip(different, found, strict=True)}
    return [known[id(cell.faults)] for cell in every]


def _possible(_: None, craft: Spacecraft, faults: Faults) -> np.ndarray:
    return possible(craft, faults)


def counts(
    _: None, who: Contestant, agents: Path, cell: Cell, able: np.ndarray
) -> dict[Class, list[int]]:
    """Count the episodes of each class: held, not held but within 8 m of the goal, and all."""
    craft = load_spacecraft(who.spacecraft)
    starts = scenarios(TASK, craft, cell.seed, len(able))
    controller = ready(who, agents, cell.faults, cell.after)
    flight = flown(craft, controller, starts, cell.faults, cell.after)
    distance = np.asarray(flight.errors()["position"])
    begins = round(cell.after / TIMING.control_period)
    held = succeeded(distance[begins:], TIMING.control_period)
    near = ~(np.nan_to_num(distance, nan=np.inf).max(axis=0) > TASK.fail_distance)
    return {
        one: [
            int(x.sum()) for x in (held & (able == one), ~held & near & (able == one), able == one)
        ]
        for one in get_args(Class)
    }


@dataclass(frozen=True)
class Raft:
    """Fly RAFT's protocol."""

    episodes: int = 512
    """Episodes flown for each cell and seed."""
    seeds: tuple[int, ...] = SEEDS
    """Seeds from which starts and faults are drawn."""
    agents: Path = Path("runs/raft")
    """Folder of the run folders of trained agents."""
    only: tuple[str, ...] = ()
    """What contestants fly, see `Contestant.spec`; by default all. Others keep their figures."""
    workers: int | None = None
    """Number of processes that fly; by default one per processor."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """Counts of every cell of each contestant."""
        flying = [who for who in CONTESTANTS if not self.only or who.spec in self.only]
        workers = Workers(nothing, count=self.workers, work="flew episodes")
        flown_cells: dict[int | None, list[Cell]] = {}
        classes: dict[tuple[str, int | None], list[np.ndarray]] = {}
        for who in flying:
            every = flown_cells.setdefault(who.most, self._cells(who.most))
            if (who.spacecraft, who.most) not in classes:
                classes[who.spacecraft, who.most] = _classes(who.spacecraft, every, workers)
        jobs = [
            (who, self.agents, cell, able)
            for who in flying
            for cell, able in zip(
                flown_cells[who.most], classes[who.spacecraft, who.most], strict=True
            )
        ]
        results = workers.ordered(counts, jobs)
        for who in flying:
            row: dict[str, Any] = {}
            for cell in flown_cells[who.most]:
                row[cell.name] = _added(row.get(cell.name), next(results))
            yield {
                "spacecraft": who.spacecraft,
                "who": who.name,
                "environment": environment(),
                "cells": row,
            }

    def _cells(self, most: int | None) -> list[Cell]:
        """What a contestant flies that flies at most so many episodes of a cell."""
        if most is None:
            return cells(self.episodes, self.seeds)
        return cells(min(most, self.episodes), self.seeds[:1])


def _added(
    before: dict[Class, list[int]] | None, more: dict[Class, list[int]]
) -> dict[Class, list[int]]:
    """Counts of the same cell of all seeds so far."""
    if before is None:
        return more
    return {name: np.add(before[name], more[name]).tolist() for name in more}


_CELLS = [
    f"{k} {moment}" for k in range(5) for moment in ("start", "flight") if k or moment == "start"
]
_LINES = (
    "none",
    *(name.replace(" start", ", start").replace(" flight", ", flight") for name in _CELLS[1:]),
    *(f"2 at {left:g}" for left in SEVERITIES),
    "recoverable",
    "at least",
    "others held",
    "others near",
)


def rows(found: Any, spacecraft: str) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Headings, which are the contestants of a spacecraft, and a row of each cell and of each summary.

    A cell has the share of recoverable episodes that are held. The summaries are this share of all cells before
    the sweep, the lower end of its 95 % interval, and of all other episodes the shares held, and held or near.
    """
    columns: list[tuple[str, ...]] = [("faults", *_LINES)]
    for one in found["rows"]:
        if one["spacecraft"] != spacecraft:
            continue
        who, by_cell = one["who"], one["cells"]
        texts = [_share(*by_cell[cell]["still"][::2]) for cell in by_cell]
        failed = [by_cell[cell] for cell in _CELLS]
        total = np.sum([cell["still"] for cell in failed], axis=0)
        others = np.sum([np.add(cell["spinning"], cell["neither"]) for cell in failed], axis=0)
        low = share(np.arange(total[2]) < total[0]).low
        all_of_them = _share(total[0], total[2])
        near = _share(others[0] + others[1], others[2])
        columns.append(
            (who, *texts, all_of_them, f"{100.0 * low:.2f}", _share(others[0], others[2]), near)
        )
    headings, *lines = zip(*columns, strict=True)
    return headings, lines


def _share(part: int, whole: int) -> str:
    return "–" if whole == 0 else f"{100.0 * part / whole:.1f}"  # noqa: RUF001
