"""Least impulses in closed form: against SciPy's linear program, and where they lead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rans_missions.convex.impulses import Impulses
from rans_missions.convex.rendezvous import Meeting

from tests.support.rendezvous import meeting_of, program


def at_a_point(deadline: float, count: int) -> tuple[Meeting, np.ndarray]:
    """A meeting at the place itself instead of within half a metre of it, and states of starts."""
    meeting, states, _, _ = meeting_of(deadline, count, 4)
    return replace(meeting, position_tolerance=0.0), states


@pytest.mark.parametrize("periods", [40, 100, 190])
def test_least_impulses_are_those_of_a_linear_program(periods: int) -> None:
    meeting, states = at_a_point(2000.0, 6)
    found = Impulses(meeting).firings(states, periods)
    expected = [program(state, periods) for state in states]
    # SciPy's program is solved to about 1e-7.
    np.testing.assert_allclose(found.impulse, expected, rtol=1e-5)


def test_firings_lead_to_the_place() -> None:
    meeting, states = at_a_point(1000.0, 8)
    impulses = Impulses(meeting)
    found = impulses.firings(states, 100)
    end = impulses.flown(states, found, np.array([1000]))[:, 0]
    np.testing.assert_allclose(end[:, :3], 0.0, atol=1e-8)


def test_a_coast_that_ends_within_the_tolerance_needs_nothing() -> None:
    meeting, states, _, _ = meeting_of(1000.0, 4, 4)
    impulses = Impulses(meeting)
    found = impulses.firings(states, 100)
    after = impulses.flown(states, found, np.array([600]))[:, 0]
    again = impulses.firings(after, 40)
    assert (found.impulse > 1.0).all()
    # What is left is what was to be fired after 600 s.
    late = np.where(found.period >= 60, found.command, 0.0) * meeting.price[found.thruster]
    np.testing.assert_allclose(again.impulse, late.sum(axis=1), atol=0.02)
