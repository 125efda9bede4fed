"""What no on/off controller can beat: certified least fuel and time, and controls that reach them.

Branch and bound over attitude: a branch is a set of windows on the lattice, its bound the dual value of
`rans.optimal.certificate.dual`, which exact dynamic programming gives. docs/certificate.md has the proofs.
"""

from __future__ import annotations

import heapq
import itertools
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rans.errors import ConfigError
from rans.model.dynamics import PlanarState
from rans.optimal.certificate.ascent import Ascent, Cut, ascend, scale, towards_goal
from rans.optimal.certificate.dual import Branch, Relaxation
from rans.optimal.certificate.lattice import GoalSet, Lattice
from rans.optimal.certificate.onoff import flown, fuel, nozzles

_DEFAULT_SET = GoalSet()


class Unreachable(ConfigError):
    """Proven: no on/off controller is in the goal set at that time."""


@dataclass(frozen=True)
class Effort:
    """When to stop looking; less of it gives wider gaps, never wrong bounds."""

    seconds: float = 20.0
    """Processor time for each level of fuel or number of periods."""
    nozzle_seconds: float = 1.0
    """For each attempt to find nozzles for an attitude."""
    levels: int = 4
    """Of fuel, or numbers of periods, tried above the first that could not be excluded."""

    def __post_init__(self) -> None:
        if not (self.seconds > 0 and self.nozzle_seconds > 0 and self.levels > 0):
            raise ConfigError(
                f"effort: seconds, nozzle_seconds and levels must be > 0, got {self}."
            )


_DEFAULT_EFFORT = Effort()


@dataclass(frozen=True)
class Certificate:
    """Certified bound and best control found; equal bounds prove the control optimal."""

    lower: float
    """No on/off controller at this rate does with less: N s of fuel, or s of time."""
    upper: float
    """What ``commands`` need; infinite where none were found."""
    commands: np.ndarray | None
    """(T, thrusters) zeros and ones, replayed into the goal set; None too where none are needed."""
    dual: float
    """The bound before branching and rounding up; in s for time, a multiple of the control period."""
    nodes: int
    """Branches looked at."""
    seconds: float
    """Wall time."""

    @property
    def gap(self) -> float:
        """(upper - lower) / lower."""
        if self.lower > 0:
            return self.upper / self.lower - 1.0
        return 0.0 if self.upper == 0.0 else math.inf


@dataclass
class _Outcome:
    """Of one level: excluded, reached by commands, or neither."""

    excluded: bool = False
    commands: np.ndarray | None = None
    nodes: int = 0


class _Node(NamedTuple):
    bound: float
    order: int
    branch: Branch
    costate: np.ndarray
    cuts: list[Cut]


def least_fuel(
    lattice: Lattice,
    start: PlanarState,
    goal: PlanarState,
    steps: int,
    goal_set: GoalSet = _DEFAULT_SET,
    effort: Effort = _DEFAULT_EFFORT,
) -> Certificate:
    """Least thrust-time of any on/off controller that is in the goal set after so many control periods.

    Start and goal are of floats; the start has any position, velocity and spin.

    Raises:
        Unreachable: no on/off controller can be in the goal set at that time.
        ConfigError: see `Relaxation`.
    """
    check_steps(steps)
    began = time.monotonic()
    nodes = 0
    open_levels = 0
    outcome = _Outcome()
    relaxation, root = _root(lattice, start, goal, goal_set, steps, 8.0 * lattice.grain)
    lower = lattice.next_fuel(root.best.value, relaxation.net)
    for level in _levels(lattice, relaxation.net, lower, lattice.most_fuel(steps)):
        if level > (relaxation.cap or 0.0):
            relaxation, root = _root(lattice, start, goal, goal_set, steps, level)
        outcome = _decide(relaxation, root, level, effort)
        nodes += outcome.nodes
        open_levels += not outcome.excluded
        if outcome.commands is not None or open_levels == effort.levels:
            break
        if open_levels == 0:
            lower = lattice.fuel_above(level, relaxation.net)
    if open_levels == 0:
        raise _unreachable(lattice, steps)
    found = outcome.commands
    upper = math.inf if found is None else fuel(lattice.craft, found, lattice.period)
    return Certificate(lower, upper, found, root.best.value, nodes, time.monotonic() - began)


def least_time(
    lattice: Lattice,
    start: PlanarState,
    goal: PlanarState,
    most_steps: int,
    goal_set: GoalSet = _DEFAULT_SET,
    effort: Effort = _DEFAULT_EFFORT,
) -> Certificate:
    """Least time in which any on/off controller can be in the goal set, up to so many control periods.

    Raises:
        ConfigError: see `Relaxation`.
    """
    check_steps(most_steps)
    if goal_set.contains(start, goal):
        return Certificate(0.0, 0.0, None, 0.0, 0, 0.0)
    began = time.monotonic()
    nodes = 0
    open_levels = 0
    outcome = _Outcome()
    upper = math.inf
    lower = dual = None
    for steps in range(1, most_steps + 1):
        relaxation = Relaxation(lattice, start, goal, goal_set, steps, None, fuel=0.0)
        root = _root_ascent(relaxation, 0.0)
        if root.best.value > 0:
            continue
        dual = dual or steps
        outcome = _decide(relaxation, root, 0.0, effort)
        nodes += outcome.nodes
        if outcome.excluded:
            continue
        lower = lower or steps
        open_levels = open_levels + 1
        if outcome.commands is not None:
            upper = steps * lattice.period
        if outcome.commands is not None or open_levels == effort.levels:
            break
    lower = lower or most_steps + 1
    return Certificate(
        lower * lattice.period,
        upper,
        outcome.commands,
        (dual or lower) * lattice.period,
        nodes,
        time.monotonic() - began,
    )


def check_steps(steps: int) -> None:
    """Refuse (`ConfigError`) what is no number of control periods."""
    if not isinstance(steps, int) or steps < 1:
        raise ConfigError(
            f"the certificate needs at least one control period, a whole number, got {steps}."
        )


def _root(
    lattice: Lattice,
    start: PlanarState,
    goal: PlanarState,
    goal_set: GoalSet,
    steps: int,
    cap: float,
) -> tuple[Relaxation, Ascent]:
    """The relaxation with a cap on fuel that its own bound does not exclude."""
    everything = lattice.most_fuel(steps)
    while True:
        relaxation = Relaxation(lattice, start, goal, goal_set, steps, min(cap, everything))
        root = _root_ascent(relaxation, cap)
        if root.best.value <= cap:
            return relaxation, root
        if cap >= everything:
            raise _unreachable(lattice, steps)
        cap *= 1.5


def _levels(lattice: Lattice, net: set[int], level: float, most: float) -> Iterator[float]:
    """Fuels to decide about, from this one on; the last is all there is, N s."""
    while level < most:
        yield level
        level = lattice.next_fuel(level + 0.5 * lattice.grain, net)
    yield most


def _unreachable(lattice: Lattice, steps: int) -> Unreachable:
    return Unreachable(
        f"no on/off controller can reach the goal set in {steps} control periods of "
        f"{lattice.period:g} s; the usual cause is too short a time."
    )


def _root_ascent(relaxation: Relaxation, target: float) -> Ascent:
    return ascend(
        relaxation,
        relaxation.reachable(),
        towards_goal(relaxation),
        [],
        target,
        0.01 * relaxation.lattice.grain,
        trust=0.5,
        most=60,
    )


def _decide(relaxation: Relaxation, root: Ascent, level: float, effort: Effort) -> _Outcome:
    """Exclude a level by branch and bound, best bound first, or find commands that reach it."""
    outcome = _Outcome()
    seen = set()
    order = itertools.count()
    deadline = time.process_time() + effort.seconds
    heap = [_node(relaxation, root, relaxation.reachable(), level, next(order))]
    closed = True
    while heap and time.process_time() < deadline:
        node = heapq.heappop(heap)
        outcome.nodes += 1
        patience = max(0.01 * relaxation.lattice.grain, 0.1 * (level - node.bound))
        found = ascend(
            relaxation, node.branch, node.costate, node.cuts, level, patience, 0.1, most=15
        )
        if found.best.value > level:
            continue
        outcome.commands = _commands(relaxation, found, level, effort, seen)
        if outcome.commands is not None:
            return outcome
        parts = _parts(relaxation, relaxation.shrunk(found.best.costate, node.branch, level), found)
        closed = closed and bool(parts)
        for part in parts:
            heapq.heappush(heap, _node(relaxation, found, part, level, next(order)))
    outcome.excluded = closed and not heap
    return outcome


def _node(
    relaxation: Relaxation, parent: Ascent, branch: Branch, level: float, order: int
) -> _Node:
    branch = relaxation.shrunk(parent.best.costate, branch, level)
    cuts = [cut for cut in parent.cuts if relaxation.inside(cut.path, branch)]
    return _Node(parent.best.value, order, branch, parent.best.costate / scale(relaxation), cuts)


def _commands(
    relaxation: Relaxation, found: Ascent, level: float, effort: Effort, seen: set[bytes]
) -> np.ndarray | None:
    """Try the paths that weigh most in the relaxation's mixture, then other nozzles for them."""
    for index in np.argsort(-found.weights)[:2]:
        path = found.cuts[index].path
        commands = flown(relaxation, path, level)
        turns = relaxation.lattice.patterns.torque[path].tobytes()
        if commands is None and turns not in seen:
            seen.add(turns)
            commands = nozzles(relaxation, path, found.best, level, effort.nozzle_seconds)
        if commands is not None:
            return commands
    return None


def _parts(relaxation: Relaxation, branch: Branch, found: Ascent) -> list[Branch]:
    """Two halves of a branch, so that the mixture of paths that solves its relaxation is in neither.

    Split by heading where the mixture's headings differ most, else by pattern where those do, else in
    the middle of the widest range of headings; none where one attitude is left and no mixture.
    """
    weights = found.weights / max(found.weights.sum(), 1e-300)
    headings = np.array([relaxation.heading_indices(cut.path) for cut in found.cuts])
    mean = weights @ headings
    spread = weights @ (headings - mean) ** 2
    k = int(spread.argmax())
    if spread[k] > 1e-6:
        return [branch.at_most(k, math.floor(mean[k])), branch.above(k, math.floor(mean[k]))]
    paths = np.array([cut.path for cut in found.cuts])
    force = relaxation.lattice.patterns.force
    mean = weights @ force[paths]
    spread = weights @ np.abs(force[paths] - mean) ** 2
    k = int(spread.argmax())
    if spread[k] > 1e-6:
        farthest = force[paths[:, k]][np.argmax(weights * np.abs(force[paths[:, k]] - mean[k]))]
        side = ((force - mean[k]) * np.conj(farthest - mean[k])).real > 0
        return [branch.using(k, side), branch.using(k, ~side)]
    lowest, highest = branch.range()
    k = int((highest - lowest).argmax())
    middle = int(lowest[k] + highest[k]) // 2
    return [branch.at_most(k, middle), branch.above(k, middle)] if lowest[k] < highest[k] else []
