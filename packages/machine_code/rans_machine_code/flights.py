"""Whole flights on a CPU: a traced program run by NumPy, and a network as machine code."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from rans.extend import FlightProgram, FlightStatistics, Symbol, World
from rans.model.random import seed_words
from rans_machine_code.layers import CpuLayers
from rans_machine_code.program import CompiledProgram


class CpuFlights:
    """A world's flights of one policy; several threads may fly at once.

    Args:
        world: in float32; its task's settings are numbers.
        program: traced program of these flights, with the policy's tables in it.
        tables: the policy's parameters (`rans.policy.traced.parameters`).
    """

    def __init__(
        self,
        world: World,
        program: FlightProgram,
        tables: Mapping[str, np.ndarray],
    ) -> None:
        # The order of the step's parts is that in which `fly` runs them, since each may use what earlier ones have
        # computed.
        self._world = world
        self._program = program
        self._own = threading.local()
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
        self._layers = [CpuLayers(stage, tables) for stage in program.policy.stages]

    @torch.no_grad()
    def fly(self, first: int, count: int, seed: int, listed: int) -> FlightStatistics:
        """Fly scenarios ``first`` to ``first + count - 1`` and return their outcomes.

        A scenario's draws depend on the seed and its number alone, so that batches of any size give the same
        flights.
        """
        numbers = np.arange(first, first + count, dtype=np.int32)
        begin, step, verdict, *memories = self._memory(count)
        stages = list(zip(self._program.policy.stages, self._layers, memories, strict=True))
        # What is no longer finite flies on in vain: nothing of it is counted.
        with np.errstate(all="ignore"):
            begin.give((*seed_words(seed), numbers))
            begun = begin.run(0)
            step.give((*seed_words(seed), numbers, *begun))
            for _ in range(self._world.timing.episode_steps):
                # The policy: inputs of each stage, then its layers; then commands from the last outputs.
                for part, (stage, layers, memory) in enumerate(stages):
                    answers = layers(step.run(part), memory)
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
            failure, settled, *totals = (np.broadcast_to(x, count) for x in verdict.run(0))
        return FlightStatistics.of(
            self._world, numbers, (failure, settled), totals, listed, "CPU, float32"
        )

    def _memory(self, count: int) -> tuple[Any, ...]:
        """This thread's memory for ``count`` flights, made anew only when the count changes.

        Values of the last batch remain in it: `fly` gives all of them anew.
        """
        memory = getattr(self._own, "memory", None)
        if memory is None or self._own.count != count:
            self._own.count = count
            self._own.memory = memory = tuple(
                variable.memory(count)
                for variable in (self._begin, self._step, self._verdict, *self._layers)
            )
        return memory
