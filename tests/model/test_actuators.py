"""What thrusters take and do within a control period, by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rans.model.actuators import Pulsed, Throttle


def listed(actuators: Any, *command: float) -> list[tuple[float, list[float]]]:
    """Pieces with a length, shares of the period rounded to eight digits."""
    return [
        (round(float(share), 8), [float(c) for c in part])
        for share, part in actuators.pulses(command)
        if share > 0
    ]


@pytest.mark.parametrize("duty", [0.0, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("actuators", [Pulsed(10), Throttle(), Throttle(0.1, 0.6)])
def test_steady_actuators_give_the_mean_force_in_one_piece(actuators, duty):
    mean = sum(share * given for share, (given,) in listed(actuators, duty))
    ((share, (steady,)),) = listed(actuators.steady(), duty)
    assert (share, steady) == (1.0, pytest.approx(mean))


def test_pulses_open_at_the_beginning_and_shut_in_order():
    # 0.3, 0.75 and 0 of 100 counts.
    assert listed(Pulsed(100), 0.3, 0.75, 0.0) == [
        (0.3, [1.0, 1.0, 0.0]),
        (0.45, [0.0, 1.0, 0.0]),
        (0.25, [0.0, 0.0, 0.0]),
    ]
    # A valve that is open to the end is so in the last piece, too, whose length is zero.
    *_, last = Pulsed(100).pulses((0.5, 1.0))
    assert last == (0.0, [0.0, 1.0])


def test_few_counts_are_pieces_of_equal_length():
    # 0.6 of two counts is 1.2, that is one; 0.75 is one and a half, rounded up to two.
    assert listed(Pulsed(2), 0.6, 0.75) == [(0.5, [1.0, 1.0]), (0.5, [0.0, 1.0])]


@pytest.mark.parametrize(
    ("duty", "counts"), [(0.02, 0), (0.044, 0), (0.046, 5), (0.05, 5), (1.0, 100)]
)
def test_no_pulse_is_shorter_than_the_least(duty, counts):
    opened = sum(share for share, part in listed(Pulsed(100, 5), duty) if part[0])
    assert opened == pytest.approx(counts / 100)


@pytest.mark.parametrize("valves", [Pulsed(10), Pulsed(10, 1), Pulsed(100, 5)])
def test_the_shortest_pulse_is_the_least_that_any_command_gives(valves):
    given = np.array(valves.opened([np.linspace(0.0, 1.0, 1001)]))
    assert valves.shortest == pytest.approx(given[given > 0.0].min())


def test_arrays_shut_each_in_its_own_time():
    duty = np.array([[0.2, 0.9], [0.6, 0.1], [0.4, 0.4]])
    open_for = sum(np.array(part) * share for share, part in Pulsed(10).pulses(tuple(duty)))
    np.testing.assert_allclose(open_for, duty, rtol=0, atol=1e-15)
    first = next(Pulsed(10).pulses(tuple(duty)))
    np.testing.assert_array_equal(
        first[0], [0.2, 0.1]
    )  # until the first valve of each spacecraft shuts
    np.testing.assert_array_equal(first[1], np.ones((3, 2)))


@pytest.mark.parametrize("least", [0.1, 0.3, 0.6])
def test_a_command_below_half_the_least_level_shuts_an_engine(least):
    """From half of it on an engine is lit at its least level, and above that follows its command."""
    given = [0.0, 0.49 * least, 0.51 * least, 0.99 * least, 0.9]
    engine = Throttle(least)
    assert [*engine.levels(given)] == pytest.approx([0.0, 0.0, least, least, 0.9])
    arrays = engine.levels([np.array(given)])
    np.testing.assert_allclose(arrays[0], [0.0, 0.0, least, least, 0.9])
