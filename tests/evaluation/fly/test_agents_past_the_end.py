"""What agents of missions do once their episodes are over.

Nobody trained them for that, but robots and other simulators go on. The limits are those that the agents
were measured to keep: they say what to expect, and can only get better.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import pytest

import rans
from rans.episode import Setup
from rans.scenario import scenarios
from tests.support.past_the_end import flown_on


class Limits(NamedTuple):
    """What an agent keeps after its episode."""

    seconds: float
    """How long it flies on, s."""
    spent: float
    """Change of velocity in that time, m/s at most."""
    margin: float
    """Least margin of the constraints, m."""
    inside: float
    """Share of the time within all tolerances."""


AGENTS = {
    # 12 % more than it was seen to spend in a minute; it stays at the goal.
    "avoid-3d": Limits(60.0, 41.0, 0.0, 0.95),
    # It stays in the cone, and fires as much as on the way: 0.6 m/s a second.
    "dock-port-3d": Limits(60.0, 44.0, 0.0, 0.02),
    # Nothing is said of the ground, which is no contact here: the engines go on until the tank is empty.
    "land-3d": Limits(60.0, 520.0, -math.inf, -1.0),
}
"""One agent of each mission."""


@pytest.mark.slow
@pytest.mark.parametrize("name", AGENTS)
def test_agents_keep_their_limits_past_the_end(name: str) -> None:
    limits = AGENTS[name]
    agent = rans.load_agent(f"pretrained:{name}")
    setup = Setup(agent.craft, agent.task.for_evaluation(), agent.timing)
    starts = scenarios(setup.task, setup.craft, 90210, 2)
    end = setup.timing.episode_steps * setup.timing.control_period
    rest = flown_on(setup, agent.controller, starts, end + limits.seconds).after(end)
    assert rest.change.sum(axis=0).max() < limits.spent
    assert rest.margin.min() > limits.margin
    assert rest.reached.mean() > limits.inside
