"""Positions to go to, by hand."""

import math

import pytest

from rans.tasks import GoToPosition, Transition
from tests.support.states import planar

SHUT = (0.0, 0.0)


def test_a_slow_spin_is_still_enough():
    """Half of it is paid for a spin of 0.3 less 0.1 rad/s at a scale of 0.2: exp(-1)."""
    task = GoToPosition(stillness_weight=0.5, stillness_scale=0.2, rest_spin=0.1, thrust_weight=0.0)
    paid = {
        w: float(task.reward(Transition(planar(w=w), planar(), SHUT, SHUT))["stillness"])
        for w in (0.0, 0.1, -0.1, 0.3)
    }
    assert paid == pytest.approx(
        {0.0: 0.5, 0.1: 0.5, -0.1: 0.5, 0.3: 0.5 * math.exp(-1.0)}, rel=1e-14
    )


def test_what_it_pays_by_hand():
    """0.5 m away: exp(-0.5 / 0.25), half of exp(-0.5 / 1.5), and a quarter of exp(-0.5 / 0.1)."""
    task = GoToPosition(fine_weight=0.25, fine_scale=0.1)
    terms = task.reward(Transition(planar(0.5), planar(), SHUT, SHUT))
    assert {name: float(x) for name, x in terms.items()} == pytest.approx(
        {
            "position": math.exp(-2.0),
            "approach": 0.5 * math.exp(-1.0 / 3.0),
            "stillness": 0.5,
            "fine": 0.25 * math.exp(-5.0),
            "thrust": 0.0,
        },
        rel=1e-14,
    )


def test_reached_is_near_whatever_the_spin():
    assert GoToPosition().reached(planar(0.049, w=3.0), planar())
    assert not GoToPosition().reached(planar(0.051), planar())
