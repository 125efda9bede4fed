"""Passively safe approach of a hold point: certified coasts of its flights, and a stay far past the end."""

from dataclasses import replace

import numpy as np
import pytest
from rans_missions.control.passive_approach import PassiveApproach
from rans_missions.passive_flights import passive_safety
from rans_missions.tasks import Hold

from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.episode.step import Setup
from rans.evaluation.measure.metrics import impulses, won
from rans.model.fields import Vec3
from rans.model.spacecraft_file import load_spacecraft
from tests.support.past_the_end import flown_on

CHASER = load_spacecraft("vbar-chaser")
TASK = Hold(deadline=(1200.0, 1200.0))
# At rest ahead of the target, below and behind it, and where a coast from the start falls into the ball.
PLACES = np.array([[-172.0, 46.0, 1.0], [-92.0, -238.0, -35.0], [5.0, 30.0, 180.0]])


@pytest.mark.slow
def test_every_coast_keeps_out_and_the_craft_holds():
    starts = scenarios(TASK, CHASER, 1, 3)
    starts = replace(starts, start=replace(starts.start, p=Vec3(*PLACES.T)))
    flight = fly(CHASER, TASK, PassiveApproach(CHASER, TASK), starts, TASK.timing)
    assert won(flight).all()
    safety = passive_safety(flight)
    assert safety.unsafe_start.tolist() == [False, False, True]
    assert not safety.unsafe.any()
    # The cheapest of the plans drawn that are safe, m/s.
    assert (impulses(flight) / CHASER.mass < [1.56, 0.40, 1.0]).all()
    # Long after it has held, staying for 1,700 s costs less than braking from the tolerance once.
    setup = Setup(CHASER, TASK, TASK.timing)
    rest = flown_on(setup, PassiveApproach(CHASER, TASK), starts, 3000.0).after(1300.0)
    assert rest.reached.all()
    assert rest.change.sum(axis=0).max() < TASK.velocity_tolerance
