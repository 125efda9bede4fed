"""Whole flights on a CPU: a traced program and a network as machine code."""

from __future__ import annotations

import numpy as np
import torch

from rans.extend import Capabilities, FlightStatistics, Network, Symbol, World, draws
from rans_machine_code.network import CompiledNetwork, NetworkCode
from rans_machine_code.policies import FlightProgram, trace_flight
from rans_machine_code.program import CompiledProgram

_FLOWN = Capabilities(backbones=("dense", "allocated"))
"""Kinds of policies that these flights fly."""
_MOST_PATTERNS = 128
"""Largest number of ways to open thrusters that are compared; a product of matrices compares more faster."""
_NONE = np.empty(0, np.float32)


def cpu_flights(world: World, network: Network, *_: object) -> CpuFlights:
    """Flights of a policy in a world in float32, whose task's settings are numbers.

    Raises:
        TypeError: the policy is of another kind, or the task does more than arithmetic on fields.
    """
    architecture = network.architecture
    if lacking := _FLOWN.missing(architecture):
        raise TypeError(lacking)
    if (patterns := architecture.kind.choices(architecture)) > _MOST_PATTERNS:
        raise TypeError(f"{patterns} ways to open thrusters")
    return CpuFlights(world, trace_flight(world, network, lookups=False))


class CpuFlights:
    """A world's flights of one policy; several threads may fly at once.

    Args:
        world: in float32; its task's settings are numbers.
        program: traced program of these flights, without lookups.
    """

    def __init__(self, world: World, program: FlightProgram) -> None:
        # The order of the step's parts is that in which `fly` runs them, since each may use what earlier ones have
        # computed.
        self._world = world
        self._program = program
        # Inputs: random seed, variables of the flights, commands of the policy, and outputs of its layers.
        words = [Symbol.input(name, "int") for name in ("low", "high", "number")]
        variables = (*program.carried, *program.policy.history)
        symbols = [variable.symbol for variable in variables]
        self._changing = [
            variable for variable in variables if variable.next is not variable.symbol
        ]
        self._carried = set(symbols)
        self._commands = [Symbol.input(f"command_{i}") for i in range(world.craft.command_count)]
        outputs = [symbol for stage in program.policy.stages for symbol in stage.outputs]
        # Programs: first values; a step, in parts between which the layers run; and the verdict.
        self._begin = CompiledProgram(words, [variable.initial for variable in variables])
        self._step = CompiledProgram(
            [*words, *symbols, *self._commands, *outputs],
            *(stage.inputs for stage in program.policy.stages),
            program.policy.commands,
            [variable.next for variable in self._changing],
        )
        self._verdict = CompiledProgram(
            symbols, [program.failure, program.settled, *program.totals]
        )
        self._layers = [
            CompiledNetwork(
                NetworkCode(
                    stage.inputs,
                    (),
                    stage.inputs,
                    tuple((layer.units, layer.activation) for layer in stage.layers),
                    stage.outputs,
                    stage.outputs,
                ),
                [
                    (program.tables[layer.weight], program.tables[layer.bias])
                    for layer in stage.layers
                ],
            )
            for stage in program.policy.stages
        ]

    @torch.no_grad()
    def fly(self, first: int, count: int, seed: int, listed: int) -> FlightStatistics:
        """Fly scenarios ``first`` to ``first + count - 1`` and return their outcomes.

        A scenario's draws depend on the seed and its number alone, so that batches of any size give the same
        flights.
        """
        source = draws(seed, count, first)
        words = source.low, source.high, source.first
        programs = self._begin, self._step, self._verdict
        begin, step, verdict = (program.memory(count) for program in programs)
        stages = list(zip(self._program.policy.stages, self._layers, strict=True))
        # What is no longer finite flies on in vain: nothing of it is counted.
        with np.errstate(all="ignore"):
            begin.give(words)
            step.give((*words, *begin.run(0)))
            for _ in range(self._world.timing.episode_steps):
                # The policy: inputs of each stage, then its layers; then commands from the last outputs.
                for part, (stage, layers) in enumerate(stages):
                    answers = layers(np.stack(step.run(part)), _NONE)
                    for symbol, answer in zip(stage.outputs, answers, strict=True):
                        step.put(symbol, answer)
                for symbol, command in zip(self._commands, step.run(len(stages)), strict=True):
                    step.put(symbol, command)
                # The motion. A value that becomes another variable's, as the last command becomes the last but one,
                # is copied before it is overwritten.
                after = [
                    np.copy(x) if variable.next in self._carried else x
                    for variable, x in zip(self._changing, step.run(len(stages) + 1), strict=True)
                ]
                for variable, value in zip(self._changing, after, strict=True):
                    step.put(variable.symbol, value)
            verdict.give(step.value(variable.symbol) for variable in self._program.carried)
            failure, settled, *totals = verdict.run(0)
        return FlightStatistics.of(
            self._world, source.first, (failure, settled), totals, listed, "CPU, float32"
        )
