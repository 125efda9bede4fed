"""Sloshing liquid as a pendulum: moments against Drake, what is refused, and a published table."""

import math
from dataclasses import replace

import numpy as np
import pytest
from rans_missions.slosh.liquid import Slosh
from rans_missions.slosh.swinging import paces
from rans_optimal.checks import check_craft
from scipy.special import jnp_zeros

import rans
from rans import BodyConditions, Conditions, ConfigError, Spacecraft
from rans.evaluation.compare.bounds import check_certifiable
from rans.model.actuators import Propellant, Wheel
from rans.model.drift import ClohessyWiltshire
from rans.reference.plant import Plant
from tests.support.pairs import InOrbit
from tests.support.slosh import IN_SPACE, IN_SPACE_SLOSH, SLOSH, SLOSHING
from validation.study.checks import Check, Skipped
from validation.study.study import LAYERS, Scope

WHEELED = replace(SLOSHING, wheels=(Wheel((0.0, 0.0, 1.0), 0.05, 0.08, 1e-3),))


@pytest.mark.parametrize("craft", [WHEELED, IN_SPACE], ids=lambda craft: craft.name)
def test_a_validation_compares_moments_and_periods_with_the_mass_that_moves(craft):
    """As closely as of a rigid craft: without its equations a tenth of the mass is a difference of a tenth."""
    names = ("accelerations", "period", "disturbances")
    scope = Scope(craft, seed=1, states=8, flights=1)
    checks = [check for name in names for check in LAYERS[name](scope)]
    assert len(checks) == 12
    assert [check for check in checks if not (isinstance(check, Check) and check.passed)] == []
    # Chaos and momenta of the rigid craft are not compared.
    for name in ("flights", "bang-bang", "engine", "onsets"):
        (skipped,) = LAYERS[name](scope)
        assert isinstance(skipped, Skipped)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"mass": 5.32}, "slosh mass must be a number .* to less than the craft's mass, 5.32 kg"),
        ({"hinge": (0.5, 0.0, 0.0)}, "at rest that adds .* of 0.2045 kg m"),
        ({"length": 0.0}, "slosh length must be"),
        ({"direction": (1.0, 1.0, 0.0)}, "slosh direction must be a unit vector"),
        ({"hinge": (0.0, 0.0, 0.1)}, "in the plane of the centre of mass"),
        ({"damping": -1.0}, "slosh damping must be a number from 0"),
    ],
)
def test_what_no_pendulum_is_is_refused(changes, sentence):
    with pytest.raises(ConfigError, match=sentence):
        replace(SLOSHING, further_effectors=(replace(SLOSH, **changes),))


def test_what_knows_nothing_of_it_refuses():
    with pytest.raises(ConfigError, match=r"and \[propellant\]"):
        replace(SLOSHING, propellant=Propellant(0.5, 50.0))
    with pytest.raises(ConfigError, match="drift is clohessy-wiltshire"):
        rans.Engine(SLOSHING, InOrbit(), 2)
    with pytest.raises(ConfigError, match="free flight and uniform gravity"):
        Plant(SLOSHING, drift=ClohessyWiltshire(0.001))
    stiff = replace(SLOSHING, further_effectors=(replace(SLOSH, damping=50.0),))
    with pytest.raises(ConfigError, match="slosh damping must be at most"):
        rans.Engine(stiff, "go-to-pose", 2)
    for check in (check_craft, check_certifiable):
        with pytest.raises(ConfigError, match="slosh"):
            check(SLOSHING)


@pytest.mark.parametrize(
    "body",
    [BodyConditions(inertia=(0.03, 1.0)), BodyConditions(mass=30.0), BodyConditions(centre=0.4)],
)
def test_conditions_leave_inertia_to_the_craft_without_it(body):
    """Otherwise craft and rod would accelerate each other without end."""
    with pytest.raises(
        ConfigError,
        match="Conditions: the body leaves no inertia to 'sloshing' without its sloshing",
    ):
        rans.Engine(SLOSHING, "go-to-pose", 2, conditions=Conditions(body=body))


@pytest.mark.parametrize("is_alone", [True, False])
def test_bodies_for_which_friction_is_too_fast_are_refused(is_alone):
    """Steps are those of the designed craft; this flight would end in NaN."""
    slosh = replace(IN_SPACE_SLOSH, length=0.5, hinge=(0.0, -0.5, 0.0), direction=(0.0, 1.0, 0.0))
    craft = replace(IN_SPACE, further_effectors=(replace(slosh, damping=2.0),))
    rans.Engine(craft, "go-to-pose", 2)
    conditions = Conditions(body=BodyConditions(inertia=(0.05, 1.0)))
    conditions = conditions if is_alone else replace(Conditions(), others=(conditions,))
    with pytest.raises(ConfigError, match=r"stop the rod of .*narrow the ranges"):
        rans.Engine(craft, "go-to-pose", 2, conditions=conditions)


def _slowing(craft: Spacecraft, slosh: Slosh, shift: np.ndarray, rod: np.ndarray) -> float:
    """Fastest rate at which friction alone slows a rod that points anywhere, 1/s: an eigenvalue.

    Of the spins of craft and rod, by the kinetic energy of a rigid part and a point about their centre of mass.
    """

    def crossed(a: np.ndarray) -> np.ndarray:
        return np.cross(np.eye(3), a)

    rigid = craft.mass - slosh.mass
    reduced = rigid * slosh.mass / craft.mass
    hinge = np.array(slosh.hinge) - craft.centre_of_mass - shift
    at_rest = hinge + slosh.length * np.array(slosh.direction)
    between = at_rest * craft.mass / rigid
    arm = hinge + at_rest * slosh.mass / rigid
    # Inertia of the rigid part; the point's velocity relative to its centre is of both spins.
    inertia = np.array(craft.inertia) - reduced * crossed(between) @ crossed(between).T
    moves = np.hstack([crossed(arm), crossed(slosh.length * rod)])
    energy = reduced * moves.T @ moves
    energy[:3, :3] += inertia
    slip = np.hstack([-np.eye(3), np.eye(3)])
    axes = np.eye(6)[:, [2, 5]]
    if craft.dimension == 3:
        # A point has no inertia about its rod, about which friction does nothing.
        axes = np.hstack([np.eye(6)[:, :3], np.vstack([np.zeros((3, 3)), crossed(rod)])])
        axes = np.linalg.svd(axes)[0][:, :5]
        slip = (np.eye(3) - np.outer(rod, rod)) @ slip
    friction = slosh.damping * axes.T @ slip.T @ slip @ axes
    return float(np.linalg.eigvals(np.linalg.solve(axes.T @ energy @ axes, friction)).real.max())


@pytest.mark.parametrize("dimension", [2, 3])
def test_friction_stops_no_rod_faster_than_its_steps_are_for(dimension):
    """Rods and shifts of the centre of mass that point anywhere come near the fastest rate."""
    random = np.random.default_rng(dimension)
    if dimension == 2:
        slosh = replace(SLOSH, hinge=(-0.1, 0.0, 0.0), direction=(1.0, 0.0, 0.0), length=0.2)
        craft = replace(SLOSHING, further_effectors=(slosh,))
    else:
        slosh = IN_SPACE_SLOSH
        craft = IN_SPACE
    directions = random.normal(size=(600, 2, 3)) * (1.0, 1.0, dimension - 2.0)
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    for most in (0.0, 0.07):
        conditions = Conditions(body=BodyConditions(centre=most))
        bodies = slosh._extreme_bodies(craft, conditions)
        fastest = max(paces(slosh, craft, body)[1] for body in bodies)
        found = max(_slowing(craft, slosh, most * shift, rod) for shift, rod in directions)
        assert 0.9 * fastest < found < 1.0001 * fastest


@pytest.mark.parametrize(
    ("depth", "period", "mass", "height"),
    [
        (0.5, 1.74, 0.700, 1.517),
        (1.5, 1.48, 0.314, 0.734),
        (3.0, 1.48, 0.158, 0.825),
    ],
)
def test_the_pendulum_is_the_first_of_the_modes_in_a_published_table(depth, period, mass, height):
    """P. K. Malhotra, T. Wenk and M. Wieland, Structural Engineering International 10(3), 2000, table 1.

    By the depth over the radius: the period of the first mode under Earth's gravity in a tank of 1 m radius, s; the
    fraction of the liquid that all modes move; and the height over the depth at which their force acts on wall and
    bottom together, which for a pendulum is the hinge's. Modes after the first move less than 3 % of the liquid.
    """
    slosh = rans.Slosh.in_cylinder(1.0, 1.0, depth, (0, 0, 0), (0, -1, 0), 0.0, 9.81)
    assert 2.0 * math.pi / math.sqrt(9.81 / slosh.length) == pytest.approx(period, abs=0.006)
    k = jnp_zeros(1, 20)
    x = k * depth
    masses = 2.0 * np.tanh(x) / ((k * k - 1.0) * x)
    heights = 1.0 + (2.0 / np.cosh(x) - 1.0) / (x * np.tanh(x))
    assert slosh.mass == pytest.approx(masses[0], rel=1e-6)
    assert slosh.hinge[1] == pytest.approx(heights[0] * depth, rel=1e-6)
    assert masses.sum() == pytest.approx(mass, abs=2e-3)
    assert masses @ heights / masses.sum() == pytest.approx(height, rel=3e-3)
