"""Landings with the least propellant: bounds, flights in the fast engine and in Drake, and tables.

Bounds are kg of propellant; each landing is flown in both engines before it counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rans.extend import (
    Body,
    Mover,
    Progress,
    Quat,
    Scenario,
    Setup,
    Spacecraft,
    StepInputs,
    Table,
    Timing,
    Vec3,
    World,
    each,
    map_leaves,
    unseen,
)
from rans_missions.convex.landing import Descent, Lander, Landing, best_landing
from rans_missions.tasks.land import Land
from rans_missions.vectors import numbers

REPLAY_BOUND = 0.1
"""Largest distance between the planned and the flown end, m, a tenth of the task's tolerance: between two knots the
acceleration of a plan is constant, and that of a constant thrust grows as the craft becomes lighter."""


@dataclass(frozen=True)
class LandingAnswer:
    """Optimum of one start; a landing that was not found is None, its numbers NaN."""

    start: int
    """Number of the scenario."""
    landing: Landing | None
    """Landing that can be flown."""
    bound: float = math.nan
    """Lower bound of the propellant, kg, of all flight times of an episode and of thrust that is held for the
    task's control period; see `rans_missions.convex.landing.best_landing`."""
    replayed: float = math.nan
    """Distance between the plan's end and that of the flight in the fast engine, m."""
    in_drake: float = math.nan
    """Distance between the plan's end and that of the flight in Drake, m."""

    @property
    def good(self) -> bool:
        """Whether there is a landing, and the flights in both engines end as planned."""
        return self.landing is not None and max(self.replayed, self.in_drake) <= REPLAY_BOUND

    def to_json(self) -> dict[str, Any]:
        """Data for `rans.base.files.write_json`, in kg, s and m; missing numbers are NaN."""
        plan = self.landing
        return {
            "start": self.start,
            "good": self.good,
            "propellant": math.nan if plan is None else plan.propellant,
            "bound": self.bound,
            "time": math.nan if plan is None else plan.time,
            "replayed": self.replayed,
            "in_drake": self.in_drake,
        }


def landings(
    craft: Spacecraft,
    task: Land,
    starts: Scenario,
    exact: bool = False,
    progress: Progress = unseen,
) -> list[LandingAnswer]:
    """Least propellant from every start, its lower bound, and the flight in both engines.

    The craft's attitude is not optimised: its axis points along the thrust at once. A craft that has to turn
    needs at least as much.

    Args:
        craft: lander, see `rans_missions.convex.landing.Lander`.
        task: landing task; thrust is held for its control period.
        starts: batch of starts.
        exact: whether to end at the site at rest instead of within the tolerances.
        progress: reports starts.

    Raises:
        ConfigError: the craft is no lander.
        SolverFailed: see `rans_missions.convex.landing.landing`.
    """
    lander = Lander.of(craft)
    descent = Descent.of(task, exact)
    period = task.timing.control_period
    times = period, period * task.timing.episode_steps
    answers = []
    for number, scenario in enumerate(each(starts)):
        start = numbers(scenario.start.p), numbers(scenario.start.v)
        # The plan that is flown has a model which the craft can follow; the bound's may do more.
        result = best_landing(lander, descent, start, period, "flyable", times)
        answer = LandingAnswer(number, result)
        # The same start with lossless limits gives the bound; both engines fly the plan.
        if result is not None:
            bound = best_landing(lander, descent, start, period, "bound", times)
            answer = replace(
                answer,
                bound=math.nan if bound is None else bound.dual,
                replayed=_missed(craft, task, lander, scenario.start, result, drake=False),
                in_drake=_missed(craft, task, lander, scenario.start, result, drake=True),
            )
        answers.append(answer)
        progress(1)
    return answers


def _missed(
    craft: Spacecraft, task: Land, lander: Lander, start: Any, plan: Landing, drake: bool
) -> float:
    """Distance, m, between a plan's end and that of its flight, with thrusts that are held.

    The craft turns at once: the attitude is set before every period, and stores (propellant, kg) follow from the
    plan.
    """
    timing = Timing(plan.period, None, len(plan.acceleration))
    move: Mover
    if drake:
        from rans.reference.flight import DrakeMover

        move = DrakeMover(craft, timing, task.drift)
    else:
        move = World(Setup(craft, task, timing)).move
    zero = np.zeros(1)
    state = map_leaves(lambda x: zero + x, replace(start, stores=()))
    left = lander.propellant
    for k, acceleration in enumerate(plan.acceleration):
        # Constant thrust that changes the velocity as much, with the same propellant.
        used = plan.mass[k] - plan.mass[k + 1]
        thrust = lander.exhaust_speed * used / plan.period
        full = lander.largest_thrust / craft.actuators.high
        throttle = np.clip(thrust / full, craft.actuators.low, craft.actuators.high)
        state = replace(
            state,
            attitude=_upright_along(acceleration),
            w=Vec3(zero, zero, zero),
            stores=(zero + left, *(zero for _ in craft.wheels)),
        )
        command = (zero + throttle,) * craft.thruster_count + (zero,) * craft.wheel_count
        (state,) = move(state, StepInputs(Body.of(craft), (command,)))
        left = float(np.asarray(state.stores[0]).item())
    return float(np.linalg.norm(numbers(state.p) - plan.p[-1]))


def _upright_along(direction: np.ndarray) -> Quat:
    """Attitude, of arrays (1,), that turns z of B along a direction by the shortest way."""
    x, y, z = direction / np.linalg.norm(direction)
    w = math.sqrt(0.5 * (1.0 + z))
    return Quat(*(np.array([value]) for value in (w, -0.5 * y / w, 0.5 * x / w, 0.0)))


def landing_table(title: str, answers: list[LandingAnswer]) -> Table:
    """Table with a row for each start: propellant and bound (kg), time (s), and misses in both engines (m)."""
    columns = ("start", "propellant kg", "bound kg", "time s", "engine m", "Drake m", "")
    rows: list[tuple[str | None, ...]] = []
    for answer in answers:
        if answer.landing is None:
            rows.append((str(answer.start), *[None] * 5, "no landing: out of reach"))
            continue
        row = (
            str(answer.start),
            f"{answer.landing.propellant:.2f}",
            f"{answer.bound:.2f}",
            f"{answer.landing.time:.1f}",
            f"{answer.replayed:.3f}",
            f"{answer.in_drake:.3f}",
            "solved" if answer.good else "solved, but it flies elsewhere",
        )
        rows.append(row)
    return Table(columns, rows, title, right=columns)
