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

from rans.compile.javascript import JAVASCRIPT, activations, function, substep_functions
from rans.compile.substeps import Substeps
from rans.effectors.commands import is_identity, of_outputs
from rans.episode import Episode, Setup, World, step
from rans.errors import ConfigError
from rans.evaluation.fly.agent import Agent, LoadedRun
from rans.evaluation.fly.tuned import task_name
from rans.files import write_text
from rans.flight import Controller, informed
from rans.model.body import Body
from rans.model.coordinates import around
from rans.model.drift import FREE
from rans.model.fields import Field, leaves, unflatten
from rans.model.random import Draws, seed_words
from rans.model.spacecraft import Spacecraft, Thruster
from rans.model.timing import Timing
from rans.model.trace import UNTRACEABLE, Symbol
from rans.outline import Outline
from rans.policy.adaptation import AWAY, POSE
from rans.policy.allocation import FALL, MOST_SUBSETS, PASSES, PRICE
from rans.policy.any_craft import RANGES, frugal, is_for_any_craft
from rans.policy.architecture import Architecture
from rans.policy.authority import WAYS, Authority, of_observation
from rans.policy.holding import HOLD
from rans.policy.network import Network
from rans.policy.program import inputs
from rans.policy.scalars import symbols
from rans.policy.timing import LARGEST_TURN, PERIODS
from rans.policy.traced import parameters, policy_program
from rans.randomization.conditions import Conditions, bounds
from rans.randomization.parameters import StepInputs
from rans.scenario import EVALUATION_SEED
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
_MOST_DRAWN = 12
"""Largest number of thrusters that a visitor may draw: all their subsets are compared."""


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
        draws = bool(self.data.get("drawing"))
        return filled(
            "playground.html.j2",
            title=self.title,
            bits=self.data.get("bits"),
            kind=self.kind,
            draws=draws,
            script=markup.code(self.script),
            page=markup.code(
                *map(text_of, ("craft.js", "playground.js", "drawing.js")[: 2 + draws])
            ),
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
    if isinstance(controller, Law):
        return _guided(controller, run, seed, episode)
    if not isinstance(controller, Agent):
        raise ConfigError(
            f"{controller.name} is no trained agent: a page flies the network of a run folder or of an agent that "
            "comes with RANS, mission guidance, such as mission:dock-3d, or a controller with `command` "
            "(examples/single_file/controller.py). `rans view` without --play replays every controller."
        )
    architecture = controller.network.architecture
    if missing := JAVASCRIPT.missing(architecture):
        raise ConfigError(f"{controller.name} has {missing}, which no page computes.")
    setup = run.judged
    world = interactive_world(setup, FRAME * pace(setup))
    tables = parameters(controller.network)
    choices, chosen = _choices(run)
    try:
        traced = _Traced(world)
        text = [traced.begin(), traced.describe()]
        # A craft that a visitor may draw has other thrusters, mass and inertia, and another control period.
        draws = _may_draw(setup.craft, architecture)
        if _is_allocated_here(architecture):
            # Choices with weights of their own have layers of their own.
            several = controller.network.at and len(choices) > 1
            tables = {
                f"{number}.{name}" if several else name: x
                for number, one in enumerate(choices)
                for name, x in parameters(one).items()
            }
            text += [
                traced.demand(one, number, f"{number}." if several else "")
                for number, one in enumerate(choices)
            ]
            text += [text_of("allocation.js"), traced.in_ranges()]
        else:
            text.append(traced.act(controller, tables))
        if draws:
            text += [_pushes(setup), text_of("drawn_craft.js")]
        else:
            text.append(traced.advance())
    except UNTRACEABLE as error:
        raise ConfigError(
            f"the task {task_name(setup.task)} does more than arithmetic on fields, which no page computes: "
            f"{error}"
        ) from error
    names = [name for name in tables if name.endswith(".weight")]
    size = sum(
        x.size for name, x in parameters(controller.network).items() if name.endswith(".weight")
    )
    bits = next(bits for limit, bits in _BITS.items() if size <= limit)
    data = page_data(
        traced.world,
        traced.episode.state,
        traced.episode.goal,
        run,
        seed,
        episode,
        architecture.memory,
    ) | {"bits": bits}
    if _is_allocated_here(architecture):
        data["allocation"] = _allocation_data(choices, chosen)
    if draws:
        data["drawing"] = _drawing_data(run)
    layers = {
        name.removesuffix(".weight"): _packed(
            tables[name], tables[name.removesuffix("weight") + "bias"], bits
        )
        for name in names
    }
    return Playground(title_of(run), _script(data, layers, text), data)


def _guided(guidance: Law, run: LoadedRun, seed: int, episode: int) -> Playground:
    """The page of mission guidance or of a user's law, which knows its state and a world as designed."""
    nominal: Any = informed(guidance, None)
    setup = run.judged
    traced = _Traced(interactive_world(setup, FRAME * pace(setup)))
    text = [traced.begin(), traced.describe(), traced.guided(nominal), traced.advance()]
    data = page_data(traced.world, traced.episode.state, traced.episode.goal, run, seed, episode, 0)
    return Playground(title_of(run), _script(data, {}, text), data, "guidance")


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

    def act(self, agent: Agent, tables: Mapping[str, np.ndarray]) -> str:
        """``act(carried, errors, memory)``: commands in the craft's ranges, outputs, and the memory afterwards.

        Errors are those of the measured state, coordinates around the true one.

        The keys are those of the call in playground.js.
        """
        world = self.world
        errors, observation = self._observed()
        architecture = agent.network.architecture
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

    def guided(self, guidance: Law) -> str:
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

    def demand(self, network: Network, number: int, prefix: str) -> str:
        """``demand0(carried, errors, authority)`` or of another number: change of twist to be allocated.

        Beside it is ``away``, 1 where the goal is far, if the price of thrust depends on it, and ``pose``
        (`rans.policy.holding.pose`) if pulses hold it. The demand is in units
        of the authority, which is a control period, six accelerations, the least linear and angular one of them,
        and those along `rans.policy.authority.WAYS`. Names of layers begin with the prefix.
        """
        errors, observation = self._observed()
        architecture = network.architecture
        tables = parameters(network)
        program = policy_program(architecture)
        numbers = inputs("authority", 9 + len(WAYS))
        period, *authority = numbers[:7]
        least_linear, least_angular, *reach = numbers[7:]
        columns = of_observation(
            architecture.layout,
            observation,
            Authority(
                period,
                authority[:4],
                authority[4:],
                least_linear,
                least_angular,
                reach if architecture.reach else (),
            ),
            architecture.coast,
            frugality=architecture.frugality,
        )
        values: dict[str, Any] = {"body": columns} | {
            name: tables[name].tolist()
            for name in ("mean", "scale", "zoom")
            if name in program.parameters
        }
        (head,) = (
            name
            for step in program.steps
            if step.operation == "Dense" and "head.weight" in step.inputs
            for name in step.outputs
        )
        # The page allocates the demand itself, so that the program ends before the head's choice.
        rows = {"demand": head} | ({"away": AWAY} if architecture.frugality.away != 1.0 else {})
        rows |= {"pose": POSE} if architecture.frugality.hold else {}
        outputs, stages = symbols(program, values, [*rows.values()])
        arguments = {"carried": self.carried, "errors": errors, "authority": numbers}
        stages = [
            stage._replace(
                layers=tuple(one._replace(weight=prefix + one.weight) for one in stage.layers)
            )
            for stage in stages
        ]
        results = {name: outputs[row] for name, row in rows.items()}
        return function(f"demand{number}", arguments, results, stages)

    def in_ranges(self) -> str:
        """``in_ranges(outputs)``: commands in the craft's ranges for numbers from 0 to 1."""
        craft = self.world.craft
        outputs = inputs("output", craft.command_count)
        if is_identity(craft):
            return "const in_ranges = outputs => ({command: outputs});"
        return function(
            "in_ranges", {"outputs": outputs}, {"command": of_outputs(craft, tuple(outputs))}
        )

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
        arguments = {"command": command, "gain": gain, "leak": leak}
        return "\n".join(self._advanced("advance", arguments, command, body))

    def push(self, number: int) -> tuple[str, str]:
        """Functions of substeps, and ``push0(carried, wrench, body)`` or of another number.

        It is as `advance`, of a craft of `_probe` with this wrench in B. The body is its mass, kg, and its moment
        of inertia, kg m^2.
        """
        wrench = inputs("wrench", 3)
        mass, moment = inputs("body", 2)
        gains: list[Field] = [*wrench, 1.0, 1.0, 1.0]
        gains[1] = gains[1] - gains[2]
        body = replace(
            Body.of(self.world.craft),
            mass=mass,
            inertia=(moment,),
            gain=tuple(gains),
        )
        arguments = {"wrench": wrench, "body": [mass, moment]}
        return self._advanced(f"push{number}", arguments, [1.0] * 3 + [0.0] * 3, body)

    def _advanced(
        self,
        name: str,
        arguments: Mapping[str, Sequence[Symbol]],
        command: Sequence[Field],
        body: Body,
    ) -> tuple[str, str]:
        """Functions of substeps, and one of this name: what is carried a period later, and poses on the way."""
        world = self.world
        poses: list[Field] = []
        substeps = Substeps()

        def move(state: Any, step_inputs: StepInputs) -> tuple[Any, ...]:
            states = world.move(state, step_inputs, substeps.advance)
            poses.extend(x for state in states for x in leaves((state.p, state.attitude)))
            return states

        outcome = step(world, replace(self.episode, body=body), tuple(command), None, move)
        after = replace(outcome.episode, body=None)
        over = [outcome.failed, False if outcome.done is None else outcome.done]
        results = {"carried": leaves(after), "poses": poses, "over": over}
        text = function(name, {"carried": self.carried, **arguments}, results, substeps.calls)
        return substep_functions(substeps), text

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


def _is_allocated_here(architecture: Architecture) -> bool:
    """Whether the page's own script allocates demands, as for drawn craft: of agents for any planar craft."""
    is_planar = is_for_any_craft(architecture) and len(architecture.tokens[0]) == 4
    return is_planar and not architecture.adapts


def _may_draw(craft: Spacecraft, architecture: Architecture) -> bool:
    """Whether a visitor may change the craft: the agent flies any, and forces are constant for a period."""
    others = craft.wheels or craft.propellant or craft.further_effectors
    return (
        is_for_any_craft(architecture)
        and not architecture.adapts
        and craft.dimension == 2
        and craft.actuators.kind == "on-off"
        and not others
    )


def _timings(own: Timing) -> tuple[Timing, ...]:
    """Timing of the page's craft, then those of drawn craft with the long and with the short control period."""
    timings = (replace(own, control_period=period) for period in reversed(PERIODS))
    return (own, *timings)


def _probe(craft: Spacecraft) -> Spacecraft:
    """A craft whose first three thrusters, open for F_x, F_y - torque and torque, give any wrench.

    The other three stay shut; without them it could not be pushed every way, which is worth a warning.
    """
    centre = (0.0, 0.0, 0.0)
    points = ((centre, (1.0, 0.0)), (centre, (0.0, 1.0)), ((1.0, 0.0, 0.0), (0.0, 1.0)))
    return replace(
        craft,
        centre_of_mass=(0.0, 0.0, 0.0),
        thrust_sharing="none",
        thrusters=tuple(
            Thruster(point, (sign * x, sign * y, 0.0), 1.0)
            for sign in (1.0, -1.0)
            for point, (x, y) in points
        ),
    )


def _pushes(setup: Setup) -> str:
    """The functions of `_Traced.push` for every one of `_timings`, and ``PUSHES``, a list of them."""
    printed = [
        _Traced(interactive_world(setup._replace(craft=_probe(setup.craft), timing=timing))).push(
            number
        )
        for number, timing in enumerate(_timings(setup.timing))
    ]
    # Durations are arguments of substeps, which are the same for all periods.
    (substeps,) = {substeps for substeps, _ in printed}
    names = ", ".join(f"push{number}" for number in range(len(printed)))
    return "\n".join((substeps, *(text for _, text in printed), f"const PUSHES = [{names}];"))


_FAST_TO_FRUGAL = 0.0, 0.5, 1.0
"""Values of the page's slider for an agent for any craft."""


def _choices(run: LoadedRun) -> tuple[list[Network], int]:
    """What a visitor may choose of, fast to frugal, and the number of the agent's own.

    The first is an agent as it was trained, if it has no value. An agent that is not for any craft is the only one;
    one of another value stands in place of the nearest.
    """
    own = run.network
    if not is_for_any_craft(own.architecture):
        return [own], 0
    low, high = run.judged.task.spawn_distance  # type: ignore[attr-defined]  # it flies to a pose
    timing = run.judged.timing
    seconds = timing.control_period * timing.episode_steps
    choices = [frugal(own, value, 0.5 * (low + high), seconds) for value in _FAST_TO_FRUGAL]
    text = run.controller.name.partition("#")[2]
    value = float(text) if text.replace(".", "", 1).isdigit() else 0.0
    nearest = min(range(len(choices)), key=lambda k: abs(_FAST_TO_FRUGAL[k] - value))
    choices[nearest] = own
    return choices, nearest


def _allocation_data(choices: list[Network], chosen: int) -> dict[str, Any]:
    """What the page's allocation must know: tokens and authority of the craft, and its constants.

    allocation.js reads these keys.
    """
    architecture = choices[chosen].architecture
    period, *authority = architecture.authority
    reach = next((one.architecture.reach for one in choices if one.architecture.reach), ())
    return {
        "tokens": architecture.tokens,
        "authority": [
            *(period, *authority, min(authority[:4]), min(authority[4:])),
            *(reach or (0.0,) * len(WAYS)),
        ],
        "ways": WAYS,
        "prices": [one.architecture.frugality.price * PRICE for one in choices],
        "away": [one.architecture.frugality.away for one in choices],
        "chosen": chosen,
        "fall": FALL,
        "passes": PASSES,
        "subsets": MOST_SUBSETS,
        "hold": HOLD,
    }


def _drawing_data(run: LoadedRun) -> dict[str, Any]:
    """What a visitor may change, and the ranges of the training; lengths in m, angles in rad.

    drawing.js and drawn_craft.js read these keys.
    """
    craft = run.craft
    nozzles = Outline(craft).nozzles
    return {
        "craft": {
            "name": craft.name,
            "mass": craft.mass,
            "inertia": craft.inertia[2][2],
            "shared": craft.thrust_sharing == "split",
            "thrusters": [
                {
                    "at": nozzle.root[:2].tolist(),
                    "angle": math.atan2(-nozzle.exhaust[1], -nozzle.exhaust[0]),
                    "force": thruster.force,
                }
                for nozzle, thruster in zip(nozzles, craft.thrusters, strict=True)
            ],
        },
        "most": _MOST_DRAWN,
        "turn": LARGEST_TURN,
        "timings": [
            {"period": timing.control_period, "checks": timing.checks}
            for timing in (
                interactive_world(run.judged._replace(timing=own)).timing
                for own in _timings(run.timing)
            )
        ],
        "ranges": [
            {"name": name, "unit": unit, "low": low, "high": None if math.isinf(high) else high}
            for name, unit, low, high in RANGES[2]
        ],
    }


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
    return Outline(craft).values(6) | {
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
