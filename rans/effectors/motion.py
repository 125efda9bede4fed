"""Motion of a craft over one control period in which a command is held, and what its effectors do meanwhile."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rans.effectors.effector import Action, Begun, Effector, Push, grown
from rans.effectors.propellant import PropellantTank
from rans.effectors.wheels import ReactionWheels
from rans.model.accuracy import chosen
from rans.model.body import Body
from rans.model.drift import FREE, Drift
from rans.model.dynamics import NODES, AnyState, Piece, Wrench, advance, at_once
from rans.model.fields import Field, at_least, map_leaves
from rans.model.spacecraft import CommandRange, Spacecraft, Store
from rans.model.timing import Timing


@dataclass(frozen=True)
class Thrusters(Effector):
    """Thrusters of a craft, on/off, pulsed or throttled: where the parts of a control period come from."""

    craft: Spacecraft

    @property
    def commands(self) -> tuple[CommandRange, ...]:
        """One of each thruster."""
        return self.craft.commands[: len(self.craft.thrusters)]

    @property
    def stores(self) -> tuple[Store, ...]:
        """None."""
        return ()

    def pieces(self, body: Body, command: Sequence[Field], period: float) -> Iterator[Piece]:
        """Parts of a control period (s) in which thrusters obey their commands at once."""
        return at_once(self.craft, body, command, period)

    def begin(self, begun: Begun) -> None:
        """They change nothing beside `pieces`."""


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
        pieces = Thrusters(craft).pieces(body, command, period)
    actions = begin(craft, command, state.stores, body, period)

    states = []
    for number, part in enumerate(cut(pieces, period, timing.checks), 1):
        # Effectors change the parts one after the other.
        pushes: Iterable[Push] = (Push(*piece) for piece in part)
        for action in actions:
            pushes = action.pushes(pushes)
        for push in pushes:
            # A float, not one of NumPy.
            duration = push.duration
            longest = min(duration if type(duration) is float else push.longest, period)
            steps = max(1, math.ceil(longest / period * substeps - 1e-9))
            # Half as long a step needs one node less at the angles that `NODES` is for.
            fewer = nodes - (2.0 * longest * substeps <= period * steps)
            pull = disturbance
            if push.growth is not None and pull is not None:
                pull = grown(pull, 0.5 * (push.growth[0] + push.growth[1]))
            momentum = push.momentum if craft.dimension == 3 else None
            state = advance(
                state, push.first, body, duration, steps, fewer, pull, drift, push.last, momentum
            )
        state = state.normalised()
        if craft.stores:
            time = period * number / timing.checks
            stores = tuple(store for action in actions for store in action.stores(time))
            state = replace(state, stores=stores)
        states.append(state)
    return tuple(states)


def effectors_of(craft: Spacecraft) -> tuple[Effector, ...]:
    """Everything that pushes a craft or changes how it is pushed, in the order in which it acts.

    Their commands, one after the other, are `rans.model.spacecraft.Spacecraft.commands`, and their stores its
    ``stores``.
    """
    found: list[Effector] = [Thrusters(craft)]
    if craft.propellant is not None:
        found.append(PropellantTank(craft.propellant, craft.stores[0]))
    if craft.wheels:
        first = len(craft.thrusters)
        ranges = craft.commands[first : first + len(craft.wheels)]
        tanks = int(craft.propellant is not None)
        momenta = craft.stores[tanks : tanks + len(craft.wheels)]
        found.append(ReactionWheels(craft.wheels, craft.dimension, ranges, momenta))
    further: tuple[Any, ...] = craft.further_effectors
    return (*found, *further)


def begin(
    craft: Spacecraft,
    command: Sequence[Field],
    stores: Sequence[Field],
    body: Body,
    period: float,
) -> list[Action]:
    """What the effectors of a craft do in a control period (s), in order.

    Args:
        craft: spacecraft.
        command: one field per command of the craft.
        stores: one field per store of the craft.
        body: mass properties with a full tank.
        period: length of the control period, s.
    """
    actions = []
    taken = kept = 0
    for effector in effectors_of(craft):
        takes = len(effector.commands)
        keeps = len(effector.stores)
        own = Begun(command[taken : taken + takes], stores[kept : kept + keeps], body, period)
        action = effector.begin(own)
        if action is not None:
            actions.append(action)
        taken += takes
        kept += keeps
    return actions


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
