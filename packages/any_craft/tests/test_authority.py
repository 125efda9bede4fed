"""Columns of a craft's authority at states whose place of rest was worked out by hand."""

import math

import pytest
from rans_any_craft.authority import Authority, Seen, columns

OWN = Authority.of_numbers((0.2, 0.1, 0.05, 0.2, 0.08, 0.5, 0.3))
"""Accelerations along +x, -x, +y, -y, m/s^2, and about +z, -z, rad/s^2."""


REACH = (0.12, 0.06, 0.24, 0.1, 0.13, 0.11, 0.06, 0.2)
"""Accelerations along +x, -x, +y, -y, then between +x and +y, +x and -y, -x and +y, -x and -y, m/s^2."""
BETWEEN = math.hypot(0.3, 0.2) / (0.1 / 0.12 + 0.2 * math.sqrt(2.0) / 0.13)
"""Of (0.3, 0.2): 0.1 along +x takes 0.1 / 0.12 of a second, 0.2 sqrt(2) between +x and +y the rest."""


@pytest.mark.parametrize(
    ("velocity", "factor"),
    [
        # Of what is against the velocity, over the least one about the nearest axis (`OWN`).
        ((-0.3, 0.0), 0.12 / 0.1),
        ((0.3, 0.0), 0.06 / 0.05),
        ((0.0, -0.3), 0.24 / 0.2),
        ((0.0, 0.3), 0.1 / 0.08),
        ((-0.2, -0.2), 0.13 / 0.1),
        ((-0.2, 0.2), 0.11 / 0.1),
        ((0.2, -0.2), 0.06 / 0.05),
        ((0.2, 0.2), math.sqrt(2.0)),  # the largest, in place of 0.2 / 0.05
        ((-0.3, -0.2), BETWEEN / 0.1),
    ],
)
def test_a_velocity_rests_after_braking_as_the_craft_can_against_it(velocity, factor):
    """The accelerations of both axes are larger by a factor."""
    against = [(0.05 if velocity[0] > 0 else 0.1), (0.08 if velocity[1] > 0 else 0.2)]
    error = [
        v * 0.2 + v * abs(v) / (2.0 * factor * a) for v, a in zip(velocity, against, strict=True)
    ]
    own = OWN._replace(reach=REACH)
    found = columns(Seen(error, 1.0, [0.0], velocity, [0.0]), own)[4:6]
    assert found == pytest.approx([0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(
    ("way", "factor"), [((1.0, 0.0), 1.2), ((0.6, 0.4), BETWEEN / 0.1), ((-3.0, -3.0), 2.0**0.5)]
)
def test_the_speed_of_approach_is_that_of_the_acceleration_toward_the_goal(way, factor):
    """No velocity is missing at it: u = 0.7 a brakes from sqrt(k k + 2 u d) - k, with k of three periods of u."""
    usable, distance = 0.7 * factor * 0.05, math.hypot(*way)
    knee = 3.0 * usable * 0.2
    speed = math.sqrt(knee**2 + 2.0 * usable * distance) - knee
    velocity = [speed * x / distance for x in way]
    own = OWN._replace(reach=REACH)
    found = columns(Seen(way, 1.0, [0.0], velocity, [0.0]), own)[6:8]
    assert found == pytest.approx([0.0, 0.0], abs=1e-9)


def test_a_craft_at_rest_at_its_goal_is_given_zeros_with_or_without_the_ways():
    rows = [
        columns(Seen([0.0, 0.0], 1.0, [0.0], [0.0, 0.0], [0.0]), own)
        for own in (OWN, OWN._replace(reach=REACH))
    ]
    assert rows[0] == rows[1]
    assert not any(rows[1][:12])
