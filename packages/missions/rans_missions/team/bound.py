"""Least impulse of a team's inspection: a proven lower bound from who sees what, by when, and who must stay."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from rans.extend import Spacecraft, SpatialState, Timing
from rans_missions.convex.inspection import (
    between_checks,
    most_gained,
    point_prices,
    sunlit,
    thruster_pushes,
)
from rans_missions.orbits.linear import carried, transition
from rans_missions.team.task import InspectTeam
from rans_missions.vectors import motion_of

_EVERY = 8
"""Checks of which one has a constraint of the zone, and on which proofs for points too are evaluated."""
_SHORTEST = 4
"""Checks of an interval at least."""
_LONGER = 16
"""Times that an interval fits into the time since enough points have been in light, where it is longer."""
_HORIZON = 1.5
"""Least bound of all later ends, over the best one without proofs for points too, at which these are left."""
_PARTS = (0.1, 0.25, 0.4, 0.55, 0.7)
"""Parts of a point in a proof for a point and a stay together."""
_CUTS = 8
"""Programs of one stay, each with the constraints that the flight of the last one breaks, at most."""


def team_bound(
    craft: Spacecraft,
    task: InspectTeam,
    starts: Sequence[SpatialState],
    goal: SpatialState,
    within: float,
    timing: Timing,
) -> float:
    """Lower bound of the impulse of all deputies together in any inspection that succeeds, N s.

    A success is at some check, in one interval of time. Deputy d has then spent at least its price c of each point
    that it has seen (`inspection_bound`), by the end of the interval, and at least the impulse s that keeps it in
    the zone until its beginning; c is that of both together. If it has spent I, it has seen no point dearer than I.
    So the team spends at least the smallest sum of numbers I_d >= s_d for which enough points have c_dk <= I_d for
    some d, and at least the smallest of these sums over all intervals after enough points have been in light.

    It holds for every control law. It leaves out the keep-out ball, the distances between deputies, limits of the
    thrust, and that a deputy sees several points in one flight.

    Args:
        craft: as in `inspection_bound`.
        task: the inspection.
        starts: states of the deputies, of numbers.
        goal: goal of the same episode, with the angle of the sun at the start in its notes.
        within: time within which it must succeed, s.
        timing: control period and checks.
    """
    prices = np.stack([point_prices(craft, task, start, goal, within, timing) for start in starts])
    asked = task.points - max(math.ceil(task.unseen_tolerance * task.points - 1e-9) - 1, 0)
    enough = np.isfinite(prices[0]).sum(axis=1) >= asked
    if not enough.any():
        return math.inf
    stays = [_Stay(craft, task, start, goal, within, timing) for start in starts]
    # A success after the check `begin`, at the check `end` at the latest.
    last = len(enough) - 1
    first = end = max(int(enough.argmax()) - 1, 0)
    best = bound = math.inf
    intervals = []
    while end < last:
        begin, end = end, min(end + max(_SHORTEST, (end - first) // _LONGER), last)
        proofs = [stay.proof(begin) for stay in stays]
        least = [proof.price for proof in proofs]
        # Later, stays cost no less and points no less than at the end.
        horizon = _HORIZON * best
        later = _divided(prices[:, last], least, asked, horizon)
        if later >= horizon:
            bound = later
            break
        alone = _divided(prices[:, end], least, asked, horizon)
        best = min(best, alone)
        intervals.append((alone, end, proofs))
    for alone, end, proofs in sorted(intervals, key=lambda interval: interval[0]):
        if alone >= bound:
            break
        least = [proof.price for proof in proofs]
        both = [
            stay.with_points(proof, row, end, min(bound, _HORIZON * alone))
            for stay, proof, row in zip(stays, proofs, prices[:, end], strict=True)
        ]
        bound = min(bound, _divided(np.stack(both), least, asked, bound))
    return bound


def _divided(prices: np.ndarray, least: Sequence[float], asked: int, best: float) -> float:
    """Smallest sum of budgets, each at least its own, that pay for enough points; at most ``best``.

    The last deputy pays for what the others leave, so that only their budgets are tried: `least` and prices of
    points.

    Args:
        prices: (D, points) N s.
        least: least budget of each deputy, N s.
        asked: number of points to be paid for.
        best: sum beyond which nothing is of interest, N s.
    """
    spare = prices.shape[1] - asked
    tried = [np.union1d(row[row > x], x) for row, x in zip(prices[:-1], least[:-1], strict=True)]
    for budgets in itertools.product(*tried):
        others = float(sum(budgets))
        if others + least[-1] >= best:
            continue
        left = (prices[:-1] > np.reshape(budgets, (-1, 1))).all(axis=0)
        dear = np.sort(prices[-1, left])[::-1]
        needed = dear[spare] if len(dear) > spare else 0.0
        best = min(best, others + max(float(needed), least[-1]))
    return best


class _Proof(NamedTuple):
    """Proof that a stay costs a price: multipliers, scaled so that 1 N s moves their sum by 1 at most."""

    price: float
    """Bound, N s."""
    push: np.ndarray
    """What 1 m/s along each axis of W adds to the sum at each check, (T, 3)."""
    between: float
    """What 1 N s adds at most between checks beyond what it adds at them."""


class _Stay:
    """Least impulse with which a deputy is in the zone at the checks until a time.

    Linear programs over burns and tangents of the zone find multipliers l_j of constraints d_j . p(t_j) <= far.
    Their proof needs no program: an impulse of 1 N s at a time s lowers the sum of l_j d_j . p(t_j) by at most
    e(s), so that the flight costs at least (sum of l_j (d_j . p_free(t_j) - far)) / max e. A point that is to be
    seen at a check too is one more constraint of the sum, with any multiplier.
    """

    def __init__(
        self,
        craft: Spacecraft,
        task: InspectTeam,
        start: SpatialState,
        goal: SpatialState,
        within: float,
        timing: Timing,
    ) -> None:
        self._craft, self._pushes = craft, thruster_pushes(craft, start)
        self._far = task.fail_distance
        step = timing.control_period / timing.checks
        times = step * np.arange(math.floor(within / step + 1e-9) + 1)
        self._free = carried(task.drift, motion_of(start), times)[:, :3]
        self._response = transition(task.drift, times)[:, :3, 3:]
        self._between = between_checks(task, step) / craft.mass
        self._normals = np.array(task.normals)
        self._missing = task.surface_distance - self._free @ self._normals.T
        self._lit = sunlit(task, goal.notes.sun, times)

    def proof(self, last: int) -> _Proof:
        """Certified lower bound until the check number ``last``."""
        free = self._free[: last + 1]
        checks = np.arange(last % _EVERY, last + 1, _EVERY)
        since = checks[:, None] - np.arange(0, last + 1, _EVERY)
        effect = self._response[np.maximum(since, 0)] * (since > 0)[..., None, None]
        effect = effect.transpose(0, 2, 1, 3).reshape(len(checks), 3, -1)
        burns = np.zeros(effect.shape[2])
        directions, when = np.zeros((0, 3)), np.zeros(0, int)
        best = _Proof(0.0, np.zeros((1, 3)), 0.0)
        for _ in range(_CUTS):
            p = free[checks] + effect @ burns
            distance = np.linalg.norm(p, axis=1)
            out = distance > self._far + 0.5
            if not out.any():
                break
            directions = np.concatenate([directions, p[out] / distance[out, None]])
            when = np.concatenate([when, np.flatnonzero(out)])
            rows = np.einsum("ci,cik->ck", directions, effect[when])
            missing = np.einsum("ci,ci->c", directions, free[checks[when]]) - self._far
            program = linprog(
                np.ones(2 * len(burns)), np.hstack([rows, -rows]), -missing, method="highs"
            )
            if program.status != 0:
                break
            burns = program.x[: len(burns)] - program.x[len(burns) :]
            multipliers = np.maximum(-program.ineqlin.marginals, 0.0)
            # Any multipliers that are not negative have a proof.
            push = np.zeros((last + 1, 3))
            for weight, direction, check in zip(multipliers, directions, checks[when], strict=True):
                push[: check + 1] -= weight * (direction @ self._response[check::-1])
            between = self._between * multipliers.sum()
            most = most_gained(self._craft, self._pushes, push).max() + between
            price = float(multipliers @ missing / most) if most > 0.0 else 0.0
            if price > best.price:
                best = _Proof(price, push / most, between / most)
        return best

    def with_points(
        self, proof: _Proof, prices: np.ndarray, end: int, ceiling: float
    ) -> np.ndarray:
        """Certified lower bounds of the stay with each point by the check ``end``, (points,) N s.

        Args:
            proof: of the stay.
            prices: of the points alone, (points,) N s.
            end: number of the check.
            ceiling: bounds beyond which nothing is of interest, N s.
        """
        result = prices.copy()
        if proof.price == 0.0:
            return result
        # Pushes at some checks, among them all at which the sum has a kink: those of the proof, and of the point.
        stay = np.zeros((end + 1, 3))
        stay[: len(proof.push)] = proof.push
        at = np.union1d(0, np.arange((len(proof.push) - 1) % _EVERY, end + 1, _EVERY))
        wider = _EVERY**2
        for point in np.flatnonzero(prices < ceiling):
            checks = np.flatnonzero(self._lit[: end + 1, point])
            along = self._normals[point] @ self._response[: end + 1]
            most = np.maximum.accumulate(most_gained(self._craft, self._pushes, along))
            most = most[checks] + self._between
            alone = self._missing[checks, point] / most
            best = np.maximum(alone, proof.price)
            live = best < ceiling
            checks, most, alone = checks[live], most[live], alone[live]
            since = checks[:, None] - at
            see = along[np.maximum(since, 0)] * ((since > 0) / most[:, None])[..., None]
            kink = most_gained(self._craft, self._pushes, stay[checks])
            for part in _PARTS:
                rest = 1.0 - part
                pushed = most_gained(self._craft, self._pushes, part * see + rest * stay[at])
                pushed = np.maximum(pushed.max(axis=1), rest * kink)
                between = wider * (part * self._between / most + rest * proof.between)
                both = (part * alone + rest * proof.price) / (pushed + between)
                best[live] = np.maximum(best[live], both)
            result[point] = max(result[point], best.min())
        return result
