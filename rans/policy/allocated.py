"""A backbone whose last layer demands a change of twist, which is then allocated to the craft's effectors.

Its weights are the same whatever effectors a craft has, and in whatever order.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from rans.model.fields import Field, within
from rans.policy.allocation import Subsets, shares, subsets
from rans.policy.backbones import Backbone, product
from rans.policy.parts import ArchitectureView, NetworkView
from rans.policy.program import Program, inputs

ON_OFF = 0.0
SHARED = 1.0
CONTINUOUS = 2.0
WHEEL = 3.0
"""Kinds of effectors, the last number of a token: on/off thruster, the same with a shared supply, thruster with
commands between, reaction wheel."""
_DEMAND = 3
"""Numbers of a change of twist in the plane."""

Tokens = tuple[tuple[float, ...], ...]


class Allocated(Backbone):
    """The last layer's three numbers are a demand in units of the craft's authority (`rans.policy.allocation`).

    A token is what an effector does to the twist in a control period in the same units, and its kind. Wheels turn
    the craft by what thrusters leave.
    """

    is_traced = True
    has_tokens = True
    token_width = 4

    def rows(self, architecture: ArchitectureView) -> int:
        """See `Backbone`."""
        return architecture.last.weights * _DEMAND

    def outputs(self, network: NetworkView, features: Tensor) -> Tensor:
        """See `Backbone`."""
        architecture = network.architecture
        weight, bias = architecture.last.folded(*network.layer("action_net"))
        demand = product(features, weight, bias)
        chosen = choice(architecture.tokens)
        if chosen is None:
            commands = continuous(list(demand.unbind(-1)), architecture.tokens)
            return torch.stack([torch.as_tensor(x).expand_as(demand[..., 0]) for x in commands], -1)
        offset, slope, table = (
            demand.new_tensor(x) for x in (chosen.offset, chosen.slope.T, effects(chosen))
        )
        row = table[torch.argmax(demand @ slope + offset, dim=-1)]
        count = chosen.opened.shape[1]
        opened = row[..., :count]
        rest = continuous(
            [demand[..., k] - row[..., count + k] for k in range(_DEMAND)],
            wheels(architecture.tokens),
        )
        if rest:
            return torch.cat((opened + 0.5, torch.stack(rest, dim=-1)), dim=-1)
        return opened

    def traced(self, program: Program, architecture: ArchitectureView, features: str) -> str:
        """See `Backbone`."""
        demand = program.dense(features, "head", _DEMAND, architecture.features)
        symbols = inputs("demand", _DEMAND)
        chosen = choice(architecture.tokens)
        if chosen is None:
            names = dict(zip(symbols, program.single(demand, _DEMAND), strict=True))
            return program.joined(*program.lowered(continuous(symbols, architecture.tokens), names))
        # The best subset is the largest of linear functions.
        product_ = program.apply(
            "MatMul", demand, program.constant(chosen.slope.T, "subset_slopes")
        )
        offset = program.constant(chosen.offset, "subset_offsets")
        best = program.apply("ArgMax", program.apply("Add", product_, offset), axis=1, keepdims=0)
        table = program.constant(effects(chosen), "subsets")
        row = program.apply("Gather", table, best, axis=0)
        count = chosen.opened.shape[1]
        opened, twist = program.split(row, (count, _DEMAND))
        rest = wheels(architecture.tokens)
        if not rest:
            return opened
        half = program.constant(0.5)
        pairs = zip(program.single(demand, _DEMAND), program.single(twist, _DEMAND), strict=True)
        left = [program.apply("Sub", a, b) for a, b in pairs]
        commands = program.lowered(continuous(symbols, rest), dict(zip(symbols, left, strict=True)))
        return program.joined(program.apply("Add", opened, half), *commands)


@lru_cache(maxsize=64)
def choice(tokens: Tokens) -> Subsets | None:
    """Subsets of the on/off thrusters, of which the demand chooses one; None: there is no on/off thruster."""
    columns = tuple(token[:3] for token in tokens if token[3] in (ON_OFF, SHARED))
    return subsets(columns, tokens[0][3] == SHARED) if columns else None


def effects(chosen: Subsets) -> np.ndarray:
    """Table (S, n + 3): 0.5 for open and -0.5 for shut thrusters, then the change of twist."""
    return np.concatenate((chosen.opened - 0.5, chosen.twist), axis=1)


def wheels(tokens: Tokens) -> Tokens:
    """Tokens of the wheels, which come last."""
    return tuple(token for token in tokens if token[3] == WHEEL)


def continuous(demand: list[Field], tokens: Tokens) -> list[Field]:
    """Commands, 0 to 1, of continuous thrusters and then of wheels, whose 0.5 is no torque.

    Args:
        demand: three fields.
        tokens: of these thrusters and wheels.
    """
    columns = np.array([token[:3] for token in tokens if token[3] == CONTINUOUS]).reshape(-1, 3)
    commands = shares(demand, columns)
    left = demand[2]
    for command, column in zip(commands, columns, strict=True):
        left = left - float(column[2]) * command
    torques = [token[2] for token in wheels(tokens)]
    # Wheels about the one axis of the plane share what is left in proportion to their torques.
    total = sum(map(abs, torques))
    for torque in torques:
        sign = 1.0 if torque > 0 else -1.0
        commands.append(within(left * (0.5 * sign / total) + 0.5, 0.0, 1.0))
    return commands
