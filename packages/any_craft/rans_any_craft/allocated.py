"""Allocation of a demanded change of twist to the effectors of a craft, by their tokens.

A token is what an effector does to the twist in a control period, in units of the craft's authority, and its kind.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from torch import Tensor
from torch.nn import functional

from rans.extend import Field, Network, subsets, within
from rans.model.spacecraft import positively_spans
from rans.policy.subsets import MOST_SUBSETS, Subsets
from rans_any_craft.allocation import PRICE, continuous_price, in_order, shares, thrust_price
from rans_any_craft.twists import directions

ON_OFF = 0.0
SHARED = 1.0
CONTINUOUS = 2.0
WHEEL = 3.0
"""Kinds of effectors, the last number of a token: on/off thruster, the same with a shared supply, thruster with
commands between, reaction wheel."""
SHUT = "shut"
"""Row of a program, (N, thrusters): 1 for a thruster that an adapting policy takes for lost, else 0."""
WHEELS = "wheels"
"""Row of a program, (N, wheels + 1): momentum of every wheel, over that at which it is full, and number of periods
since the start, of a policy that remembers them."""
Tokens = tuple[tuple[float, ...], ...]
_MOMENTUM_PRICE = 0.3
"""Price of a unit of a wheel's change of the spin that makes a full wheel fuller, in units of squared errors; what
makes it emptier is paid. At 1 half as many flights of CubeSats with a dead thruster settle as at 0.1 and 0.3."""
_GENTLE_PRICE = 0.3
"""Price of thrust where wheels take up momentum with the craft's speed: thrusters that work against each other fill
the wheels. Of 0.2, 0.3, 0.4, 0.5 and 0.8 it settles most flights of cubesat-6u without a thruster."""
_GENTLE_WEIGHT = 4.0
"""Weight of squared errors of the spin there, of 2, 4, 6, 8 and 12: the attitude is lost with full wheels."""
_LOST = 1e4
"""Price of opening a lost thruster, in units of squared errors: above what any demand is worth."""


def holds(tokens: Tokens) -> bool:
    """Whether a craft can hold its pose by pulses alone: in the plane, with on/off thrusters and nothing else."""
    kinds = {token[-1] for token in tokens}
    return bool(kinds) and kinds <= {ON_OFF, SHARED} and width(tokens) == 3


def demand(network: Network, features: Tensor) -> Tensor:
    """Change of twist (N, d) that a network of this backbone demands, of features (N, features)."""
    weight, bias = network.architecture.last.folded(*network.layer("action_net"))
    return functional.linear(features, weight, bias)


def width(tokens: Tokens) -> int:
    """Numbers of a change of twist."""
    return len(tokens[0]) - 1


@lru_cache(maxsize=64)
def choice(tokens: Tokens, adapts: bool = False, price: float = 1.0) -> Subsets | None:
    """Subsets of the on/off thrusters, of which the demand chooses one; None: there is no on/off thruster.

    Thrusters that need the wheels are chosen by the forces alone. An adapting policy has also the subsets that are
    useful without one of the thrusters that the craft can spare. ``price`` is a factor of the price of thrust.
    """
    columns = np.array([token[:-1] for token in tokens if token[-1] in (ON_OFF, SHARED)])
    if not len(columns):
        return None
    lost = spare(tokens) if adapts else ()
    if spans(columns) or not wheels(tokens):
        is_shared = tokens[0][-1] == SHARED
        return _subsets_without(columns, is_shared, lost, price * thrust_price(columns))
    forces = columns * (np.arange(columns.shape[1]) < directions(columns.shape[1]))
    chosen = _subsets_without(forces, tokens[0][-1] == SHARED, lost, price * PRICE)
    parts = chosen.opened
    if tokens[0][-1] == SHARED:
        parts = parts / np.maximum(parts.sum(axis=1, keepdims=True), 1.0)
    return chosen._replace(twist=parts @ columns)


def _subsets_without(
    columns: np.ndarray, is_shared: bool, lost: tuple[int, ...], price: float
) -> Subsets:
    """Useful subsets of on/off thrusters with columns (n, d), and those without each of some thrusters."""
    parts = [subsets(_rows(columns), is_shared, price)]
    # Of many thrusters enough of these leave each one out.
    for number in lost if 2 ** (len(columns) - 1) <= MOST_SUBSETS else ():
        part = subsets(_rows(np.delete(columns, number, axis=0)), is_shared, price)
        parts.append(part._replace(opened=np.insert(part.opened, number, 0.0, axis=1)))
    joined = [np.concatenate(x) for x in zip(*parts, strict=True)]
    _, first = np.unique(joined[0], axis=0, return_index=True)
    return Subsets(*(x[np.sort(first)] for x in joined))


def slopes_of(chosen: Subsets, adapts: bool, away: float) -> np.ndarray:
    """Table (d, S) of the linear functions of a demand, and rows for what else they depend on.

    These are whether the goal is far, where a factor ``away`` of the price is not 1, and the n lost thrusters.
    """
    rows = [chosen.slope.T]
    if away != 1.0:
        # An offset is minus the squared twist, a quarter of that of the slope, and minus the price of the thrust.
        rows.append(
            (away - 1.0) * (chosen.offset + 0.25 * np.square(chosen.slope).sum(axis=1))[None]
        )
    if adapts:
        rows.append(-_LOST * chosen.opened.T)
    return np.concatenate(rows)


@lru_cache(maxsize=64)
def spare(tokens: Tokens) -> tuple[int, ...]:
    """Numbers of the thrusters without which the others push and turn the craft every way.

    Wheels help throttled and pulsed thrusters, and others where all thrusters alone do not.
    """
    thrusters, turning = np.split(np.array(tokens)[:, :-1], [thruster_count(tokens)])
    helping = turning[:0]
    if tokens[0][-1] == CONTINUOUS or not spans(thrusters):
        helping = np.vstack([turning, -turning])
    return tuple(
        k
        for k in range(len(thrusters))
        if spans(np.vstack([np.delete(thrusters, k, axis=0), helping]))
    )


def needed(tokens: Tokens) -> np.ndarray:
    """Columns (n, d) of the thrusters, and of wheels either way where they alone do not push and turn every way."""
    thrusters, turning = np.split(np.array(tokens)[:, :-1], [thruster_count(tokens)])
    return thrusters if spans(thrusters) else np.vstack([thrusters, turning, -turning])


def thruster_count(tokens: Tokens) -> int:
    """Number of the thrusters, whose tokens come first."""
    return len(tokens) - len(wheels(tokens))


def _rows(columns: np.ndarray) -> Tokens:
    return tuple(map(tuple, columns.tolist()))


def spans(columns: np.ndarray) -> bool:
    """Whether thrusters with columns (n, d) push and turn a craft every way."""
    return positively_spans(columns.T)


def effects_of(chosen: Subsets) -> np.ndarray:
    """Table (S, n + d): 0.5 for open and -0.5 for shut thrusters, then the change of twist."""
    return np.concatenate((chosen.opened - 0.5, chosen.twist), axis=1)


def wheels(tokens: Tokens) -> Tokens:
    """Tokens of the wheels, which come last."""
    return tuple(token for token in tokens if token[-1] == WHEEL)


class Filled(NamedTuple):
    """What the momentum of a wheel leaves of its command."""

    momentum: Field
    """Over that at which the wheel is full, -1 to 1."""
    filling: float
    """Part of that momentum which a full command adds in a control period."""

    def limit(self, way: float) -> Field:
        """Largest command one way, 1 or -1, that does not fill the wheel."""
        return within((1.0 - way * self.momentum) * (1.0 / self.filling), 0.0, 1.0)


@lru_cache(maxsize=64)
def checks(tokens: Tokens) -> tuple[tuple[int, ...], ...]:
    """Thrusters that are checked together: each that the craft can spare, with the one that is most opposite."""
    columns = np.array(tokens)[:, :-1]
    left = [k for k in in_order(columns[: thruster_count(tokens)]).tolist() if k in spare(tokens)]
    groups = []
    while left:
        one = left.pop(0)
        sums = np.linalg.norm(columns[left] + columns[one], axis=1)
        other = [left.pop(int(sums.argmin()))] if left else []
        groups.append((one, *other))
    return tuple(groups)


def continuous(
    demand: list[Field],
    tokens: Tokens,
    limits: Sequence[Field] | None = None,
    gentle: Field | None = None,
    filled: Sequence[Filled] = (),
    price_factor: float = 1.0,
) -> list[Field]:
    """Commands, 0 to 1, of continuous thrusters and then of wheels, whose 0.5 is no torque.

    Args:
        demand: d fields.
        tokens: of these thrusters and wheels.
        limits: largest command of each thruster; None: 1.
        gentle: 1 where wheels take up momentum with the craft's speed, else 0; None: they never do. Thrust then has
            a higher price, and thrusters and wheels are always allocated together.
        filled: wheels, in a policy that remembers their momenta.
        price_factor: factor of the price of thrust.
    """
    turning = wheels(tokens)
    price: Field = price_factor * continuous_price(np.array(tokens)[:, :-1], bool(turning))
    if gentle is not None:
        price = price + gentle * (price_factor * _GENTLE_PRICE - price)
        # A weight is a constant of the columns.
        weight = _GENTLE_WEIGHT if isinstance(gentle, float) else 1.0
        return _allocated(demand, tokens, price, limits, weight, filled)
    throttled = tuple(token for token in tokens if token[-1] == CONTINUOUS)
    if turning and throttled and spans(np.array(throttled)[:, :-1]):
        commands = _allocated(demand, throttled, price, limits)
        left = demand
        # In an order of the columns, so that the bits do not depend on the numbers of the thrusters.
        for k in in_order(np.array(throttled)[:, :-1]):
            left = [e - x * commands[k] for e, x in zip(left, throttled[k][:-1], strict=True)]
        return commands + _allocated(left, turning, price)
    return _allocated(demand, tokens, price, limits)


def _allocated(
    demand: list[Field],
    tokens: Tokens,
    price: Field,
    limits: Sequence[Field] | None = None,
    weight: float = 1.0,
    filled: Sequence[Filled] = (),
) -> list[Field]:
    """Commands of effectors that are allocated together; a wheel is two columns, one for each way.

    Squared errors of the spin have a weight, those of the velocity 1.
    """
    scale = np.ones(len(demand))
    scale[directions(len(demand)) :] = math.sqrt(weight)
    if weight != 1.0:
        demand = [float(x) * e for x, e in zip(scale, demand, strict=True)]
    columns = [
        tuple(sign * x for x in np.array(token[:-1]) * scale)
        for token in tokens
        for sign in ((1.0, -1.0) if token[-1] == WHEEL else (1.0,))
    ]
    # Limits of the thrusters, then of both ways of every wheel; what fills a wheel has a price.
    thrusters = thruster_count(tokens)
    most: list[Field | None] = [*(limits or [None] * thrusters)]
    charges: list[Field] = [0.0] * thrusters
    for wheel, one in enumerate(filled):
        for number, way in enumerate((1.0, -1.0), start=thrusters + 2 * wheel):
            most.append(one.limit(way))
            size = math.hypot(*columns[number])
            charges.append(_MOMENTUM_PRICE * size * way * one.momentum)
    if not filled:
        most += [None] * (len(columns) - thrusters)
    parts = iter(
        shares(demand, np.array(columns), price, most, charges=charges if filled else None)
    )
    return [
        (next(parts) - next(parts)) * 0.5 + 0.5 if token[-1] == WHEEL else next(parts)
        for token in tokens
    ]
