"""What a verdict is about: every range of conditions, and requirement, length and starts by hand."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

from rans_assurance.scope import conditions_texts, meaning, scope

import rans
from rans.display import meanings
from rans.episode import Setup
from rans.model.timing import Timing
from rans.randomization.conditions import (
    BodyConditions,
    Conditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.scenario import scenarios
from rans.tasks import GoToPose

NUMBERS = set(
    """
    body.mass body.inertia
    thrusters.thrust thrusters.pressure thrusters.droop thrusters.noise
    faults.count faults.kinds faults.share faults.among faults.thrusters
    sensors.position.dropout sensors.attitude.dropout sensors.velocity.dropout sensors.spin.dropout
    """.split()  # noqa: SIM905 - as a list it is a line for each
)
"""Settings without a unit: factors, shares, probabilities, numbers and names."""


def leaf_settings(settings: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Names and docstrings of all settings, as a reader of the source has them."""
    texts = meanings(type(settings))
    for one in fields(settings):
        value = getattr(settings, one.name)
        if is_dataclass(value):
            yield from leaf_settings(value, f"{prefix}{one.name}.")
        elif one.name not in ("description", "weight", "others"):
            yield f"{prefix}{one.name}", texts[one.name]


def test_every_setting_says_what_it_is_and_its_unit() -> None:
    """A new setting without a unit, or whose docstring begins otherwise, is found here."""
    without = set()
    for name, text in leaf_settings(Conditions()):
        what, unit, factor = meaning(name, text)
        assert len(what) > 8, name
        assert not what.endswith((",", "(", " ")), what
        assert factor > 0
        if not unit:
            without.add(name)
    assert without == NUMBERS


def test_ranges_are_stated_with_their_units() -> None:
    conditions = Conditions(
        BodyConditions(mass=(0.8, 1.2)),
        ThrusterConditions(latency=(0.0, 0.05), misalignment=0.1),
        sensors=SensorsConditions(position=SensorConditions(noise=0.02)),
    )
    texts = [*conditions_texts(conditions)]
    ends = ["0.8 to 1.2", "0 to 0.05 s", "5.73 deg", "2 cm"]
    assert [text.rpartition(": ")[2] for text in texts] == ends


def test_each_part_of_a_mixture_has_its_share() -> None:
    light = Conditions(BodyConditions(mass=0.5, inertia=1.5), weight=3.0)
    mixture = replace(Conditions(BodyConditions(mass=2.0, inertia=1.5)), others=(light,))
    both, heavy, other = conditions_texts(mixture)
    assert both.endswith(": 1.5")
    assert heavy.startswith("in 25 % of the flights: ")
    assert heavy.endswith(": 2")
    assert other.startswith("in 75 % of the flights: ")
    assert other.endswith(": 0.5")


def test_requirement_length_and_starts_by_hand() -> None:
    """188 periods of 0.2 s are 37.6 s; the last fifth are 37 instants, of which the first is number 152, 30.4 s."""
    craft = rans.load_spacecraft("floating-platform")
    task = GoToPose(position_tolerance=0.07).for_evaluation()
    setup = Setup(craft, task, Timing(episode_steps=188))
    stated = scope(setup, scenarios(task, craft, 2026, 1000))
    said = dict(stated)
    for text in ("position within 7 cm", "attitude within 5 deg", "from 30.4 s on"):
        assert text in said["requirement"]
    # Of 1,000 distances between 3 and 4 m the ends are nearer than 0.5 cm to these with a chance of 99.3 % each.
    assert "position error 3 to 4 m" in said["starts"]
    assert "speed 0 m/s" in said["starts"]
    assert ("length of a flight", "37.6 s: 188 control periods of 0.2 s") in stated
    assert (
        "a flight also fails",
        "distance from the goal beyond which an episode fails: 8 m",
    ) in stated
