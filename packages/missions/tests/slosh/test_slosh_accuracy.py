"""Ten seconds of restless flight with a sloshing liquid against equations of another kind, solved by SciPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rans_missions.slosh.swinging import rod_rate

import rans
from rans import GoToPose, Spacecraft, Timing
from rans.episode.flight import Flight, fly, outran
from rans.episode.scenario import scenarios
from rans.model.fields import unflatten
from tests.support.pair_oracle import Oracle
from tests.support.slosh import IN_SPACE, IN_SPACE_SLOSH, SLOSH, SLOSHING, slosh_of
from validation.study.sampling import Restless, gaps

PLATFORM = rans.load_spacecraft("floating-platform")
FLYER = rans.load_spacecraft("free-flyer")
OF_PAGE = rans.Slosh(0.532, 0.0571168, (-0.0717647, 0.0, 0.0), (-1.0, 0.0, 0.0), 3.24768e-5)
"""The liquid of docs/missions/slosh.md."""
CRAFTS = {
    "page": replace(PLATFORM, name="page", further_effectors=(OF_PAGE,)),
    "page in space": replace(
        FLYER, name="page in space", further_effectors=(replace(OF_PAGE, mass=0.1 * FLYER.mass),)
    ),
    "without friction": replace(
        SLOSHING, name="without friction", further_effectors=(replace(SLOSH, damping=0.0),)
    ),
    "without friction in space": replace(
        IN_SPACE,
        name="without friction in space",
        further_effectors=(replace(IN_SPACE_SLOSH, damping=0.0),),
    ),
}
BOUND = 1e-5
"""m and rad over 10 s, as the page states; the pendulum is chaotic, and its errors grow."""


def restless(craft: Spacecraft, seed: int, seconds: float, timing: Timing) -> Flight:
    timing = replace(timing, episode_steps=round(seconds / timing.control_period))
    task = GoToPose(fail_distance=1e6, fail_spin=1e6)
    return fly(craft, task, Restless(craft, seed), scenarios(task, craft, seed, 1), timing)


def agrees(flight: Flight) -> None:
    rows = Oracle(flight, None, 0).fly()
    others = unflatten(flight.states, [column[:, None] for column in rows.T])
    apart = gaps(flight.states, others)
    assert apart["position"].max() < BOUND
    assert apart["attitude"].max() < BOUND
    # The liquid did swing.
    assert rod_rate(slosh_of(flight.craft), flight.craft, flight.states).max() > 2.0
    if flight.craft.dimension == 3:
        # The rod has the length 1 and turns only.
        rod, slip = np.array(flight.states.stores[:3]), np.array(flight.states.stores[3:])
        np.testing.assert_allclose((rod * rod).sum(axis=0), 1.0, rtol=1e-14)
        np.testing.assert_allclose((rod * slip).sum(axis=0), 0.0, atol=1e-14)


@pytest.mark.parametrize("name", ["page", "page in space"])
def test_a_liquid_moves_as_scipy_says(name):
    agrees(restless(CRAFTS[name], 0, 3.0, Timing(0.2)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", CRAFTS)
def test_ten_seconds_of_a_liquid_are_within_the_stated_bound(name, seed):
    agrees(restless(CRAFTS[name], seed, 10.0, Timing(0.2)))


def test_a_rod_faster_than_the_steps_are_for_warns():
    """A start whose rod turns at 40 rad/s within steps for 16; with as many substeps as it says nothing is said."""
    craft = CRAFTS["page"]
    timing = Timing(0.2, episode_steps=2)
    task = GoToPose(fail_distance=1e6, fail_spin=1e6)
    start = scenarios(task, craft, 0, 1)
    still = np.zeros(1)
    fast = replace(start, start=replace(start.start, stores=(still, still + 40.0)))
    coasting = Restless(craft, 0)
    with pytest.warns(UserWarning, match="swings the liquid of page at up to 40"):
        flight = fly(craft, task, coasting, fast, timing)
    (said,) = outran(flight, timing)
    advised = int(said.split("timing.substeps to ")[1].split()[0])
    assert outran(flight, replace(timing, substeps=advised)) == []
    # Rates that are no finite numbers, as in a damaged file of flights, decide nothing.
    angle, rate = flight.states.stores
    for wrong in (np.inf, np.nan):
        ends = replace(
            flight.states, stores=(angle, np.concatenate([rate[:-1], rate[-1:] * wrong]))
        )
        assert outran(replace(flight, states=ends), timing)[0] == said
