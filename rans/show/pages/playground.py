"""A page in which an exported agent flies in the browser: physics and policy as JavaScript, printed from the code.

The step of an episode and the policy are traced (`rans.model.trace`) and printed (`rans.compile.javascript`);
only the page's controls and its drawing are written by hand. It opens offline, from a file.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from rans.compile.javascript import JAVASCRIPT, activations, function, substep_functions
from rans.compile.substeps import Substeps
from rans.effectors.commands import of_outputs
from rans.episode import Episode, World, step
from rans.errors import ConfigError
from rans.evaluation.fly.agent import Agent, LoadedRun
from rans.evaluation.fly.tuned import task_name
from rans.files import write_text
from rans.model.body import Body
from rans.model.coordinates import around
from rans.model.fields import Field, leaves, unflatten
from rans.model.random import Draws, seed_words
from rans.model.trace import UNTRACEABLE, Symbol
from rans.policy.program import inputs
from rans.policy.scalars import symbols
from rans.policy.traced import parameters, policy_program
from rans.randomization.conditions import Conditions, bounds
from rans.randomization.parameters import StepInputs
from rans.scenario import EVALUATION_SEED
from rans.show.scene.interactive import interactive_world, may_move_goal, noise_scale
from rans.tasks.quantities import QUANTITIES
from rans.tasks.shapes import Ball, Cone, Shape

_LONGEST_DELAY = 5
"""Control periods up to which the page's delay may be set."""
_WEIGHTS = 80_000
"""Number of weights up to which they have 16 bits: 213 kB as base64. More of them have 8 bits."""


@dataclass(frozen=True)
class Playground:
    """The page of one agent.

    Attributes:
        title: who flies which spacecraft with which task.
        script: JavaScript without a browser in it: the functions ``begin``, ``act``, ``advance`` and
            ``describe`` printed from the code, the weights, and a class ``Flight`` that drives them.
        data: what the page must know of the spacecraft and the task.
    """

    title: str
    script: str
    data: Mapping[str, Any]

    def html(self) -> str:
        """The page, which fetches nothing."""
        environment = Environment(
            loader=PackageLoader("rans.show.pages", "."),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        template = environment.get_template("playground.html.j2")
        return template.render(
            title=self.title,
            bits=self.data.get("bits"),
            script=self.script,
            page=_text("playground.js"),
        )

    def write(self, file: Path) -> None:
        """Write the page; `ConfigError` if the disk refuses."""
        write_text(file, self.html())


def playground(run: LoadedRun, seed: int = EVALUATION_SEED, episode: int = 0) -> Playground:
    """The page of an agent that flies in its task, from the starts of a seed.

    Everything is as designed, but the delay, which begins in the middle of that of the training's conditions.

    Args:
        run: a trained agent with its spacecraft and task.
        seed: of starts and goals.
        episode: number of the first start; the page has a button for the next ones.

    Raises:
        ConfigError: this is no trained agent, or the page cannot compute its policy or its task.
    """
    controller = run.controller
    if not isinstance(controller, Agent):
        raise ConfigError(
            f"{controller.name} is no trained agent: a page flies the network of a run folder or of an agent that "
            "comes with RANS. `rans view --play` flies every controller."
        )
    architecture = controller.network.architecture
    if missing := JAVASCRIPT.missing(architecture):
        raise ConfigError(
            f"{controller.name} has {missing}, which no page computes; `rans view --play` flies it."
        )
    setup = run.judged
    world = interactive_world(setup)
    tables = parameters(controller.network)
    try:
        traced = _Traced(world)
        text = [
            traced.begin(),
            traced.act(controller, tables),
            traced.advance(),
            traced.describe(),
        ]
    except UNTRACEABLE as error:
        raise ConfigError(
            f"the task {task_name(setup.task)} does more than arithmetic on fields, which no page computes: "
            f"{error} `rans view --play` flies it."
        ) from error
    names = [name for name in tables if name.endswith(".weight")]
    bits = 16 if sum(tables[name].size for name in names) <= _WEIGHTS else 8
    data = _data(traced, run, seed, episode) | {"bits": bits}
    layers = {
        name.removesuffix(".weight"): _packed(
            tables[name], tables[name.removesuffix("weight") + "bias"], bits
        )
        for name in names
    }
    script = "\n".join(
        (
            f"const DATA = {json.dumps(data, separators=(',', ':'))};",
            f"const WEIGHTS = {json.dumps(layers, separators=(',', ':'))};",
            activations(),
            *text,
            _text("flight.js"),
        )
    )
    title = f"{controller.name}: {task_name(setup.task)}, {setup.craft.name}"
    return Playground(title, script, data)


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
        """
        world = self.world
        errors = inputs("error", len(noise_scale(world.craft)))
        measured = replace(
            around(self.episode.state, tuple(errors)),
            notes=self.episode.state.notes,
            stores=self.episode.state.stores,
        )
        observation = world.observe(replace(self.episode, state=measured, reading=None))
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

    def advance(self) -> str:
        """``advance(carried, command, gain, leak)``: what is carried a control period later, and poses on the way.

        A thruster with the command c gives gain * c + leak of its force.
        """
        world = self.world
        craft = world.craft
        command = inputs("command", craft.command_count)
        gain = inputs("gain", craft.thruster_count)
        leak = inputs("leak", craft.thruster_count)
        poses: list[Field] = []
        substeps = Substeps()

        def move(state: Any, step_inputs: StepInputs) -> tuple[Any, ...]:
            states = world.move(state, step_inputs, substeps.advance)
            poses.extend(x for state in states for x in leaves((state.p, state.attitude)))
            return states

        body = replace(Body.of(craft), gain=tuple(gain), leak=tuple(leak))
        outcome = step(world, replace(self.episode, body=body), tuple(command), None, move)
        after = replace(outcome.episode, body=None)
        over = [outcome.failed, False if outcome.done is None else outcome.done]
        arguments = {"carried": self.carried, "command": command, "gain": gain, "leak": leak}
        results = {"carried": leaves(after), "poses": poses, "over": over}
        text = function("advance", arguments, results, substeps.calls)
        return f"{substep_functions(substeps)}\n{text}"

    def describe(self) -> str:
        """``describe(carried)``: errors, whether all are within their tolerances, and scenery."""
        task = self.world.task
        state = self.episode.state
        goal = self.episode.goal
        return function(
            "describe",
            {"carried": self.carried},
            {
                "errors": [*task.errors(state, goal).values()],
                "reached": [task.reached(state, goal)],
                "scenery": [x for shape in self.scenery for x in leaves(shape)],
            },
        )

    @property
    def scenery(self) -> list[Shape]:
        """Shapes of the task that the page draws."""
        shapes = self.world.task.scenery(self.episode.goal)
        return [shape for shape in shapes if isinstance(shape, Ball | Cone)]


def _data(traced: _Traced, run: LoadedRun, seed: int, episode: int) -> dict[str, Any]:
    """Data of the page; lengths in m, angles in rad, times in s."""
    world = traced.world
    craft = world.craft
    centre = np.array(craft.centre_of_mass)
    largest = max(thruster.force for thruster in craft.thrusters)
    errors = world.task.errors(traced.episode.state, traced.episode.goal)
    tolerances = world.task.tolerances()
    controller = run.controller
    assert isinstance(controller, Agent)
    # A delay of the training's conditions, without which the agent may not fly: the middle of its range.
    conditions = run.conditions or Conditions()
    every = (conditions, *conditions.others)
    shortest = min(
        bounds(conditions.thrusters.latency)[0] + bounds(conditions.thrusters.command_delay)[0]
        for conditions in every
    )
    longest = max(parameters.delay for parameters in every)
    delay = round(0.5 * (shortest + longest) / world.timing.control_period, 6)
    return {
        "planar": craft.dimension == 2,
        "period": world.timing.control_period,
        "delay": delay,
        "longest": max(_LONGEST_DELAY, math.ceil(delay)),
        "checks": world.timing.checks,
        "words": seed_words(seed),
        "episode": episode,
        "goal": len(leaves(traced.episode.state)),
        "memory": controller.network.architecture.memory,
        "commands": craft.command_count,
        "noise": noise_scale(craft).tolist(),
        "moves": may_move_goal(world.task),
        "turned": "attitude" in errors,
        "radius": craft.radius,
        "thrusters": [
            {
                "at": np.round(np.array(thruster.position) - centre, 6).tolist(),
                "along": np.round(
                    np.array(thruster.direction) * (thruster.force / largest), 6
                ).tolist(),
            }
            for thruster in craft.thrusters
        ],
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
            {"kind": type(shape).__name__, "size": len(leaves(shape))} for shape in traced.scenery
        ],
    }


def _packed(weights: np.ndarray, biases: np.ndarray, bits: int) -> dict[str, str]:
    """A layer as base64: weights (o, i) as whole shares of the largest of their row, the rest in float32."""
    largest = np.maximum(np.abs(weights).max(axis=1), 1e-30)
    steps = 2 ** (bits - 1) - 1
    integers = np.round(weights / largest[:, None] * steps).astype(f"<i{bits // 8}")
    parts = {
        "weights": integers,
        "scales": (largest / steps).astype("<f4"),
        "biases": biases.astype("<f4"),
    }
    return {name: base64.b64encode(part.tobytes()).decode() for name, part in parts.items()}


def _text(name: str) -> str:
    return (files("rans.show.pages") / name).read_text("utf-8")
