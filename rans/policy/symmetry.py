"""Turns and mirror images of a spacecraft that look the same: what is learnt on one side serves all."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.model.fields import Field
from rans.model.spacecraft import Spacecraft, Thruster
from rans.tasks.observation_terms import Columns, Layout

AIM = (0.9, 0.38, 0.21)
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

    def tensors_like(self, like: Tensor) -> Symmetries:
        """Symmetries on the device and in the floating dtype of a tensor."""
        turn, hand, permutation = (torch.as_tensor(table, device=like.device) for table in self)
        return Symmetries(turn.to(like.dtype), hand.to(like.dtype), permutation.to(torch.int64))

    def which(self, direction: Columns) -> Field:
        """Index (N,) of the view to take of a vector in B, `Layout.ahead`: the one that has it ahead."""
        goal: Any = [d[:, None] for d in direction]
        ahead: Any = sum(
            a * sum(self.turn[:, i, j] * d for j, d in enumerate(goal))
            for i, a in enumerate(AIM[: len(direction)])
        )
        return ahead.argmax(1)

    def viewed(self, layout: Layout, columns: Columns, which: Field) -> list[Field]:
        """The columns in B as the chosen views show them."""
        turn = self.turn[which]
        view = lambda u: [sum(turn[:, i, j] * x for j, x in enumerate(u)) for i in range(len(u))]  # noqa: E731
        return layout.mirrored(columns, view, self.hand[which])


def symmetries(craft: Spacecraft) -> Symmetries | None:
    """Every view in which the spacecraft looks the same, in NumPy; None if it looks so in its own only.

    Forces, places and directions of thrusters about the centre of mass must agree, the inertia tensor, the place of
    the tank, and which thrusters have a supply in common.
    A craft with reaction wheels or further effectors has its own view only: their commands turn with no view.
    """
    if craft.wheels or craft.acting_effectors:
        return None
    results = [
        (view, permutation)
        for view in _candidates(craft)
        if (permutation := _places(craft, view)) is not None
    ]
    if len(results) < 2:
        return None
    turn = np.array([view for view, _ in results])
    return Symmetries(
        turn, np.linalg.det(turn).round(), np.array([permutation for _, permutation in results])
    )


def _candidates(craft: Spacecraft) -> Iterator[np.ndarray]:
    """Orthogonal matrices (d, d) in B that may put a thruster with a lever arm in another's place, or eye.

    Their order is that of the views in an agent's file, where ties of `Symmetries.which` go to the first.
    """
    levers = [t for t in craft.thrusters if abs(np.linalg.det(_axes(craft, t))) > _ROUNDING]
    if not levers:
        yield np.eye(craft.dimension)
        return
    back = np.linalg.inv(_axes(craft, levers[0]))
    for thruster in craft.thrusters:
        for hand in (1.0, -1.0)[: craft.dimension - 1]:
            view = _axes(craft, thruster, hand) @ back
            if np.allclose(view @ view.T, np.eye(craft.dimension), atol=_ROUNDING):
                yield view


def _axes(craft: Spacecraft, thruster: Thruster, hand: float = 1.0) -> np.ndarray:
    """Columns: place and direction of the thruster in B, and in space what is perpendicular to both."""
    arrow = _arrow(craft, thruster)
    return np.stack(arrow if craft.dimension == 2 else (*arrow, hand * np.cross(*arrow)), axis=1)


def _arrow(craft: Spacecraft, thruster: Thruster) -> tuple[np.ndarray, np.ndarray]:
    offset = np.subtract(thruster.position, craft.centre_of_mass)
    return offset[: craft.dimension], np.array(thruster.direction)[: craft.dimension]


def _places(craft: Spacecraft, view: np.ndarray) -> list[int] | None:
    """Thrusters' permutation by a view (d, d); None unless inertia, tank, arms, forces and supplies are alike.

    Tolerances are `_ROUNDING`: a craft that is nearly symmetric has no symmetry.
    """
    tensor = np.array(craft.inertia)
    slack = _ROUNDING * tensor.trace()
    if craft.dimension == 3 and not np.allclose(
        view @ tensor @ view.T, tensor, rtol=0.0, atol=slack
    ):
        return None
    if craft.propellant is not None and craft.propellant.position is not None:
        tank = np.subtract(craft.propellant.position, craft.centre_of_mass)[: craft.dimension]
        if np.abs(view @ tank - tank).max() > _ROUNDING:
            return None
    arrows = [(*_arrow(craft, thruster), thruster.force) for thruster in craft.thrusters]
    arrow_rows = np.array([[*offset, *direction, force] for offset, direction, force in arrows])
    image_rows = np.array(
        [[*view @ offset, *view @ direction, force] for offset, direction, force in arrows]
    )
    gaps = np.abs(image_rows[:, None] - arrow_rows).max(axis=2)
    nearest = gaps.argmin(axis=1)
    fits = gaps.min(axis=1).max() < _ROUNDING and len(set(nearest.tolist())) == len(nearest)
    supplied = {frozenset(int(nearest[i]) for i in members) for members in craft.supplies}
    fits = fits and supplied == set(map(frozenset, craft.supplies))
    return nearest.tolist() if fits else None
