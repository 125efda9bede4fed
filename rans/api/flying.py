"""Flights of a controller from scenarios, with spacecraft and task by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rans.api.names import load_spacecraft, load_task
from rans.base.errors import one_of

if TYPE_CHECKING:
    from pathlib import Path

    from rans.episode.flight import Controller, Flight
    from rans.episode.scenario import Draws, Scenario
    from rans.episode.step import Guard, Mover
    from rans.evaluation.fly.episodes import EngineName
    from rans.model.body import Body
    from rans.model.spacecraft import Spacecraft
    from rans.model.timing import Timing
    from rans.randomization.conditions import Conditions
    from rans.tasks import Task


def fly(
    craft: str | Path | Spacecraft,
    task: str | Task,
    controller: Controller,
    starts: Scenario,
    timing: Timing,
    engine: EngineName | Mover = "fast",
    body: Body | None = None,
    conditions: Conditions | None = None,
    draws: Draws | None = None,
    guard: Guard | None = None,
) -> Flight:
    """Simulate a controller from a batch of scenarios, in float64.

    >>> starts = rans.scenarios(rans.GoToPose(), rans.load_spacecraft("atmos"), 7, 3)
    >>> rans.fly("atmos", "go-to-pose", rans.Switching("atmos", "go-to-pose"), starts, rans.Timing())
    <Flight of switching: 3 episodes of 25 s with atmos (fast engine)>

    Episodes run for the full time even after a failure, so that no flight is missing in statistics. The states of
    an episode are NaN after a state that is not finite, and the controller then receives its start. The state of an
    episode is constant after a success. Warns if the craft is too fast for its control period, or spins too fast
    for its substeps before it fails.

    Args:
        craft: spacecraft, by name, TOML file or object.
        task: task, by name or as an object.
        controller: controller, which receives all N episodes at once.
        starts: scenarios with float64 arrays (N,), as `rans.episode.scenario.scenarios` returns them.
        timing: control period, substeps, checks and number of periods.
        engine: what computes the motion: "fast" (RANS's own equations), "drake", or a function that moves the
            spacecraft, a `rans.episode.step.Mover`, whose attribute ``engine``, if any, is `Flight.engine`.
        body: body of numbers or arrays (N,); None: as designed.
        conditions: domain randomization, disturbances, faults and sensors; None: everything is nominal. Under
            conditions the controller receives measured states.
        draws: random numbers of the scenarios (`rans.episode.scenario.draws`); needed under conditions.
        guard: safety filter between controller and effectors; None: every command is executed.

    Raises:
        ConfigError: there is no such spacecraft, task or engine, the starts are not a batch of its dimension, the
            controller is not a `Controller` or belongs to another dimension, number of commands or width of
            the observation, or there are conditions without ``draws``.
    """
    from rans.episode import flight

    craft = load_spacecraft(craft)
    task = load_task(task)
    if callable(engine):
        move = engine
    else:
        one_of("engine", engine, ("fast", "drake"))
        move = None
        if engine == "drake":
            from rans.reference.flight import DrakeMover

            move = DrakeMover(craft, timing, task.drift)
    return flight.fly(
        craft,
        task,
        controller,
        starts,
        timing,
        move,
        body,
        conditions,
        draws,
        guard,
    )
