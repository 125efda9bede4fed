"""How near the target coasts lead if all thrusters shut and stay shut: a certified distance, in closed form.

The motion is that of `rans.model.drift.ClohessyWiltshire`. A coast is stored as the state from which it would start
at a common instant. Thrusters that shut at any instant of a control period with constant thrust give a family of
coasts. After the same time their positions lie on a curve, whose chord between two of them is off by a bounded
distance. So the least distance of all coasts of a family is that of moving line segments, less that bound; it is
computed by branch and bound in time.
"""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np

from rans.extend import ClohessyWiltshire
from rans_missions.orbits.linear import carried, held, transition

PRECISION = 0.01
"""Largest error of a distance from line segments, m: a hundredth of the least position tolerance of a mission."""
_INTERVALS = 64
"""Parts of a coast with which the search in time begins: 6 degrees of an orbit each."""
_FEW_INTERVALS = 16
"""Parts of a coast with which the search begins where its distance is only compared: few coasts need more."""
_VELOCITY_RESPONSE = math.sqrt(50.0)
"""Upper bound of how much a velocity change grows: the Frobenius norm of the response of the velocity to it,
[[c, 2 s], [-2 s, 4 c - 3]] in the orbital plane, is largest half an orbit later, where c = -1."""
_CHORD_PART = 0.002
"""Part of the zone's radius that the chords of a family may be off by, before precision counts."""
_MOST_PARTS = 64
"""Largest number of parts into which a control period is divided."""
_EVEN = 1e-6
"""Difference of positions, m, by which thrust counts as not constant in a control period."""


class CoastZone(NamedTuple):
    """A ball around a target that craft near it keep out of, also when all their thrusters shut and stay shut."""

    radius: float
    """Radius, m."""
    approach: float = 0.0
    """Distance from the target within which the craft flies to it on purpose, m: from the first instant there on
    coasts may lead anywhere. 0: there is none."""


class Pieces(NamedTuple):
    """Families of coasts between two of them, (B,) of each."""

    first: np.ndarray
    """(B, 6) position, m, and velocity, m/s, from which the first coast starts."""
    second: np.ndarray
    """(B, 6) the same of the last coast of the family; equal to the first for a single coast."""
    time: np.ndarray
    """(B,) time for which the coasts last, s."""
    error: np.ndarray
    """(B,) largest distance of the family's positions from the segments between both coasts, m."""
    flight: np.ndarray
    """(B,) number of the flight to which each family belongs."""


def pieces_of_periods(
    mean_motion: float,
    before: np.ndarray,
    after: np.ndarray,
    period: float,
    horizon: float,
    scale: float,
    flight: np.ndarray,
) -> Pieces:
    """Families of coasts that begin at any instant of control periods with thrust.

    Thrust is constant in a period, or else it has one direction and any profile, which the error then allows for.

    Args:
        mean_motion: mean motion n of the target's orbit, rad/s.
        before: states (B, 6) at the start of each period.
        after: states (B, 6) at its end.
        period: control period, s.
        horizon: time after the period for which the coasts last, s.
        scale: distance, m, a small part of which chords may be off by.
        flight: number of each period's flight.
    """
    drift = ClohessyWiltshire(mean_motion)
    whole = transition(drift, period)
    # Constant acceleration a that changes the velocity as the thrust did: its response is that of a position.
    change = after - before @ whole.T
    acceleration = np.linalg.solve(whole[:3, 3:], change[:, 3:].T).T
    size = np.linalg.norm(acceleration, axis=1)
    uneven = (
        np.linalg.norm(change[:, :3] - acceleration @ held(drift, period)[:3].T, axis=1) > _EVEN
    )
    bent = _VELOCITY_RESPONSE * size * period**2 / 8.0
    parts = np.sqrt(np.where(uneven, 0.0, bent) / (_CHORD_PART * scale))
    parts = 2 ** np.ceil(np.log2(np.clip(parts, 1.0, _MOST_PARTS))).astype(int)
    blocks = []
    for count in np.unique(parts):
        rows = np.flatnonzero(parts == count)
        instants = np.linspace(0.0, period, count + 1)
        # States at which thrusters shut, and from where coasts through them would have started.
        coasts = [before[rows]]
        for instant in instants[1:-1]:
            forced = transition(drift, -instant) @ held(drift, instant)
            coasts.append(before[rows] + acceleration[rows] @ forced.T)
        coasts.append(after[rows] @ transition(drift, -period).T)
        # Thrust of one direction, whenever it was, is at most twice as far from the chord as constant thrust is.
        error = np.where(uneven[rows], 2.0 * bent[rows], bent[rows] / count**2)
        for first, second in itertools.pairwise(coasts):
            time = np.full(len(rows), period + horizon)
            blocks.append(Pieces(first, second, time, error, flight[rows]))
    if not blocks:
        return single_coasts(before, np.zeros(0), flight)
    return joined(blocks)


def coasts_of_flights(
    mean_motion: float,
    states: np.ndarray,
    burning: np.ndarray,
    lengths: np.ndarray,
    period: float,
    seconds: float,
    scale: float,
    is_safe_start: np.ndarray,
) -> Pieces:
    """Coasts of N flights if thrusters shut at any instant, also in the midst of a burn.

    Where the coast from the start enters the zone, instants count from the end of the first control period on.

    Args:
        mean_motion: mean motion n of the target's orbit, rad/s.
        states: states at the ends of control periods, (T + 1, N, 6).
        burning: whether a flight burns in a period, (T, N); False in periods that do not count.
        lengths: number of periods of each flight that count, (N,).
        period: control period, s.
        seconds: time after thrusters shut for which coasts last, s.
        scale: distance, m, a small part of which chords may be off by.
        is_safe_start: whether the coast from the start keeps out of the zone, (N,).
    """
    # Families of coasts from the midst of burns.
    families = burning.copy()
    families[0] &= is_safe_start
    step, who = np.nonzero(families)
    midst = pieces_of_periods(
        mean_motion, states[step, who], states[step + 1, who], period, seconds, scale, who
    )
    # Coasts from the ends of burns, and from the start, until the next burn begins and the time after it.
    upcoming = np.where(burning, np.arange(len(burning))[:, None], lengths)
    upcoming = np.minimum.accumulate(upcoming[::-1], axis=0)[::-1]
    upcoming = np.concatenate([upcoming, lengths[None]])
    waiting = np.flatnonzero(is_safe_start | (upcoming[0] > 0))
    step, who = np.nonzero(burning)
    step = np.concatenate([np.zeros(len(waiting), int), step + 1])
    who = np.concatenate([waiting, who])
    quiet = (upcoming[step, who] - step) * period
    return joined([midst, single_coasts(states[step, who], seconds + quiet, who)])


def single_coasts(states: np.ndarray, time: np.ndarray, flight: np.ndarray) -> Pieces:
    """Coasts from states (B, 6) for times (B,), s."""
    return Pieces(states, states, time, np.zeros(len(states)), flight)


def joined(several: list[Any]) -> Any:
    """All rows of several named tuples of arrays, such as `Pieces`."""
    return type(several[0])(*map(np.concatenate, zip(*several, strict=True)))


def least_distances(mean_motion: float, pieces: Pieces, flights: int) -> np.ndarray:
    """Distance from the target that all coasts of a flight keep, (flights,), m; infinite without a coast.

    It is a certified lower bound, at most `PRECISION` and the error of the nearest family below the least distance.

    Args:
        mean_motion: mean motion n of the target's orbit, rad/s.
        pieces: families of coasts.
        flights: number of flights.
    """
    best = _least_of_segments(mean_motion, pieces, flights, _INTERVALS, math.inf)
    return np.maximum(best - PRECISION, 0.0)


def keep_away(mean_motion: float, pieces: Pieces, flights: int, distance: float) -> np.ndarray:
    """Whether all coasts of a flight certainly keep a distance, m, from the target, (flights,) bool.

    It takes less time than `least_distances`: no coast is searched further once the answer is certain.

    Args:
        mean_motion: mean motion n of the target's orbit, rad/s.
        pieces: families of coasts.
        flights: number of flights.
        distance: distance from the target, m.
    """
    asked = distance + PRECISION
    return _least_of_segments(mean_motion, pieces, flights, _FEW_INTERVALS, asked) > asked


def _least_of_segments(
    n: float, pieces: Pieces, flights: int, intervals: int, asked: float
) -> np.ndarray:
    """Least distance (flights,), m, of segments less their families' errors, `PRECISION` above the least at most.

    Args:
        n: mean motion, rad/s.
        pieces: families of coasts.
        flights: number of flights.
        intervals: parts of every coast with which the search begins.
        asked: distance, m, on whose side the result of a flight must be; beyond it results are too large.
    """
    best = np.full(flights, np.inf)
    drift = ClohessyWiltshire(n)
    bend = np.maximum(_bend(n, pieces.first), _bend(n, pieces.second))
    # Equal parts of every coast first.
    owner = np.repeat(np.arange(len(pieces.time)), intervals)
    step = np.tile(np.arange(intervals), len(pieces.time)) / intervals
    start = step * pieces.time[owner]
    end = (step + 1.0 / intervals) * pieces.time[owner]
    while len(owner):
        # Chunks bound the memory.
        survivors = []
        for rows in np.array_split(np.arange(len(owner)), -(-len(owner) // 2**18)):
            who, begin, finish = owner[rows], start[rows], end[rows]
            middle = 0.5 * (begin + finish)
            half = 0.5 * (finish - begin)
            first, second = (carried(drift, x[who], middle) for x in (pieces.first, pieces.second))
            near = _nearest(first[:, :3], second[:, :3])
            distance = np.linalg.norm(near, axis=1)
            np.minimum.at(best, pieces.flight[who], distance - pieces.error[who])
            # All points of the segment move at most at this speed, and along the direction of the nearest one as
            # its ends do, but for their accelerations.
            speeds = [np.linalg.norm(x[:, 3:], axis=1) for x in (first, second)]
            fastest = np.maximum(*speeds) + bend[who] * half
            slack = fastest * half
            unit = near / np.maximum(distance, 1e-12)[:, None]
            along = [np.abs(np.sum(unit * x[:, 3:], axis=1)) for x in (first, second)]
            slack = np.minimum(slack, np.maximum(*along) * half + 0.5 * bend[who] * half**2)
            lower = distance - slack - pieces.error[who]
            so_far = best[pieces.flight[who]]
            candidates = lower < np.minimum(so_far - PRECISION, asked)
            if math.isfinite(asked):
                candidates &= so_far > asked
            survivors.append(
                (who[candidates], begin[candidates], middle[candidates], finish[candidates])
            )
        who, begin, middle, finish = (np.concatenate(x) for x in zip(*survivors, strict=True))
        owner = np.concatenate([who, who])
        start = np.concatenate([begin, middle])
        end = np.concatenate([middle, finish])
    return best


def _bend(n: float, states: np.ndarray) -> np.ndarray:
    """Upper bound (B,) of the acceleration on coasts from states (B, 6), m/s^2.

    It oscillates at n with the amplitudes n^2 r along x, 2 n^2 r along y, and n^2 z.
    """
    x, _, z, u, v, w = states.T
    radial = np.hypot(3.0 * x + 2.0 * v / n, u / n)
    return n**2 * np.sqrt(4.0 * radial**2 + z**2 + (w / n) ** 2)


def _nearest(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The point (B, 3) nearest to the origin of each segment between two points (B, 3)."""
    along: Any = second - first
    square = np.maximum(np.sum(along * along, axis=1), 1e-30)
    part = np.clip(-np.sum(first * along, axis=1) / square, 0.0, 1.0)
    return first + part[:, None] * along
