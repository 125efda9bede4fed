"""States by their numbers: at the origin, aligned with the world and at rest, unless these say otherwise."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from rans.model.dynamics import PlanarState, SpatialState
from rans.model.fields import Heading, Quat, Vec2, Vec3

NOWHERE = (0.0, 0.0, 0.0)


def planar(
    x: Any = 0.0, y: Any = 0.0, heading: Any = 0.0, v: Iterable[Any] = NOWHERE[:2], w: Any = 0.0
) -> PlanarState:
    """Position m, heading rad, velocity m/s and spin rad/s."""
    return PlanarState(Vec2(x, y), Heading(heading), Vec2(*v), w)


def spatial(
    p: Iterable[Any] = NOWHERE,
    attitude: Iterable[Any] = (1.0, 0.0, 0.0, 0.0),
    v: Iterable[Any] = NOWHERE,
    w: Iterable[Any] = NOWHERE,
) -> SpatialState:
    """Position m, quaternion (w, x, y, z), velocity m/s and spin rad/s in B."""
    return SpatialState(Vec3(*p), Quat(*attitude), Vec3(*v), Vec3(*w))


def in_space(flat: PlanarState) -> SpatialState:
    """A planar state as the motion in space that it is."""
    half = flat.attitude.angle / 2
    zero = 0.0 * half
    return spatial(
        (flat.p.x, flat.p.y, zero),
        (np.cos(half), zero, zero, np.sin(half)),
        (flat.v.x, flat.v.y, zero),
        (zero, zero, flat.w),
    )
