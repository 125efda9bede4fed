"""Which failed thrusters a spacecraft can do without: every push and turn is still possible, on average.

A dead thruster never opens, one stuck open always pushes. What the others give on average over time, each
open for a share u_i in [0, 1] of it, is W u with their wrenches as the columns of W. The craft stays master
of its motion if it can hold still against the stuck ones and from there push and turn every way: zero lies
inside the set of w_stuck + W u. That is so if and only if W has full rank and w_stuck + W u = 0 for some u
with all 0 < u_i < 1 (a linear map takes the inside of a box to the inside of its image). A supply that is
shared by what is open scales all forces alike and changes nothing of this.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np

from rans.errors import ConfigError
from rans.model.fields import Field
from rans.model.spacecraft import Spacecraft, wrenches_either_way
from rans.randomization.conditions import FaultKind

_LEAST = 1e-6
"""Share of full thrust below which a margin is rounding."""
_MOST = 1e8
"""Inverse of what a margin of one half may lack of it."""


@dataclass(frozen=True)
class FaultSet:
    """Thrusters that fail together, in the same way."""

    kind: FaultKind
    thrusters: tuple[int, ...]
    margin: float
    """How far the others can stay from always shut and always open while they hold the craft still: a share
    of full thrust, up to 0.5; zero or less: they cannot, or some way they can neither push nor turn."""

    @property
    def recoverable(self) -> bool:
        """Whether the craft can still push and turn every way."""
        return self.margin > _LEAST


def fault_sets(
    craft: Spacecraft, count: int, kind: FaultKind, shares: tuple[float, ...] = (1.0,)
) -> Iterator[FaultSet]:
    """Every set of so many thrusters that fail in this way, in order, with the least margin of the shares.

    What the craft can do without at both ends of a range of shares, it can between them.
    """
    for thrusters in combinations(range(len(craft.thrusters)), count):
        ways = {failed(kind, share) for share in shares}
        yield FaultSet(kind, thrusters, min(margin(craft, thrusters, *way) for way in ways))


@cache
def _sets(
    craft: Spacecraft, count: int, kind: FaultKind, shares: tuple[float, ...]
) -> tuple[FaultSet, ...]:
    return tuple(fault_sets(craft, count, kind, shares))


def sets_among(
    craft: Spacecraft, count: int, kind: FaultKind, shares: tuple[float, ...], recoverable: bool
) -> tuple[tuple[int, ...], ...]:
    """The sets of so many thrusters that are recoverable, or those that are not.

    Raises:
        ConfigError: there is none.
    """
    found = tuple(
        one.thrusters for one in _sets(craft, count, kind, shares) if one.recoverable == recoverable
    )
    if not found:
        sort = "recoverable" if recoverable else "unrecoverable"
        raise ConfigError(
            f"conditions ask for {sort} faults of {count} {kind} thruster{'s' * (count > 1)}, "
            f"but spacecraft {craft.name!r} has none; `rans faults` shows what it can do "
            "without."
        )
    return found


def failed(
    kind: FaultKind, share: Field, none: Field = 0.0, full: Field = 1.0
) -> tuple[Field, Field]:
    """Gain and leak of a thruster that fails in this way, see `rans.model.body.Body`.

    For fields that may be of another kind elsewhere, no thrust and full thrust are fields too.
    """
    ways: dict[FaultKind, tuple[Field, Field]] = {
        "dead": (none, none),
        "stuck-open": (none, full),
        "stuck": (none, share),
        "weak": (share, none),
    }
    return ways[kind]


def margin(craft: Spacecraft, lost: Sequence[int], gain: float = 0.0, leak: float = 0.0) -> float:
    """See `FaultSet`: the largest m with w_stuck + W u = 0 and m <= u_i <= 1 - m, a linear programme.

    The lost thrusters give gain * u_i + leak of their force; without gain they have no u_i. With
    u_i = 1/2 + z_i / s, |z_i| <= 1, the margin is 1/2 - 1/s; the largest s has one condition for each of the
    craft's degrees of freedom, however many its thrusters are. Reaction wheels help either way, as long as they
    are not full.
    """
    from scipy.optimize import linprog

    wrenches = wrenches_either_way(craft).T
    scale = np.linalg.norm(wrenches, axis=0).max()
    gains = np.ones(len(wrenches))
    gains[list(lost)] = gain
    sound = ((wrenches * gains[:, None])[gains > 0.0]).T / scale
    stuck = leak * wrenches[list(lost)].sum(axis=0) / scale
    if np.linalg.matrix_rank(sound, tol=1e-9) < craft.degrees_of_freedom:
        return 0.0
    count = sound.shape[1]
    middle = stuck + 0.5 * sound.sum(axis=1)
    found = linprog(
        np.append(np.zeros(count), -1.0),
        A_eq=np.column_stack((sound, middle)),
        b_eq=np.zeros(len(sound)),
        bounds=[(-1, 1)] * count + [(0, _MOST)],
    )
    return max(0.0, 0.5 + 1.0 / found.fun) if found.success and found.fun else 0.0
