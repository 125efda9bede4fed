"""Search for on/off commands that reach the goal set in space: with few pulses, or in few periods.

Both searches begin with the duty cycles of good flights with throttled thrust (`throttled`). For few pulses see
`pulses_kernel.search_pulses`. For few periods `kernel.anneal` removes the error of rounding, at a temperature too
low to lose the rotation of the craft. A solution counts only if a replay by the engines' equations confirms it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rans.extend import SpatialState, leaves
from rans.optimal.certificate.flight import state_after
from rans.optimal.certificate.goal_set import GoalSet
from rans_space_certificates.reach import SpinLattice

_INSIDE = 0.999
"""Fraction of the tolerances that the search aims at, as its own integration is off by some micrometres."""
_SUBSTEPS = 8
"""Substeps of the replay in a period."""
_ROUNDED = np.array([0.6, 0.94, 0.57])
"""Fractions of the tolerances of position, velocity and attitude that impulses at any instant must reach, so that
rounding to periods has the rest: half a period of one quantum of spin turns the free flyer by 1.7 degrees."""
_TRIES = 4_000
"""Changes that annealing tries in one search for few pulses."""
_SEARCHES_PER_SECOND = 25
"""Searches for few pulses in a nominal second."""
_DRAWS = 300
"""Draws of pulses from duty cycles at most, until their torques cancel."""
_JITTER = 1.0
"""Periods by which drawn pulses are shifted at most."""
_ROUNDINGS = 100
"""Roundings of duty cycles, with the best of which an attempt to arrive in few periods begins."""
_CHANGES = 20_000
"""Changes that annealing tries in an attempt to arrive in few periods."""
_ATTEMPTS_PER_SECOND = 75
"""Attempts to arrive in few periods in a nominal second."""


class ArrivalSearch(NamedTuple):
    """A search for on/off commands: craft, start, goal set and the work to spend."""

    lattice: SpinLattice
    start: SpatialState
    goal: SpatialState
    goal_set: GoalSet
    rest_asked: bool
    """Whether the flight must end without spin, within the goal set's tolerance."""
    work: float
    """Work of one search, nominal s (`rans.optimal.certificate.problem.SearchEffort`)."""

    @property
    def wrenches(self) -> np.ndarray:
        """(thrusters, 6) acceleration and angular acceleration on B."""
        craft = self.lattice.craft
        moment = self.lattice.moment
        return np.array(craft.wrench_map) / np.repeat([craft.mass, moment], 3)

    @property
    def ends(self) -> list[np.ndarray]:
        """Start and goal, (13,) each: p, quaternion, v, w in B."""
        return [
            np.array(
                [*x.p.columns(), *leaves(x.attitude.normalised()), *x.v.columns(), *x.w.columns()]
            )
            for x in (self.start, self.goal)
        ]

    @property
    def radii(self) -> np.ndarray:
        """(4,) tolerances of position, velocity, attitude and spin that the search aims at; SI units, rad."""
        set_ = self.goal_set
        spin = set_.spin if self.rest_asked else math.inf
        return np.maximum(
            _INSIDE * np.array([set_.position, set_.velocity, set_.heading, spin]), 1e-9
        )

    @property
    def torque_pairs(self) -> np.ndarray:
        """(thrusters, thrusters): 1 where torques are the same, -1 where opposite, 0 else."""
        products = self.lattice.products
        squares = np.diag(self.lattice.products)
        same = (squares[:, None] == squares) & (np.abs(products) == squares)
        torque_pairs = np.where(same, np.sign(products), 0)
        torque_pairs[(squares[:, None] == 0) & (squares == 0)] = 1
        return torque_pairs

    def is_solution(self, commands: np.ndarray) -> bool:
        """Whether a replay of commands (N, thrusters) ends in the goal set."""
        final = state_after(
            self.lattice.craft, self.start, commands, self.lattice.period, _SUBSTEPS
        )
        return is_in_goal_set(final, self.goal, self.goal_set, self.rest_asked)


def is_in_goal_set(
    state: SpatialState, goal: SpatialState, goal_set: GoalSet, rest_asked: bool
) -> bool:
    """Whether a state of floats is in the goal set; its spin counts where ``rest_asked``."""
    spin = np.linalg.norm(np.subtract(state.w.columns(), goal.w.columns()))
    return bool(
        (goal.p - state.p).norm() <= goal_set.position
        and (goal.v - state.v).norm() <= goal_set.velocity
        and state.attitude.normalised().to(goal.attitude.normalised()).magnitude()
        <= goal_set.heading
        and (not rest_asked or spin <= goal_set.spin + 1e-9)
    )


def search_fixed_pulses(
    query: ArrivalSearch, steps: int, pulses: int, duties: Sequence[np.ndarray]
) -> np.ndarray | None:
    """On/off commands with a fixed number of pulses that end in the goal set.

    Args:
        query: what to search for.
        steps: control periods of the flight, N.
        pulses: number of pulses, K.
        duties: duty cycles (N, thrusters) of throttled flights, from which attempts draw first pulses in turn.

    Returns:
        Commands (N, thrusters) of zeros and ones; None if the work is spent without a solution.
    """
    from rans_space_certificates.pulses_kernel import search_pulses

    lattice = query.lattice
    radii = query.radii
    nothing = np.zeros((steps, len(lattice.products)), dtype=np.int64)
    if pulses == 0:
        return nothing if query.is_solution(nothing) else None
    inner = _ROUNDED * radii[:3]
    start, goal = query.ends
    periods, thrusters = np.zeros((2, pulses), dtype=np.int64)
    for attempt in range(int(query.work * _SEARCHES_PER_SECOND)):
        random = np.random.default_rng(attempt)
        instants, first_thrusters = _draw_pulses(
            query, duties[attempt % len(duties)], pulses, random
        )
        miss = search_pulses(
            instants,
            first_thrusters,
            steps=steps,
            wrenches=query.wrenches,
            products=lattice.products,
            start=start,
            goal=goal,
            radii=radii,
            inner=inner,
            quantum=lattice.spin,
            h=lattice.period,
            quadrature=gauss(),
            attempts=_TRIES,
            random=random,
            best_periods=periods,
            best_thrusters=thrusters,
        )
        commands = nothing.copy()
        commands[periods, thrusters] = 1
        if miss <= 0.0 and query.is_solution(commands):
            return commands
    return None


def _draw_pulses(
    query: ArrivalSearch, duties: np.ndarray, pulses: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw pulses from duty cycles (N, thrusters), as evenly as their cumulative sum (systematic sampling).

    Of `_DRAWS` draws it is the first without spin at the end, or that with the least spin.

    Returns:
        Instants (K,), s, and thrusters (K,).
    """
    h = query.lattice.period
    (steps, count) = duties.shape
    spin_changes = h * query.wrenches[:, 3:]
    (start, goal) = query.ends
    cumulative = np.cumsum(duties) / duties.sum()
    (periods, thrusters) = np.zeros((2, pulses), dtype=np.int64)
    spin_error = math.inf
    for _ in range(_DRAWS):
        cells = np.searchsorted(cumulative, (np.arange(pulses) + random.random()) / pulses)
        spin = float(
            np.linalg.norm(start[10:] - goal[10:] + spin_changes[cells % count].sum(axis=0))
        )
        if spin < spin_error - 1e-9:
            thrusters = cells % count
            spin_error = spin
            periods = cells // count
        if spin_error <= query.radii[3]:
            break
    instants = (periods + 0.5 + random.uniform(-_JITTER, _JITTER, pulses)) * h
    return np.clip(instants, 0.5 * h, (steps - 0.5) * h), thrusters


def search_fixed_time(query: ArrivalSearch, duties: Sequence[np.ndarray]) -> np.ndarray | None:
    """On/off commands of any number of pulses that end in the goal set after a fixed time.

    Args:
        query: what to search for.
        duties: duty cycles (N, thrusters) of throttled flights, which attempts round in turn.

    Returns:
        Commands (N, thrusters) of zeros and ones; None if the work is spent without a solution.
    """
    from rans_space_certificates.kernel import anneal

    lattice = query.lattice
    start, goal = query.ends
    for attempt in range(int(query.work * _ATTEMPTS_PER_SECOND)):
        random = np.random.default_rng(attempt)
        commands = _round_duties(query, duties[attempt % len(duties)], random)
        miss = anneal(
            commands,
            wrenches=query.wrenches,
            torque_pairs=query.torque_pairs,
            start=start,
            goal=goal,
            radii=query.radii,
            quantum=lattice.spin,
            h=lattice.period,
            quadrature=gauss(),
            attempts=_CHANGES,
            random=random,
        )
        if miss <= 0.0 and query.is_solution(commands):
            return commands
    return None


def _round_duties(
    query: ArrivalSearch, duties: np.ndarray, random: np.random.Generator
) -> np.ndarray:
    """Round duty cycles (N, thrusters) to zeros and ones: of `_ROUNDINGS` roundings the one that ends nearest.

    At any time a thruster has been open for less than a period more or less than its duty cycles sum up to.
    """
    from rans_space_certificates.kernel import integrate_flight, miss

    (start, goal) = query.ends
    radii = query.radii
    lattice = query.lattice
    quadrature = gauss()
    cumulative = np.cumsum(duties, axis=0)
    best = np.zeros(duties.shape, dtype=np.int64)
    least_distance = math.inf
    path = np.zeros((len(duties) + 1, 13))
    path[0] = start
    for _ in range(_ROUNDINGS):
        # A thruster opens where its sum, from a random beginning, passes a whole number.
        commands = ((cumulative + random.random(duties.shape[1])) % 1.0 < duties).astype(np.int64)
        integrate_flight(commands, 0, query.wrenches, lattice.period, quadrature, path)
        distance = miss(path[-1], goal, radii, lattice.spin)
        if distance < least_distance:
            best = commands
            least_distance = distance
    return best


def gauss() -> np.ndarray:
    """Gauss-Legendre quadrature, (2, 3): nodes and weights on (0, 1)."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    return np.stack([0.5 * (nodes + 1.0), 0.5 * weights])
