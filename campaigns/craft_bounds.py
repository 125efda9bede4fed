"""Real spacecraft: bounds of least time and least impulse of a transfer to rest, beside the best flight known.

``python -m campaigns craft-bounds`` measures; with ``--no-flights`` only the bounds are computed anew. Conditions
are nominal. The best flight is that of optimal control, within the same tolerances; its wheels are couples of
thrusters without a price, and it counts only if wheels can give their torques, with the gyroscopic torque of their
own momentum.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tyro.conf import Positional

from campaigns.craft import CRAFTS
from rans.evaluation.compare.bounds import goal_set
from rans.files import read_json
from rans.model.fields import leaves
from rans.model.spacecraft import Spacecraft, Thruster
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.certificate import attitude_tube, hull
from rans.optimal.certificate.goal_set import GoalSet
from rans.optimal.trajectory.objectives import MinimumFuel, MinimumTime, Objective
from rans.optimal.trajectory.transcription import Trajectory, Transcription, usual_guesses
from rans.scenario import EVALUATION_SEED, Scenario, each, scenarios
from rans.tasks import GoToPose

_ARM = 1000.0
"""Arm of the couples that stand for wheels, m, so long that their forces are as good as none."""
_SHARES = 1.0, 0.6, 0.3, 0.15, 0.075, 0.07
"""Shares of the torque of wheels that optimal control may use, tried in turn until wheels can give it."""
_INTERVALS = 50


def with_couples(craft: Spacecraft, share: float) -> Spacecraft:
    """The craft with two couples of thrusters for each wheel, for a share of its largest torque either way."""
    couples = []
    for wheel in craft.wheels:
        axis = np.array(wheel.axis)
        arm = np.cross(axis, (0.0, 0.0, 1.0) if abs(axis[2]) < 0.5 else (1.0, 0.0, 0.0))
        arm /= np.linalg.norm(arm)
        force = 0.5 * share * wheel.max_torque / _ARM
        for sense in (1.0, -1.0):
            for side in (1.0, -1.0):
                place = np.array(craft.centre_of_mass) + side * _ARM * arm
                push = sense * side * np.cross(axis, arm)
                couples.append(Thruster(_triple(place), _triple(push), force))
    return replace(craft, wheels=(), thrusters=(*craft.thrusters, *couples))


def _triple(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(value) + 0.0 for value in vector)
    return x, y, z


def wheels_can(craft: Spacecraft, share: float, path: Trajectory) -> bool:
    """Whether wheels at rest at first can give the torques of the couples of a trajectory, period by period."""
    if not craft.wheels:
        return True
    commands = path.commands[:, craft.thruster_count :].reshape(
        len(path.commands), craft.wheel_count, 4
    )
    torques = np.array([wheel.max_torque for wheel in craft.wheels])
    given = 0.5 * share * torques * (commands[..., :2].sum(-1) - commands[..., 2:].sum(-1))
    axes = np.array([wheel.axis for wheel in craft.wheels])
    if craft.dimension == 2:
        momenta = -path.control_period * np.cumsum(given, axis=0)
        return bool((np.abs(momenta) <= [wheel.max_momentum for wheel in craft.wheels]).all())
    # In space, for wheels along three axes: the momentum of wheels in B follows h' = -torque - w x h.
    spin = np.stack(leaves(path.states.w), axis=1)
    momentum = np.zeros(3)
    for torque, w in zip(given @ axes, spin, strict=False):
        motor = np.abs(axes @ (torque + np.cross(w, momentum)))
        momentum = momentum - path.control_period * (torque + np.cross(w, momentum))
        limits = [wheel.max_momentum for wheel in craft.wheels]
        if (motor > torques).any() or (np.abs(axes @ momentum) > limits).any():
            return False
    return True


def best(
    craft: Spacecraft, task: GoToPose, objective: Objective, start: Scenario, guesses: int
) -> float:
    """Least time, s, or impulse of thrusters, N s, of optimal control; infinite: none was found."""
    for share in _SHARES if craft.wheels else (1.0,):
        flown = with_couples(craft, share)
        transcription = Transcription(flown, task, objective)
        path = transcription.solve(
            start.start, start.goal, guesses or usual_guesses(flown, task, objective)
        )
        if path.solved and wheels_can(craft, share, path):
            if isinstance(objective, MinimumTime):
                return path.cost
            forces = np.array([thruster.force for thruster in craft.thrusters])
            spent = path.control_period * path.commands[:, : len(forces)].sum(axis=0) @ forces
            return float(spent)
    return math.inf


def measured(
    name: str,
    count: int,
    distance: Sequence[float],
    guesses: int = 0,
    before: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Bounds and best flights of a craft from the first starts of an evaluation.

    With an earlier result its flights, starts and horizon stay.
    """
    craft = load_spacecraft(name)
    low, high = distance
    task = GoToPose(evaluation_distance=(low, high)).for_evaluation()
    assert isinstance(task, GoToPose)
    with warnings.catch_warnings():  # without its wheels, a craft may be unable to turn
        warnings.simplefilter("ignore", UserWarning)
        bare = replace(craft, wheels=())
        within = replace(goal_set(task), velocity=0.0, spin=0.0)
        if before is not None:
            count = len(before["starts"])
        starts = [*each(scenarios(task, bare, EVALUATION_SEED, count))]
        hulls = [_hull_time(bare, within, one) for one in starts]
        # Twice the least time, in whole seconds: neither in haste nor as slow as you like.
        horizon = float(math.ceil(2.0 * float(np.mean(hulls))))
        if before is not None:
            horizon = before["horizon"]
        rows = []
        for k, (one, loose) in enumerate(zip(starts, hulls, strict=True)):
            start: Any = one.start
            goal: Any = one.goal
            fuel = MinimumFuel(horizon, horizon / _INTERVALS, "set")
            if before is None:
                time = best(craft, task, MinimumTime(_INTERVALS, "set"), one, guesses)
                impulse = best(craft, task, fuel, one, guesses)
            else:
                row = before["starts"][k]
                time, impulse = float(row["best time"]), float(row["best impulse"])
            rows.append(
                {
                    "hull time": loose,
                    "least time": attitude_tube.least_time(craft, start, goal, within),
                    "best time": time,
                    "least impulse": attitude_tube.least_impulse(
                        craft, start, goal, horizon, within
                    ),
                    "best impulse": impulse,
                }
            )
    return {"horizon": horizon, "starts": rows}


def _hull_time(craft: Spacecraft, within: GoalSet, one: Scenario) -> float:
    start: Any = one.start
    goal: Any = one.goal
    return hull.least_time(craft, ("position", "velocity"), start, goal, within)


@dataclass(frozen=True)
class CraftBounds:
    """Bound transfers of real craft to rest."""

    only: Positional[tuple[str, ...]] = ()
    """Names of craft; by default all. The others stay as they are in the evidence."""
    starts: int = 2
    """Starts of each."""
    guesses: int = 0
    """Guesses of optimal control; 0: as usual, 3 for least times in space."""
    flights: bool = True
    """Whether flights are computed anew; else those of the evidence stay."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """Bounds and best flights of each craft."""
        distances = _evidence("craft.json")
        known = {} if self.flights else _evidence("craft-bounds.json")
        for name in self.only or CRAFTS:
            distance = distances[name]["distance"]
            found = measured(name, self.starts, distance, self.guesses, known.get(name))
            yield {"name": name, **found}

    def failed(self, evidence: Any) -> bool:
        """Whether a flight is below its bound."""
        return any(
            float(row[f"best {kind}"]) < row[f"least {kind}"] * (1.0 - 1e-6)
            for one in evidence["rows"]
            for row in one["starts"]
            for kind in ("time", "impulse")
        )


def _evidence(name: str) -> dict[str, Any]:
    """Rows of evidence by the names of craft."""
    return {row["name"]: row for row in read_json(Path("docs/validation") / name)["rows"]}


def cells(evidence: Any) -> Iterator[dict[str, Any]]:
    """Rows of the table: bounds over best flights of every craft, the mean and the lowest of its starts."""
    for one in evidence["rows"]:
        hull_time, tube_time, tube_impulse = (_ratio(one["starts"], *pair) for pair in _PAIRS)
        times = [_mean(one["starts"], key) for key in ("least time", "best time")]
        spent = [_mean(one["starts"], key) for key in ("least impulse", "best impulse")]
        impulse = f"{one['horizon']:g} s: {spent[0]:.3g}, {spent[1]:.3g} N s"
        yield {
            "name": one["name"],
            "starts": len(one["starts"]),
            "time": f"{times[0]:.1f}, {times[1]:.1f} s".replace("inf s", "none"),
            "hull": hull_time,
            "tube": tube_time,
            "impulse": impulse.replace("inf N s", "none"),
            "tube impulse": tube_impulse,
        }


_PAIRS = (
    ("hull time", "best time"),
    ("least time", "best time"),
    ("least impulse", "best impulse"),
)


def _ratio(rows: Sequence[dict[str, float]], bound: str, flight: str) -> str:
    ratios = [float(row[bound]) / float(row[flight]) for row in rows]
    if min(ratios) == 0.0:  # optimal control found no flight that the wheels can fly
        return "-"
    return f"{np.mean(ratios):.2f} (≥ {math.floor(100.0 * min(ratios)) / 100.0:.2f})"


def _mean(rows: Sequence[dict[str, float]], key: str) -> float:
    """Mean of the starts; files have infinite numbers as text."""
    return float(np.mean([float(row[key]) for row in rows]))
