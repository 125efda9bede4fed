"""Interface contract of an exported agent as JSON: observation columns, thrusters, timing and test vectors.

Firmware and other languages rely on its keys, so that a change of meaning needs a new version; the tests fly by the
contract alone.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import asdict, fields, is_dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import torch

from rans.base.display import default
from rans.base.errors import ConfigError
from rans.base.files import git_revision, package_version
from rans.deploy.columns import (
    column_meanings,
    left_out,
    refused_ranges,
    state_quantities,
    valid_ranges,
)
from rans.effectors.commands import of_outputs
from rans.episode.flight import Controller, begin_flight
from rans.episode.safety_filters import safety_filter
from rans.episode.scenario import draws, sampled_scenarios, scenario
from rans.episode.step import Setup
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.fly.exported import FORMAT, longest_age
from rans.fast.learn.config import TrainConfig, to_table
from rans.model.dynamics import State
from rans.model.fields import Vec3, leaves, map_leaves
from rans.model.rotation import exponential
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.policy.network import Network
from rans.randomization.conditions import Conditions, largest
from rans.tasks import Task
from rans.tasks.base import observation
from rans.tasks.derived import example
from rans.tasks.observation_terms import TradeOff

FLIGHTS = 2048
"""Flights of which the columns' ranges are taken."""
STEPS = 125
"""Most control periods of each."""
PAIRED = 64
"""The first of these flights, among which the golden ones are chosen."""
GOLDEN = 4
"""Flights that are kept as golden pairs."""
FLIGHT_SEED = 2026
"""Seed of the starts of these flights, drawn as in training; no training or judgement uses this seed."""
WIRED = 64
"""States and goals whose observation is kept, to check how an observation is put together."""
_WIRING_SEED = 2029
DUTY_TOLERANCE = 1e-4
"""Largest error of golden duties: rounding of float32 in another order of sums is a hundredth of it."""
OBSERVATION_TOLERANCE = 1e-4
"""Largest error of a column of observations that is computed elsewhere: single precision of coordinates of up to
ten metres is a hundredth of it."""
_FRAMES = {
    "W": "at rest (or, on an orbit, the Hill frame: x outwards, y along the track, z across); right-handed",
    "B": "fixed to the spacecraft: origin at its centre of mass, with a full tank where that has a place; axes of "
    "spacecraft.toml; right-handed",
}


class RecordedFlights(NamedTuple):
    """What an agent met on N flights of T control periods."""

    observations: np.ndarray
    """(T, N, width), float32."""
    states: Any
    """`State` of arrays (T, N), as sensors measured it: the observations are of these."""
    goals: Any
    """Goals of the states: `State` of arrays (T, N)."""

    def of(self, which: Any) -> RecordedFlights:
        """The flights that an index along N names."""
        return RecordedFlights(*map_leaves(lambda x: x[:, which], tuple(self)))


class ActionRecorder:
    """A controller that keeps whatever an agent is given."""

    def __init__(self, controller: Controller) -> None:
        self.name = controller.name
        self._controller = controller
        self._met = list[tuple[np.ndarray, Any, Any]]()

    def __copy__(self) -> Any:
        """Itself: what it keeps is read after the flight."""
        return self

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`."""
        self._controller = begin_flight(self._controller, count)
        self._met.clear()

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.episode.flight.Controller`."""
        count = len(observation)
        wide = [map_leaves(lambda x: np.broadcast_to(x, count), sample) for sample in (state, goal)]
        self._met.append((observation, *wide))
        return self._controller.act(state, goal, observation)

    @property
    def flights(self) -> RecordedFlights:
        """The last flights."""
        observations, states, goals = zip(*self._met, strict=True)

        def stacked(several: Any) -> Any:
            return map_leaves(lambda *x: np.stack(x), *several)

        return RecordedFlights(np.stack(observations), stacked(states), stacked(goals))


def flights_of_training(
    controller: Controller, setup: Setup, count: int = FLIGHTS
) -> RecordedFlights:
    """Flights from the starts of training, under the setup's conditions, without those that failed.

    An episode of a training ends where it fails, so that nothing is known of an agent beyond. If every flight
    failed, all of them are returned.
    """
    flights, failed = recorded(controller, setup, count)
    return flights if failed.all() else flights.of(~failed)


def recorded(
    controller: Controller, setup: Setup, count: int = FLIGHTS
) -> tuple[RecordedFlights, np.ndarray]:
    """Flights of the first `STEPS` periods from the starts of training, and whether each failed, (N,).

    Valid ranges and golden pairs are of these flights: another count makes other files.
    """
    recorder = ActionRecorder(controller)
    timing = setup.timing
    short = replace(timing, episode_steps=min(timing.episode_steps, STEPS), substeps=None)
    flight = fly_episodes(recorder, setup._replace(timing=short), FLIGHT_SEED, count)
    return recorder.flights, flight.failed()


def contract(
    name: str,
    config: TrainConfig,
    craft: Spacecraft,
    spacecraft_text: str,
    memory: int,
    seen: np.ndarray,
) -> dict[str, Any]:
    """The contract of an agent with so much memory that observed (T, N, width) on flights.

    Args:
        name: of the agent.
        config: its training.
        craft: its spacecraft.
        spacecraft_text: file of the spacecraft.
        memory: numbers that it remembers.
        seen: observations of flights under the training's conditions.
    """
    task = config.settings
    conditions = config.conditions
    return {
        # Whose contract it is.
        "format": FORMAT,
        "agent": name,
        "task": config.task,
        "settings": to_table(config)["settings"],
        "spacecraft": {
            "name": craft.name,
            "file": "spacecraft.toml",
            "sha256": hashlib.sha256(spacecraft_text.encode()).hexdigest(),
        },
        # What goes in and what comes out, every control period.
        "control_period": config.timing.control_period,
        "episode_steps": config.timing.episode_steps,
        "frames": _FRAMES,
        "observation": _columns(task, craft, seen),
        "tasks": _flagged(config.task, task, craft),
        "trade_off": _trade_off(task, craft),
        "command": _command(craft),
        "memory": memory,
        "memory_rule": "zeros where an episode begins; memory_out of one period is memory of the next. It "
        "counts on every command having been given: while a supervisor gives others, do not ask the agent, "
        "and begin a new episode when it takes over again. Do so too where a number in it is not finite.",
        "safety_filter": _safety_filter(task, craft, config.timing),
        # For what the agent was made.
        "conditions": {
            "of_training": changed_settings(conditions),
            "summary": _conditions_text(conditions),
        },
        "readings": _readings(conditions, config.timing.control_period),
        "valid": f"range of {seen.shape[1]} flights of {seen.shape[0]} periods from the starts of training "
        "under its conditions, which did not fail, and a tenth more on either side; directions are known all "
        f"around. The {left_out(seen.shape[1])} flights that reached farthest on each side are left out. The agent "
        "was hardly tried beyond.",
        "refused": "a number beyond is an error of measurement, no reading: hold the last one, and shut the "
        "valves once that is older than readings.oldest",
        # How to test an integration, and what made these files.
        "golden": "golden.json: observation and command of flights, row after row, with the state and the "
        "goal that the observation is of; wiring has states and goals that differ in everything. Of both: "
        "position (m) and velocity (m/s) of B's origin in W; attitude, the heading in rad or in space "
        "the unit quaternion w, x, y, z of R_WB; spin, the angular velocity in B, rad/s; notes, further "
        "numbers of a goal by name; stores, such as the momentum of each wheel, N m s.",
        "units": {
            "control_period": "s",
            "position": "m",
            "force": "N",
            "max_torque": "N m",
            "max_momentum": "N m s",
            "inertia": "kg m^2",
        },
        "revision": git_revision(),
        "rans": package_version("rans"),
    }


def _columns(task: Task, craft: Spacecraft, seen: np.ndarray) -> list[dict[str, Any]]:
    """What each column of the observation is, with its range in observations of flights (T, N, width).

    Firmware reads these keys, and packages that write other forms of exports.
    """
    layout = example(task, craft.dimension)
    ranges = np.array(valid_ranges(task, craft.dimension, seen), dtype=np.float32)
    valid = [(low, high) for low, high in map(_short, ranges)]
    rows = zip(
        layout.table(),
        layout.bounds(),
        _meanings(task, craft),
        valid,
        refused_ranges(valid),
        strict=True,
    )
    return [
        {
            "column": number,
            "name": row.name,
            "unit": row.unit,
            "frame": row.frame,
            "meaning": meaning,
            "bound": bound if math.isfinite(bound) else None,
            "valid": [*usual],
            # A bounded column is refused a hundredth beyond its bound, for rounding.
            "refused": _short(np.array(beyond))
            if math.isinf(bound)
            else [-1.01 * bound, 1.01 * bound],
        }
        for number, (row, bound, meaning, usual, beyond) in enumerate(rows)
    ]


def _command(craft: Spacecraft) -> dict[str, Any]:
    """What the commands of a craft are: thrusters first, then wheels, as every exported agent gives them.

    Firmware reads these keys; thrusters are in the order of commands.
    """
    return {
        "actuators": craft.actuators.kind,
        "values": craft.actuators.allowed,
        "thrusters": [_thruster(craft, at) for at in range(craft.thruster_count)],
        "thruster_position": "where the force acts, from the centre of mass, axes of B, m",
        "thruster_direction": "unit vector of the force on the spacecraft, axes of B: the exhaust "
        "leaves the other way",
        "wheels": [asdict(wheel) for wheel in craft.wheels],
        "wheel_command": "share of max_torque, -1 to 1: the motor turns its wheel about +axis (axes of B) "
        "where it is positive, and the spacecraft about -axis; a wheel at max_momentum gives no more torque"
        if craft.wheels
        else None,
        "ranges": [command._asdict() for command in craft.commands],
        "shut": [0.0] * craft.command_count,
    }


def _readings(conditions: Conditions, period: float) -> dict[str, Any]:
    """Ages of readings, s, under any of the conditions of a training with a control period, s.

    `rans fly` shuts the valves by "oldest".
    """
    sensors = [variant.sensors for variant in (conditions, *conditions.others)]
    late = max(largest(sensor.delay) for sensor in sensors) * period
    outage = max(largest(sensor.outage) for sensor in sensors)
    return {
        "age_of_training": late,
        "outage_of_training": outage,
        "oldest": min(late + period + outage, longest_age(period)),
        "meaning": "age of a reading when a command is decided, s. In training readings came so late, and "
        "for the time of an outage the last ones were repeated; both are the longest of any of its "
        "conditions. A reading that is older than oldest, which is their sum and a control period, and at most "
        f"{longest_age(period):g} s, is stale: shut the valves.",
    }


def _safety_filter(task: Task, craft: Spacecraft, timing: Timing) -> dict[str, Any] | None:
    """Constraints of the task, and the filter that keeps them, which exported files lack; None: no constraints."""
    example = scenario(task, craft.dimension, seed=0, episode=0)
    constraints = task.constraints(example.start, example.goal)
    if not constraints:
        return None
    about: dict[str, Any] = {
        "constraints": [*constraints],
        "in_these_files": False,
        "meaning": "this agent's commands may violate the constraints: its files do not hold the safety filter, "
        "which predicts the motion with RANS. rans fly FOLDER --trust --guard flies them behind it.",
    }
    try:
        guard = safety_filter(Setup(craft, task, timing))
    except ConfigError as error:
        return about | {"name": None, "meaning": f"there is no safety filter: {error}"}
    settings = {key: value for key, value in asdict(guard).items() if key != "name"}  # pyrefly: ignore[bad-argument-type]
    return about | {"name": guard.name, "settings": settings}  # pyrefly: ignore[missing-attribute]


def changed_settings(value: Any) -> dict[str, Any]:
    """What a dataclass has that is not its default, as JSON; nested ones likewise."""
    result: dict[str, Any] = {}
    for field in fields(value):
        own = getattr(value, field.name)
        if own == default(field):
            continue
        if is_dataclass(own):
            own = changed_settings(own)
        elif isinstance(own, tuple) and own and is_dataclass(own[0]):
            own = [changed_settings(each) for each in own]
        result[field.name] = own
    return result


def _conditions_text(conditions: Conditions) -> str:
    """Sentence with the conditions of the training that a robot engineer asks for first: latency, mass, noise."""
    if conditions.or_none is None:
        return "everything as designed: no latency, the designed mass, exact readings"
    every = (conditions, *conditions.others)
    mass = [x for variant in every for x in np.atleast_1d(np.asarray(variant.body.mass))]
    parts = [
        f"latency up to {max(variant.delay for variant in every):g} s",
        f"mass {min(mass):g} to {max(mass):g} times the designed one",
    ]
    names = ("position", "m"), ("attitude", "rad"), ("velocity", "m/s"), ("spin", "rad/s")
    for at, (name, unit) in enumerate(names):
        noise = max(largest(variant.sensors.each()[at].noise) for variant in every)
        parts.append(f"noise of {name} up to {noise:g} {unit}")
    return ", ".join(parts)


def _example_states(task: Task, craft: Spacecraft, count: int) -> tuple[Any, Any]:
    """States and goals (N,) in which every quantity is something: to tell apart what a column is.

    Start and goal are those of episodes; both are moved, and the start is turned, set in motion and spun.

    Drawn with `_WIRING_SEED`, in the order in which they stand here: files of golden pairs have them.
    """
    own = draws(_WIRING_SEED, count)
    scenario = sampled_scenarios(task, craft, own)
    start = scenario.start
    goal = scenario.goal
    random = own.random(craft.dimension, own.first, 2**20)

    def vector(like: Any, size: float) -> Any:
        return map_leaves(lambda _: random.uniform(-size, size), like)

    attitude: Any = start.attitude
    if isinstance(start.w, Vec3):
        attitude = attitude.times(exponential(vector(start.p, 1.0)))
        spin = vector(start.w, 0.5)
    else:
        attitude = type(attitude)(attitude.angle + random.uniform(-1.0, 1.0))
        spin = random.uniform(-0.5, 0.5)
    stores = tuple(np.full(count, store.initial) for store in craft.stores)
    state = replace(
        start,
        p=start.p + vector(start.p, 1.0),
        attitude=attitude,
        v=vector(start.v, 0.3),
        w=spin,
        stores=stores,
    )
    return state, replace(goal, p=goal.p + vector(goal.p, 1.0))


def _meanings(task: Task, craft: Spacecraft) -> list[str]:
    """Meaning of each column; of a multi-task the meanings that its tasks share (see `_flagged`)."""
    state, goal = _example_states(task, craft, WIRED)
    return column_meanings(task, state, goal)


def _flagged(called: str, task: Task, craft: Spacecraft) -> list[dict[str, Any]]:
    """Flag and columns of every task that the agent flies, from example states, as the contract has them.

    Keys are an interface, and rows are ordered by column.
    """
    parts: dict[str, Task] = {"": task} if is_one_task(task) else dict(task.parts())
    results = []
    for name, part in parts.items():
        state, goal = _example_states(part, craft, WIRED)
        flag = float(np.atleast_1d(part.flag_of(goal))[0])
        rows = zip(
            example(part, craft.dimension).table(), column_meanings(part, state, goal), strict=True
        )
        columns = [
            {"column": at, **row._asdict(), "meaning": meaning}
            for at, (row, meaning) in enumerate(rows)
        ]
        results.append({"task": name or called, "flag": flag, "columns": columns})
    return results


def is_one_task(task: Task) -> bool:
    """Whether all of the task's parts are observed in the same columns."""
    return all(type(part) is type(task) for part in task.parts().values())


def _trade_off(task: Task, craft: Spacecraft) -> dict[str, Any] | None:
    """Column of the observation that trades time for thrust, and the meaning of its ends; None: there is none."""
    at = 0
    for entry in example(task, craft.dimension).terms:
        if isinstance(entry, TradeOff):
            low, high = getattr(task, "price", (0.0, 1.0))
            ends = ("fast", "thrifty") if high >= low else ("thrifty", "fast")
            return {"column": at, "0": ends[0], "1": ends[1], "valid": [0.0, 1.0]}
        at += len(entry.columns())
    return None


def _thruster(craft: Spacecraft, at: int) -> dict[str, Any]:
    """One entry of a command; the place is about the centre of mass.

    Firmware reads these keys.
    """
    thruster = craft.thrusters[at]
    lever = np.subtract(thruster.position, craft.centre_of_mass).tolist()
    return {
        "index": at,
        "position": lever,
        "direction": list(thruster.direction),
        "force": thruster.force,
        "supply": thruster.supply,
    }


@torch.no_grad()
def golden(
    network: Network,
    seen: np.ndarray | RecordedFlights,
    craft: Spacecraft | None = None,
    task: Task | None = None,
) -> dict[str, Any]:
    """Pairs of observations and commands, episode after episode; ``begins`` where the memory is zero.

    Of on/off thrusters those flights are taken in which no choice is close, so that rounding turns none. Of flights
    the first `PAIRED` count, and states and goals are kept beside the observations that they gave; with a craft and
    a task also ``wiring``, of states and goals that differ in everything, with the observation of each.
    Observations are (T, N, width), computed again in float64; commands are as the craft takes them.
    """
    flights = None
    if isinstance(seen, RecordedFlights):
        flights = seen.of(slice(PAIRED))
        seen = flights.observations
    # Commands in double precision, and how clear each choice of an on/off thruster was.
    exact = Network(network.architecture, {name: x.double() for name, x in network.tensors.items()})
    memory = exact.initial_state(seen.shape[1])
    commands = []
    margins = []
    for rows in torch.from_numpy(seen):
        output, columns = exact.forward(rows, memory)
        commands.append(output.policy.mode())
        margins.append(output.policy.margin())
        memory = exact.next_state(columns, memory, commands[-1])
    # The flights whose closest choice is the clearest, one after the other.
    clearest = torch.stack(margins).amin(dim=(0, 2)).argsort(descending=True).numpy()
    outputs = torch.stack(commands).numpy()
    answers = _in_ranges(outputs.reshape(-1, outputs.shape[-1]), craft).reshape(outputs.shape)
    return golden_pairs(
        seen, answers, clearest, network.architecture.continuous, flights, craft, task
    )


def golden_pairs(
    seen: np.ndarray,
    commands: np.ndarray,
    clearest: np.ndarray,
    continuous: bool,
    flights: RecordedFlights | None,
    craft: Spacecraft | None,
    task: Task | None,
) -> dict[str, Any]:
    """Golden pairs of the first `GOLDEN` of some flights, from observations and commands (T, N, ...).

    ``clearest`` (N,) are numbers of flights, whose pairs follow one another, flight by flight and in order of time.

    Keys are an interface: agents' tests in C and Python read them from contract.json.
    """
    clearest = clearest[:GOLDEN]
    observed, commanded = (x[:, clearest].swapaxes(0, 1) for x in (seen, commands))
    begins = [step == 0 for _ in clearest for step in range(len(seen))]
    result: dict[str, Any] = {
        "begins": begins,
        "tolerance": DUTY_TOLERANCE if continuous else 0.0,
        "observation": [_short(row) for row in observed.reshape(len(begins), -1)],
        "command": [_short(row) for row in commanded.reshape(len(begins), -1)],
    }
    if flights is not None:
        positions = [(step, int(k)) for k in clearest for step in range(len(seen))]
        result |= {
            "state": [state_quantities(_at(flights.states, position)) for position in positions],
            "goal": [state_quantities(_at(flights.goals, position)) for position in positions],
        }
    if craft is not None and task is not None:
        result["wiring"] = wiring(task, craft)
    return result


def wiring(task: Task, craft: Spacecraft) -> dict[str, Any]:
    """States and goals that differ in everything, with the observation of each and its tolerance.

    Whoever mixes up a sign, a frame or an order sees it here: on flights of a task whose goal is the origin, a
    forgotten goal does not show.

    Programs in other languages are tested by it before they fly.
    """
    state, goal = _example_states(task, craft, WIRED)
    columns = observation(task, state, goal)
    rows = np.stack([np.broadcast_to(x, WIRED) for x in columns], axis=1)
    wired = [k for k in range(WIRED) if np.isfinite(rows[k]).all()]
    return {
        "tolerance": OBSERVATION_TOLERANCE,
        "state": [state_quantities(_at(state, k)) for k in wired],
        "goal": [state_quantities(_at(goal, k)) for k in wired],
        "observation": [_short(rows[k]) for k in wired],
    }


def _at(state: State, index: Any) -> Any:
    """One state of numbers among many."""
    shape = np.broadcast_shapes(*(np.shape(x) for x in leaves(state)))
    return map_leaves(lambda x: float(np.broadcast_to(x, shape)[index]), state)


def _in_ranges(outputs: np.ndarray, craft: Spacecraft | None) -> np.ndarray:
    """Commands (rows, commands) of a policy's outputs from 0 to 1."""
    if craft is None:
        return outputs
    return np.stack(of_outputs(craft, tuple(outputs.T)), axis=1)


def _short(row: np.ndarray) -> list[float]:
    """Numbers of single precision, with no more digits than tell them apart."""
    return [float(str(x)) for x in row.astype(np.float32)]
