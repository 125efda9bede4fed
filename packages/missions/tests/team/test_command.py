"""Coasts of deputies after a failure, against orbits in closed form, and flights of teams beside their bound."""

import numpy as np
import pytest
from rans_missions.team.coasts import coasts_apart
from rans_missions.team.command import team

N = 0.001027


def test_coasts_in_two_body_gravity_come_together_as_by_hand():
    """Deputies 60 m behind and 100 m ahead of the target on its orbit stay where they are, to its curvature.

    One that is slower by dv drifts ahead by 3 T dv in a period T (Clohessy and Wiltshire).
    """
    still = np.zeros((1, 2, 6))
    still[0, 0, 1] = -60.0
    still[0, 1, 1] = 100.0
    assert coasts_apart(N, still) == pytest.approx(160.0, abs=0.05)
    slower = still.copy()
    period = 2.0 * np.pi / N
    slower[0, 0, 4] = -130.0 / (3.0 * period)
    # It is farthest ahead a little before the end of the orbit, where 4 cos(n t) = 3, and lower then.
    turned = 2.0 * np.pi - np.arccos(0.75)
    ahead = 130.0 * (3.0 * turned - 4.0 * np.sin(turned)) / (6.0 * np.pi)
    lower = 130.0 * 2.0 * 0.25 / (6.0 * np.pi)
    assert coasts_apart(N, slower) == pytest.approx(np.hypot(160.0 - ahead, lower), abs=0.1)


@pytest.mark.slow
def test_teams_succeed_apart_and_above_their_bound():
    flown = team(deputies=2, episodes=2)
    assert flown.succeeded.all()
    assert not flown.broken.any()
    assert np.all(flown.spent >= flown.bound)
    assert np.all(flown.apart >= 10.0)
