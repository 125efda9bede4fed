"""``rans twin``: the robot at the other end of the bus, flown by the engine under a file of conditions.

It speaks the robot's end of `rans_robot.interfaces`, so that pilot and twin share units and frames.
"""

from __future__ import annotations

import gc
import json
import math
import queue
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rans import Conditions, GoToPose
from rans.extend import (
    MOST_STEPS,
    ConfigError,
    Setup,
    Spacecraft,
    Timing,
    World,
    bounds,
    brief,
    draws,
    is_finite,
    leaves,
    map_leaves,
    positive,
    step,
)
from rans_robot.bus import Bus
from rans_robot.frames import Motion
from rans_robot.interfaces import Interface, RobotName
from rans_robot.messages import FLOATS, TEXT, pack, text_message
from rans_robot.pilot import CRAFT_TOPIC, craft_hash, motion_of, placed

VALVES_TOPIC = "rans/valves"
"""What the effectors do, as the twin knows it: for monitors."""
_SEED = 0
"""Seed of the random numbers of conditions and of a start that is sampled."""
_WATCHDOG = 2.5
"""Control periods after which a command no longer holds."""
_MOST_CAUSES = 20
"""Different causes for which commands were refused that are said: anybody can send more."""
_MOST_BEHIND = 0.5
"""s by which the twin may be behind its clock before it says so."""


Fault = Callable[[Motion, float, int], tuple[Motion | None, float]]
"""What is published of a motion so many s and messages after a fault began, or None, and by how many s its time
stamp is off."""


def _frozen() -> Fault:
    first: list[Motion] = []

    def fault(motion: Motion, _: float, number: int) -> tuple[Motion, float]:
        first[number:] = [] if number else [motion]
        return first[0], 0.0

    return fault


def _jumps(by: float, every: int) -> Fault:
    away = np.array([by, 0.0, 0.0])
    return lambda motion, _, number: (
        motion._replace(position=motion.position + away * (number % every == every - 1)),
        0.0,
    )


FAULTS: dict[str, Callable[[], Fault]] = {
    "frozen": _frozen,
    "dead": lambda: lambda *_: (None, 0.0),
    "restart": lambda: lambda motion, after, _: (motion if after > 2.0 else None, 0.0),
    "two-senders": lambda: _jumps(3.0, 2),
    "outliers": lambda: _jumps(4.0, 5),
    "no-twist": lambda: (
        lambda motion, *_: (
            motion._replace(velocity=np.zeros(3), spin=np.zeros(3)),
            0.0,
        )
    ),
    "slow-link": lambda: lambda motion, after, _: (motion, -0.5 * after),
    "fast-clock": lambda: lambda motion, after, _: (motion, after),
}
"""What a user may see the own node shut for, by name."""


@dataclass(frozen=True)
class TwinPlan:
    """What a twin is."""

    craft: Spacecraft
    control_period: float
    """s between commands; those of pulsed thrusters are shares of it."""
    robot: RobotName = "ros"
    """Kind of robot (`rans_robot.interfaces`)."""
    conditions: Conditions | None = None
    """Randomization, disturbances, faults and sensors; None: everything is as designed."""
    rate: float = 100.0
    """States published a second; the motion is computed as often."""
    start: tuple[float, ...] = ()
    """x, y (m) and heading (degrees) in the plane; x, y, z, roll, pitch and yaw in space. Empty: one is sampled."""
    seconds: float = 600.0
    """Length of the episode, over which sudden pushes are spread."""
    fault: str = ""
    """NAME:SECONDS, one of `FAULTS` and when it begins, s; "": none."""

    def __post_init__(self) -> None:
        """Reject (`ConfigError`) wrong times, rates and starts."""
        positive("--period", self.control_period)
        positive("--rate", self.rate)
        positive("--seconds", self.seconds)
        if not all(map(is_finite, self.start)):
            raise ConfigError(f"the numbers of a start must be finite, got {self.start}.")
        name, _, after = self.fault.partition(":")
        if self.fault and (name not in FAULTS or not after.replace(".", "", 1).isdecimal()):
            raise ConfigError(
                f"--fault is NAME:SECONDS, with one of {', '.join(FAULTS)}, got {brief(self.fault)}."
            )


class Craft:
    """A simulated spacecraft that holds its commands, step by step.

    Readings are drawn for every published state: a dropout of 10 % loses one state of ten, and a delay of one
    control period is one of ``control_period`` seconds. A pulsed thruster's pulse begins when its command comes.

    Raises:
        ConfigError: the rate does not fit the control period, or see `rans.episode.step.World`.
    """

    def __init__(self, plan: TwinPlan) -> None:
        self.plan = plan
        craft = plan.craft
        if not plan.rate * plan.control_period >= 1.0:
            raise ConfigError(
                f"--rate must be at least one state a control period of {plan.control_period:g} s, got "
                f"{plan.rate:g} a second."
            )
        self.period = 1.0 / plan.rate
        steps = min(MOST_STEPS, math.ceil(plan.seconds * plan.rate))
        timing = Timing(control_period=self.period, episode_steps=steps)
        conditions = _at_rate(plan.conditions, plan.control_period * plan.rate)
        task = GoToPose()
        self._world = World(Setup(craft, task, timing, conditions))
        self._draws = draws(_SEED, 1, 0)
        start, goal = task.for_evaluation().sample(
            self._draws.random(craft.dimension, self._draws.first)
        )
        if plan.start:
            start = placed(craft, "start", plan.start)
        self._now = _of_numbers(self._world.begin(start, goal, 0, self._draws))
        self._low = np.array([channel.low for channel in craft.commands])
        self._command = np.zeros(craft.command_count)
        self._elapsed = math.inf
        self._published: tuple[float, ...] = ()

    @property
    def motion(self) -> Motion:
        """True motion."""
        return motion_of(self._now.state)

    def measured(self) -> Motion | None:
        """Motion as sensors measure it now; None: they repeat their last reading. Remembers what it gave.

        It is called once a published state, as each call draws the errors of the present instant and compares with
        the last.
        """
        state = self._world.sensed(self._now, self._draws)
        state = map_leaves(lambda x: float(np.squeeze(x)), state)
        values = leaves(replace(state, stores=()))
        drawn = self._now.parameters
        sensors = None if drawn is None else drawn.sensors
        if sensors is not None and sensors.repeats and values == self._published:
            return None
        self._published = values
        return motion_of(state)

    def hold(self, command: np.ndarray) -> None:
        """Hold a command from now on: what the craft cannot do of it, it does not."""
        commands = self.plan.craft.commands
        values = np.clip(command, self._low, [channel.high for channel in commands])
        on_off = [channel.kind == "on-off" for channel in commands]
        self._command = np.where(on_off, np.round(values), values)
        self._elapsed = 0.0

    def advance(self) -> np.ndarray:
        """Fly one step of the engine, and return what (n,) the effectors were given: duties become pulses.

        A new command sets `_elapsed` back, so that its pulse begins then.
        """
        given = self._command
        if self.plan.craft.actuators.kind == "pulsed":
            # Of a pulse of command times control period, that which falls into this step.
            left = given * self.plan.control_period - self._elapsed
            count = self.plan.craft.thruster_count
            pulse = np.clip(left / self.period, 0.0, 1.0)
            given = np.where(np.arange(len(given)) < count, pulse, given)
            given = np.maximum(given, self._low)
        self._elapsed += self.period
        outcome = step(self._world, self._now, tuple(given.tolist()), self._draws)
        self._now = _of_numbers(outcome.episode)
        if not all(map(is_finite, leaves(self._now.state))):
            raise ConfigError(
                "the motion of the twin is no longer finite: is its thrust too large?"
            )
        return given


def _at_rate(conditions: Conditions | None, ratio: float) -> Conditions | None:
    """Conditions whose readings are as late, and impulses as noisy, at so many times the rate of commands.

    ``ratio`` is states a control period.
    """
    if conditions is None or conditions.or_none is None:
        return None

    def late(variant: Conditions) -> Conditions:
        """Conditions with delays and noise of a period in steps of the engine's shorter one."""
        delays = [float(round(x * ratio)) for x in bounds(variant.sensors.delay)]
        # The mean of n independent factors on a force scatters by 1 / sqrt(n) of what each does.
        noises = [min(1.0, x * math.sqrt(ratio)) for x in bounds(variant.thrusters.noise)]
        return replace(
            variant,
            sensors=replace(variant.sensors, delay=(delays[0], delays[1])),
            thrusters=replace(variant.thrusters, noise=(noises[0], noises[1])),
        )

    return replace(late(conditions), others=tuple(late(variant) for variant in conditions.others))


def _of_numbers(episode: Any) -> Any:
    """An episode whose arrays of one element are floats; whole numbers stay as they are."""

    def plain(x: Any) -> Any:
        return x if np.asarray(x).dtype.kind in "iu" else float(np.squeeze(x))

    return map_leaves(plain, episode)


def run_twin(
    bus: Bus,
    plan: TwinPlan,
    say: Callable[[str], None] = print,
    stopped: Callable[[], bool] = lambda: False,
) -> Motion:
    """Be the robot until its time is up or it is stopped, and return where it is then.

    It publishes its state, takes commands, and shuts its valves when none comes for two and a half control
    periods. Beside them it says which spacecraft it is, and what its valves do (`VALVES_TOPIC`).

    Args:
        bus: see `rans_robot.bus.open_bus`; it stays open.
        plan: what it is.
        say: takes each sentence.
        stopped: whether somebody wants it to end.

    Raises:
        ConfigError: see `Craft` and `rans_robot.interfaces.interface`.
    """
    for _ in range(3):  # what is computed first takes long
        craft = Craft(plan)
        craft.advance()
        craft.measured()
    # The craft, and its topics.
    craft = Craft(plan)
    ends = Interface(plan.robot, plan.craft.command_count, plan.craft.thruster_count)
    inbox: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
    for topic, kind in ends.outputs.items():
        bus.subscribe(topic, kind, lambda data, topic=topic: inbox.put((topic, data)))
    about = {
        "sha256": craft_hash(plan.craft),
        "control_period": plan.control_period,
        "name": plan.craft.name,
    }
    announced = text_message(json.dumps(about))
    # Times in ns: of the next step, the last command, and the next messages beside the state.
    period = round(craft.period * 1e9)
    watchdog = round(_WATCHDOG * plan.control_period * 1e9)
    begun = due = time.monotonic_ns()
    commanded: int | None = None
    is_open = False
    shown = np.full(plan.craft.command_count, np.nan)
    next_announcement = begun
    next_valves = begun
    behind = False
    name, _, after = plan.fault.partition(":")
    fault = FAULTS[name]() if name else None
    number = 0
    refused: set[str] = set()
    gc.collect()
    gc.freeze()
    while not stopped() and due - begun < plan.seconds * 1e9:
        left = (due - time.monotonic_ns()) * 1e-9
        if left > 0.0:
            time.sleep(left)
        elif left < -_MOST_BEHIND:
            due = time.monotonic_ns()
            if not behind:
                say("the twin cannot keep up with its rate on this machine: lower --rate.")
            behind = True
        now = time.monotonic_ns()

        # The newest command, or shut valves where it no longer holds.
        command = _newest_command(inbox, ends, refused, say)
        if command is not None:
            craft.hold(command)
            commanded = now
            is_open = True
        elif is_open and commanded is not None and now - commanded > watchdog:
            craft.hold(np.zeros(plan.craft.command_count))
            is_open = False
            say(f"no command for {(now - commanded) * 1e-9:.2f} s: valves shut.")

        # Motion, and what sensors say of it.
        given = craft.advance()
        measured = craft.measured()
        since = (now - begun) * 1e-9 - float(after or 0.0)
        off = 0.0
        if fault is not None and measured is not None and since >= 0.0:
            measured, off = fault(measured, since, number)
            number += 1
        if measured is not None:
            stamp = time.time_ns() + round(off * 1e9)
            for message in ends.state(measured, stamp):
                bus.publish(*message)
        if now >= next_valves or not np.array_equal(given > 0.0, shown > 0.0):
            shown = given
            next_valves = now + round(plan.control_period * 1e9)
            bus.publish(VALVES_TOPIC, FLOATS, pack(FLOATS, {"data": given}))
        if now >= next_announcement:
            next_announcement = now + 10**9
            bus.publish(CRAFT_TOPIC, TEXT, announced)
        due += period
    return craft.motion


def _newest_command(
    inbox: queue.SimpleQueue[tuple[str, bytes]],
    ends: Interface,
    refused: set[str],
    say: Callable[[str], None],
) -> np.ndarray | None:
    """The last command (n,) among all messages that wait; None: there is none.

    Args:
        inbox: topics and contents of the messages, which are taken out.
        ends: how this kind of robot reads them.
        refused: reasons that were said already, to which new ones are added.
        say: takes a sentence about each new reason to refuse a message.
    """
    command = None
    while True:
        try:
            topic, data = inbox.get_nowait()
        except queue.Empty:
            return command
        try:
            received = ends.commanded(topic, data)
        except ValueError as error:
            if str(error) not in refused and len(refused) < _MOST_CAUSES:
                refused.add(str(error))
                say(f"{topic}: {error}.")
            continue
        # Some messages hold no command.
        command = command if received is None else received
