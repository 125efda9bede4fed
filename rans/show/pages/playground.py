"""A page in which an agent or mission guidance flies in the browser: physics and policy as printed JavaScript.

The step of an episode and the policy, or the law of guidance, are traced (`rans.model.trace`) and printed
(`rans.compile.javascript`); only the page's controls and its drawing are written by hand. It opens offline.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np

from rans.base.errors import ConfigError
from rans.base.files import write_text
from rans.compile.javascript import JAVASCRIPT, activations, function, substep_functions
from rans.compile.substeps import Substeps
from rans.effectors.commands import of_outputs
from rans.episode.flight import Controller, informed
from rans.episode.outline import outline_values
from rans.episode.scenario import EVALUATION_SEED
from rans.episode.step import Episode, Setup, World, step
from rans.evaluation.fly.agent import Agent, LoadedRun
from rans.evaluation.fly.tuned import task_name
from rans.model.body import Body
from rans.model.coordinates import around
from rans.model.drift import FREE
from rans.model.fields import Field, leaves, unflatten
from rans.model.random import Draws, seed_words
from rans.model.spacecraft import Spacecraft
from rans.model.trace import UNTRACEABLE, Symbol
from rans.policy.network import Network
from rans.policy.program import inputs
from rans.policy.scalars import symbols
from rans.policy.traced import parameters, policy_program
from rans.randomization.conditions import Conditions, bounds
from rans.randomization.parameters import StepInputs
from rans.show import markup
from rans.show.pages.page import filled
from rans.tasks import Task
from rans.tasks.derived import goal_stands_still
from rans.tasks.goal_set import aims
from rans.tasks.quantities import QUANTITIES
from rans.tasks.shapes import Ball, Cone, GlideSlope, Shape


@runtime_checkable
class Law(Controller, Protocol):
    """A controller whose commands are arithmetic on fields, as of mission guidance: a page computes them."""

    def command(self, state: Any, goal: Any) -> tuple[Field, ...]:
        """Commands, from 0 to 1 of each thruster, for an exact state and a goal."""
        ...


POSITION_NOISE = 0.05
"""Standard deviation of position (m) and velocity (m/s) at full noise."""
ANGLE_NOISE = math.radians(5.0)
"""Standard deviation of each angle (rad) and angular velocity (rad/s) at full noise."""
FRAME = 0.05
"""Longest time between two states to draw, s."""
_LONGEST_DELAY = 5
"""Control periods up to which the page's delay may be set."""
_BITS = {10_000: 32, 80_000: 16, math.inf: 8}
"""Bits of a weight by the number of weights up to which they have as many: 53 kB or 213 kB as base64, or more."""
_PACES = (1, 2, 5, 10, 20, 50, 100, 200)
"""Seconds of flight in a second on the screen that a page begins with."""
_SECONDS = 30.0
"""Time on the screen of an episode at that pace, at most twice as long."""


def interactive_world(setup: Setup, frame: float = FRAME) -> World:
    """World of a flight that a person changes: nominal, with a state to draw every ``frame`` seconds at least."""
    timing = setup.timing
    frames = math.ceil(timing.control_period / frame)
    checks = math.ceil(max(frames, timing.checks) / timing.checks) * timing.checks
    return World(setup._replace(conditions=None, timing=replace(timing, checks=checks)))


def may_move_goal(task: Task) -> bool:
    """Whether a person may move a task's goal: it has a place to go to, and stands still."""
    return "position" in aims(task) and goal_stands_still(task)


def noise_scale(craft: Spacecraft) -> np.ndarray:
    """Standard deviations at full noise of the coordinates of a state around another.

    (2 n,) for the n degrees of freedom of a craft: m, rad, m/s, rad/s.
    """
    angles = craft.degrees_of_freedom - craft.dimension
    return np.repeat(
        [POSITION_NOISE, ANGLE_NOISE, POSITION_NOISE, ANGLE_NOISE],
        [craft.dimension, angles, craft.dimension, angles],
    )


@dataclass(frozen=True)
class Playground:
    """The page of one agent.

    Attributes:
        title: who flies which spacecraft with which task.
        kind: whether an agent flies, or guidance without a network.
        script: JavaScript without a browser in it: the functions ``begin``, ``act``, ``advance`` and
            ``describe`` printed from the code, the weights, and a class ``Flight`` that drives them.
        data: what the page must know of the spacecraft and the task.
    """

    title: str
    script: str
    data: Mapping[str, Any]
    kind: Literal["agent", "guidance"] = "agent"
    """Whether there is a button for whoever commands next."""

    def html(self) -> str:
        """The page as one text, which fetches nothing: script, data and template are in it."""
        return filled(
            "playground.html.j2",
            title=self.title,
            bits=self.data.get("bits"),
            kind=self.kind,
            script=markup.code(self.script),
            page=markup.code(text_of("craft.js"), text_of("playground.js")),
        )

    def write(self, file: Path) -> None:
        """Write the page; `ConfigError` if the disk refuses."""
        write_text(file, self.html())


def playground(run: LoadedRun, seed: int = EVALUATION_SEED, episode: int = 0) -> Playground:
    """The page of an agent, or of mission guidance, that flies in its task, from the starts of a seed.

    Everything is as designed, but the delay, which begins in the middle of that of the training's conditions.

    Args:
        run: a trained agent, or mission guidance, with its spacecraft and task.
        seed: of starts and goals.
        episode: number of the first start; the page has a button for the next ones.

    Raises:
        ConfigError: this is neither, or the page cannot compute its policy or its task.
    """
    controller = run.controller
    network = controller.network if isinstance(controller, Agent) else None
    if network is None and not isinstance(controller, Law):
        raise ConfigError(
            f"{controller.name} is no trained agent: a page flies the network of a run folder or of an agent that "
            "comes with RANS, mission guidance, such as mission:dock-3d, or a controller with `command` "
            "(examples/single_file/controller.py). `rans view` without --play replays every controller."
        )
    if network is not None and (missing := JAVASCRIPT.missing(network.architecture)):
        raise ConfigError(f"{controller.name} has {missing}, which no page computes.")
    setup = run.judged
    world = interactive_world(setup, FRAME * pace(setup))
    tables = {} if network is None else parameters(network)
    try:
        traced = _Traced(world)
        text = [
            traced.begin(),
            traced.describe(),
            # Guidance knows its state and a world as designed.
            traced.guided(informed(controller, None))
            if network is None
            else traced.act(network, tables),
            traced.advance(),
        ]
    except UNTRACEABLE as error:
        raise ConfigError(
            f"the task {task_name(setup.task)} does more than arithmetic on fields, which no page computes: "
            f"{error}"
        ) from error
    names = [name for name in tables if name.endswith(".weight")]
    size = sum(tables[name].size for name in names)
    bits = next(bits for limit, bits in _BITS.items() if size <= limit)
    memory = 0 if network is None else network.architecture.memory
    begun = traced.episode
    data = page_data(traced.world, begun.state, begun.goal, run, seed, episode, memory)
    if network is not None:
        data["bits"] = bits
    layers = {
        name.removesuffix(".weight"): _packed(
            tables[name], tables[name.removesuffix("weight") + "bias"], bits
        )
        for name in names
    }
    kind = "guidance" if network is None else "agent"
    return Playground(title_of(run), _script(data, layers, text), data, kind)


def pace(setup: Setup) -> int:
    """Seconds of flight in a second on the screen: 1 for an episode of a minute or less, more for longer ones."""
    seconds = setup.timing.control_period * setup.timing.episode_steps / _SECONDS
    return max((x for x in _PACES if x <= seconds), default=1)


def title_of(run: LoadedRun) -> str:
    """Who flies what."""
    return f"{run.controller.name}: {task_name(run.judged.task)}, {run.judged.craft.name}"


def _script(data: Mapping[str, Any], layers: Mapping[str, Any], text: Sequence[str]) -> str:
    """The script without a browser in it: data, weights, printed functions, and the class that drives them."""
    return "\n".join(
        (
            f"const DATA = {markup.data(data)};",
            f"const WEIGHTS = {markup.data(layers)};",
            activations(),
            *text,
            text_of("flight.js"),
        )
    )


class _Traced:
    """Prints what one world computes; "carried" is what lives from step to step, all of an episode."""

    def __init__(self, world: World) -> None:
        self.world = world
        words = [Symbol.input(name, "int") for name in ("low", "high", "number")]
        self._words = words
        clock = Symbol.constant(0)
        draws = Draws(words[0], words[1], words[2], 0, None)
        self._begun = world.begin(*world.scenario(clock, draws), clock, draws)
        count = len(leaves(self._begun))
        offset = len(leaves((self._begun.state, self._begun.goal)))
        kinds = ["int" if k == offset else "real" for k in range(count)]
        self.carried = [Symbol.input(f"carried_{k}", kinds[k]) for k in range(count)]  # type: ignore[arg-type]
        self.episode: Episode = unflatten(self._begun, self.carried)
        assert self.episode.clock is self.carried[offset]

    def begin(self) -> str:
        """``begin([low, high, number])``: what is carried at an episode's start."""
        return function("begin", {"words": self._words}, {"carried": leaves(self._begun)})

    def act(self, network: Network, tables: Mapping[str, np.ndarray]) -> str:
        """``act(carried, errors, memory)``: commands in the craft's ranges, outputs, and the memory afterwards.

        Errors are those of the measured state, coordinates around the true one.

        The keys are those of the call in playground.js.
        """
        world = self.world
        errors, observation = self._observed()
        architecture = network.architecture
        program = policy_program(architecture)
        memory = inputs("memory", architecture.memory)
        values: dict[str, Any] = {"observation": observation}
        values |= {
            name: tables[name].tolist()
            for name in ("mean", "scale", "zoom")
            if name in program.parameters
        }
        requested = ["command"]
        if memory:
            values["memory"] = memory
            requested.append("memory_out")
        outputs, stages = symbols(program, values, requested)
        results = {
            "command": of_outputs(world.craft, tuple(outputs["command"])),
            "memory": outputs.get("memory_out", ()),
        }
        arguments = {"carried": self.carried, "errors": errors, "memory": memory}
        return function("act", arguments, results, stages)

    def guided(self, guidance: Any) -> str:
        """``act(carried, errors, memory)``: commands of guidance for the measured state, without a memory."""
        errors, measured = self._measured()
        command = guidance.command(measured, self.episode.goal)
        arguments = {"carried": self.carried, "errors": errors, "memory": []}
        return function("act", arguments, {"command": command, "memory": ()})

    def _measured(self) -> tuple[list[Symbol], Any]:
        """Errors of the measured state, coordinates around the true one, and the measured state."""
        errors = inputs("error", len(noise_scale(self.world.craft)))
        measured = replace(
            around(self.episode.state, tuple(errors)),
            notes=self.episode.state.notes,
            stores=self.episode.state.stores,
        )
        return errors, measured

    def _observed(self) -> tuple[list[Symbol], Any]:
        """Errors of the measured state, coordinates around the true one, and the observation with them."""
        errors, measured = self._measured()
        return errors, self.world.observe(replace(self.episode, state=measured, reading=None))

    def advance(self) -> str:
        """``advance(carried, command, gain, leak)``: what is carried a control period later, and poses on the way.

        A thruster with the command c gives gain * c + leak of its force.
        """
        world = self.world
        craft = world.craft
        command = inputs("command", craft.command_count)
        gain = inputs("gain", craft.thruster_count)
        leak = inputs("leak", craft.thruster_count)
        body = replace(Body.of(craft), gain=tuple(gain), leak=tuple(leak))
        poses: list[Field] = []
        substeps = Substeps()

        def move(state: Any, step_inputs: StepInputs) -> tuple[Any, ...]:
            states = world.move(state, step_inputs, substeps.advance)
            poses.extend(x for state in states for x in leaves((state.p, state.attitude)))
            return states

        outcome = step(world, replace(self.episode, body=body), tuple(command), None, move)
        after = replace(outcome.episode, body=None)
        over = [outcome.failed, False if outcome.done is None else outcome.done]
        arguments = {"carried": self.carried, "command": command, "gain": gain, "leak": leak}
        results = {"carried": leaves(after), "poses": poses, "over": over}
        text = function("advance", arguments, results, substeps.calls)
        return f"{substep_functions(substeps)}\n{text}"

    def describe(self) -> str:
        """``describe(carried)``: errors, whether all are within their tolerances, scenery and markers.

        playground.js reads these keys; errors have the order of `Task.errors`, markers that of their fields.
        """
        task = self.world.task
        state = self.episode.state
        goal = self.episode.goal
        return function(
            "describe",
            {"carried": self.carried},
            {
                "errors": [*task.errors(state, goal).values()],
                "reached": [task.reached(state, goal)],
                "scenery": [x for shape in scenery(task, goal) for x in leaves(shape)],
                "markers": leaves(task.markers(goal)),
            },
        )


def scenery(task: Task, goal: Any) -> list[Shape]:
    """Shapes of a task that the page draws."""
    return [shape for shape in task.scenery(goal) if isinstance(shape, Ball | Cone | GlideSlope)]


def page_data(
    world: World, state: Any, goal: Any, run: LoadedRun, seed: int, episode: int, memory: int
) -> dict[str, Any]:
    """Data of the page of a flight with such states and goals; lengths in m, angles in rad, times in s.

    playground.js and flight.js read these keys, and those that `Playground` adds.
    """
    craft = world.craft
    errors = world.task.errors(state, goal)
    tolerances = world.task.tolerances()
    # A delay of the training's conditions, without which the agent may not fly: the middle of its range.
    conditions = run.conditions or Conditions()
    every = (conditions, *conditions.others)
    shortest = min(
        bounds(conditions.thrusters.latency)[0] + bounds(conditions.thrusters.command_delay)[0]
        for conditions in every
    )
    longest = max(parameters.delay for parameters in every)
    delay = round(0.5 * (shortest + longest) / world.timing.control_period, 6)
    return outline_values(craft, 6) | {
        "pace": pace(run.judged),
        "period": world.timing.control_period,
        "delay": delay,
        "longest": max(_LONGEST_DELAY, math.ceil(delay)),
        "checks": world.timing.checks,
        "words": seed_words(seed),
        "episode": episode,
        "goal": len(leaves(state)),
        "memory": memory,
        "commands": craft.command_count,
        "noise": noise_scale(craft).tolist(),
        # Missions on an orbit have planned for their goal, and others far away leave the range of the sliders.
        "moves": may_move_goal(world.task) and world.task.drift == FREE,
        "turned": "attitude" in errors,
        "errors": [
            {
                "name": name,
                "unit": QUANTITIES[name].display_unit,
                "factor": QUANTITIES[name].display_factor,
                "tolerance": tolerances.get(name),
            }
            for name in errors
        ],
        "scenery": [
            {"kind": type(shape).__name__, "size": len(leaves(shape))}
            for shape in scenery(world.task, goal)
        ],
    }


def _packed(weights: np.ndarray, biases: np.ndarray, bits: int) -> dict[str, str]:
    """A layer as base64, for flight.js: weights (o, i) as whole shares of their row's largest; scales, biases."""
    largest = np.maximum(np.abs(weights).max(axis=1), 1e-30)
    steps = 2 ** (bits - 1) - 1
    whole = np.round(weights.astype(float) / largest[:, None] * steps)
    integers = whole.astype(f"<i{bits // 8}")
    parts = {
        "weights": integers,
        "scales": (largest / steps).astype("<f4"),
        "biases": biases.astype("<f4"),
    }
    return {name: base64.b64encode(part.tobytes()).decode() for name, part in parts.items()}


def text_of(name: str) -> str:
    """The text of a script of pages."""
    return (files("rans.show.pages") / name).read_text("utf-8")
