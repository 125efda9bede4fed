"""Recoverable thruster faults: those after which every mean force and torque direction is still possible.

A dead thruster never opens, and a stuck-open one always pushes. If each other thruster is open for a share u_i
in [0, 1] of the time, their mean wrench is W u, with their wrenches as the columns of W. The craft remains
controllable if it can balance the stuck thrusters and from there accelerate in every direction: zero is an
interior point of the set of w_stuck + W u. This is the case if and only if W has full rank and
w_stuck + W u = 0 for some u with 0 < u_i < 1 for all i, because a linear map of full rank takes the interior of
a box to the interior of its image. A shared supply scales all forces by the same factor and does not change
this.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np

from rans.base.errors import ConfigError
from rans.model.fields import Field
from rans.model.spacecraft import Spacecraft
from rans.randomization.conditions import FaultKind

_LEAST = 1e-6
"""Share of full thrust below which a margin is treated as rounding."""
_MOST = 1e8
"""Bound on 1 / (1/2 - margin), which keeps the linear program bounded."""


@dataclass(frozen=True)
class FaultSet:
    """Set of thrusters that fail with the same fault kind, and the margin of the others."""

    kind: FaultKind
    thrusters: tuple[int, ...]
    margin: float
    """Distance of the other thrusters from always shut and always open while they balance the craft: a share of
    full thrust, up to 0.5. Zero: they cannot balance it, or not accelerate it in every direction."""

    @property
    def recoverable(self) -> bool:
        """Whether the craft can still accelerate in every direction."""
        return self.margin > _LEAST


def fault_sets(
    craft: Spacecraft, count: int, kind: FaultKind, severities: tuple[float, ...] = (1.0,)
) -> Iterator[FaultSet]:
    """All sets of ``count`` thrusters with this fault kind, in order, each with its least margin over the shares.

    A fault that is recoverable at both ends of a range of shares is recoverable between them.
    """
    for thrusters in combinations(range(craft.thruster_count), count):
        effects = {failed(kind, severity) for severity in severities}
        yield FaultSet(
            kind, thrusters, min(margin(craft, thrusters, *effect) for effect in effects)
        )


@cache
def _sets(
    craft: Spacecraft, count: int, kind: FaultKind, severities: tuple[float, ...]
) -> tuple[FaultSet, ...]:
    return tuple(fault_sets(craft, count, kind, severities))


def sets_among(
    craft: Spacecraft, count: int, kind: FaultKind, severities: tuple[float, ...], recoverable: bool
) -> tuple[tuple[int, ...], ...]:
    """Sets of ``count`` thrusters whose failure is recoverable, or those whose failure is not.

    Raises:
        ConfigError: there is no such set.
    """
    result = tuple(
        fault_set.thrusters
        for fault_set in _sets(craft, count, kind, severities)
        if fault_set.recoverable == recoverable
    )
    if not result:
        sort = "recoverable" if recoverable else "unrecoverable"
        raise ConfigError(
            f"conditions ask for {sort} faults of {count} {kind} thruster{'s' * (count > 1)}, "
            f"but spacecraft {craft.name!r} has none; `rans faults` shows what it can do "
            "without."
        )
    return result


def failed(
    kind: FaultKind, severity: Field, none: Field = 0.0, full: Field = 1.0
) -> tuple[Field, Field]:
    """Gain and leak of a thruster with this fault kind, see `rans.model.body.Body`.

    Kinds are those of files of conditions.

    Args:
        kind: fault kind.
        severity: share of "stuck" and "weak" thrusters.
        none: no thrust, as a number or a field.
        full: full thrust, as a number or a field.
    """
    effects: dict[FaultKind, tuple[Field, Field]] = {
        "dead": (none, none),
        "stuck-open": (none, full),
        "stuck": (none, severity),
        "weak": (severity, none),
    }
    return effects[kind]


def margin(craft: Spacecraft, lost: Sequence[int], gain: float = 0.0, leak: float = 0.0) -> float:
    """Margin of the thrusters after a fault (`FaultSet`), of which the failed ones have this gain and leak."""
    gains = np.ones(craft.thruster_count)
    leaks = np.zeros(craft.thruster_count)
    gains[list(lost)] = gain
    leaks[list(lost)] = leak
    return margin_left(craft, gains, leaks)


def margin_left(craft: Spacecraft, gains: np.ndarray, leaks: np.ndarray) -> float:
    """Margin of thrusters that fail in ways of their own: largest m with w_stuck + W u = 0, m <= u_i <= 1 - m.

    It is the solution of a linear program. A thruster gives gain * u_i + leak of its force; without gain it has
    no u_i. With u_i = 1/2 + z_i / s and |z_i| <= 1 the margin is 1/2 - 1/s, and the program for the largest s has
    one constraint for each degree of freedom, whatever the number of thrusters. Reaction wheels contribute in
    both directions, as long as they are not saturated.

    Args:
        craft: with its thrusters as designed.
        gains: (thrusters,) shares of the command that thrusters give.
        leaks: (thrusters,) shares of their force that they give whatever the command.
    """
    from scipy.optimize import linprog

    wrenches = craft.wrenches_either_way.T
    scale = np.linalg.norm(wrenches, axis=0).max()
    left = np.append(gains, np.ones(len(wrenches) - len(gains)))
    sound = ((wrenches * left[:, None])[left > 0.0]).T / scale
    stuck = leaks @ wrenches[: len(leaks)] / scale
    if np.linalg.matrix_rank(sound, tol=1e-9) < craft.degrees_of_freedom:
        return 0.0
    count = sound.shape[1]
    middle = stuck + 0.5 * sound.sum(axis=1)
    result = linprog(
        np.append(np.zeros(count), -1.0),
        A_eq=np.column_stack((sound, middle)),
        b_eq=np.zeros(len(sound)),
        bounds=[(-1, 1)] * count + [(0, _MOST)],
    )
    return max(0.0, 0.5 + 1.0 / result.fun) if result.success and result.fun else 0.0
