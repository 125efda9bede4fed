"""Whole flights on a CPU: a traced program run by NumPy, and a network of one call of oneDNN a layer."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from rans.episode import World
from rans.fast.kernels.flight_program import FlightProgram
from rans.fast.learn.architecture import ACTIVATIONS, EXTRACTOR
from rans.fast.learn.network import Network
from rans.fast.straight import Memory, Straight
from rans.fast.verdicts import Sums, Verdicts
from rans.model.random import seed_words
from rans.model.trace import Symbol

_TRIED = 128
"""Flights that tell how far bfloat16 is off."""
_BLOCK = 2048
"""Flights whose activations stay in a core's own cache."""
_PADDED = 64
"""Doubtful flights come in multiples of so many."""
_DEVIATIONS = 6.0
"""Errors beyond so many standard deviations: of 10^8 there was none beyond 9."""


class CpuFlights:
    """A world's flights of one policy; several threads may fly at once.

    Args:
        world: in float32; its task's settings are numbers.
        network: of one member that remembers nothing, in float32 on the CPU.
        program: theirs.
    """

    def __init__(self, world: World, network: Network, program: FlightProgram) -> None:
        self._world, self._program, self._own = world, program, threading.local()
        words = [Symbol.input(name, "int") for name in ("low", "high", "number")]
        carried = [one.symbol for one in program.carried]
        self._moved = [one for one in program.carried if one.after is not one.symbol]
        self._told = [Symbol.input(f"command_{i}") for i in range(len(world.craft.thrusters))]
        self._begin = Straight(words, [one.begin for one in program.carried])
        self._step = Straight([*words, *carried, *self._told], [*program.seen, program.view],
                              [one.after for one in self._moved])
        self._verdict = Straight(carried, [program.failure, program.settles, program.settled,
                                           *program.totals])
        self._answers = _Answers(network)
        self.fly(0, _TRIED, 0, 0)
        self._answers.settle()

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
        return Verdicts.of(self._world, numbers, (failure, settles, settled), totals, listed, "CPU, float32")

    def _memory(self, count: int) -> tuple[Memory, ...]:
        """This thread's; most calls are for as many flights."""
        kept = getattr(self._own, "memory", None)
        if kept is None or self._own.count != count:
            self._own.count = count
            self._own.memory = kept = tuple(p.memory(count) for p in (self._begin, self._step, self._verdict))
        return kept


class _Answers:
    """The likeliest commands of a network, as float32 finds them.

    On a processor that multiplies bfloat16, hidden layers do so after the first, which is dearer to round and
    cheap to have. Where that leaves a command in doubt, float32 decides: in a few rows of a hundred.
    """

    def __init__(self, network: Network) -> None:
        given, tensors = network.architecture, network.tensors
        mean, variance = (tensors[EXTRACTOR + name].numpy() for name in ("mean", "variance"))
        self._given, self._mean = given, mean
        self._scale = (1.0 / np.sqrt(variance + np.float32(1e-6))).astype(np.float32)
        weight, bias = tensors["action_net.weight"], tensors["action_net.bias"]
        if not given.continuous:
            weight, bias = weight[1::2] - weight[0::2], bias[1::2] - bias[0::2]
        names = [f"{EXTRACTOR}trunk.{2 * i}" for i in range(len(given.layers))]
        layers = [(tensors[f"{name}.weight"], tensors[f"{name}.bias"]) for name in names]
        self._first, self._exact = layers[0], [*layers[1:], (weight, bias)]
        # A duty is nowhere in doubt: all its digits count.
        quick = _multiplies_bf16() and len(layers) > 1 and not given.continuous
        self._quick = [(w.bfloat16(), b.bfloat16()) for w, b in self._exact] if quick else []
        self._places = None if given.symmetries is None else np.array(given.symmetries.place).T.copy()
        self._layer, self._linear = _layer(given.activation), _layer("")
        self._doubtful = math.inf
        self._errors = Sums()

    def settle(self) -> None:
        """Doubt logits below a bound from now on, by the errors of all answers so far."""
        self._doubtful = _DEVIATIONS * math.sqrt(self._errors.mean)

    def __call__(self, seen: Sequence[np.ndarray], view: np.ndarray) -> Sequence[np.ndarray]:
        """Commands, each (N,), to columns (N,) as they are seen from one side of the craft."""
        given, count, shown = self._given, len(seen[0]), self._shown(seen)
        out = self._logits(shown).numpy()
        command = np.clip(out, 0.0, 1.0) if given.continuous else (out > 0.0).astype(np.float32)
        if self._places is None:
            return tuple(command)
        flat, own = command.reshape(-1), np.arange(count)
        return [flat.take(place.take(view) * count + own) for place in self._places]

    def _logits(self, shown: Tensor) -> Tensor:
        """Log-odds or duties (thrusters, N)."""
        if not self._quick:
            return self._blocks(shown, self._exact)
        out = self._blocks(shown, self._quick)
        nearest = torch.from_numpy(np.abs(out.numpy()).min(axis=0))
        doubtful = (nearest < self._doubtful).nonzero()[:, 0]
        # Of as many rows as before: for every new number oneDNN makes a new program.
        padded = torch.zeros(-(-len(doubtful) // _PADDED) * _PADDED, shown.shape[1])
        padded[:len(doubtful)] = shown[doubtful]
        exact = self._blocks(padded, self._exact)[:, :len(doubtful)]
        if self._doubtful == math.inf:
            self._errors += Sums.of((out - exact).square().flatten().numpy())
        out[:, doubtful] = exact
        return out

    def _blocks(self, shown: Tensor, layers: Sequence[tuple[Tensor, Tensor]]) -> Tensor:
        """Block by block, after the first layer in the layers' dtype."""
        out = torch.empty(self._given.thrusters, len(shown))
        for rows, place in zip(shown.split(_BLOCK), out.split(_BLOCK, dim=1), strict=True):
            place.copy_(self._through(self._layer(rows, *self._first).to(layers[0][0].dtype), layers).T)
        return out

    def _through(self, x: Tensor, layers: Sequence[tuple[Tensor, Tensor]]) -> Tensor:
        *hidden, head = layers
        for weight, bias in hidden:
            x = self._layer(x, weight, bias)
        return self._linear(x, *head)

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
        return torch.from_numpy(rows).T.contiguous()


def _layer(activation: str) -> Callable[[Tensor, Tensor, Tensor], Tensor]:
    """A linear layer and its activation, if any: at once where oneDNN knows it, which is twice as fast."""
    act = ACTIVATIONS[activation]() if activation else lambda x: x
    try:
        one = partial(torch.ops.mkldnn._linear_pointwise, attr=activation or "none", scalars=[], algorithm="")
        torch.testing.assert_close(one(torch.ones(1, 1), torch.ones(1, 1), torch.ones(1)),
                                   act(torch.full((1, 1), 2.0)))
    except (AttributeError, RuntimeError, AssertionError):
        return lambda x, weight, bias: act(functional.linear(x, weight, bias))
    return one


def _multiplies_bf16() -> bool:
    """Whether this processor does."""
    return torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported()
