"""Substeps of the motion as calls of printed functions, so that a traced control period stays short.

A traced control period repeats the equations of motion for each of its substeps and pieces: 18,000 lines for a
CubeSat with pulsed thrusters. `Substeps.advance` records calls instead, and traces the equations once for each kind
of substep.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from inspect import signature
from typing import Any, NamedTuple

from rans.model.body import Body
from rans.model.dynamics import advance
from rans.model.fields import Field, leaves, unflatten
from rans.model.trace import Symbol
from rans.policy.program import inputs


class Call(NamedTuple):
    """A function applied to a state several times in succession; what else it reads stays the same."""

    function: str
    """Name of the function."""
    repeats: int
    """Number of applications."""
    state: tuple[Symbol, ...]
    """State before the first one."""
    others: tuple[Symbol, ...]
    """What else the function reads."""
    outputs: tuple[Symbol, ...]
    """State after the last one: inputs of what is computed afterwards."""

    @property
    def inputs(self) -> tuple[Symbol, ...]:
        """All that is read."""
        return (*self.state, *self.others)


@dataclass(frozen=True)
class Substep:
    """A function to print: the state after one kind of substep."""

    name: str
    state: tuple[Symbol, ...]
    """State before it, as inputs."""
    others: tuple[Symbol, ...]
    """What else it reads, as inputs."""
    after: tuple[Symbol, ...]
    """State after it."""


_ADVANCE = signature(advance)


class Substeps:
    """Records motion as calls. Kinds of substeps differ in which wrenches act, and in the body's numbers.

    Attributes:
        calls: in order.
    """

    def __init__(self) -> None:
        self.calls: list[Call] = []
        self._kinds: dict[tuple[Any, ...], Substep] = {}

    @property
    def kinds(self) -> tuple[Substep, ...]:
        """The functions that are called."""
        return tuple(self._kinds.values())

    def advance(self, *arguments: Any, **options: Any) -> Any:
        """`rans.model.dynamics.advance` on symbols: the motion over a part of a control period.

        State, wrenches and body as there, of symbols; `_kinds` gets the program of a kind that was not there yet.
        """
        bound = _ADVANCE.bind(*arguments, **options)
        bound.apply_defaults()
        state, applied, body, duration, substeps, nodes, disturbance, drift, *rest = bound.args
        last, momentum, growth, rotors, tank = rest
        # Where loads change from substep to substep, one function makes all of them.
        constant = last is None and momentum is None and growth is None and drift.steady
        constant = constant and tank is None
        grows = rotors is not None and rotors[1] is not None
        together = 1 if constant else substeps
        repeats = substeps // together
        state = replace(state, notes=None, stores=())
        loads = (
            replace(applied, exhaust=None),
            None if last is None else replace(last, exhaust=None),
            momentum,
            growth,
            rotors if grows else None,
            tank,
            duration / repeats,
        )
        constants = (Body(body.mass, body.inertia), disturbance, drift)

        # Numbers of the body and the disturbance stay numbers, and what they multiply is folded.
        varying = [x for x in leaves(constants) if isinstance(x, Symbol)]
        key = (
            together,
            nodes,
            last is None,
            momentum is None,
            growth is None,
            disturbance is None,
            grows or rotors,
            tank is None,
            tuple(None if isinstance(x, Symbol) else x for x in leaves(constants)),
        )
        # A kind that was not there yet is traced once.
        if key not in self._kinds:
            before = inputs("state", len(leaves(state)))
            read = inputs("load", len(leaves(loads)) + len(varying))
            entries = iter(read)
            first, end, wheels, swell, grown, lacks, step = unflatten(loads, entries)
            fixed, push, motion = unflatten(
                constants,
                [next(entries) if isinstance(x, Symbol) else x for x in leaves(constants)],
            )
            after = advance(
                unflatten(state, before),
                first,
                fixed,
                step,
                together,
                nodes,
                push,
                motion,
                end,
                wheels,
                swell,
                grown if grows else rotors,
                lacks,
            )
            self._kinds[key] = Substep(
                f"substep{len(self._kinds)}", tuple(before), tuple(read), _symbols(leaves(after))
            )
        # Its call, in the order of calls.
        outputs = inputs(f"moved_{len(self.calls)}", len(leaves(state)))
        self.calls.append(
            Call(
                self._kinds[key].name,
                repeats,
                _symbols(leaves(state)),
                _symbols([*leaves(loads), *varying]),
                tuple(outputs),
            )
        )
        return unflatten(state, outputs)


def _symbols(fields: Sequence[Field]) -> tuple[Symbol, ...]:
    return tuple(map(Symbol.constant, fields))
