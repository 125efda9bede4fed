"""What the judge's valves are valve_commands, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from rans.model.actuators import ON_OFF, Pulsed, Throttle
from rans.reference.nozzles import valve_commands


def listed(actuators: object, *duties: float) -> list[tuple[float, list[float]]]:
    """Of one spacecraft and a period of 2 s."""
    parts = valve_commands(actuators, np.array([duties]), 2.0)  # type: ignore[arg-type]
    return [(float(begin), opened[0].tolist()) for begin, opened in parts]


FROM_TWO = [
    (0.0, [1.0, 1.0, 1.0, 1.0]),
    (0.4, [0.0, 1.0, 1.0, 1.0]),
    (0.6, [0.0, 0.0, 0.0, 1.0]),
]


@pytest.mark.parametrize(
    ("least", "expected"),
    [
        # Tenths of 2 s: 0.2 is 2 counts, 0.25 rounds up to 3, 0.34 down to 3, all of it stays open.
        (0, FROM_TWO),
        (2, FROM_TWO),
        # Of 3 counts at least: the first never opens.
        (3, [(0.0, [0.0, 1.0, 1.0, 1.0]), (0.6, [0.0, 0.0, 0.0, 1.0])]),
        (4, [(0.0, [0.0, 0.0, 0.0, 1.0])]),
    ],
)
def test_no_pulse_is_shorter_than_the_least(least, expected):
    found = listed(Pulsed(10, least), 0.2, 0.25, 0.34, 1.0)
    assert [opened for _, opened in found] == [opened for _, opened in expected]
    assert [begin for begin, _ in found] == pytest.approx([begin for begin, _ in expected])


@pytest.mark.parametrize("kind", [ON_OFF, Throttle()], ids=str)
def test_other_valves_stay_as_they_are_told(kind):
    assert listed(kind, 0.0, 1.0) == [(0.0, [0.0, 1.0])]
