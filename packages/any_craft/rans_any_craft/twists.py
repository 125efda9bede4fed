"""What thrusters can do to the twist of a craft: a polytope, whose facets tell how far it reaches.

A twist in B is (v_x, v_y, w_z) in the plane, and three velocities, then three angular velocities, in space. Every
thruster changes it by a column. A thruster that is open for a part of the time gives this part of its column.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

_PARALLEL = 1e-9
"""Sine of the angle, and one less its cosine, up to which two directions count as one."""
_NOTHING = 1e-9
"""Part of the largest change along a way that is a rounding error: nothing is possible there."""


def directions(width: int) -> int:
    """Number of the axes of B along which thrusters push, of twists with so many numbers: 3 or 6."""
    return {3: 2, 6: 3}[width]


def thrust(columns: np.ndarray) -> np.ndarray:
    """Velocity change (n,) by each of columns (n, d)."""
    return np.linalg.norm(columns[:, : directions(columns.shape[1])], axis=1)


def reaches(columns: np.ndarray, ways: np.ndarray, shared: bool = False) -> np.ndarray:
    """Largest changes (k,) along unit ways (k, d), without any change across them.

    Columns (n, d) are those of thrusters that are open for a part of the time; ``shared``: the parts sum to 1 at
    most. 0: nothing is possible along the way alone.

    The twists are a polytope, which reaches along a way u as far as the least over its facets' normals w of
    support(w) / (w u).
    """
    size, normals, support = _facets(columns, shared)
    result = []
    for way in ways:
        # In units of the largest change along the way.
        along = way != 0.0
        unit = float((size[along] / np.abs(way[along])).min())
        reach = _least_reach(normals @ (way * unit / np.where(size > 0.0, size, 1.0)), support)
        result.append(reach * unit if reach > _NOTHING else 0.0)
    return np.array(result)


def balanced(columns: np.ndarray, shared: bool = False) -> np.ndarray:
    """`reaches` (2 d,) along both ways of every axis: in the plane +x, -x, +y, -y, +turn and -turn."""
    axes = np.eye(columns.shape[1])
    return reaches(columns, np.stack([axes, -axes], axis=1).reshape(-1, len(axes)), shared)


def cone_pushes(columns: np.ndarray, shared: bool) -> np.ndarray:
    """Changes of velocity (4,) that are possible in all directions within 45 degrees of +x, -x, +y and -y.

    The spin is balanced. Thrusters at 45 degrees to the axes push least between them. The least reach of a cone is
    that along the way of the cone which is nearest to a facet's normal.

    Args:
        columns: (n, 3), see `reaches`; they push and turn a craft in the plane every way.
        shared: see `reaches`.
    """
    size, normals, support = _facets(columns, shared)
    pushes = normals[:, :2] / size[:2]
    result = []
    for axis in np.array([(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)]):
        ahead = pushes @ axis
        aside = np.abs(pushes @ axis[::-1])
        within = ahead >= aside
        nearest = np.where(within, np.hypot(ahead, aside), (ahead + aside) / math.sqrt(2.0))
        result.append(_least_reach(nearest, support))
    return np.array(result)


def authority_margin(columns: np.ndarray, least: float = 0.0) -> float:
    """Least support of the twists that thrusters can give, over all directions of twist.

    The support in a direction is the sum of what every thruster gives along it if it helps. Columns (n, d) are
    first divided by the mean force and by the root mean square of the torques, so that the result has no unit;
    0 means that some direction cannot be given at all. The least support is along the normal of a facet of the
    polytope of twists, and every such normal is that of a hyperplane along d - 1 thrusters' columns.

    Args:
        columns: of thrusters, and of wheels either way.
        least: margin below which any number below it may be returned, sooner.
    """
    pushing = directions(columns.shape[1])
    forces = thrust(columns)
    torques = np.linalg.norm(columns[:, pushing:], axis=1)
    if not (forces.max(initial=0.0) > 0.0 and torques.max(initial=0.0) > 0.0):
        return 0.0
    force = forces[forces > 0.0].mean()
    torque = math.sqrt(np.square(torques[torques > 0.0]).mean())
    scaled = columns / np.repeat([force, torque], [pushing, columns.shape[1] - pushing])

    def support(ways: np.ndarray) -> float:
        return float(_support(ways, scaled).min(initial=math.inf))

    # Directions against the sum of all columns bound it from above.
    some = -scaled - scaled.sum(axis=0)
    some = np.vstack([some, -scaled, np.eye(len(scaled[0])), -np.eye(len(scaled[0]))])
    length = np.linalg.norm(some, axis=1)
    bound = support(some[length > 0.0] / length[length > 0.0, None])
    if bound <= least:
        return bound
    facets = _normals(scaled)
    return support(facets) if len(facets) else 0.0


def _support(ways: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """How far (k,) the sums of parts of columns (n, d) reach along ways (k, d), whatever else they do."""
    return np.maximum(ways @ columns.T, 0.0).sum(axis=1)


def _least_reach(ahead: np.ndarray, support: np.ndarray) -> float:
    """How far a polytope reaches where its facets with these supports (k,) are so far ahead (k,)."""
    reached = ahead > _PARALLEL
    return max(0.0, float((support[reached] / ahead[reached]).min())) if reached.any() else 0.0


def _facets(columns: np.ndarray, shared: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Largest change (d,) along each axis, and in these units normals (k, d) and supports (k,) of the facets.

    Arguments are those of `reaches`. Without a shared supply there are normals of hyperplanes that only touch the
    polytope, too, which change no reach.
    """
    size = np.abs(columns).max(axis=0, initial=0.0)
    # Pushes along an axis that nothing pushes along: the polytope then has facets, and reaches as far along others.
    idle = np.eye(len(size))[size <= 0.0]
    scaled = np.vstack([columns / np.where(size > 0.0, size, 1.0), idle, -idle])
    if not shared:
        normals = _normals(scaled)
        return size, normals, _support(normals, scaled)
    from scipy.spatial import ConvexHull, QhullError

    try:
        # Rows are a normal and minus the support.
        hull = ConvexHull(np.vstack([np.zeros_like(size), scaled])).equations
    except QhullError:  # the columns are in one hyperplane
        hull = np.zeros((0, len(size) + 1))
    return size, hull[:, :-1], -hull[:, -1]


def _normals(columns: np.ndarray) -> np.ndarray:
    """Unit normals (k, d), both ways, of all hyperplanes along d - 1 of columns (n, d).

    These are the normals of the facets of every polytope that is a sum of segments along the columns.
    """
    # Parallel columns span the same hyperplanes.
    lines: list[np.ndarray] = []
    for column in columns:
        if (length := np.linalg.norm(column)) > 0.0:
            line = column / length
            if all(abs(line @ previous) < 1.0 - _PARALLEL for previous in lines):
                lines.append(line)
    width = columns.shape[1]
    if len(lines) < width - 1:
        return np.zeros((0, width))
    chosen = np.array(list(itertools.combinations(range(len(lines)), width - 1)))
    rows = np.array(lines)[chosen]
    # The product across d - 1 vectors: minors of the first rows, by their columns, each from those with a row less
    # (Laplace). Numbers of a simple layout come out exact, and exports have their bits.
    minors: dict[tuple[int, ...], Any] = {(k,): rows[:, 0, k] for k in range(width)}
    for row in range(1, width - 1):
        minors = {
            axes: sum(
                (-1.0) ** (row + omitted)
                * rows[:, row, axis]
                * minors[axes[:omitted] + axes[omitted + 1 :]]
                for omitted, axis in enumerate(axes)
            )
            for axes in itertools.combinations(range(width), row + 1)
        }
    every = tuple(range(width))
    normal = np.stack([(-1.0) ** k * minors[every[:k] + every[k + 1 :]] for k in every], axis=1)
    length = np.linalg.norm(normal, axis=1)
    normal = normal[length > _PARALLEL] / length[length > _PARALLEL, None]
    return np.vstack([normal, -normal])
