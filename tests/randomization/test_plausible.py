"""Conditions that were hardly meant: units mistaken, and numbers that cannot be flown."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import pytest
from rans_assurance.stress.effects import applicable_effects
from rans_robot.functions import twin

import rans
from rans import (
    BodyConditions,
    Conditions,
    ConfigError,
    DisturbanceConditions,
    Engine,
    GoToPose,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
    Timing,
)
from rans.model.spacecraft_file import SPACECRAFT, load_spacecraft
from rans.randomization.conditions_file import CONDITIONS
from rans.randomization.plausible import implausible
from tests.support.engines import PLATFORM


def sensed(**of: Any) -> Conditions:
    return Conditions(sensors=replace(SensorsConditions(), **of))


HARDLY_MEANT = {
    "attitude noise of 30 degrees": sensed(attitude=SensorConditions(noise=30.0)),
    "attitude noise of 0.5 rad": sensed(attitude=SensorConditions(noise=0.5)),
    "position noise of 5 mm": sensed(position=SensorConditions(noise=5.0)),
    "force of 250 mN": Conditions(disturbances=DisturbanceConditions(force=250.0)),
    "torque of 1e6": Conditions(disturbances=DisturbanceConditions(torque=1e6)),
    "mass in percent": Conditions(body=BodyConditions(mass=(75.0, 125.0))),
    "mass of 11.9 kg": Conditions(body=BodyConditions(mass=11.9)),
    "latency of 30 ms": Conditions(thrusters=ThrusterConditions(latency=30.0)),
    "kick of 500 mN s": Conditions(disturbances=DisturbanceConditions(kick=500.0)),
    "delay of 200 ms": sensed(delay=200.0),
}


@pytest.mark.parametrize("slip", HARDLY_MEANT)
def test_a_slip_is_named(slip):
    assert len(implausible(HARDLY_MEANT[slip], PLATFORM)) == 1
    mixed = replace(
        Conditions(disturbances=HARDLY_MEANT[slip].disturbances), others=(HARDLY_MEANT[slip],)
    )
    assert len(implausible(mixed, PLATFORM)) == 1


DOORS: dict[str, Callable[[Path], object]] = {
    "assure": lambda file: rans.assure("mpc:go-to-pose-2d", conditions=file, output=file),
    "engine": lambda file: Engine(PLATFORM, GoToPose(), 2, conditions=file),
    "environment": lambda file: gymnasium.make("rans/GoToPose2D-v0", conditions=file),
    "evaluate": lambda file: rans.load_agent("go-to-pose-2d").under(file),
    "stress": lambda file: rans.stress("go-to-pose-2d", conditions=[str(file)], slow_episodes=0),
    "tune": lambda file: rans.tune("lqr", conditions=file, output=file / "lqr.json"),
    "twin": lambda file: twin(PLATFORM, conditions=file, start=("nowhere",)),
    "validate": lambda file: rans.validate(PLATFORM, conditions=file, layer="none"),
}
"""What takes conditions, with something else wrong where a flight would begin."""


@pytest.mark.parametrize("door", DOORS)
def test_conditions_are_doubted_once_wherever_they_are_taken(door, tmp_path):
    (tmp_path / "mine.toml").write_text("[sensors.position]\nnoise = 5\n")
    with pytest.warns(UserWarning, match="distance in mm") as said, suppress(ConfigError):
        DOORS[door](tmp_path / "mine.toml")
    assert len(said) == 1


def test_what_rans_ships_is_meant():
    """Every condition with every craft, and every size of `rans stress`."""
    for name in SPACECRAFT:
        craft = load_spacecraft(name)
        every = [
            level.conditions
            for one in applicable_effects(craft, Timing())
            for level in one.levels()
        ]
        assert not [text for one in every for text in implausible(one, craft)], name
    for name in CONDITIONS:
        assert not implausible(CONDITIONS[name].conditions, PLATFORM), name
