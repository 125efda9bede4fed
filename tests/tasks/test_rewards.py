"""The prices that every task can charge, by hand."""

from dataclasses import replace

import numpy as np
import pytest
from rans_missions.tasks.avoid import Zones

from rans import ConfigError, Timing
from rans.episode.flight import Flight
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import TASKS, GoToPosePriced, SingleTask
from rans.tasks.rewards import Transition, nearness
from tests.support.crafts import ANY_CRAFT
from tests.support.states import planar
from tests.support.switching import SwitchingGoToPose

PLANAR = PlanarState(Vec2(7.0, -9.0), Heading(2.0), Vec2(0.3, -0.4), -0.2)
"""At 0.5 m/s and 0.2 rad/s."""
WORK = ((1.0, 0.0, 1.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0, 0.0))
"""Three valves are open; of the two open before one has shut, and two of the three have opened."""


@pytest.mark.parametrize(
    "kind",
    [
        kind
        for kind in map(TASKS.__getitem__, ANY_CRAFT)
        if issubclass(kind, SingleTask) and kind is not GoToPosePriced
    ],
)
def test_every_task_charges_for_open_thrusters_only(kind):
    """Unless it is told to charge for more; and no weight may be negative."""
    goal = replace(PLANAR, notes=Zones(()))  # which avoid reads
    charged = kind().reward(Transition(PLANAR, goal, *WORK)).keys() & {"thrust", "spin"}
    assert charged == {"thrust"}
    dearer = kind(thrust_weight=0.5, spin_weight=0.25).reward(Transition(PLANAR, goal, *WORK))
    assert (dearer["thrust"], dearer["spin"]) == (-1.5, -0.05)
    with pytest.raises(ConfigError, match="spin_weight must be from 0"):
        kind(spin_weight=-0.1)


def test_a_flight_pays_for_every_valve_from_the_first_command_on():
    """One valve opens, another joins it, both shut; nothing happens in the second episode."""
    commands = np.zeros((4, 2, 8))
    commands[0, 0, 3] = commands[1, 0, 3] = commands[1, 0, 6] = 1.0
    still = np.zeros((5, 2))
    states = PlanarState(Vec2(still, still), Heading(still), Vec2(still, still), still)
    goals = PlanarState(
        Vec2(still[0], still[0]), Heading(still[0]), Vec2(still[0], still[0]), still[0]
    )
    task = SwitchingGoToPose(switching_weight=0.5, thrust_weight=0.25)
    flight = Flight(
        load_spacecraft("floating-platform-shared"),
        task,
        Timing(episode_steps=4),
        states,
        goals,
        commands,
        "by hand",
    )
    np.testing.assert_array_equal(
        flight.rewards()["switching"].T, [[-0.5, -0.5, -1.0, 0.0], [0.0] * 4]
    )
    # What is counted are commands: the platform shares one thruster's worth among the open ones.
    np.testing.assert_array_equal(
        flight.rewards()["thrust"].T, [[-0.25, -0.5, 0.0, 0.0], [0.0] * 4]
    )


def test_nothing_is_nearer_than_a_rest():
    """Flat up to 0.5, then the same shape moved out by 0.5: ln 2 further on it has halved."""
    error = np.array([0.0, 0.3, 0.5, 0.5 + np.log(2.0)])
    np.testing.assert_allclose(nearness(error, 1.0, rest=0.5), [1.0, 1.0, 1.0, 0.5], rtol=1e-15)


@pytest.mark.parametrize(
    ("name", "fine"),
    [("go-to-position", {"fine"}), ("go-to-pose", {"fine position", "fine attitude"})],
)
def test_an_agent_at_rest_gains_nothing_by_coming_closer(name, fine):
    """At 7 mm and 0.01 rad within rests of 8 mm and 0.02 rad every term is as at the goal."""
    goal = planar()
    near = planar(y=-7e-3, heading=0.01)
    rests = {
        "rest_position": 8e-3,
        "rest_spin" if name == "go-to-position" else "rest_attitude": 0.02,
    }
    task = TASKS[name](fine_weight=0.5, **rests)
    plain = TASKS[name]()
    assert task.reward(Transition(near, goal, *WORK)) == task.reward(Transition(goal, goal, *WORK))
    close, there = (plain.reward(Transition(state, goal, *WORK)) for state in (near, goal))
    assert close["position"] < there["position"]
    assert task.reward(Transition(near, goal, *WORK)).keys() - close.keys() == fine
