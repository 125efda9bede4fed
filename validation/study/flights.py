"""Whole flights of 25 s, under three kinds of input, against Drake.

Thousands of periods add up what one period hides, and they show how accurate the default step is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rans.base.abilities import PUBLIC
from rans.base.errors import ConfigError
from rans.episode.flight import fly
from rans.episode.scenario import each, scenarios
from rans.model.accuracy import chosen
from rans.model.fields import map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.reference.flight import rows_from_states, states_from_rows
from rans.reference.plant import Plant
from rans.tasks import GoToPose
from validation.study.checks import Check, Curve, Skipped
from validation.study.dynamics import VALIDATION_SUBSTEPS
from validation.study.sampling import Restless, any_spin, gap_checks, growth, reach, rollout

_OPTIMAL_STARTS = 4
_HARDER = 4.0
"""How much farther off the default step may be when every thruster always fires: such flights spin up to
1.4 times as fast, and the error of a step grows with the seventh power of the angle turned."""


def flight_checks(craft: Spacecraft, seed: int, count: int) -> list[Check | Curve]:
    """Under a restless controller: all attitudes, always firing, near the goal."""
    timing = Timing()
    task = GoToPose()
    starts = scenarios(task, craft, seed, count)
    with any_spin():
        flight = fly(craft, task, Restless(craft, seed), starts, timing)
    coarse, fine = (
        drake_states(craft, starts.start, flight.commands, timing, step) for step in (0.01, 0.005)
    )
    reason = "Its fixed step halved: the judge must be a decade better than what it judges."
    return [
        *gap_checks("Drake's own error", coarse, fine, 0.1 * _agreement(flight.states), reason)[:2],
        *growth("Drake, 0.01 s against 0.005 s", coarse, fine, timing),
        *_accuracy("25 s", craft, starts.start, flight.commands, fine, timing),
    ]


def bang_bang_checks(craft: Spacecraft, seed: int, count: int) -> list[Check | Curve]:
    """Under full thrust one way or the other at every moment, the hardest input a controller gives."""
    timing = Timing()
    task = GoToPose()
    starts = scenarios(task, craft, seed + 1, count)
    with any_spin():
        commands = fly(craft, task, Restless(craft, seed, share=0.0), starts, timing).commands
    drake = drake_states(craft, starts.start, commands, timing, 0.005)
    return _accuracy("bang-bang", craft, starts.start, commands, drake, timing, _HARDER)


def optimal_checks(craft: Spacecraft, seed: int) -> Sequence[Check | Curve | Skipped]:
    """Under minimum-fuel inputs, which are anything between shut and open."""
    name = "optimal input"
    starts = scenarios(GoToPose().for_evaluation(), craft, seed, _OPTIMAL_STARTS)
    try:
        solve = PUBLIC["optimal_trajectory"]
        found = [
            solve(GoToPose(), craft, start=s.start, goal=s.goal).trajectory for s in each(starts)
        ]
    except ConfigError as error:
        return [Skipped(name, str(error))]
    solved = np.array([trajectory.solved for trajectory in found])
    if not solved.any():
        return [Skipped(name, f"The optimiser found no trajectory: {found[0].status}.")]
    commands = np.stack([t.commands for t in found if t.solved], axis=1)
    start = map_leaves(lambda x: x[solved], starts.start)
    timing = Timing(control_period=found[0].control_period)
    drake = drake_states(craft, start, commands, timing, 0.005)
    return _accuracy(name, craft, start, commands, drake, timing)


def drake_states(
    craft: Spacecraft, start: Any, commands: np.ndarray, timing: Timing, max_step: float
) -> Any:
    """Commands (T, N, thrusters) replayed by Drake at an integration step, s."""
    plant = Plant(craft, commands.shape[1], max_step)
    rows = plant.rollout(rows_from_states(start), commands, timing.control_period)
    return states_from_rows(rows, start)


def _accuracy(
    layer: str,
    craft: Spacecraft,
    start: Any,
    commands: np.ndarray,
    drake: Any,
    timing: Timing,
    harder: float = 1.0,
) -> list[Check | Curve]:
    """Default substeps (a bound on accuracy), and in space validation substeps (the equations)."""
    default = chosen(craft, timing).substeps or 1
    ours = rollout(craft, start, commands, timing.control_period, default)
    if craft.dimension == 2:
        reason = (
            "The plane's step is exact: rounding, and Drake's own error, over the whole flight."
        )
        return [
            *gap_checks(layer, ours, drake, _agreement(drake), reason),
            *growth(f"{layer}, default", ours, drake, timing),
        ]
    substeps = VALIDATION_SUBSTEPS[3]
    fine = rollout(craft, start, commands, timing.control_period, substeps)
    reason = "A hundredth of what a task notices (1 cm, 1 mrad); more substeps lower the error."
    position, attitude, *_ = gap_checks(
        f"{layer}, default substeps", ours, drake, 1e-4 * harder, reason
    )
    return [
        position,
        replace(attitude, tolerance=1e-5 * harder),
        *gap_checks(
            f"{layer}, {substeps} substeps",
            fine,
            drake,
            _agreement(drake),
            "Truncation; a wrong term of the equations would not shrink with it.",
        ),
        *growth(f"{layer}, default", ours, drake, timing),
        *growth(f"{layer}, {substeps} substeps", fine, drake, timing),
    ]


def _agreement(states: Any) -> float:
    """How closely a flight must agree with Drake where the step size plays no part."""
    return (1e-9 if len(states.p.columns()) == 2 else 1e-6) * reach(states)
