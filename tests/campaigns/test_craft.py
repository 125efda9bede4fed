"""The bounds beside agents of real craft: of whichever body is drawn, and below what the agents take."""

import numpy as np

from campaigns.craft import flown, least_settling_times, luckiest
from rans.episode.flight import fly
from rans.episode.scenario import EVALUATION_SEED, scenarios
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions_file import load_conditions


def test_the_luckiest_craft_is_lighter_and_stronger_than_any_that_is_drawn():
    craft = load_spacecraft("astrobee-iss")
    found = luckiest(craft, load_conditions("astrobee"))
    assert found.mass == 0.9 * craft.mass
    # Thrust up to 1.1 times as large, and pressure up to 1.25.
    assert np.isclose(found.thrusters[0].force, 0.268 * 1.1 * 1.25)


def test_no_flight_settles_before_its_bound():
    name = "astrobee-granite"
    run = flown(name)
    task = run.task.for_evaluation()
    flight = fly(
        run.craft, task, run.controller, scenarios(task, run.craft, EVALUATION_SEED, 16), run.timing
    )
    far = flight.errors()["position"] > 0.05
    last = np.array([np.flatnonzero(column).max() for column in far.T])
    settled = (last + 1) * run.timing.control_period
    bound = least_settling_times(name, 16)
    assert (bound > 3.0).all()  # a metre at 0.036 m/s^2 takes longer
    assert (settled >= bound).all()
