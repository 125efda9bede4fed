"""The network of an agent for any craft, and what it becomes for one craft: weights stay, constants change.

Constants are the authority (`rans_any_craft.authority`) and what each effector does to the twist in a control
period (`rans_any_craft.allocated`). Mass, inertia and radius are in them. In space the torque of a fast spin about
other than the principal axes is left to feedback.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import torch

from rans import GoToPose
from rans.extend import ConfigError, Network, Spacecraft, brief
from rans_any_craft.allocated import (
    CONTINUOUS,
    ON_OFF,
    SHARED,
    WHEEL,
    Tokens,
    holds,
    needed,
    spans,
    spare,
)
from rans_any_craft.authority import DIMENSIONS, WAYS, Authority, braking_distance
from rans_any_craft.frugality import AS_TRAINED, Frugality, Leisure, cruise_speed
from rans_any_craft.twists import authority_margin, balanced, cone_pushes, reaches

LEAST_MARGIN = 0.25
"""Least `rans_any_craft.twists.authority_margin` in the training."""
COAST = 3.0
"""Control periods for which a craft coasts near the goal. Of 0, 2, 3, 5 and 8 this saves impulse on random layouts
of on/off thrusters in the plane and costs no time; in space of 3, 5 and 8 it saves most of the free flyer's.
Throttled thrusters lose by it (docs/decisions/any_craft.md)."""
_SLOW_COAST = 5.0
"""Control periods for which a craft coasts near the goal if its speed is bounded (`farthest`); of 3 and 5 this
settles more flights of cubesat-6u without a thruster."""
_FULL_WHEELS = 0.6
"""Part of the speed at which a wheel is full that a craft flies at; turns need the rest of the wheels."""
_NEVER_FULL = 1e9
"""Speed, m/s, from which thrusters balance their torques themselves."""
_BEYOND = 0.1
"""How far beyond the fast end weights of on/off thrusters in the plane are at the value 0. Each of 21
random layouts then takes less time, 0.9 % in the mean, and fewer flights are lost; throttled craft lose by it."""
_FAST_TURN = 0.8
"""Largest angle, rad, that such a craft is given at the value 0: it need not turn faster than it arrives. The
floating platform takes 1 % less time, random layouts as much."""
_ALONE = 0.3
"""Value from which the weights are those of the value alone, and angles have no bound."""
_HEAVIER = math.sqrt(2.0)
"""Time that twice the mass takes over that of a file's: an agent that adapts has it for a mass of which it does not
know."""


def authority(craft: Spacecraft, period: float) -> tuple[float, ...]:
    """Control period and accelerations of the craft, as `Architecture.authority`.

    Wheels count only where thrusters alone do not push and turn the craft every way.

    Raises:
        ConfigError: the craft has effectors that cannot be allocated, or they do not push and turn it every way.
    """
    if craft.acting_effectors or (craft.actuators.low, craft.actuators.high) != (0.0, 1.0):
        raise ConfigError(
            f"the agent for any craft commands thrusters from 0 to 1 and wheels, but {craft.name} has others: "
            "train an agent of its own with rans train."
        )
    if not craft.thrusters:
        raise ConfigError(
            f"the agent for any craft flies to a pose, and {craft.name} has no thruster: turn it with "
            "go-to-attitude, by LQR or by an agent of its own (rans train go-to-attitude)."
        )
    if not craft.can_turn and craft.is_steerable:
        raise ConfigError(
            f"{craft.name} cannot turn, because all of its thrusters push through its centre of mass: fly "
            f"go-to-position or track-velocity, as in rans compare lqr:go-to-position-{craft.dimension}d@mine.toml."
        )
    columns = columns_of(craft)
    is_shared = craft.thrust_sharing == "split"
    ways = balanced(columns, is_shared)
    axes = {2: "z"}.get(craft.dimension, "xyz")
    names = [f"along {sign}{axis}" for axis in "xyz"[: craft.dimension] for sign in "+-"]
    names += [f"about {sign}{axis}" for axis in axes for sign in "+-"]
    if weak := [name for name, way in zip(names, ways, strict=True) if way <= 0.0]:
        raise ConfigError(
            f"the thrusters of {craft.name} cannot accelerate it {weak[0]} without turning or pushing it another "
            "way, so that no agent can steer it: the usual cause is a missing or reversed thruster."
        )
    if craft.dimension == 2:
        ways[:4] = cone_pushes(columns, is_shared)
    return (period, *map(float, ways))


def effects(craft: Spacecraft, period: float) -> Tokens:
    """Token of each command: change of the twist in a period, in units of the authority, and kind of effector.

    Files of agents have them in the order of the craft's commands.
    """
    own = Authority.of_numbers(authority(craft, period))
    scale = np.repeat(
        [own.least_linear, own.least_angular], [len(own.linear) // 2, len(own.angular) // 2]
    )
    kind = CONTINUOUS
    if not craft.actuators.is_continuous:
        kind = SHARED if craft.thrust_sharing == "split" else ON_OFF
    columns = _accelerations(craft) / scale
    count = craft.thruster_count
    rows = [(*map(float, row), kind) for row in columns[:count]]
    # Of both ways of every wheel the first.
    rows += [(*map(float, row), WHEEL) for row in columns[count::2]]
    return tuple(rows)


def farthest(craft: Spacecraft, own: Authority) -> float:
    """Distance, m, of `rans_any_craft.authority.nearer` for a craft with an authority; 0: no bound.

    From there the braking curve leads to a part of the speed at which a wheel is full that balances the torques of
    the thrusters. Without a bound the thrusters can push along every axis without torques that only wheels balance.
    """
    if not craft.wheels or not craft.is_continuous:
        return 0.0
    speed = _FULL_WHEELS * _speed_of_full_wheels(craft)
    if not math.isfinite(speed):
        return 0.0
    return braking_distance(speed, float(own.least_linear), float(own.period))


def _speed_of_full_wheels(craft: Spacecraft) -> float:
    """Speed, m/s, at which a wheel is full after a push along the worst axis, with the best choice of thrusters."""
    from scipy.optimize import linprog

    columns = craft.wrenches_either_way
    # Impulses of the thrusters, seconds of full torque of the wheels either way, and the speed.
    bounds: list[tuple[float, float | None]] = [(0.0, None)] * craft.thruster_count
    for wheel in craft.wheels:
        bounds += [(0.0, wheel.max_momentum / wheel.max_torque)] * 2
    bounds += [(0.0, _NEVER_FULL)]
    cost = np.append(np.zeros(columns.shape[1]), -1.0)
    speed = _NEVER_FULL
    for axis in np.eye(len(columns))[: craft.dimension]:
        for way in (axis, -axis):
            balance = np.column_stack([columns, -craft.mass * way])
            best = linprog(cost, A_eq=balance, b_eq=np.zeros(len(balance)), bounds=bounds)
            speed = min(speed, -best.fun) if best.success else speed
    return speed if speed < _NEVER_FULL else math.inf


def without(craft: Spacecraft, number: int) -> Spacecraft:
    """The craft without one thruster; its commands are those of the others."""
    left = tuple(one for k, one in enumerate(craft.thrusters) if k != number)
    return replace(craft, name=f"{craft.name}-{number}-dead", thrusters=left)


def for_craft(network: Network, craft: Spacecraft, period: float) -> Network:
    """Policy for one craft and control period (s) by a network for any.

    Raises:
        ConfigError: see `authority`; or the network is that of one craft only.
    """
    old = network.architecture
    if not old.authority:
        raise ConfigError(
            f"the agent flies its own spacecraft only: name any-craft-{craft.dimension}d for another one."
        )
    numbers = authority(craft, period)
    own = Authority.of_numbers(numbers)
    if len(numbers) != len(old.authority):
        raise ConfigError(
            f"the agent flies craft {'in the plane' if craft.dimension == 3 else 'in space'} only: name "
            f"any-craft-{craft.dimension}d for {craft.name}."
        )
    # What changes with the craft; weights stay.
    tokens = effects(craft, period)
    bound = farthest(craft, own)
    coast = _SLOW_COAST if bound else COAST
    # Without each thruster that an agent which adapts may lose.
    lost = spare(tokens) if old.adapts and craft.wheels else ()
    bounds = [farthest(without(craft, k), own) for k in lost]
    farthest_lost = min((x for x in bounds if x > 0.0), default=0.0)
    fills_up = old.adapts and max(bound, farthest_lost) > 0.0
    new = replace(
        old,
        thrusters=len(craft.commands),
        head="gaussian" if craft.is_continuous else "on-off",
        tokens=tokens,
        authority=numbers,
        reach=_reach(tokens, numbers)
        if old.reach and all(row[-1] != CONTINUOUS for row in tokens)
        else (),
        coast=0.0 if craft.actuators.kind == "throttle" else coast,
        farthest=bound,
        farthest_lost=farthest_lost,
        filling=tuple(
            period * one.max_torque / one.max_momentum for one in craft.wheels if fills_up
        ),
    )

    def fitted(own: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        """Tensors with a last layer for the craft's head."""
        layer = old.last.folded(own["action_net.weight"], own["action_net.bias"])
        if new.last.weights == 2:
            # The log-odds of a thruster are its second row less its first.
            layer = [torch.stack((torch.zeros_like(x), x), dim=1).flatten(0, 1) for x in layer]
        weight, bias = layer
        spread = torch.zeros(new.thrusters)
        tensors = dict(own) | {
            "action_net.weight": weight,
            "action_net.bias": bias,
            "log_std": spread,
        }
        return {name: tensors[name] for name in new.shapes()}

    at = {value: fitted(own) for value, own in network.at.items()}
    return Network(new, fitted(network.tensors), at=at)


def frugal(
    network: Network,
    value: float,
    distance: float,
    seconds: float = math.inf,
    tolerances: tuple[float, float] = (GoToPose.position_tolerance, GoToPose.attitude_tolerance),
) -> Network:
    """The network for any craft at a frugality from 0 (fast) to 1, for starts at a distance (m) from their goals.

    Its weights are linear in the value between those that it has for some (`Network.at`), and above 0.5 as frugal
    as flights of so many seconds allow (`rans_any_craft.frugality.Leisure`).

    ``tolerances`` of the position (m) and of the attitude (rad) need no other weights: a craft flies within 2 cm as
    a larger and quicker one within 5 cm (`rans_any_craft.authority.finer`).

    Raises:
        ConfigError: the value is not from 0 to 1, or the network has weights of one value.
    """
    architecture = network.architecture
    dimension = DIMENSIONS[len(architecture.authority) - 1]
    reach: tuple[float, ...] = ()
    if not 0.0 <= value <= 1.0:
        raise ConfigError(
            f"the frugality of an agent for any craft is from 0 (fast) to 1 (frugal), got {brief(value)}."
        )
    if not network.at:
        raise ConfigError(
            f"the agent has weights of one value, so that #{value:g} would change nothing: leave it out."
        )
    is_continuous = architecture.last.weights == 1
    kinds = {row[-1] for row in architecture.tokens}
    hurries = dimension == 3 and is_continuous and architecture.coast > 0.0 and WHEEL not in kinds
    own = Authority.of_numbers(architecture.authority)
    period = float(own.period)
    # Tolerances by similarity: lengths and accelerations of the craft are those that the network is given.
    length = GoToPose.position_tolerance / tolerances[0]
    angle = GoToPose.attitude_tolerance / tolerances[1]
    distance, least = length * distance, length * float(own.least_linear)
    margin = authority_margin(needed(architecture.tokens))
    has_pulses = not is_continuous or architecture.coast > 0.0
    if architecture.adapts:
        seconds /= _HEAVIER
    value, slow = Leisure.of_flight(value, distance, seconds, least, margin, dimension, has_pulses)
    numbers = Frugality.trained(value, is_continuous, hurries)
    if slow:
        speed = cruise_speed(distance, seconds, least, period, CONTINUOUS in kinds)
        farthest = braking_distance(speed, least, period)
        numbers = numbers.slower(slow, distance, farthest, dimension)
        # What is estimated in flight would change the pulses.
        if holds(architecture.tokens) and not architecture.adapts and length == angle == 1.0:
            numbers = numbers._replace(hold=1.0)
    beyond = 0.0
    if dimension == 2 and CONTINUOUS not in kinds:
        # Others pay with thrust for the time that this saves, and throttled craft brake too late.
        reach = _reach(architecture.tokens, architecture.authority)
        fast = max(0.0, 1.0 - value / _ALONE)
        beyond = _BEYOND * fast
        if fast:
            numbers = numbers._replace(largest_angle=math.pi + fast * (_FAST_TURN - math.pi))
    numbers = numbers._replace(finer=length, finer_turn=angle)
    # Files and programs have six digits; the time of a coast is a multiple of periods.
    numbers = Frugality(*(round(x, 6) for x in numbers))._replace(coast=numbers.coast)
    nodes = network.at
    values = sorted(nodes)
    following = min(int(np.searchsorted(values, value, "right")), len(values) - 1)
    low, high = values[following - 1], values[following]
    part = (value - beyond - low) / (high - low)
    tensors = {
        name: x if name not in nodes[high] else torch.lerp(x, nodes[high][name], part)
        for name, x in nodes[low].items()
    }
    chosen = () if numbers == AS_TRAINED else tuple(numbers)
    return Network(replace(architecture, frugal=chosen, reach=reach), tensors, at=network.at)


def _reach(tokens: Tokens, authority: tuple[float, ...]) -> tuple[float, ...]:
    """`Architecture.reach` of a craft in the plane with tokens (`effects`) and an authority."""
    least = float(Authority.of_numbers(authority).least_linear)
    ways = np.column_stack([WAYS, np.zeros(len(WAYS))])
    pushes = reaches(needed(tokens), ways, tokens[0][-1] == SHARED)
    return tuple(least * float(push) for push in pushes)


def columns_of(craft: Spacecraft) -> np.ndarray:
    """Layout (n, d) of a craft: accelerations by thrusters, and by wheels where thrusters are not enough."""
    columns = _accelerations(craft)
    thrusters = columns[: craft.thruster_count]
    return thrusters if spans(thrusters) else columns


def _accelerations(craft: Spacecraft) -> np.ndarray:
    """Accelerations (n, d) by each thruster, then by each wheel one way and the other, m/s^2 and rad/s^2."""
    forces, torques = np.split(craft.wrenches_either_way.T, [craft.dimension], axis=1)
    if craft.dimension == 2:
        angular = torques / craft.inertia[2][2]
    else:
        angular = np.linalg.solve(np.array(craft.inertia), torques.T).T
    return np.column_stack([forces / craft.mass, angular])
