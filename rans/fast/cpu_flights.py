"""Whole flights on a CPU: a traced program run by NumPy, and a network whose layers are one call of oneDNN each."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from rans.episode import World
from rans.fast.kernels.design import DoesNotFit
from rans.fast.kernels.flight_program import trace_flight
from rans.fast.learn.architecture import ACTIVATIONS, EXTRACTOR
from rans.fast.learn.network import Network
from rans.fast.straight import Memory, Straight
from rans.fast.verdicts import Verdicts
from rans.model.random import seed_words
from rans.model.trace import Symbol


class CpuFlights:
    """A world's flights of one policy; several threads may fly at once.

    Args:
        world: in float32; its task's settings are numbers.
        network: of one member, in float32 on the CPU.
        bf16: whether the network's products are of bfloat16, with sums of float32.

    Raises:
        DoesNotFit: the network remembers.
        TypeError: the task does more than arithmetic on fields.
    """

    def __init__(self, world: World, network: Network, bf16: bool) -> None:
        if network.architecture.memory:
            raise DoesNotFit("a policy with a memory")
        self._world, self._program, self._own = world, trace_flight(world, network.architecture), threading.local()
        self.way = f"CPU, {'bf16' if bf16 else 'float32'}"
        program, words = self._program, [Symbol.input(name, "int") for name in ("low", "high", "number")]
        carried = [one.symbol for one in program.carried]
        self._moved = [one for one in program.carried if one.after is not one.symbol]
        self._told = [Symbol.input(f"command_{i}") for i in range(len(world.craft.thrusters))]
        self._begin = Straight(words, [one.begin for one in program.carried])
        self._step = Straight([*words, *carried, *self._told], [*program.seen, program.view],
                              [one.after for one in self._moved])
        self._verdict = Straight(carried, [program.failure, program.settles, program.settled, *program.totals])
        self._answers = _Answers(network, torch.bfloat16 if bf16 else torch.float32)

    @torch.no_grad()
    def fly(self, first: int, count: int, seed: int, listed: int) -> Verdicts:
        """What becomes of scenarios ``first`` to ``first + count - 1``."""
        numbers = np.arange(first, first + count, dtype=np.int32)
        begin, step, verdict = self._memory(count)
        # What is no longer finite flies on in vain: nothing of it is counted.
        with np.errstate(all="ignore"):
            begin.give((*seed_words(seed), numbers))
            begun = begin.run(0)
            step.give((*seed_words(seed), numbers, *begun))
            for _ in range(self._world.timing.episode_steps):
                *seen, view = step.run(0)
                for symbol, command in zip(self._told, self._answers(seen, view), strict=True):
                    step.put(symbol, command)
                for one, value in zip(self._moved, step.run(1), strict=True):
                    step.put(one.symbol, value)
            verdict.give(step.value(one.symbol) for one in self._program.carried)
            failure, settles, settled, *totals = (np.broadcast_to(x, count) for x in verdict.run(0))
        return Verdicts.of(self._world, numbers, (failure, settles, settled), totals, listed, self.way)

    def _memory(self, count: int) -> tuple[Memory, ...]:
        """This thread's; most calls are for as many flights."""
        kept = getattr(self._own, "memory", None)
        if kept is None or self._own.count != count:
            self._own.count = count
            self._own.memory = kept = tuple(p.memory(count) for p in (self._begin, self._step, self._verdict))
        return kept


class _Answers:
    """The likeliest commands of a network."""

    def __init__(self, network: Network, dtype: torch.dtype) -> None:
        given, tensors = network.architecture, network.tensors
        mean, variance = (tensors[EXTRACTOR + name].numpy() for name in ("mean", "variance"))
        self._given, self._dtype, self._mean = given, dtype, mean
        self._scale = (1.0 / np.sqrt(variance + np.float32(1e-6))).astype(np.float32)
        trunk = [f"{EXTRACTOR}trunk.{2 * i}" for i in range(len(given.layers))]
        self._layers = [(tensors[f"{name}.weight"].to(dtype), tensors[f"{name}.bias"].to(dtype)) for name in trunk]
        weight, bias = tensors["action_net.weight"], tensors["action_net.bias"]
        if not given.continuous:
            weight, bias = weight[1::2] - weight[0::2], bias[1::2] - bias[0::2]
        # A duty is not to be rounded, but the sign of a logit may be of a rounded one.
        self._out = torch.float32 if given.continuous else dtype
        self._head = weight.to(self._out), bias.to(self._out)
        self._places = None if given.symmetries is None else torch.as_tensor(given.symmetries.place)
        self._layer = _layer(given.activation)

    def __call__(self, seen: Sequence[np.ndarray], view: np.ndarray) -> Sequence[np.ndarray]:
        """Commands, each (N,), to columns (N,) as they are seen from one side of the craft."""
        x = self._shown(seen)
        for weight, bias in self._layers:
            x = self._layer(x, weight, bias)
        out = functional.linear(x.to(self._out), *self._head)
        command = out.clamp(0.0, 1.0) if self._given.continuous else (out > 0).to(torch.uint8)
        if self._places is not None:
            command = command.gather(1, self._places[torch.from_numpy(view)])
        return tuple(command.T.to(torch.float32).contiguous().numpy())

    def _shown(self, seen: Sequence[np.ndarray]) -> Tensor:
        """What the first layer is given, as `Network._looks`."""
        given, width = self._given, len(seen)
        rows = np.empty((width * (2 if given.zoom else 1), len(seen[0])), np.float32)
        for i, column in enumerate(seen):
            row = np.subtract(column, self._mean[i], rows[i])
            np.clip(np.multiply(row, self._scale[i], row), -given.clip, given.clip, row)
            if given.zoom:
                row = np.multiply(column, self._scale[i] * np.float32(given.zoom), rows[width + i])
                np.tanh(row, row)
        return torch.from_numpy(rows).T.to(self._dtype, memory_format=torch.contiguous_format)


def _layer(activation: str) -> Callable[[Tensor, Tensor, Tensor], Tensor]:
    """A linear layer and its activation: at once where oneDNN knows it, which is twice as fast."""
    try:
        one = torch.ops.mkldnn._linear_pointwise
        torch.testing.assert_close(one(torch.ones(1, 1), torch.ones(1, 1), torch.ones(1), activation, [], ""),
                                   ACTIVATIONS[activation]()(torch.full((1, 1), 2.0)))
    except (AttributeError, RuntimeError, AssertionError):
        act = ACTIVATIONS[activation]()
        return lambda x, weight, bias: act(functional.linear(x, weight, bias))
    return lambda x, weight, bias: one(x, weight, bias, activation, [], "")


def quick_bf16() -> bool:
    """Whether this processor multiplies bfloat16."""
    return torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported()
