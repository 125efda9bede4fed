"""On/off controls that arrive, in space: with few pulses, and in few periods.

Both draw their first commands from what thrusters would do that can be throttled (`spatial_shares`). Few
pulses are found by `pulses_kernel`. For few periods annealing mends what rounding has spoilt, too cold to
lose how the craft turns. What counts is the replay by the engines' equations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rans.model.dynamics import SpatialState
from rans.model.fields import leaves
from rans.optimal.certificate.flight import replay
from rans.optimal.certificate.goal_set import GoalSet
from rans.optimal.certificate.space.reach import SpinLattice

_INSIDE = 0.999
"""Share of the tolerances that the search keeps to; its flights are some micrometres off."""
_SUBSTEPS = 8
"""Substeps of the replay in a period."""
_ROUNDED = np.array([0.6, 0.94, 0.57])
"""Shares of the tolerances of position, velocity and attitude that are left before instants of pulses are
rounded to periods: half a period of one quantum of spin turns the free flyer by 1.7 degrees."""
_TRIES = 4_000
"""Changes of one search for few pulses."""
_SEARCHES_PER_SECOND = 25
"""Such searches in a nominal second."""
_DRAWS = 300
"""Draws of pulses from shares at most, until their torques cancel."""
_JITTER = 1.0
"""Periods by which drawn pulses are moved at most."""
_ROUNDINGS = 100
"""Roundings of shares, with the best of which an attempt to arrive in few periods begins."""
_CHANGES = 20_000
"""Changes of such an attempt."""
_ATTEMPTS_PER_SECOND = 75
"""Such attempts in a nominal second."""


class Wanted(NamedTuple):
    """Commands that are wanted: from where to where, and how long to search."""

    lattice: SpinLattice
    start: SpatialState
    goal: SpatialState
    goal_set: GoalSet
    spins: bool
    """Whether the end must be at rest."""
    work: float
    """Work of one search, nominal s (`rans.optimal.certificate.problem.Effort`)."""

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
        """(4,) of position, velocity, attitude and spin, a little inside."""
        set_ = self.goal_set
        spin = set_.spin if self.spins else math.inf
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

    def reached(self, commands: np.ndarray) -> bool:
        """Whether a replay of commands (N, thrusters) ends in the goal set."""
        final = replay(self.lattice.craft, self.start, commands, self.lattice.period, _SUBSTEPS)
        return arrived(final, self.goal, self.goal_set, self.spins)


def arrived(state: SpatialState, goal: SpatialState, goal_set: GoalSet, spins: bool) -> bool:
    """Whether a state of floats is in the set; its spin counts where ``spins``."""
    spin = np.linalg.norm(np.subtract(state.w.columns(), goal.w.columns()))
    return bool(
        (goal.p - state.p).norm() <= goal_set.position
        and (goal.v - state.v).norm() <= goal_set.velocity
        and state.attitude.normalised().to(goal.attitude.normalised()).magnitude()
        <= goal_set.heading
        and (not spins or spin <= goal_set.spin + 1e-9)
    )


def with_pulses(
    wanted: Wanted, steps: int, pulses: int, shares: Sequence[np.ndarray]
) -> np.ndarray | None:
    """Commands (N, thrusters) of so many pulses that arrive after so many periods; None once the work is done.

    Attempts begin with pulses drawn from one of the shares (N, thrusters) after another.
    """
    from rans.optimal.certificate.space.pulses_kernel import fewest_pulses

    lattice = wanted.lattice
    radii = wanted.radii
    nothing = np.zeros((steps, len(lattice.products)), dtype=np.int64)
    if pulses == 0:
        return nothing if wanted.reached(nothing) else None
    inner = _ROUNDED * radii[:3]
    when, who = np.zeros((2, pulses), dtype=np.int64)
    for attempt in range(int(wanted.work * _SEARCHES_PER_SECOND)):
        random = np.random.default_rng(attempt)
        first = _drawn(wanted, shares[attempt % len(shares)], pulses, random)
        miss = fewest_pulses(
            *first,
            steps,
            wanted.wrenches,
            lattice.products,
            *wanted.ends,
            radii,
            inner,
            lattice.spin,
            lattice.period,
            gauss(),
            _TRIES,
            random,
            when,
            who,
        )
        commands = nothing.copy()
        commands[when, who] = 1
        if miss <= 0.0 and wanted.reached(commands):
            return commands
    return None


def _drawn(
    wanted: Wanted, shares: np.ndarray, pulses: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Instants (K,) and thrusters (K,) of pulses: as many from every stretch of time as its shares say.

    Of some draws the one whose torques leave the least spin.
    """
    h = wanted.lattice.period
    (steps, count) = shares.shape
    turns = h * wanted.wrenches[:, 3:]
    (start, goal) = wanted.ends
    passed = np.cumsum(shares) / shares.sum()
    (periods, who) = np.zeros((2, pulses), dtype=np.int64)
    left = math.inf
    for _ in range(_DRAWS):
        places = np.searchsorted(passed, (np.arange(pulses) + random.random()) / pulses)
        spin = float(np.linalg.norm(start[10:] - goal[10:] + turns[places % count].sum(axis=0)))
        if spin < left - 1e-9:
            who = places % count
            left = spin
            periods = places // count
        if left <= wanted.radii[3]:
            break
    instants = (periods + 0.5 + random.uniform(-_JITTER, _JITTER, pulses)) * h
    return np.clip(instants, 0.5 * h, (steps - 0.5) * h), who


def in_time(wanted: Wanted, shares: Sequence[np.ndarray]) -> np.ndarray | None:
    """Commands (N, thrusters) that arrive after as many periods as shares have; None once the work is done.

    Attempts begin with roundings of one of the shares (N, thrusters) after another.
    """
    from rans.optimal.certificate.space.kernel import anneal

    lattice = wanted.lattice
    for attempt in range(int(wanted.work * _ATTEMPTS_PER_SECOND)):
        random = np.random.default_rng(attempt)
        commands = _rounded(wanted, shares[attempt % len(shares)], random)
        miss = anneal(
            commands,
            wanted.wrenches,
            wanted.torque_pairs,
            *wanted.ends,
            wanted.radii,
            lattice.spin,
            lattice.period,
            gauss(),
            _CHANGES,
            random,
        )
        if miss <= 0.0 and wanted.reached(commands):
            return commands
    return None


def _rounded(wanted: Wanted, shares: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """The commands (N, thrusters), of some that open every thruster as its shares sum up, that miss least.

    At any time a thruster has been open for less than a period more or less than its shares say.
    """
    from rans.optimal.certificate.space.kernel import fly, miss

    (start, goal) = wanted.ends
    radii = wanted.radii
    lattice = wanted.lattice
    rule = gauss()
    passed = np.cumsum(shares, axis=0)
    best = np.zeros(shares.shape, dtype=np.int64)
    least = math.inf
    path = np.zeros((len(shares) + 1, 13))
    path[0] = start
    for _ in range(_ROUNDINGS):
        # open where the sum, from a random beginning, passes a whole number
        commands = ((passed + random.random(shares.shape[1])) % 1.0 < shares).astype(np.int64)
        fly(commands, 0, wanted.wrenches, lattice.period, rule, path)
        left = miss(path[-1], goal, radii, lattice.spin)
        if left < least:
            best = commands
            least = left
    return best


def gauss() -> np.ndarray:
    """Gauss-Legendre, (2, 3): places and weights on (0, 1)."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    return np.stack([0.5 * (nodes + 1.0), 0.5 * weights])
