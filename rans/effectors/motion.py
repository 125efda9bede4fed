"""Motion of a craft over one control period in which a command is held, and what its effectors do meanwhile."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from rans.effectors.propellant import Tank, grown
from rans.effectors.wheels import along_axes, motor_torques
from rans.model.accuracy import chosen
from rans.model.body import Body
from rans.model.drift import FREE, Drift
from rans.model.dynamics import NODES, AnyState, Piece, Wrench, advance, at_once
from rans.model.fields import Field, Vec3, at_least, map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing


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
) -> tuple[AnyState, ...]:
    """States at the checks of a control period in which a command is held (`rans.model.timing.Timing.checks`).

    The last one is the state at the end of the period. Headings and quaternions are normalised.

    The craft says how it takes commands (`rans.model.spacecraft.Spacecraft.commands`); ``pieces`` are instead
    what late valves and failing thrusters make of it (`rans.randomization.parameters.StepInputs.pieces`). Each
    takes the share of the substeps that is its share of the period at most; the rest is as for `advance`.
    """
    substeps = timing.substeps or chosen(craft, timing).substeps or 1
    period = timing.control_period
    if pieces is None:
        pieces = at_once(craft, body, command, period)

    # What the effectors hold at the start of the period, and the wheels' constant torques.
    tank = None if craft.propellant is None else Tank.of(craft.propellant, body)
    left = None if tank is None else state.stores[0]
    momenta = state.stores[len(state.stores) - len(craft.wheels) :]
    motors = motor_torques(craft, command, momenta, period) if craft.wheels else ()
    elapsed: Field = 0.0

    states = []
    for number, part in enumerate(cut(pieces, period, timing.checks), 1):
        for whole in part:
            for (duration, first, last, longest), growth, after in _burned(tank, whole, left):
                left = after
                # A float, not one of NumPy.
                longest = min(duration if type(duration) is float else longest, period)
                steps = max(1, math.ceil(longest / period * substeps - 1e-9))
                # Half as long a step needs one node less at the angles that `NODES` is for.
                few = nodes - (2.0 * longest * substeps <= period * steps)
                pull = disturbance
                if growth is not None and pull is not None:
                    pull = grown(pull, 0.5 * (growth[0] + growth[1]))
                momentum = None
                if motors:
                    turn = along_axes(craft, motors)
                    held_now = _held(momenta, motors, elapsed)
                    momentum = along_axes(craft, held_now), _times(turn, duration)
                    begins = ends = turn
                    if growth is not None:
                        begins, ends = (_times(turn, one) for one in growth)
                        middle = 0.5 * (growth[0] + growth[1])
                        momentum = (_times(momentum[0], middle), _times(momentum[1], middle))
                    first = replace(first, torque=first.torque - begins)
                    last = last if last is None else replace(last, torque=last.torque - ends)
                    elapsed = elapsed + duration
                stored = momentum if craft.dimension == 3 else None
                state = advance(state, first, body, duration, steps, few, pull, drift, last, stored)
        state = state.normalised()
        if craft.stores:
            gone = period * number / timing.checks
            tanks = () if left is None else (left,)
            state = replace(state, stores=(*tanks, *_held(momenta, motors, gone)))
        states.append(state)
    return tuple(states)


def _burned(
    tank: Tank | None, piece: Piece, left: Field | None
) -> Iterator[tuple[Piece, tuple[Field, Field] | None, Field | None]]:
    """A piece as it moves the full craft, its growth at both ends, and what is left afterwards (`Tank.burned`)."""
    if tank is None:
        yield piece, None, None
        return
    for (duration, first, last, longest), after in tank.burned(piece, left):
        growth = tank.growth(left), tank.growth(after)
        first = replace(first, exhaust=None)
        last = last if last is None else replace(last, exhaust=None)
        yield (duration, first, last, longest), growth, after
        left = after


def _held(momenta: Sequence[Field], motors: Sequence[Field], time: Field) -> tuple[Field, ...]:
    """Momenta of wheels after their motors gave these torques for a time, s."""
    return tuple(h + torque * time for h, torque in zip(momenta, motors, strict=True))


def _times(amount: Any, factor: Field) -> Any:
    return amount.scale(factor) if isinstance(amount, Vec3) else amount * factor


def held(*arguments: Any, **options: Any) -> Any:
    """State at the end of a control period in which a command is held; arguments as `states_at_checks`."""
    return states_at_checks(*arguments, **options)[-1]


def cut(pieces: Iterable[Piece], period: float, parts: int) -> Iterator[Iterable[Piece]]:
    """Pieces of a control period (s), divided among equal parts of it, in their order.

    A piece that lasts beyond the end of a part goes on in the next one. Where durations are fields, each part
    holds a share of every piece, which may last no time.
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
                first_share = (enters - begin) / at_least(duration, 1e-30)
                last_share = (exits - begin) / at_least(duration, 1e-30)
                part.append(
                    (
                        exits - enters,
                        first if last is None else _between(first, last, first_share),
                        None if last is None else _between(first, last, last_share),
                        min(longest, high - low),
                    )
                )
            begin = end
        yield part


def _clamped(time: Field, low: float, high: float) -> Field:
    """A time within bounds; a float where it is one."""
    if isinstance(time, float):
        return min(max(time, low), high)
    return high - at_least(high - at_least(time, low), 0.0)


def _between(first: Wrench, last: Wrench, share: Field) -> Wrench:
    return map_leaves(lambda a, b: a + (b - a) * share, first, last)
