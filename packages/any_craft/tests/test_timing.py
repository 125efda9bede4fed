"""Control periods and lengths of episodes of craft from files."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from rans_any_craft.timing import timing_for

from rans import TASKS, ConfigError, RansWarning, Spacecraft, Thruster, Timing
from rans.evaluation.compare.entrants import contest_of, enlist
from rans.evaluation.fly.contestants import contestant
from rans.fast.learn.config import training
from rans.model.spacecraft_file import load_spacecraft, to_toml
from rans.policy.timing import timing_of_file
from tests.support.crafts import heavier

PLATFORM = load_spacecraft("floating-platform")


def slow() -> Spacecraft:
    """The platform with 20 times the mass and inertia: at 0.02 m/s^2 it needs longer episodes than its task's."""
    return heavier(PLATFORM, 20.0, 20.0, name="slow")


def test_every_contestant_of_a_file_flies_the_same_length_and_period(tmp_path):
    file = tmp_path / "slow.toml"
    file.write_text(to_toml(slow()))
    chosen = timing_for(slow(), Timing())
    assert chosen.episode_steps * chosen.control_period > 1.5 * 25.0
    for name in (
        f"any-craft-2d@{file}",
        f"lqr:go-to-pose-2d@{file}",
        f"switching:go-to-pose@{file}",
        f"{file}",
    ):
        assert contestant(name).judged.timing == chosen, name
    assert training("go-to-pose", str(file)).timing == chosen
    # Tasks that no agent for any craft flies keep their own, and craft that come with RANS those of their tasks.
    for task in ("track-velocity-heading", "go-to-position"):
        assert timing_of_file(slow(), TASKS[task](), str(file)) == TASKS[task]().timing
    assert contestant("lqr:go-to-pose-2d@floating-platform").timing == Timing()


def test_a_period_is_set_for_who_can_act_at_any(tmp_path):
    file = tmp_path / "slow.toml"
    file.write_text(to_toml(slow()))
    length = timing_for(slow(), Timing(), 0.1).episode_steps * 0.1
    for name in (f"{file}", f"lqr:go-to-pose-2d@{file}", "lqr:go-to-pose-2d"):
        timing = contestant(name, period=0.1).timing
        assert timing.control_period == 0.1
        expected = length if "slow" in name else 25.0
        assert timing.episode_steps * 0.1 == pytest.approx(expected)
    with pytest.raises(ConfigError, match=r"every 0.2 s.*0.1 s"):
        contestant("go-to-pose-2d", period=0.1)
    # Beside an earlier contestant a controller acts at that one's rate, and a trained agent cannot.
    contest = contest_of(f"{file}", 1, period=0.1)
    assert enlist(f"lqr:go-to-pose-2d@{file}", contest).name == "LQR"


def test_what_cannot_be_steered_is_refused_by_its_axis_before_its_length():
    """Four thrusters that cannot push it one way along x: rounding leaves 1e-18 m/s^2 there."""
    layout = (
        ((0.2, 0.05), (-1.0, 0.2)),
        ((-0.2, 0.05), (1.0, 0.25)),
        ((0.1, -0.2), (0.3, 1.0)),
        ((-0.05, 0.2), (-0.1, -1.0)),
    )
    thrusters = tuple(
        Thruster((*at, 0.0), (way[0] / math.hypot(*way), way[1] / math.hypot(*way), 0.0), 0.5)
        for at, way in layout
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RansWarning)
        craft = replace(PLATFORM, name="odd", thrusters=thrusters, centre_of_mass=(0.0, 0.0, 0.0))
    with pytest.raises(ConfigError, match="cannot accelerate it"):
        timing_for(craft, Timing())


def test_a_craft_of_wrong_units_keeps_the_length_of_its_task_and_is_refused_by_the_agent():
    """1e11 times the mass over force takes 3e5 times as long: 13 s for 4 m become 1.5 months, of 0.2 s each."""
    weak = tuple(replace(one, force=1e-3 * one.force) for one in PLATFORM.thrusters)
    craft = heavier(PLATFORM, 1e8, 1e8, thrusters=weak)
    assert timing_of_file(craft, TASKS["go-to-pose"](), "heavy.toml") == Timing()
    with pytest.raises(ConfigError, match="mass in g"):
        timing_for(craft, Timing())


@pytest.mark.parametrize(
    ("name", "mass", "moment", "arm", "force", "period"),
    [
        # Pulses of 1 N turn it by 0.8 x 0.04 = 0.032 rad in 0.2 s, and those of 0.4 N by 0.013 rad.
        ("free-flyer", 5.32, 0.2, 0.16, 1.0, 0.1),
        ("free-flyer", 5.32, 0.2, 0.16, 0.4, 0.2),
        # Throttles turn it by 0.02 and 0.1 rad in 1 s, 0.025 in 0.5.
        ("astrobee-iss", 50.0, 5.0, 0.1, 1.0, 1.0),
        ("astrobee-iss", 50.0, 5.0, 0.5, 1.0, 0.5),
    ],
)
def test_thrusters_that_turn_a_craft_far_in_space_are_commanded_often(
    name, mass, moment, arm, force, period
):
    """Four on levers (m) along every axis, on a ball of so many kg and kg m^2."""
    unit = np.eye(3)
    thrusters = tuple(
        Thruster(tuple(arm * side * unit[(axis + 1) % 3]), tuple(sign * unit[axis]), force)
        for axis in range(3)
        for side in (-1.0, 1.0)
        for sign in (-1.0, 1.0)
    )
    craft = replace(
        load_spacecraft(name),
        wheels=(),
        thrusters=thrusters,
        mass=mass,
        inertia=tuple(map(tuple, moment * unit)),
        centre_of_mass=(0.0, 0.0, 0.0),
    )
    timing = timing_for(craft, Timing())
    assert timing.control_period == period
    assert timing.episode_steps * period >= 25.0
