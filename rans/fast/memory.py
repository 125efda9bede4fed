"""An engine's numbers: where they lie, how they are laid out, and how they are saved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from operator import truediv
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.episode import Episode, World
from rans.errors import ConfigError
from rans.fast.distributed import Processes
from rans.model.body import Body
from rans.model.fields import leaves, map_leaves
from rans.model.random import Draws, seed_words
from rans.model.spacecraft import Spacecraft

_NUMPY_DTYPES = {torch.float32: np.float32, torch.float64: np.float64}


def field_dtype(device: torch.device, dtype: torch.dtype = torch.float32,
                compiled: bool | None = None) -> Any:
    """Dtype of an engine's fields: NumPy's for an uncompiled step on a CPU, else torch's."""
    return dtype if compiled or device.type == "cuda" else _NUMPY_DTYPES[dtype]


@dataclass(frozen=True)
class Place:
    """Where fields lie: in NumPy's arrays, or in torch's tensors on a device."""

    device: torch.device
    fields: Any
    """Their floating dtype, see `field_dtype`."""

    @property
    def on_numpy(self) -> bool:
        """Whether they are NumPy's."""
        return not isinstance(self.fields, torch.dtype)

    def put(self, values: Any, dtype: torch.dtype) -> Any:
        """A copy of numbers, an array or a tensor."""
        copy = torch.as_tensor(values).to(self.device, dtype, copy=True)
        return copy.numpy() if self.on_numpy else copy

    def stack(self, rows: Sequence[Any]) -> Tensor:
        """Fields (N,) as one tensor (rows, N)."""
        return torch.from_numpy(np.stack(rows)) if self.on_numpy else torch.stack(tuple(rows))

    def words(self, seeds: Sequence[int], each: int) -> tuple[Any, Any]:
        """The two words of a seed, or every environment's own of its member's, int32."""
        table = np.repeat([seed_words(seed) for seed in seeds], each, axis=0).T if len(seeds) > 1 else (
            seed_words(seeds[0]))
        low, high = (self.put(word, torch.int32) for word in table)
        return low, high


def allocated(world: World, body: Body, place: Place, count: int, draws: Draws, remember: bool) -> Episode:
    """Episodes of N spacecraft in buffers of the right shape, which a reset fills.

    The body is in memory already; from what the first episodes draw it is seen what varies. They remember
    what they draw from their conditions, or draw it in every step.
    """
    zeros, kept = torch.zeros(count, dtype=torch.float64), getattr(torch, world.craft.actuators.dtype)
    clock = place.put(zeros, torch.int32)
    real = torch.float64 if place.fields in (np.float64, torch.float64) else torch.float32
    start, goal = world.scenario(clock, draws)
    new = world.begin(start, goal, clock, draws, body)

    def buffer(x: Any, later: Any = None) -> Any:
        return x if isinstance(x, int | float) and later is x else place.put(zeros, real)

    moved = world.task.next_goal(goal, start, world.timing.control_period)
    case = new.case and replace(map_leaves(buffer, new.case, new.case), number=place.put(zeros, torch.int32))
    return replace(new, state=map_leaves(buffer, start), goal=map_leaves(buffer, goal, moved),
                   case=case if remember else None, past=map_leaves(buffer, new.past),
                   reading=map_leaves(buffer, new.reading),
                   commands=map_leaves(lambda _: place.put(zeros, kept), new.commands))


def write(buffers: Sequence[Any], values: Sequence[Any]) -> None:
    """Change memory in place; what never varies is a number in both."""
    for buffer, value in zip(buffers, values, strict=True):
        if isinstance(buffer, Tensor):
            buffer.copy_(value) if isinstance(value, Tensor) else buffer.fill_(value)
        elif not isinstance(buffer, float):
            buffer[...] = value


class Known(NamedTuple):
    """One of the numbers that episodes draw from their conditions, for a critic that may know it."""

    place: int
    """Among the leaves of `rans.model.case.Case`."""
    mean: float
    """Over many episodes."""
    spread: float
    """Standard deviation."""


def known(world: World) -> list[Known]:
    """Everything that differs from episode to episode, but for its number."""
    draws = Draws(0, 0, np.arange(1024, dtype=np.int32), 0, np.float64)
    drawn = leaves(world.recalled(Episode(None, None), draws).case)
    return [Known(place, float(x.mean()), float(x.std()))
            for place, x in enumerate(drawn) if isinstance(x, np.ndarray) and place and x.std() > 0.0]


def relative(body: Body, craft: Spacecraft) -> Iterator[Any]:
    """A body's numbers over the craft's own, or over the largest of their kind where those may be zero."""
    nominal = Body.of(craft)
    scales = replace(nominal, inertia=(max(nominal.inertia),) * len(nominal.inertia),
                     centre=(craft.radius,) * len(nominal.centre), leak=(1.0,) * len(nominal.leak))
    for x in map(truediv, leaves(body), leaves(scales)):
        yield x if isinstance(x, int | float) else torch.as_tensor(x)


def restore(table: dict[str, Any], world: World, episode: Episode, seed: Sequence[Any],
            processes: Processes) -> None:
    """Write what `Engine.save_state` gave into an engine's memory.

    Raises:
        ConfigError: it was saved with another number of environments, dimension or length of episodes.
    """
    buffers, values = episode.memory(), [processes.mine(value) for value in table["buffers"]]
    if [tuple(b.shape) for b in buffers] != [tuple(v.shape) for v in values]:
        raise ConfigError(
            f"the saved state is not one of {len(episode.clock)} environments of {world.craft.name!r}; "
            "the usual cause is a changed number of environments, or an older RANS that saved it.")
    if table["episode_steps"] != world.timing.episode_steps:
        raise ConfigError(
            f"the saved state is one of episodes of {table['episode_steps']:,} steps, not "
            f"{world.timing.episode_steps:,}: its clocks would be misread.")
    write(buffers, [value.cpu() if isinstance(b, np.ndarray) else value.to(b.device)
                    for b, value in zip(buffers, values, strict=True)])
    write(seed, [torch.as_tensor(word).numpy() if isinstance(kept, np.ndarray) else torch.as_tensor(word)
                 for kept, word in zip(seed, table["seed"], strict=True)])
