"""Privileged observation of a critic: parameters of every spacecraft that only the simulator knows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from operator import truediv
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.episode.step import Episode, World
from rans.model.body import Body
from rans.model.fields import leaves
from rans.model.spacecraft import Spacecraft
from rans.randomization.parameters import examples


class PrivilegedObservation:
    """Parameters of the body relative to the nominal ones; with conditions, all randomized parameters.

    Args:
        world: setup of the episodes.
        body: mass properties and thrusters in the episodes.
        everywhere: ones (N,), of the dtype and on the device of the observation.
    """

    def __init__(self, world: World, body: Body, everywhere: Tensor) -> None:
        self._body = body
        self._craft = world.craft
        self._quantities = privileged_quantities(world)
        self._everywhere = everywhere
        # On the device: a CUDA graph cannot read from the CPU.
        self._mean, self._scale = (
            everywhere.new_tensor(row)
            for row in (
                [quantity.mean for quantity in self._quantities],
                [1.0 / quantity.spread for quantity in self._quantities],
            )
        )
        self.width = len(self._quantities) or len(leaves(body))
        """Number of columns."""
        self.nominal = (0.0,) * len(self._quantities) or tuple(
            relative(Body.of(world.craft), world.craft)
        )
        """Values of the nominal spacecraft, or with conditions the mean values (zero)."""

    def of(self, episode: Episode) -> Tensor:
        """Privileged observation (N, width) of N running episodes, which must keep their parameters.

        Columns are in the order of the leaves, by which the critic of a resumed training reads them.
        """
        if not self._quantities:
            return torch.stack(
                [self._everywhere * x for x in relative(self._body, self._craft)], dim=1
            )
        parameters = leaves(episode.parameters)
        columns = torch.stack(
            [torch.as_tensor(parameters[quantity.leaf]) for quantity in self._quantities], dim=1
        )
        return (columns - self._mean) * self._scale


class PrivilegedQuantity(NamedTuple):
    """Randomized parameter, observed with zero mean and unit variance."""

    leaf: int
    """Index among the leaves of `rans.randomization.parameters.EpisodeParameters`."""
    mean: float
    """Mean over many episodes."""
    spread: float
    """Standard deviation over many episodes."""


def privileged_quantities(world: World) -> list[PrivilegedQuantity]:
    """All randomized parameters of the episodes except the episode number; empty if nothing is randomized.

    Mean and spread are those of 1,024 draws under seed 0: others would rescale what a resumed critic reads.
    """
    if world.conditions is None:
        return []
    varied = leaves(examples(world.conditions, world.craft, world.timing.episode_steps))
    return [
        PrivilegedQuantity(leaf, float(x.mean()), float(x.std()))
        for leaf, x in enumerate(varied)
        if isinstance(x, np.ndarray) and leaf and x.std() > 0.0
    ]


def relative(body: Body, craft: Spacecraft) -> Iterator[Any]:
    """Parameters of a body over the nominal ones, or over a positive scale where those may be zero."""
    nominal = Body.of(craft)
    scales = replace(
        nominal,
        inertia=(max(nominal.inertia),) * len(nominal.inertia),
        centre=(craft.radius,) * len(nominal.centre),
        leak=(1.0,) * len(nominal.leak),
    )
    for x in map(truediv, leaves(body), leaves(scales)):
        yield x if isinstance(x, int | float) else torch.as_tensor(x)
