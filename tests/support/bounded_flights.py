"""Random spacecraft, random on/off flights, and their bounds with what they reached as goal.

Flights follow the equations that all engines share. Each is held against the least time and the least impulse to
where it ended: the hull bound, rounded up to whole periods and pulses, and for every planar spacecraft with a
lattice the dual bound of the certificate. A lattice's size is planned before it is built.
"""

from __future__ import annotations

import math
import warnings
from typing import Any, Literal

import numpy as np
from rans_bounds.goal_set import GoalSet
from rans_bounds.plane.ascent import ascend, scale, towards_goal
from rans_bounds.plane.dual import Relaxation
from rans_bounds.plane.lattice import Lattice
from rans_bounds.problem import SearchEffort
from rans_bounds.starts import Question, bound

from rans import ConfigError, Spacecraft, Thruster
from rans.episode.scenario import Scenario
from rans.model.body import Body
from rans.model.dynamics import PlanarState, advance, thrust, wrench
from rans.model.fields import Heading, Vec2
from tests.support.crafts import triple
from tests.support.states import spatial

PERIOD = 0.2
_AIMS = (
    ("attitude", "position", "spin", "velocity"),
    ("position", "velocity"),
    ("velocity",),
    ("spin",),
)
_FASTEST = 3.0
"""Spin up to which eight steps a period are exact enough in space, rad/s."""
_HASTE = SearchEffort(1e-9, levels=1)
"""The certificate's search stops at once: what it has then must hold too."""
_MOST_POINTS = 300_000
"""Of a lattice: its costs and their tables then take less than 100 MB and a search some seconds."""
ROUNDING = 1e-9
"""Relative, of a flight of a hundred steps in double precision."""


def beaten(seed: int) -> dict[str, float]:
    """Bounds over what a random flight took; above 1 would refute a bound. Large lattices are not built."""
    random = np.random.default_rng(seed)
    craft = random_craft(random)
    flown = flight(craft, random)
    if flown is None:
        return {}
    start, goal, spent, steps = flown
    loose = GoalSet(*10.0 ** random.uniform(-6, -1, 4))
    wanted = _AIMS[random.integers(len(_AIMS))]
    found: dict[str, float] = {}
    count = points(craft, start, goal, loose, steps)
    if count > _MOST_POINTS:
        wanted = _AIMS[1]
    for name, horizon, took in (
        ("least time", None, steps * PERIOD),
        ("least impulse", steps * PERIOD, spent),
    ):
        question = Question(craft, wanted, loose, PERIOD, horizon, _HASTE, Scenario(start, goal))
        found[name] = _share(bound(0, question).best, took)
    if 0 < count <= _MOST_POINTS:
        dual = _dual(craft, start, goal, spent, steps, loose)
        found["dual of the certificate"] = _share(dual, spent)
    return found


def _share(least: float, took: float) -> float:
    return least / took if took > 0 else (1.0 if least <= ROUNDING else math.inf)


def random_craft(random: np.random.Generator) -> Spacecraft:
    """Planar or not, one to eight thrusters, equal or not, many through the centre or without a push."""
    dimension: Literal[2, 3] = 2 if random.random() < 0.5 else 3
    count = int(random.integers(1, 9))
    forces = random.uniform(0.2, 3.0, count)
    if random.random() < 0.5:
        forces[:] = forces[0]
    arms = random.integers(-2, 3, count) * 0.15
    nozzles: list[Thruster] = []
    for force, arm in zip(forces, arms, strict=True):
        way = random.normal(size=3) * (1.0, 1.0, float(dimension == 3))
        way /= np.linalg.norm(way)
        # aside of the line through the centre by an arm from a short list: sums of torques often cancel
        aside = np.cross(way, (0.0, 0.0, 1.0) if dimension == 2 else random.normal(size=3))
        place = arm * aside / np.linalg.norm(aside) + random.uniform(-0.3, 0.3) * way
        nozzles.append(Thruster(triple(place), triple(way), float(force)))
        if random.random() < 0.4:  # and one against it on the other side: a couple
            nozzles.append(Thruster(triple(-place), triple(-way), float(force)))
    a, b, c = map(float, random.uniform(0.02, 0.3, 3))
    inertia = ((b + c, 0.0, 0.0), (0.0, a + c, 0.0), (0.0, 0.0, a + b))
    sharing = "split" if random.random() < 0.25 else "none"
    with warnings.catch_warnings():  # what cannot be steered everywhere flies as well
        warnings.simplefilter("ignore", UserWarning)
        return Spacecraft(
            "random",
            dimension,
            float(random.uniform(1.0, 20.0)),
            inertia,
            tuple(nozzles[:8]),
            thrust_sharing=sharing,
        )


def flight(craft: Spacecraft, random: np.random.Generator) -> tuple[Any, Any, float, int] | None:
    """Start, end, impulse and periods; None where it spins too fast to be computed exactly.

    Half the flights hold a random set of thrusters open all the time, which is what saturates a bound.
    """
    steps = int(random.integers(1, 9))
    count = len(craft.thrusters)
    commands = (random.random((steps, count)) < random.uniform(0.05, 0.9)).astype(float)
    if random.random() < 0.5:
        commands[:] = random.random(count) < 0.6
    p = random.uniform(-2, 2, 3)
    v = random.uniform(-0.3, 0.3, 3)
    w = random.uniform(-0.5, 0.5, 3)
    if random.random() < 0.5:
        v = 0.0 * v
        w = 0.0 * w
    start: Any = spatial(p, v=v, w=w)
    if craft.dimension == 2:
        start = PlanarState(Vec2(p[0], p[1]), Heading(p[2]), Vec2(v[0], v[1]), w[2])
    state = start
    spent = 0.0
    for row in commands:
        fields = tuple(float(c) for c in row)
        state = advance(state, wrench(craft, fields), Body.of(craft), PERIOD, 8).normalised()
        shares = thrust(craft, fields)
        spent += PERIOD * sum(s * t.force for s, t in zip(shares, craft.thrusters, strict=True))
        if not np.linalg.norm(state.spin()) < (_FASTEST if craft.dimension == 3 else 50.0):
            return None
    return start, state, float(spent), steps


def points(craft: Spacecraft, start: Any, goal: Any, loose: GoalSet, steps: int) -> int:
    """Of the lattice that a certificate of so many periods builds, in period, spin and heading; 0: none."""
    try:
        lattice = Lattice(craft, PERIOD)
        last = max(map(abs, lattice.net_spins(loose, start, goal)))
    except ConfigError:  # in space, of shared thrust, or of torques without a common quantum
        return 0
    most = int(np.abs(lattice.patterns.torque).max())
    k = np.arange(steps + 1)
    limits = np.minimum(most * k, most * (steps - k) + last)
    return (steps + 1) * (2 * max(int(limits.max()), last) + 1) * (2 * int(limits[:-1].sum()) + 1)


def _dual(
    craft: Spacecraft, start: Any, goal: Any, spent: float, steps: int, loose: GoalSet
) -> float:
    """The certificate's bound before branching, rounded up to pulses."""
    lattice = Lattice(craft, PERIOD)
    relaxation = Relaxation(lattice, start, goal, loose, steps, max(spent, 0.2))
    first = towards_goal(relaxation)
    found = ascend(relaxation, relaxation.reachable(), first, [], np.inf, 1e-3, 0.5, 15).best
    rough = relaxation.bound(first * scale(relaxation), relaxation.reachable())
    return lattice.next_fuel(max(found.value, rough.value, 0.0), relaxation.net)
