"""Final approaches with their bounds: guidance and the cheapest flights found from the same starts."""

from __future__ import annotations

import numpy as np

from rans.extend import Progress, Spacecraft, fly, fly_in_drake, scenarios
from rans.scenario import each
from rans_missions.bounds.transfers import TransferTable, row_of
from rans_missions.control.corridor import Corridor
from rans_missions.convex.approach import PortMeeting, flight_to_port, least_to_approach
from rans_missions.convex.rendezvous import state_of
from rans_missions.script import Script
from rans_missions.tasks.final_approach import FinalApproach


def judged_approaches(
    craft: Spacecraft,
    task: FinalApproach,
    seed: int,
    episodes: int,
    progress: Progress | None = None,
) -> TransferTable:
    """Fly guidance and the cheapest flights found from the same starts, beside their bounds.

    Args:
        craft: spacecraft, whose thrusters do not turn it.
        task: the final approach.
        seed: seed of the starts.
        episodes: number of starts.
        progress: reports starts.

    Raises:
        ConfigError: see `rans_missions.convex.rendezvous.forces_in_w`.
    """
    timing = task.timing
    starts = scenarios(task, craft, seed, episodes)
    lower = []
    commands = np.zeros((timing.episode_steps, episodes, craft.thruster_count))
    for k, one in enumerate(each(starts)):
        meeting, state = PortMeeting.at_port(craft, task, timing, one.goal), state_of(one)
        lower.append(least_to_approach(meeting, state)[0])
        found = flight_to_port(meeting, state)
        if found is not None:
            commands[: len(found.commands), k] = found.commands
        if progress is not None:
            progress(1)
    guided = row_of("corridor", fly(craft, task, Corridor(craft, task, timing), starts, timing))
    found, in_drake = (
        row_of("cheapest found", flying(craft, task, Script(commands), starts, timing))
        for flying in (fly, fly_in_drake)
    )
    upper = np.where(found.docked & in_drake.docked, found.impulse, np.inf)
    last = timing.control_period * timing.episode_steps
    return TransferTable(last, np.array(lower), upper, (guided, found))
