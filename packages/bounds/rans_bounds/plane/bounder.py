"""Branch and bound over attitude: certified least fuel and time in the plane.

A branch is a set of windows on the lattice, its bound the dual value of `rans_bounds.plane.dual`,
which exact dynamic programming gives. docs/bounds/certificate.md has the proofs.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rans.extend import ConfigError, Spacecraft, rounded_up
from rans_bounds import hull
from rans_bounds.cutting_planes import Ascent, Cut
from rans_bounds.plane.ascent import ascend, scale, towards_goal
from rans_bounds.plane.dual import Branch, Relaxation
from rans_bounds.plane.lattice import Lattice
from rans_bounds.plane.onoff import nozzles, replayed_within_cost
from rans_bounds.problem import (
    Found,
    Problem,
    SearchEffort,
    TooManyPoints,
    Unreachable,
)


@dataclass
class _Outcome:
    """Result for one level of fuel or time: excluded, reached by commands, or neither."""

    excluded: bool = False
    commands: np.ndarray | None = None


class _Node(NamedTuple):
    bound: float
    order: int
    branch: Branch
    costate: np.ndarray
    cuts: list[Cut]


class PlanarBounder:
    """Bounds on/off control of a planar craft by branch and bound over its lattice of attitudes.

    See `rans_bounds.certificate.Bounder`. The goal set always asks for the goal's spin.
    """

    def __init__(self, lattice: Lattice) -> None:
        self.lattice = lattice

    @property
    def craft(self) -> Spacecraft:
        """Spacecraft that the bounds are of."""
        return self.lattice.craft

    @property
    def period(self) -> float:
        """Control period, s."""
        return self.lattice.period

    def contains(self, problem: Problem) -> bool:
        """See `Bounder`."""
        return problem.goal_set.contains(problem.start, problem.goal)

    def can_stop(self, problem: Problem) -> bool:
        """See `Bounder`."""
        try:
            self.lattice.net_spins(problem.goal_set, problem.start, problem.goal)
        except ConfigError:
            return False
        return True

    def least_fuel(self, problem: Problem, steps: int, effort: SearchEffort) -> Found:
        """Certified least fuel, and commands if found; `TooManyPoints` for long times. See `Bounder`."""
        lattice = self.lattice
        open_levels = 0
        outcome = _Outcome()
        # The bounds of the hull and of the relaxation, rounded up to a fuel that whole pulses can spend.
        loose = hull.least_fuel(
            lattice.craft,
            problem.aims,
            problem.start,
            problem.goal,
            steps * lattice.period,
            problem.goal_set,
        )
        if math.isinf(loose):
            raise Unreachable.after(steps, lattice.period)
        relaxation, root = _root(lattice, problem, steps, 8.0 * lattice.grain, effort)
        lower = lattice.next_fuel(max(loose, root.best.value), relaxation.net)
        # From there on every level of fuel in turn: excluded, reached, or open within the effort. The bound rises
        # as long as no level is open; a relaxation serves until the level passes its cap.
        for level in _levels(lattice, relaxation.net, lower, lattice.most_fuel(steps)):
            if level > (relaxation.cap or 0.0):
                try:
                    relaxation, root = _root(lattice, problem, steps, level, effort)
                except TooManyPoints:
                    return Found(lower, None)
            outcome = _decide(relaxation, root, level, effort)
            open_levels += not outcome.excluded
            if outcome.commands is not None or open_levels == effort.levels:
                break
            if open_levels == 0:
                lower = lattice.fuel_above(level, relaxation.net)
        if open_levels == 0:
            raise Unreachable.after(steps, lattice.period)
        return Found(lower, outcome.commands)

    def least_time(self, problem: Problem, most_steps: int, effort: SearchEffort) -> Found:
        """See `Bounder`; the `ConfigError` is that of `Relaxation`.

        The search begins where the hull's bound ends. It gives up where a relaxation has too many points.
        """
        lattice = self.lattice
        open_levels = 0
        outcome = _Outcome()
        lower = None
        # Fewer steps than the bound of the hull are excluded without a search.
        loose = hull.least_time(
            lattice.craft, problem.aims, problem.start, problem.goal, problem.goal_set
        )
        if math.isinf(loose):
            return Found(math.inf, None)
        first = max(1, round(rounded_up(loose, lattice.period) / lattice.period))
        for steps in range(first, most_steps + 1):
            try:
                relaxation = Relaxation(
                    lattice, problem.start, problem.goal, problem.goal_set, steps, None, fuel=0.0
                )
            except TooManyPoints:
                lower = lower or steps
                break
            # A positive dual value proves that no commands arrive in so many steps.
            root = _root_ascent(relaxation, 0.0, effort)
            if root.best.value > 0:
                continue
            # Else branching decides: excluded, solved, or open within the effort.
            outcome = _decide(relaxation, root, 0.0, effort)
            if outcome.excluded:
                continue
            lower = lower or steps
            open_levels = open_levels + 1
            if outcome.commands is not None or open_levels == effort.levels:
                break
        lower = lower or max(first, most_steps + 1)
        return Found(lower * lattice.period, outcome.commands)


def planar_bounder(craft: Spacecraft, period: float) -> PlanarBounder:
    """Bounder of a planar craft whose commands are held for a period, s; for errors see `Lattice`."""
    return PlanarBounder(Lattice(craft, period))


def _root(
    lattice: Lattice, problem: Problem, steps: int, cap: float, effort: SearchEffort
) -> tuple[Relaxation, Ascent]:
    """The relaxation with a cap on fuel that its own bound does not exclude.

    A cap that is too low proves nothing, one that is too high only costs time: it grows until it is not excluded.
    """
    everything = lattice.most_fuel(steps)
    while True:
        relaxation = Relaxation(
            lattice, problem.start, problem.goal, problem.goal_set, steps, min(cap, everything)
        )
        root = _root_ascent(relaxation, cap, effort)
        if root.best.value <= cap:
            return relaxation, root
        if cap >= everything:
            raise Unreachable.after(steps, lattice.period)
        cap *= 1.5


def _levels(lattice: Lattice, net: set[int], level: float, highest: float) -> Iterator[float]:
    """Fuels to decide about, from this one on; the last is all there is, N s."""
    while level < highest:
        yield level
        level = lattice.next_fuel(level + 0.5 * lattice.grain, net)
    yield highest


def _root_ascent(relaxation: Relaxation, target: float, effort: SearchEffort) -> Ascent:
    """Lower bound before the search branches, with the weights of paths from which commands are tried first."""
    return ascend(
        relaxation,
        relaxation.reachable(),
        towards_goal(relaxation),
        [],
        target,
        0.01 * relaxation.lattice.grain,
        trust=0.5,
        iterations=60,
        work=effort.work,
    )


def _decide(relaxation: Relaxation, root: Ascent, level: float, effort: SearchEffort) -> _Outcome:
    """Exclude a level by branch and bound, best bound first, or find commands that reach it.

    Where work runs out the level stays open: the bound no longer rises, and still holds.
    """
    outcome = _Outcome()
    evaluated = set()
    order = itertools.count()
    limit = relaxation.work + effort.work
    heap = [_node(relaxation, root, relaxation.reachable(), level, next(order))]
    closed = True
    while heap and relaxation.work < limit:
        node = heapq.heappop(heap)
        # Raise the bound of the node: the more, the farther it is from the level.
        patience = max(0.01 * relaxation.lattice.grain, 0.1 * (level - node.bound))
        result = ascend(
            relaxation, node.branch, node.costate, node.cuts, level, patience, 0.1, iterations=15
        )
        if result.best.value > level:
            continue
        # Commands that reach the level end the search; else the node's paths are divided.
        outcome.commands = _commands(relaxation, result, level, effort, evaluated)
        if outcome.commands is not None:
            return outcome
        parts = _parts(
            relaxation, relaxation.shrunk(result.best.costate, node.branch, level), result
        )
        closed = closed and bool(parts)
        for part in parts:
            heapq.heappush(heap, _node(relaxation, result, part, level, next(order)))
    outcome.excluded = closed and not heap
    return outcome


def _node(
    relaxation: Relaxation, parent: Ascent, branch: Branch, level: float, order: int
) -> _Node:
    branch = relaxation.shrunk(parent.best.costate, branch, level)
    cuts = [cut for cut in parent.cuts if relaxation.inside(cut.source.path, branch)]
    return _Node(parent.best.value, order, branch, parent.best.costate / scale(relaxation), cuts)


def _commands(
    relaxation: Relaxation,
    result: Ascent,
    level: float,
    effort: SearchEffort,
    evaluated: set[bytes],
) -> np.ndarray | None:
    """Commands (T, thrusters) of the paths that weigh most, or None; adds to ``evaluated``.

    What it returns has been flown by the engine's equations; a path alone is no control.
    """
    for index in np.argsort(-result.weights)[:2]:
        path = result.cuts[index].source.path
        commands = replayed_within_cost(relaxation, path, level)
        turns = relaxation.lattice.patterns.torque[path].tobytes()
        if commands is None and turns not in evaluated:
            evaluated.add(turns)
            commands = nozzles(relaxation, path, result.best, level, effort.nozzle_work)
        if commands is not None:
            return commands
    return None


def _parts(relaxation: Relaxation, branch: Branch, result: Ascent) -> list[Branch]:
    """Two halves of a branch, so that the mixture of paths that solves its relaxation is in neither.

    Split by heading where the mixture's headings differ most, else by pattern where those do, else in
    the middle of the widest range of headings; none where one attitude is left and no mixture.
    """
    # Headings along the paths of the mixture, and where they vary.
    weights = result.weights / max(result.weights.sum(), 1e-300)
    headings = np.array([relaxation.heading_indices(cut.source.path) for cut in result.cuts])
    mean = weights @ headings
    spread = weights @ (headings - mean) ** 2
    k = int(spread.argmax())
    if spread[k] > 1e-6:
        return [branch.at_most(k, math.floor(mean[k])), branch.above(k, math.floor(mean[k]))]
    # Forces of their patterns, split across the line to the farthest one from the mean.
    paths = np.array([cut.source.path for cut in result.cuts])
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
