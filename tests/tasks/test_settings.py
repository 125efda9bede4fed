"""What settings may be, and numbers replaced in them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import pytest

from rans import ConfigError, GoToPose, MultiTask
from rans.tasks.settings import check_settings, map_settings


@dataclass(frozen=True)
class Settings:
    """One of every kind."""

    scale: float = 1.0
    price_weight: float = 0.0
    rest_angle: float = 0.0
    spawn_distance: tuple[float, float] = (0.0, 4.5)
    fail_distance: float = 4.6


@dataclass(frozen=True)
class Choice:
    """A setting that is no number."""

    spins: bool = False


@pytest.mark.parametrize("spins", [False, True])
def test_a_truth_value_may_be_either(spins):
    check_settings(Choice(spins))


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"scale": 1e-300},
        {"scale": 3},
        {"price_weight": 2.0},
        {"rest_angle": 0.1},
        {"spawn_distance": (0.0, 0.0)},
        {"spawn_distance": (2.0, 2.0)},
        {"fail_distance": math.nextafter(4.5, 5.0)},
    ],
)
def test_what_works(change):
    check_settings(replace(Settings(), **change))


def test_numbers_by_name():
    seen = {}

    def note(name, *numbers):
        seen[name] = numbers
        return numbers[0] + 100.0

    one = Settings()
    two = Settings(scale=2.0, spawn_distance=(1.0, 4.0))
    mapped = map_settings(note, one, two)
    assert seen == {
        "scale": (1.0, 2.0),
        "price_weight": (0.0, 0.0),
        "rest_angle": (0.0, 0.0),
        "spawn_distance.0": (0.0, 1.0),
        "spawn_distance.1": (4.5, 4.0),
        "fail_distance": (4.6, 4.6),
    }
    assert mapped == Settings(101.0, 100.0, 100.0, (100.0, 104.5), 104.6)
    assert one == Settings()


def test_numbers_of_tasks_within_a_task():
    names = []
    tasks = MultiTask(tasks=("go-to-pose", "track-twist"))
    same = map_settings(lambda name, number: names.append(name) or number, tasks)
    assert same == tasks
    assert {"go_to_pose.thrust_weight", "track_twist.target_speed.1"} <= set(names)
    assert not [
        name for name in names if name.startswith((".", "tasks"))
    ]  # names of tasks are no numbers


def test_what_a_map_makes_is_checked_where_that_is_asked():
    negative = map_settings(lambda name, number: -number, GoToPose())
    assert negative.fine_scale == -GoToPose().fine_scale
    with pytest.raises(ConfigError, match="from 0 to"):
        map_settings(lambda name, number: -number, GoToPose(), checked=True)
