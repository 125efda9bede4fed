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
"""Part of the largest change along an axis that is a rounding error: nothing is possible there."""


def directions(width: int) -> int:
    """Number of the axes of B along which thrusters push, of twists with so many numbers: 3 or 6."""
    return {3: 2, 6: 3}[width]


def thrust(columns: np.ndarray) -> np.ndarray:
    """Velocity change (n,) by each of columns (n, d)."""
    return np.linalg.norm(columns[:, : directions(columns.shape[1])], axis=1)


def normals(columns: np.ndarray) -> np.ndarray:
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
    # Minors of the first rows, by their columns, each from those with a row less (Laplace).
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


def balanced(columns: np.ndarray, shared: bool = False) -> np.ndarray:
    """Largest changes along both ways of every axis of a twist, all other axes being balanced, (2 d,).

    In the plane these are +x, -x, +y, -y, +turn and -turn. Columns (n, d) are those of thrusters that are open for
    a part of the time; ``shared``: the parts sum to 1 at most. 0: the axis cannot be pushed alone.

    The twists are a polytope, the projection of the parts: how far it reaches along an axis is the least over its
    facets' normals w of support(w) / w_axis. With a shared supply it is the optimum of a linear program.
    """
    width = columns.shape[1]
    size = np.abs(columns).max(axis=0, initial=0.0)
    # Pushes along an axis that nothing pushes along: the polytope then has facets, and reaches as far along others.
    idle = np.eye(width)[size <= 0.0]
    scaled = np.vstack([columns / np.where(size > 0.0, size, 1.0), idle, -idle])
    if shared:
        return _balanced_by_programs(scaled) * size.repeat(2)
    facets = normals(scaled)
    support = np.maximum(facets @ scaled.T, 0.0).sum(axis=1)
    result = []
    for axis in range(width):
        for sign in (1.0, -1.0):
            part = sign * facets[:, axis]
            ahead = part > _PARALLEL
            reach = (support[ahead] / part[ahead]).min() if ahead.any() else 0.0
            result.append(_possible(float(reach)) * size[axis])
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
        return float(np.maximum(ways @ scaled.T, 0.0).sum(axis=1).min(initial=math.inf))

    # Directions against the sum of all columns bound it from above.
    some = -scaled - scaled.sum(axis=0)
    some = np.vstack([some, -scaled, np.eye(len(scaled[0])), -np.eye(len(scaled[0]))])
    length = np.linalg.norm(some, axis=1)
    bound = support(some[length > 0.0] / length[length > 0.0, None])
    if bound <= least:
        return bound
    facets = normals(scaled)
    return support(facets) if len(facets) else 0.0


def cone_pushes(columns: np.ndarray, shared: bool = False) -> np.ndarray:
    """Changes of velocity (4,) that are possible in all directions within 45 degrees of +x, -x, +y and -y.

    The spin is balanced. Thrusters at 45 degrees to the axes push least between them.

    Args:
        columns: (n, 3) of thrusters in the plane that are open for a part of the time.
        shared: whether the parts sum to 1 at most.

    The polytope reaches support(w) / (w u) along u before a facet with the normal w, so that the least reach of a
    cone is that along the u of the cone which is nearest to w.
    """
    ways, support = _pushing_facets(columns, shared)
    result = []
    for axis in np.array([(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)]):
        ahead = ways @ axis
        aside = np.abs(ways @ axis[::-1])
        within = ahead >= aside
        nearest = np.where(within, np.hypot(ahead, aside), (ahead + aside) / math.sqrt(2.0))
        result.append(_least_reach(nearest, support))
    return np.array(result)


def pushes_along(columns: np.ndarray, ways: np.ndarray, shared: bool = False) -> np.ndarray:
    """Largest changes of velocity (k,) along unit vectors (k, 2) in the plane, the spin being balanced.

    Args:
        columns: see `cone_pushes`.
        ways: unit vectors in B.
        shared: see `cone_pushes`.
    """
    facets, support = _pushing_facets(columns, shared)
    return np.array([_least_reach(facets @ way, support) for way in ways])


def _pushing_facets(columns: np.ndarray, shared: bool) -> tuple[np.ndarray, np.ndarray]:
    """What facets of the twists in the plane bound: w u (k, 2) @ (2,) of a push u is at most the support (k,)."""
    size = np.abs(columns).max(axis=0, initial=0.0)
    if not (size > 0.0).all():
        return np.zeros((0, 2)), np.zeros(0)
    scaled = columns / size
    edges = scaled
    if shared:
        # Every edge of the polytope joins two corners, the columns and the origin.
        corners = np.vstack([np.zeros(3), scaled])
        edges = np.array([a - b for a, b in itertools.combinations(corners, 2)])
    facets = normals(edges)
    along = np.maximum(facets @ scaled.T, 0.0)
    support = along.max(axis=1) if shared else along.sum(axis=1)
    return facets[:, :2] / size[:2], support


def _least_reach(ahead: np.ndarray, support: np.ndarray) -> float:
    """How far a polytope reaches where its facets with these supports (k,) are so far ahead (k,)."""
    reached = ahead > _PARALLEL
    return max(0.0, float((support[reached] / ahead[reached]).min())) if reached.any() else 0.0


def _possible(reach: float) -> float:
    """How far a polytope reaches, in parts of the largest change along the axis; 0 for a rounding error."""
    return reach if reach > _NOTHING else 0.0


def _balanced_by_programs(columns: np.ndarray) -> np.ndarray:
    """`balanced` (2 d,) of thrusters (n, d) with a shared supply, by a linear program for each way."""
    from scipy.optimize import linprog

    count, width = columns.shape
    result = []
    for axis in range(width):
        for sign in (1.0, -1.0):
            best = linprog(
                -sign * columns[:, axis],
                A_ub=np.ones((1, count)),
                b_ub=[1.0],
                A_eq=np.delete(columns, axis, axis=1).T,
                b_eq=np.zeros(width - 1),
            )
            result.append(_possible(-best.fun) if best.success else 0.0)
    return np.array(result)
