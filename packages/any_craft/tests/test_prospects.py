"""What is said before the flight: whether a craft settles, and which thrusters it can lose."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_any_craft.prospects import Prospect, slips, spared

from rans import ConfigError, Spacecraft, Thruster
from rans.model.actuators import Pulsed
from rans.model.spacecraft_file import load_spacecraft

PLATFORM = load_spacecraft("floating-platform")


def three_pairs(lever: float) -> Spacecraft:
    """Six thrusters: pairs along x and y through the centre of mass, and two that turn it with a lever, m."""
    layout = (
        ((0.2, 0.0), (-1.0, 0.0)),
        ((-0.2, 0.0), (1.0, 0.0)),
        ((0.0, 0.2), (0.0, -1.0)),
        ((0.0, -0.2), (0.0, 1.0)),
        ((0.2, lever), (-1.0, 0.0)),
        ((-0.2, lever), (1.0, 0.0)),
    )
    thrusters = tuple(Thruster((*at, 0.0), (*way, 0.0), 1.0) for at, way in layout)
    return replace(PLATFORM, name="pairs", thrusters=thrusters)


def test_a_pulse_by_hand():
    """1 N on 5 kg for 0.2 s gives 0.04 m/s, 0.8 cm a period; at 0.2 m and 0.2 kg m^2 it turns by 0.04 rad."""
    inertia = tuple(map(tuple, 0.2 * np.eye(3)))
    craft = replace(three_pairs(0.2), mass=5.0, inertia=inertia)
    found = Prospect.of(craft, 0.2)
    assert found.shift == pytest.approx(0.2 / 5.0 * 0.2)
    assert found.turn == pytest.approx(0.2 * 0.2 / 0.2 * 0.2)
    assert "moves it 0.8 cm and turns it 2.29 degrees" in found.text(0.2)


def test_a_large_turn_is_no_power_of_ten():
    assert "turns it 230 degrees" in Prospect.of(PLATFORM, 0.1)._replace(turn=4.0143).text(0.1)


def test_only_thrusters_whose_loss_leaves_a_margin_are_spared():
    assert spared(PLATFORM, 0.1).startswith(
        "A file without any one of its thrusters still settles."
    )
    craft = three_pairs(0.15)
    # The pairs through the centre leave no torque about z but by the last two.
    sentence = spared(craft, 0.2)
    assert "these it may not: 0, 1, 2, 3, 4, 5 (cannot be steered)." in sentence
    with pytest.raises(ConfigError):
        Prospect.of(replace(craft, thrusters=craft.thrusters[:4]), 0.2)


def test_the_shortest_pulse_is_printed():
    """Three of forty steps of 0.1 s."""
    valves = replace(PLATFORM, actuators=Pulsed(40, 3))
    assert "The shortest pulse has 7.5 ms." in Prospect.of(valves, 0.1).text(0.1)
    assert "The shortest pulse" not in Prospect.of(PLATFORM, 0.1).text(0.1)


def changed(number: int, **changes: Any) -> Spacecraft:
    """The platform with other values of one thruster."""
    thrusters = list(PLATFORM.thrusters)
    thrusters[number] = replace(thrusters[number], **changes)
    return replace(PLATFORM, thrusters=tuple(thrusters))


def test_reversed_copied_and_lonely_thrusters_are_asked_about():
    assert list(slips(PLATFORM)) == []
    x, y, z = PLATFORM.thrusters[5].direction
    # Thrusters 4 and 5 push against each other at one corner: now either may be the wrong one.
    reversed_, _ = slips(changed(5, direction=(-x, -y, z)))
    assert "force of thruster 4 or 5 reversed the margin would be 2 in place of 1" in reversed_
    first = PLATFORM.thrusters[0]
    (copied,) = slips(changed(3, position=first.position, direction=first.direction))
    assert "Thrusters 0 and 3 have one position and direction" in copied
    (lonely,) = slips(changed(6, supply=1))
    assert "Thruster 6 alone has supply 1" in lonely
