"""The network of an agent for any craft, and what it becomes for one craft: weights stay, constants change.

Constants are the authority (`rans.policy.authority`) and what each effector does to the twist in a control period
(`rans.policy.allocated`). In the plane nothing else of a rigid body matters: mass, inertia and radius are in them.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch

from rans.errors import ConfigError
from rans.model.spacecraft import Spacecraft
from rans.policy.allocated import CONTINUOUS, ON_OFF, SHARED, WHEEL
from rans.policy.allocation import balanced
from rans.policy.architecture import Architecture
from rans.policy.network import Network
from rans.randomization.layouts import LayoutRanges, authority_margin


class Range(NamedTuple):
    """Range of a quantity in the training."""

    name: str
    unit: str
    low: float
    high: float

    def text(self) -> str:
        """The range in words."""
        bounded = f"from {self.low:g} to {self.high:g}"
        return f"above {self.low:g}" if math.isinf(self.high) else bounded


RANGES = (
    Range("control period", "s", 0.1, 0.2),
    Range("least linear authority", "m/s^2", 0.015, 0.7),
    Range("least angular authority", "rad/s^2", 0.15, 8.0),
)
"""Ranges of the craft that the shipped agent was trained on (`rans.fast.learn.demands.DemandSettings`)."""
MARGIN = Range("authority margin", "", LayoutRanges.least_authority, math.inf)
"""Range of `rans.randomization.layouts.authority_margin`."""
_LEEWAY = 1e-3
"""Part of a bound by which it may be missed."""


def is_for_any_craft(architecture: Architecture) -> bool:
    """Whether the network flies other craft than its own (`for_craft`)."""
    return bool(architecture.authority) and architecture.backbone == "allocated"


def authority(craft: Spacecraft, period: float) -> tuple[float, ...]:
    """Control period and accelerations of the craft's thrusters, as `Architecture.authority`; wheels do not count.

    Raises:
        ConfigError: the craft is not one of the plane, has effectors that cannot be allocated, or its thrusters do
            not push and turn it every way.
    """
    if craft.dimension != 2:
        raise ConfigError(
            f"the agent for any craft flies in the plane, and {craft.name} moves in space: train an agent of its "
            "own with rans train."
        )
    if craft.further_effectors or (craft.actuators.low, craft.actuators.high) != (0.0, 1.0):
        raise ConfigError(
            f"the agent for any craft commands thrusters from 0 to 1 and wheels, but {craft.name} has others: "
            "train an agent of its own with rans train."
        )
    ways = balanced(_accelerations(craft), craft.thrust_sharing == "split")
    names = "along +x", "along -x", "along +y", "along -y", "about +z", "about -z"
    if weak := [name for name, way in zip(names, ways, strict=True) if way <= 0.0]:
        raise ConfigError(
            f"the thrusters of {craft.name} cannot accelerate it {weak[0]} without turning or pushing it another "
            "way, so that no agent can steer it: the usual cause is a missing or reversed thruster."
        )
    return (period, *map(float, ways))


def effects(craft: Spacecraft, period: float) -> tuple[tuple[float, ...], ...]:
    """Token of each command: change of the twist in a period, in units of the authority, and kind of effector."""
    ways = authority(craft, period)[1:]
    scale = np.array([min(ways[:4]), min(ways[:4]), min(ways[4:])])
    kind = CONTINUOUS
    if not craft.actuators.is_continuous:
        kind = SHARED if craft.thrust_sharing == "split" else ON_OFF
    rows = [(*map(float, row / scale), kind) for row in _accelerations(craft)]
    moment = craft.inertia[2][2]
    rows += [(0.0, 0.0, torque / moment / float(scale[2]), WHEEL) for (torque,) in craft.wheel_map]
    return tuple(rows)


def for_craft(network: Network, craft: Spacecraft, period: float) -> Network:
    """Policy for one craft and control period (s) by a network for any; warns outside of `RANGES` and `MARGIN`.

    Raises:
        ConfigError: see `authority`; or the network is that of one craft only.
    """
    old = network.architecture
    if not is_for_any_craft(old):
        raise ConfigError(
            "the agent flies its own spacecraft only: name any-craft-2d for another one."
        )
    own = authority(craft, period)
    margin = authority_margin(_accelerations(craft))
    numbers = (period, min(own[1:5]), min(own[5:]), margin)
    for number, allowed in zip(numbers, (*RANGES, MARGIN), strict=True):
        if not allowed.low * (1 - _LEEWAY) <= number <= allowed.high * (1 + _LEEWAY):
            figure = f"{number:.3g} {allowed.unit}".rstrip()
            warnings.warn(
                f"{craft.name} has a {allowed.name} of {figure}, and the agent for any craft was "
                f"trained {allowed.text()}: it may not reach its goals. `rans train` makes an agent for this "
                "craft alone.",
                stacklevel=2,
            )
    weight, bias = old.last.folded(*network.layer("action_net"))
    new = replace(
        old,
        thrusters=len(craft.commands),
        head="gaussian" if craft.is_continuous else "on-off",
        tokens=effects(craft, period),
        authority=own,
    )
    tensors = {
        name: x
        for name, x in network.tensors.items()
        if not name.startswith("action_net.") and name != "log_std"
    }
    tensors |= last_layer(new, weight, bias)
    return Network(new, {name: tensors[name] for name in new.shapes()})


def last_layer(
    architecture: Architecture, weight: torch.Tensor, bias: torch.Tensor
) -> dict[str, torch.Tensor]:
    """Tensors of the last layer whose outputs are demands (3, features) and (3,), for the architecture's head."""
    if architecture.last.weights == 1:
        spread = torch.zeros(architecture.thrusters)
        return {"action_net.weight": weight, "action_net.bias": bias, "log_std": spread}
    # The head of on/off thrusters takes the difference of two rows.
    pairs = torch.stack((torch.zeros_like(weight), weight), dim=1).flatten(0, 1)
    return {
        "action_net.weight": pairs,
        "action_net.bias": torch.stack((torch.zeros_like(bias), bias), dim=1).flatten(),
    }


def _accelerations(craft: Spacecraft) -> np.ndarray:
    """Accelerations (n, 3) by each thruster, m/s^2 and rad/s^2."""
    moment = craft.inertia[2][2]
    return np.array(craft.wrench_map) / np.array([craft.mass, craft.mass, moment])
