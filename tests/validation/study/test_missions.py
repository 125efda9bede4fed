"""What missions declare is checked: right as it is, and every kind of planted error is reported by name."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
import rans_missions.tasks.land
from rans_missions.tasks import Avoid, Inspect, Land
from rans_missions.tasks.avoid import Zones

from rans.model.fields import Vec3
from rans.scenario import draws
from rans.tasks import TASKS
from rans.tasks.shapes import GlideSlope
from validation.study.missions import MISSIONS, mission_checks


def wrong() -> set[str]:
    """Names of the checks that fail, in both dimensions."""
    return {check.name for check in (*mission_checks(2), *mission_checks(3)) if not check.passed}


def test_missions_are_as_declared() -> None:
    assert wrong() == set()


def test_every_mission_is_declared() -> None:
    """A mission ends with a success; those of `TASKS` that are not missions last until their time is up."""
    for name, task_class in TASKS.items():
        task = task_class()
        for size in task.dimensions:
            own = draws(0, 2)
            if task.done(*task.sample(own.random(size, own.first))) is not None or name == "avoid":
                assert (name, size) in MISSIONS


class _HalfTheSpeed(Inspect):
    """Starts up to 0.8 n r instead of 0.8 of 2 n r."""

    def sample(self, random: Any) -> Any:
        start, goal = super().sample(random)
        return replace(start, v=start.v.scale(0.5)), goal


class _CrossingBefore(Avoid):
    """Zones that are at their offset before the start instead of after it."""

    def sample(self, random: Any) -> Any:
        start, goal = super().sample(random)
        zones = tuple(replace(z, v=z.v.scale(-1.0)) for z in goal.notes.zones)
        return start, replace(goal, notes=Zones(zones))


def _above(apex: Vec3, up: Vec3, angle: float) -> GlideSlope:
    """A slope whose apex lies above the site."""
    return GlideSlope(apex.scale(-1.0), up, angle)


@pytest.mark.parametrize(
    ("name", "planted", "check"),
    [
        ("inspect", _HalfTheSpeed(), "tasks: inspect draws speed over 2 n r"),
        ("inspect", Inspect(keep_out=15.1), "tasks: margins of inspect"),
        ("avoid", _CrossingBefore(), "tasks: avoid draws offset of zones in the first 12 s"),
        ("land", Land(start_altitude=(1450.0, 1750.0)), "tasks: land draws height"),
        ("land", Land(glide_slope=math.radians(5.0)), "tasks: margins of land"),
        ("land", Land(tilt_limit=math.radians(41.0)), "tasks: margins of land"),
    ],
)
def test_what_is_planted_is_named(
    name: str, planted: Any, check: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    others = {known: TASKS[known] for known in TASKS}
    monkeypatch.setattr("validation.study.missions.TASKS", {**others, name: lambda: planted})
    assert wrong() == {check}


def test_a_glide_slope_from_above_the_site_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rans_missions.tasks.land, "GlideSlope", _above)
    assert wrong() == {"tasks: margins of land"}
