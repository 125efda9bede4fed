"""On/off controls that arrive, in space: with few pulses, and in few periods.

Few pulses are found by `pulses_kernel`. Few periods need nearly all thrusters at nearly all times. There,
annealing gives a first flight; linear programs around one flight after another lead to shares between 0 and 1
that arrive, mixed-integer ones to on/off commands, and annealing again mends what is nonlinear in the last
step. What counts is the replay by the engines' equations.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rans.model.dynamics import SpatialState
from rans.model.fields import leaves
from rans.optimal.certificate.lattice import GoalSet
from rans.optimal.certificate.onoff import replay
from rans.optimal.certificate.spatial import SpinLattice

_INSIDE = 0.999
"""Share of the tolerances that the search keeps to; its flights are some micrometres off."""
_SUBSTEPS = 8
"""Of the replay in a period."""
_ROUNDED = np.array([0.6, 0.94, 0.57])
"""Shares of the tolerances of position, velocity and attitude that are left before instants of pulses are
rounded to periods: half a period of one quantum of spin turns the free flyer by 1.7 degrees."""
_TRIES = 4_000
"""Changes of one search for few pulses, 40 ms."""
_DRAWS = 300
"""Of pulses from shares, at most, until their torques cancel."""
_JITTER = 1.0
"""By how many periods pulses drawn are moved, at most."""
_FIRST_TRIES, _MENDING = 250_000, 200_000
"""Changes of the first annealing of commands, 0.3 s, and of one that mends."""
_PROGRAMS = 40
"""Linear programs of one search, at most, 20 ms each."""
_PROMISING = 0.6
"""Radii off, in sum, up to which shares are worth rounding."""
_ROUNDS = 8
"""Mixed-integer programs of one search."""
_NEIGHBOURS = 14
"""Commands that all but the first of them may change: as many as the linear model is good for."""
_WHOLE = 0.02
"""Price of u (1 - u) of a share u, in radii."""
_NORMALS = np.array([n for n in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(n)])
_NORMALS /= np.linalg.norm(_NORMALS, axis=1)[:, None]
"""Of the 26 sides that stand for a ball."""
_SIDES = 0.93
"""Radii from the centre to them, between those inside the ball (0.9) and those outside."""


class Wanted(NamedTuple):
    """What commands are looked for."""

    lattice: SpinLattice
    start: SpatialState
    goal: SpatialState
    goal_set: GoalSet
    spins: bool
    """Whether the end must be at rest."""
    seconds: float
    """Processor time."""

    @property
    def wrenches(self) -> np.ndarray:
        """(thrusters, 6) acceleration and angular acceleration on B."""
        craft, moment = self.lattice.craft, self.lattice.moment
        return np.array(craft.wrench_map) / np.repeat([craft.mass, moment], 3)

    @property
    def ends(self) -> list[np.ndarray]:
        """Start and goal, (13,) each: p, quaternion, v, w in B."""
        return [np.array([*x.p.columns(), *leaves(x.attitude.normalised()), *x.v.columns(), *x.w.columns()])
                for x in (self.start, self.goal)]

    @property
    def radii(self) -> np.ndarray:
        """(4,) of position, velocity, attitude and spin, a little inside."""
        set_ = self.goal_set
        spin = set_.spin if self.spins else math.inf
        return np.maximum(_INSIDE * np.array([set_.position, set_.velocity, set_.heading, spin]), 1e-9)

    @property
    def mates(self) -> np.ndarray:
        """(thrusters, thrusters): 1 where torques are the same, -1 where opposite, 0 else."""
        products, squares = self.lattice.products, np.diag(self.lattice.products)
        same = (squares[:, None] == squares) & (np.abs(products) == squares)
        mates = np.where(same, np.sign(products), 0)
        mates[(squares[:, None] == 0) & (squares == 0)] = 1
        return mates

    def reached(self, commands: np.ndarray) -> bool:
        """Whether a replay of commands (N, thrusters) ends in the goal set."""
        final = replay(self.lattice.craft, self.start, commands, self.lattice.period, _SUBSTEPS)
        return arrived(final, self.goal, self.goal_set, self.spins)


def arrived(state: SpatialState, goal: SpatialState, goal_set: GoalSet, spins: bool) -> bool:
    """Whether a state of floats is in the set; its spin counts where ``spins``."""
    spin = np.linalg.norm(np.subtract(state.w.columns(), goal.w.columns()))
    return bool((goal.p - state.p).norm() <= goal_set.position
                and (goal.v - state.v).norm() <= goal_set.velocity
                and state.attitude.normalised().to(goal.attitude.normalised()).magnitude() <= goal_set.heading
                and (not spins or spin <= goal_set.spin + 1e-9))


def with_pulses(wanted: Wanted, steps: int, pulses: int, shares: Sequence[np.ndarray]) -> np.ndarray | None:
    """Commands (N, thrusters) of so many pulses that arrive after so many periods; None once time is up.

    Attempts begin with pulses drawn from one of the shares (N, thrusters) after another.
    """
    from rans.optimal.certificate.pulses_kernel import few

    lattice, radii = wanted.lattice, wanted.radii
    nothing = np.zeros((steps, len(lattice.products)), dtype=np.int64)
    if pulses == 0:
        return nothing if wanted.reached(nothing) else None
    inner = _ROUNDED * radii[:3]
    when, who = np.zeros((2, pulses), dtype=np.int64)
    deadline, attempt = time.process_time() + wanted.seconds, 0
    while time.process_time() < deadline:
        random = np.random.default_rng(attempt)
        first = _drawn(wanted, shares[attempt % len(shares)], pulses, random)
        miss = few(*first, steps, wanted.wrenches, lattice.products, *wanted.ends, radii, inner,
                   lattice.spin, lattice.period, gauss(), _TRIES, random, when, who)
        commands = nothing.copy()
        commands[when, who] = 1
        if miss <= 0.0 and wanted.reached(commands):
            return commands
        attempt += 1
    return None


def _drawn(wanted: Wanted, shares: np.ndarray, pulses: int,
           random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Instants (K,) and thrusters (K,) of pulses: as many from every stretch of time as its shares say.

    Of some draws the one whose torques leave the least spin.
    """
    h, (steps, count) = wanted.lattice.period, shares.shape
    turns, (start, goal) = h * wanted.wrenches[:, 3:], wanted.ends
    passed = np.cumsum(shares) / shares.sum()
    (periods, who), left = np.zeros((2, pulses), dtype=np.int64), math.inf
    for _ in range(_DRAWS):
        places = np.searchsorted(passed, (np.arange(pulses) + random.random()) / pulses)
        spin = float(np.linalg.norm(start[10:] - goal[10:] + turns[places % count].sum(axis=0)))
        if spin < left - 1e-9:
            who, left, periods = places % count, spin, places // count
        if left <= wanted.radii[3]:
            break
    instants = (periods + 0.5 + random.uniform(-_JITTER, _JITTER, pulses)) * h
    return np.clip(instants, 0.5 * h, (steps - 0.5) * h), who


def in_time(wanted: Wanted, steps: int, first: np.ndarray | None = None) -> np.ndarray | None:
    """Commands (N, thrusters) that arrive after so many periods; None once time is up.

    The first attempt begins with those that are given.
    """
    deadline, attempt = time.process_time() + wanted.seconds, 0
    while time.process_time() < deadline:
        random = np.random.default_rng(attempt)
        commands = np.zeros((steps, len(wanted.wrenches)), dtype=np.int64)
        if attempt == 0 and first is not None:
            commands[:] = first
        miss = _annealed(wanted, commands, _FIRST_TRIES, 0.7 if attempt % 2 == 0 else 3.0, random)
        if miss > 0.0:
            miss = _programmed(wanted, commands, random, deadline)
        if miss <= 0.0 and wanted.reached(commands):
            return commands
        attempt += 1
    return None


def gauss() -> np.ndarray:
    """Gauss-Legendre, (2, 3): places and weights on (0, 1)."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    return np.stack([0.5 * (nodes + 1.0), 0.5 * weights])


def _annealed(wanted: Wanted, commands: np.ndarray, tries: int, heat: float,
              random: np.random.Generator) -> float:
    """Improve commands, in place; returns by how many radii they miss."""
    from rans.optimal.certificate.spatial_kernel import anneal

    return anneal(commands, wanted.wrenches, wanted.mates, *wanted.ends, wanted.radii, wanted.lattice.spin,
                  wanted.lattice.period, gauss(), tries, heat, random)


def _programmed(wanted: Wanted, commands: np.ndarray, random: np.random.Generator, deadline: float) -> float:
    """Improve commands, in place, by programs; returns by how many radii they miss.

    No program begins after this processor time, s.
    """
    # shares between 0 and 1, as far as linear programs can be trusted
    shares, reach = np.clip(commands, 0.01, 0.99), 0.5
    model = _Model(wanted, shares)
    for _ in range(_PROGRAMS):
        trial = model.solved(np.clip(shares - reach, 0.0, 1.0), np.clip(shares + reach, 0.0, 1.0))
        if trial is None or reach < 0.01 or time.process_time() > deadline:
            break
        there = _Model(wanted, trial)
        if there.value < model.value - 1e-3:
            shares, model, reach = trial, there, min(1.0, 1.5 * reach)
        else:
            reach *= 0.4
    miss = math.inf
    # on/off commands near them, then near one another
    for _ in range(_ROUNDS if model.miss < _PROMISING else 0):
        trial = model.solved(np.zeros_like(shares), np.ones_like(shares), 2.0, _NEIGHBOURS)
        if trial is None or time.process_time() > deadline:
            break
        commands[:] = np.round(trial)
        miss = _annealed(wanted, commands, _MENDING, 0.3, random)
        if miss <= 0.0:
            break
        model = _Model(wanted, commands.astype(float))
    return miss


class _Model:
    """What shares (N, thrusters) end off by, in linear terms around some of them."""

    def __init__(self, wanted: Wanted, shares: np.ndarray) -> None:
        from rans.optimal.certificate.spatial_kernel import slopes

        self.shares, self.radii = shares, wanted.radii
        off, slope = slopes(shares.copy(), wanted.wrenches, *wanted.ends, wanted.lattice.period, gauss())
        sizes = np.repeat(self.radii[:3], 3)
        self.off, self.slope = off[:9] / sizes, slope[:9] / sizes[:, None]
        # spin counts in quanta
        quantum = wanted.lattice.spin
        self.spin, self.spin_slope = off[9:] / quantum, slope[9:] / quantum
        self.rest = wanted.radii[3] / quantum
        outside = np.maximum(0.0, np.linalg.norm(self.off.reshape(3, 3), axis=1) - 1.0).sum()
        self.miss = float(outside) + 5.0 * max(0.0, float(np.linalg.norm(self.spin)) - self.rest)
        """Radii outside, in sum; a quantum of spin counts as 5."""
        self.value = self.miss + _WHOLE * float((shares * (1.0 - shares)).sum())
        """What linear programs lessen, so that few shares are left between 0 and 1."""

    def solved(self, low: np.ndarray, high: np.ndarray, seconds: float | None = None,
               changes: int | None = None) -> np.ndarray | None:
        """Shares between these that end least outside, if any end at rest.

        With so many seconds they are 0 or 1, and differ from those of the model in at most so many changes.
        """
        from scipy.optimize import Bounds, LinearConstraint, milp

        flat, count = self.shares.ravel(), self.shares.size
        sides, slack = [], np.zeros((3, len(_NORMALS), 3))
        for group in range(3):
            slack[group, :, group] = -1.0
            toward = _NORMALS @ self.slope[3 * group:3 * group + 3]
            left = _SIDES - _NORMALS @ self.off[3 * group:3 * group + 3] + toward @ flat
            sides.append(LinearConstraint(np.hstack([toward, slack[group]]), -np.inf, left))
        if math.isfinite(self.rest):
            middle, most = self.spin_slope @ flat - self.spin, self.rest / math.sqrt(3.0) + 1e-6
            span: Any = [middle - most, middle + most]
            sides.append(LinearConstraint(np.hstack([self.spin_slope, np.zeros((3, 3))]), *span))
        if changes is not None:
            sides.append(LinearConstraint(np.append(1.0 - 2.0 * flat, np.zeros(3))[None], -np.inf,
                                          changes - flat.sum()))
        whole = np.append(np.full(count, 0 if seconds is None else 1), np.zeros(3))
        price = _WHOLE * (1.0 - 2.0 * flat) if seconds is None else np.zeros(count)
        time_limit = {} if seconds is None else {"time_limit": seconds}
        limits: list[Any] = [np.append(low, np.zeros(3)), np.append(high, np.full(3, np.inf))]
        answer = milp(np.append(price, np.ones(3)), integrality=whole, constraints=sides,
                      bounds=Bounds(*limits), options={"mip_rel_gap": 0.3} | time_limit)
        return None if answer.x is None else np.clip(answer.x[:count], 0.0, 1.0).reshape(self.shares.shape)
