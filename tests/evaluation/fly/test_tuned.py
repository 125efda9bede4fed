"""Tuned settings are used where they fit, and nowhere else."""

from __future__ import annotations

import os
from dataclasses import replace

import pytest

from rans import LQR, TASKS, ConfigError, GoToPose, Timing
from rans.control.regulator import Deadband, Weights
from rans.episode.scenario import TUNING_SEED
from rans.episode.step import Setup
from rans.evaluation.fly.make_controller import controller
from rans.evaluation.fly.tuned import OWN, SHIPPED, Tuned, arguments, defaults, file_name, tuned
from rans.model.spacecraft_file import load_spacecraft, parse_spacecraft
from rans.randomization.conditions_file import load_conditions

SETUP = Setup(load_spacecraft("floating-platform"), GoToPose(), Timing())
FILES = sorted(SHIPPED.glob("*.json"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_what_ships_fits_what_it_was_tuned_for(file):
    found = Tuned.read(file)
    craft = parse_spacecraft(found.spacecraft, file.name)
    task = TASKS[found.task]()
    conditions = load_conditions("lab") if found.conditions else None
    setup = Setup(load_spacecraft(craft.name), task, Timing(found.control_period), conditions)
    assert tuned(found.controller, setup) == found
    label = "lab" if found.conditions else ""
    assert file.name == file_name(found.controller, setup.craft, task, label)
    assert found.costs["tuned"] < found.costs["default"]
    assert found.seed == TUNING_SEED
    controller(found.controller, setup)


@pytest.mark.parametrize(
    "change",
    [
        {"craft": replace(SETUP.craft, mass=6.0)},
        {"task": GoToPose(position_tolerance=0.04)},
        {"task": TASKS["go-to-position"]()},
        {"timing": Timing(0.1)},
    ],
    ids=["mass", "tolerance", "task", "rate"],
)
def test_does_not_fit_another_setup(change):
    assert tuned("switching", SETUP) is not None
    assert tuned("switching", SETUP._replace(**change)) is None


def test_fits_other_starts_and_lengths():
    """What is judged from elsewhere and longer, as by protocols, is the same to a controller."""
    longer = SETUP._replace(task=SETUP.task.for_evaluation(), timing=Timing(episode_steps=250))
    assert tuned("switching", longer)


def test_spacecraft_of_one_name_have_files_apart():
    """The name is whatever a user's file says, also a path."""
    task = TASKS["go-to-pose"]()
    known = load_spacecraft("floating-platform")
    crafts = [
        known,
        replace(known, mass=7.0),
        replace(known, mass=8.0),
        replace(known, name="../../x"),
    ]
    names = [file_name("lqr", craft, task) for craft in crafts]
    assert names[0] == "lqr-go-to-pose-floating-platform.json"
    assert len(set(names)) == len(names)
    assert not any("/" in name for name in names)


@pytest.fixture
def shipped(here) -> Tuned:
    """Settings that ship, where a user has none."""
    found = tuned("lqr", SETUP)
    assert found is not None
    return found


def test_of_own_ones_the_newest_serves(shipped):
    """An older version wrote the same by another name."""
    for age, name in ((0, "z"), (60, "a")):
        replace(shipped, settings={"weights.position": 1.0 + age}).write(OWN / f"{name}.json")
        os.utime(OWN / f"{name}.json", (1e9 - age, 1e9 - age))
    found = tuned("lqr", SETUP)
    assert found is not None
    assert found.settings == {"weights.position": 1.0}


def test_own_goes_first(shipped):
    own = replace(shipped, settings={"weights.position": 1.5})
    own.write(OWN / "mine.json")
    assert tuned("lqr", SETUP) == own
    replace(shipped, settings={"weights.position": -1.0}).write(OWN / "mine.json")
    with pytest.raises(ConfigError, match=r"mine\.json: .*position must be"):
        tuned("lqr", SETUP)


def gained(
    craft: object, task: object, timing: object, gain: float = 0.6, weights: object = None
) -> None:
    """Takes a number of its own."""


def test_a_setting_may_be_an_argument_itself():
    assert defaults(gained, ["gain"]) == {"gain": 0.6}
    assert arguments(gained, {"gain": 1.5}) == {"gain": 1.5}
    with pytest.raises(ConfigError, match="are not those of the controller"):
        arguments(gained, {"damping": 1.5})


@pytest.mark.parametrize("key", ["gian", "weights", "weights.position", "craft", "gain.x"])
def test_what_is_no_setting_is_a_sentence(key):
    with pytest.raises(
        ConfigError, match=f"names '{key}', which must be an argument of the controller"
    ):
        defaults(gained, [key])


def test_settings_become_arguments():
    given = arguments(LQR, {"weights.position": 1.5, "deadband.spin": 0.2, "weights.spin": 0.3})
    assert given == {"weights": Weights(position=1.5, spin=0.3), "deadband": Deadband(spin=0.2)}
    usual = {"weights.position": 0.6, "deadband.share": 0.8}
    assert defaults(LQR, usual) == usual
    with pytest.raises(ConfigError, match="are not those of the controller"):
        arguments(LQR, {"weights.mass": 1.0})
