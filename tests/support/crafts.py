"""Spacecraft and states that tests share: awkward ones built by hand, random ones from hypothesis."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rans import TASKS, Spacecraft, Thruster
from rans.model.actuators import Throttle
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import spacecraft_names
from tests.support.states import spatial

OWN_CRAFT = {name: TASKS[name].spacecraft for name in TASKS if TASKS[name].spacecraft}
"""Missions that only a craft of their own can fly, which tests of their own do."""
ANY_CRAFT = [name for name in TASKS if name not in OWN_CRAFT]
"""Tasks that every craft of the right dimension flies."""
REAL_CRAFT = [
    "afrl-12kg",
    "apollo-csm",
    "astrobee-granite",
    "astrobee-iss",
    "atmos-orbit-12",
    "atmos-orbit-16",
    "cubesat-3u",
    "cubesat-6u",
    "freeflyer2",
    "pingu",
    "roboran-platform",
    "spheres",
]
"""Real craft with tests of their own (`tests.model.test_real_craft`): elsewhere they would repeat
what others of their kind of actuators show."""
MISSION_CRAFT = ["afrl-deputy", "mars-lander-steered"]
"""Craft of the core that only missions fly, whose tasks a package adds."""
FREE_CRAFT = [
    name
    for name in spacecraft_names()
    if name not in {*OWN_CRAFT.values(), *MISSION_CRAFT, *REAL_CRAFT}
]
"""Craft that fly every task."""

Tensor = tuple[tuple[float, float, float], ...]
Triple = tuple[float, float, float]


def nasty_planar() -> Spacecraft:
    """Off-centre mass, G above the plane of motion, five unequal thrusters at odd angles."""
    com = (0.07, -0.11, 0.25)
    layout = [  # x, y (m, in G), direction (degrees), force (N)
        (-0.39, 0.25, 305.0, 0.7),
        (0.33, 0.09, 225.0, 1.9),
        (0.18, 0.03, 180.0, 0.4),
        (0.35, 0.25, 95.0, 1.3),
        (-0.4, 0.29, 110.0, 1.1),
    ]
    thrusters = tuple(
        Thruster((x, y, com[2]), (math.cos(math.radians(a)), math.sin(math.radians(a)), 0.0), force)
        for x, y, a, force in layout
    )
    return Spacecraft("nasty-planar", 2, 7.3, _nasty_tensor(), thrusters, com)


def nasty_spatial() -> Spacecraft:
    """Off-centre mass, three different principal moments about skew axes, fourteen unequal thrusters."""
    generator = np.random.default_rng(5)
    half = [(triple(generator.uniform(-0.4, 0.4, 3)), generator.normal(size=3)) for _ in range(7)]
    thrusters = tuple(
        Thruster(position, triple(sign * axis / np.linalg.norm(axis)), 0.3 + 0.2 * index)
        for index, (position, axis) in enumerate(half)
        for sign in (1.0, -1.0)
    )
    return Spacecraft("nasty-spatial", 3, 8.1, _nasty_tensor(), thrusters, (0.04, -0.09, 0.06))


def deputy() -> Spacecraft:
    """The deputy of AFRL's docking environment (Ravaioli et al., 2022): 12 kg, 1 N of throttle each way along
    every axis, through the centre of mass."""
    axes = np.vstack([np.eye(3), -np.eye(3)])
    thrusters = tuple(Thruster((0.0, 0.0, 0.0), triple(axis), 1.0) for axis in axes)
    return Spacecraft(
        "deputy", 3, 12.0, ((0.3, 0.0, 0.0), (0.0, 0.3, 0.0), (0.0, 0.0, 0.3)), thrusters,
        actuators=Throttle(),
    )  # fmt: skip


def point() -> Spacecraft:
    """A point mass in the plane: 4 kg, three on/off thrusters of 1 N at 120 degrees through its centre."""
    angles = (math.pi / 2 + k * math.tau / 3 for k in range(3))
    thrusters = tuple(
        Thruster((0.0, 0.0, 0.0), (math.cos(angle), math.sin(angle), 0.0), 1.0) for angle in angles
    )
    return Spacecraft("point", 2, 4.0, _rotated((0.2, 0.2, 0.2), Rotation.identity()), thrusters)


def heavier(craft: Spacecraft, mass: float, inertia: float, **changes: Any) -> Spacecraft:
    """The craft with so many times its mass and its inertia."""
    moments = tuple(triple(inertia * x for x in row) for row in craft.inertia)
    return replace(craft, mass=mass * craft.mass, inertia=moments, **changes)


def _nasty_tensor() -> Tensor:
    return _rotated((0.21, 0.34, 0.47), Rotation.from_rotvec([0.5, -0.8, 0.3]))


def _rotated(moments: Any, axes: Rotation) -> Tensor:
    matrix = axes.as_matrix()
    tensor = matrix @ np.diag(moments) @ matrix.T
    tensor = (tensor + tensor.T) / 2  # equal to the last bit: the reader asks for symmetry
    return tuple(triple(row) for row in tensor)


def triple(vector: Any) -> Triple:
    """Three numbers as a craft has them."""
    x, y, z = (float(component) for component in vector)
    return (x, y, z)


def _numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False)


@st.composite
def inertias(draw: st.DrawFn) -> Tensor:
    """Any physical inertia tensor, 0.02 to 2 kg m^2: the second moments of mass a, b, c along three
    axes are free, the moments of inertia b + c, a + c, a + b then obey the triangle inequality."""
    a, b, c = (draw(_numbers(0.01, 1.0)) for _ in range(3))
    turn = [draw(_numbers(-2.0, 2.0)) for _ in range(3)]
    return _rotated((b + c, a + c, a + b), Rotation.from_rotvec(turn))


@st.composite
def thrusters(draw: st.DrawFn, dimension: Literal[2, 3], height: float) -> Thruster:
    """Anywhere within half a metre, pointing anywhere; in the plane at the given height."""
    azimuth = draw(_numbers(-math.pi, math.pi))
    elevation = draw(_numbers(-1.5, 1.5))
    x, y, z = (draw(_numbers(-0.5, 0.5)) for _ in range(3))
    if dimension == 2:
        z = height
        elevation = 0.0
    level = math.cos(elevation)
    direction = (level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation))
    return Thruster((x, y, z), direction, draw(_numbers(0.05, 5.0)))


@st.composite
def spacecraft(draw: st.DrawFn, dimension: Literal[2, 3]) -> Spacecraft:
    """Any physical spacecraft with 1 to 10 thrusters, controllable or not."""
    com = triple(draw(_numbers(-0.3, 0.3)) for _ in range(3))
    nozzles = draw(st.lists(thrusters(dimension, com[2]), min_size=1, max_size=10))
    with warnings.catch_warnings():  # too few thrusters to control it is a case we want
        warnings.simplefilter("ignore", UserWarning)
        return Spacecraft(
            name="random",
            dimension=dimension,
            mass=draw(_numbers(0.5, 50.0)),
            inertia=draw(inertias()),
            thrusters=tuple(nozzles),
            centre_of_mass=com,
            thrust_sharing=draw(st.sampled_from(("none", "split"))),
        )


def random_states(
    dimension: Literal[2, 3],
    count: int,
    seed: int,
    reach: float = 3.0,
    speed: float = 0.5,
    spin: float = 1.0,
) -> Any:
    """States of float64 arrays (count,): anywhere within the reach (m), any attitude, any motion."""
    generator = np.random.default_rng(seed)
    p, v = (generator.uniform(-s, s, (dimension, count)) for s in (reach, speed))
    if dimension == 2:
        angle = generator.uniform(-math.pi, math.pi, count)
        w = generator.uniform(-spin, spin, count)
        return PlanarState(Vec2(*p), Heading(angle), Vec2(*v), w)
    x, y, z, w = Rotation.random(count, rng=generator).as_quat().T
    return spatial(p, attitude=(w, x, y, z), v=v, w=generator.uniform(-spin, spin, (3, count)))
