"""A backbone whose last layer demands a change of twist, which is then allocated to the craft's effectors.

Its weights are the same whatever effectors a craft has, and in whatever order.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from rans.model.fields import Field
from rans.model.twists import balanced, directions
from rans.policy.allocation import Subsets, in_order, shares, subsets
from rans.policy.backbones import Backbone, product
from rans.policy.parts import ArchitectureView, NetworkView
from rans.policy.program import Program, inputs

ON_OFF = 0.0
SHARED = 1.0
CONTINUOUS = 2.0
WHEEL = 3.0
"""Kinds of effectors, the last number of a token: on/off thruster, the same with a shared supply, thruster with
commands between, reaction wheel."""
Tokens = tuple[tuple[float, ...], ...]


class Allocated(Backbone):
    """The last layer's numbers are a demand in units of the craft's authority (`rans.policy.allocation`).

    They are three in the plane and six in space. A token is what an effector does to the twist in a control period
    in the same units, and its kind. Wheels turn the craft by what thrusters leave; where thrusters alone cannot
    push and turn it every way, both are allocated together.
    """

    is_traced = True
    has_tokens = True
    token_widths = 4, 7

    def rows(self, architecture: ArchitectureView) -> int:
        """See `Backbone`."""
        return architecture.last.weights * _width(architecture.tokens)

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
        rest = (demand - row[..., count:]).unbind(-1)
        if wheels(architecture.tokens):
            turning = continuous(list(rest), wheels(architecture.tokens))
            return torch.cat((opened + 0.5, torch.stack(turning, dim=-1)), dim=-1)
        return opened

    def traced(self, program: Program, architecture: ArchitectureView, features: str) -> str:
        """See `Backbone`."""
        width = _width(architecture.tokens)
        demand = program.dense(features, "head", width, architecture.features)
        symbols = inputs("demand", width)
        chosen = choice(architecture.tokens)
        if chosen is None:
            names = dict(zip(symbols, program.single(demand, width), strict=True))
            return program.joined(*program.lowered(continuous(symbols, architecture.tokens), names))
        # The best subset is the largest of linear functions.
        product_ = program.apply(
            "MatMul", demand, program.constant(chosen.slope.T, "subset_slopes")
        )
        offset = program.constant(chosen.offset, "subset_offsets")
        best = program.apply("ArgMax", program.apply("Add", product_, offset), axis=1, keepdims=0)
        turning = wheels(architecture.tokens)
        count = chosen.opened.shape[1]
        if not turning:
            table = program.constant(effects(chosen)[:, :count], "subsets")
            return program.apply("Gather", table, best, axis=0)
        table = program.constant(effects(chosen), "subsets")
        row = program.apply("Gather", table, best, axis=0)
        opened, twist = program.split(row, (count, width))
        half = program.constant(0.5)
        pairs = zip(program.single(demand, width), program.single(twist, width), strict=True)
        left = [program.apply("Sub", a, b) for a, b in pairs]
        commands = program.lowered(
            continuous(symbols, turning), dict(zip(symbols, left, strict=True))
        )
        return program.joined(program.apply("Add", opened, half), *commands)


def _width(tokens: Tokens) -> int:
    """Numbers of a change of twist."""
    return len(tokens[0]) - 1


@lru_cache(maxsize=64)
def choice(tokens: Tokens) -> Subsets | None:
    """Subsets of the on/off thrusters, of which the demand chooses one; None: there is no on/off thruster.

    Thrusters that need the wheels are chosen by the forces alone.
    """
    columns = np.array([token[:-1] for token in tokens if token[-1] in (ON_OFF, SHARED)])
    if not len(columns):
        return None
    chosen = subsets(_rows(columns), tokens[0][-1] == SHARED)
    if spans(columns) or not wheels(tokens):
        return chosen
    forces = columns * (np.arange(columns.shape[1]) < directions(columns.shape[1]))
    chosen = subsets(_rows(forces), tokens[0][-1] == SHARED)
    parts = chosen.opened
    if tokens[0][-1] == SHARED:
        parts = parts / np.maximum(parts.sum(axis=1, keepdims=True), 1.0)
    return chosen._replace(twist=parts @ columns)


def _rows(columns: np.ndarray) -> Tokens:
    return tuple(map(tuple, columns.tolist()))


def spans(columns: np.ndarray) -> bool:
    """Whether thrusters with columns (n, d) push and turn a craft every way."""
    return bool((balanced(columns) > 0.0).all())


def effects(chosen: Subsets) -> np.ndarray:
    """Table (S, n + d): 0.5 for open and -0.5 for shut thrusters, then the change of twist."""
    return np.concatenate((chosen.opened - 0.5, chosen.twist), axis=1)


def wheels(tokens: Tokens) -> Tokens:
    """Tokens of the wheels, which come last."""
    return tuple(token for token in tokens if token[-1] == WHEEL)


def continuous(demand: list[Field], tokens: Tokens) -> list[Field]:
    """Commands, 0 to 1, of continuous thrusters and then of wheels, whose 0.5 is no torque.

    Args:
        demand: d fields.
        tokens: of these thrusters and wheels.
    """
    turning = wheels(tokens)
    throttled = tuple(token for token in tokens if token[-1] == CONTINUOUS)
    if turning and throttled and spans(np.array(throttled)[:, :-1]):
        commands = _allocated(demand, throttled)
        left = demand
        # In an order of the columns, so that the bits do not depend on the numbers of the thrusters.
        for k in in_order(np.array(throttled)[:, :-1]):
            left = [e - x * commands[k] for e, x in zip(left, throttled[k][:-1], strict=True)]
        return commands + _allocated(left, turning)
    return _allocated(demand, tokens)


def _allocated(demand: list[Field], tokens: Tokens) -> list[Field]:
    """Commands of effectors that are allocated together; a wheel is two columns, one for each way."""
    columns = [
        tuple(sign * x for x in token[:-1])
        for token in tokens
        for sign in ((1.0, -1.0) if token[-1] == WHEEL else (1.0,))
    ]
    parts = iter(shares(demand, np.array(columns)))
    return [
        (next(parts) - next(parts)) * 0.5 + 0.5 if token[-1] == WHEEL else next(parts)
        for token in tokens
    ]
