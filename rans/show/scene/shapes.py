"""Shapes that Drake has no class for: cones, rods between points, and meshes of triangles."""

# Drake's stubs write NumPy's array types with their two parameters exchanged.

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import Cylinder, InMemoryMesh, Mesh, Rgba, Shape
from pydrake.math import RigidTransform, RotationMatrix

SIDES = 20
"""Number of sides of the polygon that stands for a circle."""


def rod(
    start: np.ndarray, end: np.ndarray, radius: float, colour: Rgba
) -> tuple[Shape, Rgba, RigidTransform]:
    """A thin cylinder from one point to another, m."""
    axis = end - start
    pose = RigidTransform(RotationMatrix.MakeFromOneVector(axis, 2), (start + end) / 2.0)
    return Cylinder(radius, float(np.linalg.norm(axis))), colour, pose


def frustum(
    bottom: float, top: float, height: float, scale: float = 1.0, sides: int = SIDES
) -> Mesh:
    """A closed cone, cut off, along z: radii at z = 0 and z = height, m, all of them times a scale.

    Few sides have edges, many look round.
    """
    n = sides
    angles = np.linspace(0.0, math.tau, sides, endpoint=False)
    around = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    points = [*((*(bottom * a), 0.0) for a in around), *((*(top * a), height) for a in around)]
    points += [(0.0, 0.0, 0.0), (0.0, 0.0, height)]
    quads = [(i, (i + 1) % n) for i in range(n)]
    walls = [face for i, j in quads for face in ((i, j, n + j), (i, n + j, n + i))]
    caps = [face for i, j in quads for face in ((2 * n, j, i), (2 * n + 1, n + i, n + j))]
    if sides < SIDES:
        return mesh(points, [*walls, *caps], scale)
    return mesh(points, caps, scale, walls, [(*a, (bottom - top) / height) for a in around])


def mesh(
    points: Sequence[Sequence[float]],
    flat: Sequence[tuple[int, int, int]],
    scale: float,
    curved: Sequence[tuple[int, int, int]] = (),
    normals: Sequence[Sequence[float]] = (),
) -> Mesh:
    """Triangles as a text in the format OBJ: points (v), normals (vn), faces (f) of "point//normal" from 1.

    Flat ones have normals of their own; at corner k of a curved one stands normal k modulo their number.
    """
    corners = np.array(points)
    n = len(normals)
    lines = [f"f {' '.join(f'{i + 1}//{i % n + 1}' for i in face)}" for face in curved]
    around: list[Sequence[float] | np.ndarray] = [*normals]
    for face in flat:
        a, b, c = corners[[*face]]
        normal = np.cross(b - a, c - a)
        around.append(normal / max(float(np.linalg.norm(normal)), 1e-30))
        lines.append(f"f {' '.join(f'{i + 1}//{len(around)}' for i in face)}")
    text = [
        *("v {:.5g} {:.5g} {:.5g}".format(*point) for point in points),
        *("vn {:.4g} {:.4g} {:.4g}".format(*normal) for normal in around),
        *lines,
    ]
    return Mesh(InMemoryMesh(mesh_file=MemoryFile("\n".join(text), ".obj", "mesh.obj")), scale)
