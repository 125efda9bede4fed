"""Motion of a craft over a control period in which a command is held, under all its effectors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rans.base.errors import ConfigError
from rans.effectors.effector import Action, Begun, Effector, JointMotion, Push
from rans.effectors.propellant import PropellantTank
from rans.effectors.wheels import ReactionWheels, wheel_inertia
from rans.model.accuracy import chosen
from rans.model.body import Body
from rans.model.drift import FREE, Drift, Following
from rans.model.dynamics import NODES, AnyState, Piece, Wrench, advance, between, undelayed
from rans.model.fields import Field, at_least, fraction_of, where
from rans.model.spacecraft import CommandRange, Spacecraft, Store
from rans.model.timing import Timing

_NO_SPIN = 1e-15
"""Spin relative to W, rad/s, up to which a craft stands in it: in a day it turns by 1e-10 rad."""


@dataclass(frozen=True)
class ThrusterEffector(Effector):
    """Thrusters of a craft (on/off, pulsed or throttled), whose commands define the parts of a control period."""

    craft: Spacecraft

    @property
    def commands(self) -> tuple[CommandRange, ...]:
        """Commands of the thrusters, one each."""
        return self.craft.commands[self.craft.thruster_commands]

    @property
    def stores(self) -> tuple[Store, ...]:
        """No states."""
        return ()

    def pieces(self, body: Body, command: Sequence[Field], period: float) -> Iterator[Piece]:
        """Pieces of a control period (s) in which thrusters follow their commands without delay."""
        return undelayed(self.craft, body, command, period)

    def begin(self, begun: Begun) -> None:
        """No further action: thrusters act through `pieces`."""


def states_at_checks(
    state: AnyState,
    craft: Spacecraft,
    body: Body,
    command: Sequence[Field],
    timing: Timing,
    drift: Drift = FREE,
    nodes: int = NODES,
    disturbance: Wrench | None = None,
    pieces: Iterable[Piece] | None = None,
    integrate: Callable[..., Any] = advance,
) -> tuple[AnyState, ...]:
    """States at the checks of a control period in which a command is held (`rans.model.timing.Timing.checks`).

    The last one is the state at the end of the period. Headings and quaternions are normalised. Each piece of
    the period has substeps in proportion to the upper bound on its duration.

    Args:
        state: state at the start of the period.
        craft: spacecraft.
        body: mass properties and thruster health.
        command: one field per command of the craft (`rans.model.spacecraft.Spacecraft.commands`).
        timing: control period, substeps and checks.
        drift: motion of a free point, from the start of the period.
        nodes: nodes of the quadrature in the plane.
        disturbance: disturbance wrench, constant in W.
        pieces: pieces of the period under delayed valves and failing thrusters
            (`rans.randomization.parameters.StepInputs.pieces`); None: thrusters follow the command without delay.
        integrate: replaces `rans.model.dynamics.advance`, for programs that are printed.
    """
    substeps = timing.substeps or chosen(craft, timing).substeps or 1
    period = timing.control_period
    if pieces is None:
        pieces = ThrusterEffector(craft).pieces(body, command, period)
    actions = begin_actions(craft, command, state.stores, body, period)
    # On an orbit on which W turns unevenly, what stands in W without effectors that turn it is held there, unless
    # gravity turns it.
    if not (drift.steady or craft.turns or drift.gradient() is not None):
        square = sum(x * x for x in state.spin())
        zero = square * 0.0
        drift = Following(drift, where(square > _NO_SPIN**2, zero + 1.0, zero))
    # Gravity acts on the wheels too, whose inertia about their axes is not in that of the craft.
    inertia: tuple[float, ...] = ()
    if drift.gradient() is not None:
        check_gradient(craft)
        inertia = wheel_inertia(craft.wheels)
    # A mass inside the craft moves together with it.
    joint = next((action for action in actions if isinstance(action, JointMotion)), None)
    if joint is not None:
        integrate = joint.advance

    states = []
    for number, part in enumerate(cut(pieces, period, timing.checks), 1):
        # Effectors modify the parts one after the other.
        pushes: Iterable[Push] = (Push(*piece) for piece in part)
        for action in actions:
            pushes = action.pushes(pushes)
        for push in pushes:
            # A Python float, not a scalar of NumPy.
            duration = push.duration
            longest = min(duration if type(duration) is float else push.longest, period)
            steps = max(1, math.ceil(longest / period * substeps - 1e-9))
            if joint is not None:
                steps = max(steps, joint.steps(longest))
            # A step of half the length needs one node less at the angles that `NODES` is for.
            fewer = nodes - (2.0 * longest * substeps <= period * steps)
            momentum = push.momentum if craft.dimension == 3 else None
            growth = None
            if push.loss is not None and disturbance is not None:
                growth = push.loss.growth.constant
            # The wheels stay as the propellant leaves: beside a full craft they grow.
            rotors = None
            if inertia:
                rotors = (inertia, None) if push.loss is None else push.loss.growth.line(inertia)
            state = integrate(
                state,
                push.first,
                body,
                duration,
                steps,
                fewer,
                disturbance,
                drift,
                push.last,
                momentum,
                growth,
                *([rotors, push.tank] if rotors or push.tank else []),
            )
            drift = drift.later(duration)
        state = state.normalised()
        if craft.stores:
            time = period * number / timing.checks
            stores = tuple(store for action in actions for store in action.stores(time))
            state = replace(state, stores=stores)
        states.append(state)
    return tuple(states)


def check_gradient(craft: Spacecraft) -> None:
    """Refuse (`ConfigError`) craft on which the torque of gravity's gradient is not computed."""
    if craft.dimension == 2 or not craft.is_rigid:
        raise ConfigError(
            f"the gradient of gravity turns rigid craft in space, and {craft.name!r} "
            f"{'moves in the plane' if craft.dimension == 2 else 'has a mass that moves in it'}: leave "
            "gravity_gradient out."
        )


def effectors_of(craft: Spacecraft) -> tuple[Effector, ...]:
    """All effectors of a craft, in the order in which they act.

    Their commands, concatenated, are `rans.model.spacecraft.Spacecraft.commands`, and their states its ``stores``.
    """
    results: list[Effector] = [ThrusterEffector(craft)]
    if craft.propellant is not None:
        flow = sum(thruster.force for thruster in craft.thrusters) / craft.propellant.exhaust_speed
        fastest = flow / (craft.mass * craft.lightest)
        place = craft.propellant.position
        arm = place and tuple(a - b for a, b in zip(place, craft.centre_of_mass, strict=True))
        results.append(PropellantTank(craft.propellant, craft.stores[0], fastest, arm))
    if craft.wheels:
        ranges = craft.commands[craft.wheel_commands]
        tanks = int(craft.propellant is not None)
        momenta = craft.stores[tanks : tanks + craft.wheel_count]
        results.append(ReactionWheels(craft.wheels, craft.dimension, ranges, momenta))
    return (*results, *craft.mounted)


def begin_actions(
    craft: Spacecraft,
    command: Sequence[Field],
    stores: Sequence[Field],
    body: Body,
    period: float,
) -> list[Action]:
    """Actions of the effectors of a craft over a control period, in order.

    Args:
        craft: spacecraft.
        command: one field per command of the craft.
        stores: one field per store of the craft.
        body: mass properties with a full tank.
        period: length of the control period, s.

    Raises:
        ConfigError: an effector moves a mass in the craft (`JointMotion`) without `Effector.moves_mass`.
    """
    actions = []
    # Commands and stores follow one another in the order of the effectors, as in `Spacecraft`.
    taken = stored = 0
    effectors = effectors_of(craft)
    own = len(effectors) - len(craft.further_effectors)
    for described, effector in zip(
        (*effectors[:own], *craft.further_effectors), effectors, strict=True
    ):
        takes = len(effector.commands)
        keeps = len(effector.stores)
        inputs = Begun(
            command[taken : taken + takes], stores[stored : stored + keeps], body, period
        )
        action = effector.begin(inputs)
        if isinstance(action, JointMotion) and not described.moves_mass:
            raise ConfigError(
                f"{described.label} of spacecraft {craft.name!r} begins a JointMotion, which moves a mass in the "
                "craft, but its moves_mass is False: return True from it."
            )
        if action is not None:
            actions.append(action)
        taken += takes
        stored += keeps
    return actions


def held(*arguments: Any, **options: Any) -> Any:
    """State at the end of a control period in which a command is held; arguments as for `states_at_checks`."""
    return states_at_checks(*arguments, **options)[-1]


def cut(pieces: Iterable[Piece], period: float, parts: int) -> Iterator[Iterable[Piece]]:
    """Divide the pieces of a control period (s) among equal parts of it, in order.

    A piece that lasts beyond the end of a part continues in the next one. If durations are fields, every part
    has a share of every piece, and its duration may be zero.
    """
    if parts == 1:
        yield pieces
        return
    pieces = list(pieces)
    for k in range(parts):
        low = period * k / parts
        high = period * (k + 1) / parts
        part = []
        begin: Field = 0.0
        for duration, first, last, longest in pieces:
            end = begin + duration
            enters = _clamped(begin, low, high)
            exits = _clamped(end, low, high)
            if not (isinstance(begin, float) and isinstance(end, float) and enters == exits):
                first_share = fraction_of(enters - begin, duration)
                last_share = fraction_of(exits - begin, duration)
                part.append(
                    (
                        exits - enters,
                        first if last is None else between(first, last, first_share),
                        None if last is None else between(first, last, last_share),
                        min(longest, high - low),
                    )
                )
            begin = end
        yield part


def _clamped(time: Field, low: float, high: float) -> Field:
    """Time clipped to bounds; a float for a float."""
    if isinstance(time, float):
        return min(max(time, low), high)
    return high - at_least(high - at_least(time, low), 0.0)
