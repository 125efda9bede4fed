"""How well flights identify a hidden spacecraft: ``python -m campaigns identification``.

Each hidden craft has thrusters, inertia, centre of mass, delays and disturbances drawn from the ranges of the
conditions ``lab``. It is flown in our engine for 60 s by random commands that keep it in a room, and read with
lab's noise. `rans.identify` begins from the data sheet. The mass is weighed: motion does not determine it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from rans_robot.identify.fit import fit, parameters_of
from rans_robot.identify.log import FlightLog
from rans_robot.identify.result import SPREAD, Identification

from rans.base.processes import Workers, nothing
from rans.base.terminal import progress, stages
from rans.episode.scenario import draws
from rans.episode.step import Setup, World, step
from rans.model.fields import Vec2, Vec3, leaves
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.randomization.conditions_file import load_conditions
from rans.tasks.go_to_pose import GoToPose

Found = TypeVar("Found")
_OPEN = 0.25
"""Probability that a thruster is open."""
_CHOICES = 8
"""Random commands of which the calmest is given."""
_SHEET = (0.75, 1.25)
"""Factors on forces and inertia of hidden craft: those of `lab`."""
_HELD = 2
"""Control periods for which a random command is held, so that speeds and angles are told apart from noise."""


def hidden_flights(
    craft: Spacecraft,
    count: int,
    seconds: float,
    period: float,
    seed: int,
    conditions: Conditions | None = None,
) -> tuple[list[FlightLog], np.ndarray]:
    """Logs of hidden craft, and their true parameters (count, P) in the order of `parameters_of`.

    They are drawn from `conditions`; None: from `lab` with the mass weighed.
    """
    if conditions is None:
        named = load_conditions("lab")
        body = replace(named.body, mass=1.0, inertia=_SHEET)
        conditions = replace(named, body=body, thrusters=replace(named.thrusters, thrust=_SHEET))
    random = np.random.default_rng(seed)
    steps = round(seconds / period)
    timing = Timing(control_period=period, episode_steps=steps)
    task = GoToPose().for_evaluation()
    world = World(Setup(craft, task, timing, conditions))
    drawn = draws(seed, count, 0)
    start, goal = task.sample(drawn.random(craft.dimension, drawn.first))
    episode = world.begin(start, goal, np.zeros(count, np.int32), drawn)
    # Readings and commands of every period; a command is held for a while.
    width = 6 if craft.dimension == 2 else 13
    readings = []
    commands = []
    command = np.zeros((count, craft.command_count))
    for k in range(steps):
        columns = leaves(world.read(episode, drawn))[:width]
        readings.append(np.stack([np.broadcast_to(x, count) for x in columns], axis=-1))
        if k % _HELD == 0:
            command = _calming(craft, episode.state, random, _HELD * period)
        commands.append(command)
        episode = step(world, episode, tuple(command.T), drawn).episode
    # A log of each craft.
    times = np.arange(steps) * period
    d = craft.dimension
    logs = [
        FlightLog(
            f"hidden craft {i}",
            times,
            np.array([u[i] for u in commands]),
            times,
            rows[:, :d],
            rows[:, 2] if d == 2 else rows[:, 3:7],
            rows[:, 3:5] if d == 2 else rows[:, 7:10],
            rows[:, 5] if d == 2 else rows[:, 10:],
        )
        for i in range(count)
        for rows in [np.array([row[i] for row in readings])]
    ]
    # The truth, which is constant during a flight.
    parameters: Any = episode.parameters
    body = parameters.body
    forces = [thruster.force * g for thruster, g in zip(craft.thrusters, body.gain, strict=True)]
    lag = parameters.lag
    late = (0.0, 0.0) if lag is None else (lag.latency, lag.rise)
    none = (0.0,) * craft.degrees_of_freedom
    push = none if parameters.push is None else leaves(parameters.push)
    fields = [*forces, *body.inertia, *body.centre, *push, *late]
    return logs, np.stack([np.broadcast_to(x, count) for x in fields], axis=-1)


def _calming(
    craft: Spacecraft, state: Any, random: np.random.Generator, lasting: float
) -> np.ndarray:
    """The calmest of several random commands: it leaves least speed and spin, so that a flight stays in a room."""
    columns = np.array(craft.wrench_map)
    count = len(state.p.x)
    d = craft.dimension
    choices = (random.random((_CHOICES, count, len(columns))) < _OPEN).astype(float)
    wrench = choices @ columns
    force = Vec2(*np.moveaxis(wrench[..., :2], -1, 0))
    if d == 3:
        force = Vec3(*np.moveaxis(wrench[..., :3], -1, 0))
    pushed = state.attitude.rotate(force).columns()
    inertia = np.diag(craft.inertia)[3 - len(state.spin()) :]
    radius = 0.5  # m: a rad/s counts as so many m/s
    speed = sum(
        (v + 0.2 * p + lasting * f / craft.mass) ** 2
        for v, p, f in zip(state.v.columns(), state.p.columns(), pushed, strict=True)
    )
    spin = sum(
        (radius * (w + lasting * wrench[..., d + j] / inertia[j])) ** 2
        for j, w in enumerate(state.spin())
    )
    best = np.argmin(speed + spin, axis=0)
    return choices[best, np.arange(count)]


def _identified(
    _: None, craft: Spacecraft, log: FlightLog
) -> tuple[np.ndarray, np.ndarray, tuple[float, float], float]:
    """Values and deviations of all parameters, the mean delay with its deviation, s, and the time of the fit, s."""
    began = time.process_time()
    found = Identification(fit(craft, [log]))
    spent = time.process_time() - began
    assert found.delay is not None  # craft of this campaign have thrusters
    return found.fit.values, found.fit.deviations, (found.delay, found.delay_deviation), spent


@dataclass(frozen=True)
class Hidden:
    """Identify hidden craft."""

    spacecraft: str = "floating-platform"
    """Data sheet."""
    count: int = 256
    """Number of hidden craft."""
    seconds: float = 60.0
    """Length of each flight, s."""
    period: float = 0.2
    """Control period, s."""
    seed: int = 2026
    """Seed of the hidden craft and of their commands."""

    def measured(self) -> dict[str, Any]:
        """Fly, identify and compare."""
        craft = load_spacecraft(self.spacecraft)
        logs, truth = hidden_flights(craft, self.count, self.seconds, self.period, self.seed)
        found = identified(_identified, craft, logs)
        values, deviations, delays, spent = (np.array(x) for x in zip(*found, strict=True))
        return {
            "rows": [*self._rows(craft, values, deviations, delays, truth)],
            "median seconds of a fit": float(np.median(spent)),
        }

    def _rows(
        self,
        craft: Spacecraft,
        values: np.ndarray,
        deviations: np.ndarray,
        delays: np.ndarray,
        truth: np.ndarray,
    ) -> Iterator[list[str]]:
        """Rows of the table."""
        names = [one.name for one in parameters_of(craft)]
        groups = {
            "force of a thruster": ("force", "%"),
            "moment of inertia": ("inertia", "%"),
            "centre of mass": ("centre", "mm"),
            "disturbance force": ("disturbance", "N"),
            "disturbance torque": ("torque", "N m"),
        }
        errors = values - truth
        held = np.abs(errors) <= SPREAD * deviations
        for title, (word, unit) in groups.items():
            columns = [k for k, name in enumerate(names) if name.startswith(word)]
            # Products of inertia of a symmetric craft are zero, and so is what they are compared with.
            columns = [k for k in columns if unit != "%" or np.all(truth[:, k] != 0.0)]
            error = np.abs(errors[:, columns])
            if unit == "%":
                error = 100.0 * error / np.abs(truth[:, columns])
            if unit == "mm":
                error = 1e3 * error
            yield row_of(title, error, unit, held[:, columns])
        mean = truth[:, names.index("latency")] + 0.5 * truth[:, names.index("rise")]
        late = np.abs(delays[:, 0] - mean)
        yield row_of("mean delay", 1e3 * late, "ms", late <= SPREAD * delays[:, 1])


def identified(
    job: Callable[..., Found], craft: Spacecraft, logs: Sequence[FlightLog]
) -> list[Found]:
    """What a job of a worker, called with None, the data sheet and a log, finds in each log."""
    found = []
    with progress() as bars:
        step = stages(bars)(f"{len(logs)} logs", len(logs))
        jobs = [(craft, log) for log in logs]
        for one in Workers(nothing, work="identified craft").ordered(job, jobs):
            found.append(one)
            step(1)
    return found


def row_of(title: str, errors: np.ndarray, unit: str, held: np.ndarray) -> list[str]:
    """Row of a quantity, of its errors and of whether intervals hold the truth."""
    return [
        title,
        f"{np.median(errors):.2g} {unit}",
        f"{np.quantile(errors, 0.95):.2g} {unit}",
        f"{100.0 * held.mean():.1f} %",
    ]
