"""Turns and mirror images of a spacecraft that look the same: what is learnt on one side serves all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from rans.model.fields import Field, where
from rans.model.spacecraft import Spacecraft, Thruster
from rans.tasks import TrackTwist

_AIM = (0.9, 0.38, 0.21)
"""Of all equivalent views, the one taken has the goal nearest to this direction. Any will do that lies in
no mirror plane of the spacecraft; otherwise two views would tie for whole regions."""
_ROUNDING = 1e-6
"""Of lengths of the order of a metre, in a spacecraft's file."""


class Symmetries(NamedTuple):
    """S views of one spacecraft, in arrays of NumPy or torch; in all of them it looks and moves the same."""

    turn: Any
    """(S, d, d): orthogonal matrices from the coordinates of B to those of the view."""
    hand: Any
    """(S,): 1 for a turn, -1 for a mirror image, in which turning to the left is turning to the right."""
    place: Any
    """(S, n): index of the thruster that thruster i looks like in the view."""

    def which(self, seen: Sequence[Field]) -> Field:
        """Index (N,) of the view to take of columns in B, as `rans.fast.policy.BodyFrame` gives them."""
        _, _, _, way, _ = _parts(seen)
        goal: Any = [d[:, None] for d in way]
        ahead = sum(a * sum(self.turn[:, i, j] * d for j, d in enumerate(goal))
                    for i, a in enumerate(_AIM[:len(way)]))
        return ahead.argmax(1)  # type: ignore[union-attr]

    def viewed(self, seen: Sequence[Field], which: Field) -> list[Field]:
        """The columns as the chosen views show them."""
        turn, hand = self.turn[which], self.hand[which]
        v, w, flag, way, rest = _parts(seen)
        view = lambda u: [sum(turn[:, i, j] * x for j, x in enumerate(u)) for i in range(len(u))]  # noqa: E731
        if len(v) == 2:
            first = where(flag == TrackTwist.flag, rest[0] * hand, rest[0])
            return [*view(v), w[0] * hand, flag, *view(way), first, rest[1] * hand]
        spin = [x * hand for x in view(w)]
        rotation, twist = _rotation(view, rest), [x * hand for x in view(rest[:3])] + list(rest[3:])
        data = [where(flag == TrackTwist.flag, a, b) for a, b in zip(twist, rotation, strict=True)]
        return [*view(v), *spin, flag, *view(way), *data]


def symmetries(craft: Spacecraft) -> Symmetries | None:
    """Every view in which the spacecraft looks the same, in NumPy; None if it looks so in its own only.

    Forces, places and directions of thrusters about the centre of mass must agree, and the inertia tensor.
    """
    found = [(view, place) for view in _candidates(craft) if (place := _places(craft, view)) is not None]
    if len(found) < 2:
        return None
    turn = np.array([view for view, _ in found])
    return Symmetries(turn, np.linalg.det(turn).round(), np.array([place for _, place in found]))


def _parts(x: Sequence[Field]) -> tuple[Sequence[Field], ...]:
    """Velocity, spin, task flag, first vector and rest of the task data, of columns in B."""
    d, k = (2, 1) if len(x) == 8 else (3, 3)
    return x[:d], x[d:d + k], x[d + k], x[d + k + 1:2 * d + k + 1], x[2 * d + k + 1:]


def _rotation(view: Any, rest: Sequence[Field]) -> list[Field]:
    """First two rows of G R G^T, where G is the view and rest holds the first two rows of R."""
    a, b = rest[:3], rest[3:]
    third = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    columns = [view(column) for column in zip(a, b, third, strict=True)]
    return [x for row in list(zip(*columns, strict=True))[:2] for x in view(row)]


def _candidates(craft: Spacecraft) -> Iterator[np.ndarray]:
    """The orthogonal matrices that may put one thruster, which has a lever arm, in another's place."""
    levers = [t for t in craft.thrusters if abs(np.linalg.det(_axes(craft, t))) > _ROUNDING]
    if not levers:
        yield np.eye(craft.dimension)
        return
    back = np.linalg.inv(_axes(craft, levers[0]))
    for thruster in craft.thrusters:
        for hand in (1.0, -1.0)[:craft.dimension - 1]:
            view = _axes(craft, thruster, hand) @ back
            if np.allclose(view @ view.T, np.eye(craft.dimension), atol=_ROUNDING):
                yield view


def _axes(craft: Spacecraft, thruster: Thruster, hand: float = 1.0) -> np.ndarray:
    """Columns: place and direction of the thruster in B, and in space what is perpendicular to both."""
    place, direction = _arrow(craft, thruster)
    if craft.dimension == 2:
        return np.stack((place, direction), axis=1)
    return np.stack((place, direction, hand * np.cross(place, direction)), axis=1)


def _arrow(craft: Spacecraft, thruster: Thruster) -> tuple[np.ndarray, np.ndarray]:
    place = np.subtract(thruster.position, craft.centre_of_mass)
    return place[:craft.dimension], np.array(thruster.direction)[:craft.dimension]


def _places(craft: Spacecraft, view: np.ndarray) -> list[int] | None:
    """Where the view puts every thruster; None if one has no counterpart or the inertia differs."""
    tensor = np.array(craft.inertia)
    slack = _ROUNDING * tensor.trace()
    if craft.dimension == 3 and not np.allclose(view @ tensor @ view.T, tensor, rtol=0.0, atol=slack):
        return None
    arrows = [(*_arrow(craft, thruster), thruster.force) for thruster in craft.thrusters]
    here = np.array([[*place, *direction, force] for place, direction, force in arrows])
    there = np.array([[*view @ place, *view @ direction, force] for place, direction, force in arrows])
    gaps = np.abs(there[:, None] - here).max(axis=2)
    place = gaps.argmin(axis=1)
    fits = gaps.min(axis=1).max() < _ROUNDING and len(set(place.tolist())) == len(place)
    return place.tolist() if fits else None
