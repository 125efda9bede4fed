"""Spacecraft: the paper's thruster tables by hand, and what cannot exist or be controlled."""

import dataclasses
import warnings

import pytest

from rans import ConfigError
from rans.base.pretrained import pretrained_folder
from rans.model.dynamics import thrust, wrench
from rans.model.spacecraft import Thruster
from rans.model.spacecraft_file import load_spacecraft, to_toml
from tests.support.crafts import nasty_planar, nasty_spatial
from tests.support.effector_crafts import WHEELED

DIAGONAL = 0.7071067811865476
"""Component of a unit vector at 45 degrees."""


@pytest.mark.parametrize(
    ("name", "mass", "inertia"),
    [
        ("floating-platform", 5.32, 0.2045),
        ("floating-platform-air-tank", 10.92, 0.4198),
    ],
)
def test_the_papers_platforms(name, mass, inertia):
    craft = load_spacecraft(name)
    assert (craft.name, craft.dimension, craft.mass, craft.radius) == (name, 2, mass, 0.31)
    assert craft.inertia[2][2] == pytest.approx(inertia, abs=5e-5)  # the table's digits
    assert craft.thrust_sharing == "none"
    assert craft.thrusters == load_spacecraft("floating-platform").thrusters


@pytest.mark.parametrize("agent", ["go-to-pose-2d", "go-to-pose-3d-faults"])
def test_craft_of_agents_are_those_that_are_shipped(agent):
    """Recorded commands of the agents say that thrusters push and turn as they did (`tests.test_recorded`)."""
    flown = load_spacecraft(str(pretrained_folder(agent) / "spacecraft.toml"))
    assert load_spacecraft(flown.name) == flown


def test_the_shared_platform_has_one_thrusters_worth():
    """1 N along a diagonal, 0.707 N along an axis, 0.31 N m: the original system's authority."""
    shared, platform = (load_spacecraft(f"floating-platform{end}") for end in ("-shared", ""))
    assert dataclasses.replace(shared, name=platform.name, thrust_sharing="none") == platform
    cases = (((0, 5), 1.0, 0.0), ((0, 2, 5, 7), DIAGONAL, 0.0), ((1, 3, 5, 7), 0.0, 0.31))
    for opened, push, torque in cases:
        total = wrench(shared, [float(k in opened) for k in range(8)])
        assert (total.force.norm(), total.torque) == pytest.approx((push, torque), abs=1e-15)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            lambda x: {"thrusters": (Thruster((0.1, 0.1, 0.0), (0.6, 0.8 + x, 0.0), 1.0),)},
            "unit vector",
        ),
        (
            lambda x: {"thrusters": (Thruster((0.1, 0.1, x), (0.6, 0.8, 0.0), 1.0),)},
            "in the plane of",
        ),
        (
            lambda x: {"thrusters": (Thruster((0.1, 0.1, 0.0), (0.6, 0.8, -x), 1.0),)},
            "in the plane of",
        ),
        (
            lambda x: {
                "dimension": 3,
                "inertia": ((0.3, x, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
            },
            "symmetric",
        ),
        (
            lambda x: {
                "dimension": 3,
                "inertia": ((0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 1.0 + x)),
            },
            "rigid body",
        ),
    ],
)
def test_rounding_passes_and_mistakes_do_not(change, says):
    """A part in two thousand million is rounding of a file, one in two hundred million is none."""
    platform = load_spacecraft("floating-platform")
    with warnings.catch_warnings(action="ignore"):  # one thruster cannot do much
        dataclasses.replace(platform, **change(5e-10))
        with pytest.raises(ConfigError, match=says):
            dataclasses.replace(platform, **change(5e-9))


@pytest.mark.parametrize("key", ["mass", "radius"])
@pytest.mark.parametrize(("fits", "does_not"), [(1e-9, 0.9e-9), (1e9, 1.1e9)])
def test_the_least_and_the_most(key, fits, does_not):
    platform = load_spacecraft("floating-platform")
    assert getattr(dataclasses.replace(platform, **{key: fits}), key) == fits
    with pytest.raises(ConfigError, match=f"{key} must be a number from 1e-09 to 1e\\+09"):
        dataclasses.replace(platform, **{key: does_not})


def test_control_depends_on_directions_not_on_strength_or_scale():
    """Twelve orders of magnitude between the nozzles leave every direction within reach."""
    for craft in (nasty_planar(), nasty_spatial()):
        forces = [10.0 ** (i % 3 * 4 - 6) for i in range(len(craft.thrusters))]
        thrusters = tuple(
            dataclasses.replace(t, force=f) for t, f in zip(craft.thrusters, forces, strict=True)
        )
        assert dataclasses.replace(craft, thrusters=thrusters).controls_every_direction


def test_every_shipped_spacecraft_is_controllable(shipped):
    assert shipped.controls_every_direction


@pytest.mark.parametrize("factor", [0.1, 2.5, 5.0])
def test_a_planar_craft_has_the_moment_about_z_and_no_others(factor, tmp_path):
    """Whatever stands beside it: it flies, is written and comes back."""
    craft = load_spacecraft("floating-platform")
    (a, _, _), (_, b, _), (_, _, c) = craft.inertia
    heavier = dataclasses.replace(
        craft, inertia=((a, 0.0, 0.0), (0.0, b, 0.0), (0.0, 0.0, factor * c))
    )
    assert heavier.inertia[2][2] == factor * c
    assert heavier == dataclasses.replace(
        craft,
        inertia=tuple(tuple(factor * x for x in row) for row in craft.inertia),
    )
    (tmp_path / "heavier.toml").write_text(to_toml(heavier))
    assert load_spacecraft(str(tmp_path / "heavier.toml")).inertia == heavier.inertia
    with pytest.raises(ConfigError, match="about z"):
        dataclasses.replace(craft, inertia=((a, 0.0, 0.0), (0.0, b, 0.0), (0.0, 0.0, -c)))


def test_wheels_take_numbers_beside_on_off_thrusters():
    plain = dataclasses.replace(WHEELED, wheels=())
    assert [one.has_only_thrusters for one in (WHEELED, plain)] == [False, True]
    assert [one.is_continuous for one in (WHEELED, plain)] == [True, False]
    assert [one.command_dtype for one in (WHEELED, plain)] == ["float32", "int8"]
    assert len(thrust(WHEELED, [1.0] * 8 + [-0.5])) == 8
