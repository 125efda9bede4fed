"""A spacecraft as shapes: what its file says, or a platform on air bearings, or a free flyer; and its plumes.

Lengths are in units of the spacecraft's radius, in the body frame B.
"""

# Drake's stubs write NumPy's array types with their two parameters exchanged.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import Box, Cylinder, InMemoryMesh, Mesh, Rgba, Shape, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from rans.model.solids import Solid, triangles
from rans.model.spacecraft import Spacecraft
from rans.outline import BELL, Outline

FLOOR = -0.62
"""Where a platform's air pads end, in radii from its centre of mass along z."""
PLUME = 1.7
"""Length of a plume at full command, in radii."""
AXES = (Rgba(0.84, 0.25, 0.05), Rgba(0.0, 0.62, 0.30), Rgba(0.1, 0.42, 0.95))
"""Of the body's x, y and z: red, green and blue."""
_DARK = Rgba(0.20, 0.24, 0.29)
_STEEL = Rgba(0.80, 0.83, 0.86)
_PANEL = Rgba(0.10, 0.18, 0.42)
_GLASS = Rgba(0.05, 0.07, 0.10)
_CORE = Rgba(1.0, 0.62, 0.10)
_HALO = Rgba(1.0, 0.50, 0.05, 0.30)
_SIDES = 20
"""Of the polygon that stands for a circle."""


class Part(NamedTuple):
    """One shape, fixed in the frame that it belongs to."""

    name: str
    shape: Shape
    colour: Rgba
    pose: RigidTransform


def craft_parts(craft: Spacecraft, body: Rgba) -> list[Part]:
    """Hull, axes x, y, z (red, green, blue; in the plane only x, the heading) and nozzles, in B."""
    r = craft.radius
    parts = [*hull_parts(craft, body), *triad(craft, 1.55, 0.04)]
    outline = Outline(craft)
    for i, (bell, nozzle) in enumerate(zip(_frames(outline, False), outline.nozzles, strict=True)):
        parts.append(Part(f"nozzle {i}", frustum(0.045 * r, 0.12 * r, BELL * r), _DARK, bell))
        position = nozzle.root
        parts.append(
            Part(f"valve {i}", Box(0.15 * r, 0.15 * r, 0.15 * r), _STEEL, RigidTransform(position))
        )
        if (distance := float(np.linalg.norm(position))) > 0.7 * r:
            inner = position * (0.5 * r / distance)
            parts.append(Part(f"arm {i}", *rod(inner, position, 0.045 * r, _STEEL)))
    return parts


def plumes(craft: Spacecraft) -> list[RigidTransform]:
    """Frames in B of the mouths of all nozzles, whose z axes point along the exhausts."""
    return _frames(Outline(craft), True)


def plume_parts(craft: Spacecraft, command: float = 1.0) -> list[Part]:
    """A plume as long as its command, 0 to 1, in a frame of `plumes`."""
    r = craft.radius
    length = PLUME * command * craft.radius
    return [
        Part("core", frustum(0.10 * r, 0.015 * r, 0.75 * length), _CORE, RigidTransform()),
        Part("halo", frustum(0.11 * r, 0.24 * r, length), _HALO, RigidTransform()),
    ]


def hull_parts(
    craft: Spacecraft, body: Rgba, scale: float = 1.0, one_colour: bool = False
) -> list[Part]:
    """Everything but nozzles, so many times as large; of the body's colour alone where that is asked for."""
    if craft.solids:
        parts = [
            _solid(craft, solid, body, scale, f"solid {k}") for k, solid in enumerate(craft.solids)
        ]
    else:
        parts = [
            *(_platform if craft.dimension == 2 else _flyer)(
                scale * craft.radius, craft.shape, body
            )
        ]
    return [part._replace(colour=body) for part in parts] if one_colour else parts


def _platform(r: float, shape: str, body: Rgba) -> Iterator[Part]:
    """Two round decks on three air pads, with an air tank (a sphere or a cylinder) and a computer."""

    def at(x: float, y: float, z: float) -> RigidTransform:
        return RigidTransform([x * r, y * r, z * r])

    yield Part("deck", Cylinder(0.92 * r, 0.07 * r), body, at(0.0, 0.0, 0.0))
    yield Part("lower deck", Cylinder(0.92 * r, 0.07 * r), body, at(0.0, 0.0, -0.34))
    for k, angle in enumerate(math.radians(degrees) for degrees in (60.0, 180.0, 300.0)):
        x = 0.66 * math.cos(angle)
        y = 0.66 * math.sin(angle)
        yield Part(f"post {k}", Cylinder(0.045 * r, 0.5 * r), _STEEL, at(x, y, -0.25))
        yield Part(f"pad {k}", frustum(0.24 * r, 0.18 * r, 0.10 * r), _DARK, at(x, y, FLOOR))
    if shape == "sphere":
        yield Part("tank", Sphere(0.46 * r), _STEEL, at(-0.08, 0.0, 0.42))
    else:
        yield Part("tank", Cylinder(0.36 * r, 0.55 * r), _STEEL, at(-0.08, 0.0, 0.30))
        yield Part("dome", Sphere(0.36 * r), _STEEL, at(-0.08, 0.0, 0.57))
    yield Part("computer", Box(0.22 * r, 0.5 * r, 0.16 * r), _DARK, at(0.62, 0.0, 0.11))


def _flyer(r: float, shape: str, body: Rgba) -> Iterator[Part]:
    """A body of eight sides (or round) with solar cells, two tanks and a camera that looks along x."""
    eighth_turn = RotationMatrix.MakeZRotation(math.pi / 8.0)
    yield Part(
        "bus",
        frustum(0.74 * r, 0.74 * r, 0.84 * r, sides=8 if shape == "sphere" else _SIDES),
        body,
        RigidTransform(eighth_turn, [0.0, 0.0, -0.42 * r]),
    )
    for k, z in enumerate((-0.42, 0.42)):
        yield Part(f"tank {k}", Sphere(0.40 * r), _STEEL, RigidTransform([0.0, 0.0, z * r]))
        yield Part(
            f"ring {k}", Cylinder(0.50 * r, 0.06 * r), _DARK, RigidTransform([0.0, 0.0, z * r])
        )
    for k in (1, 2, 3):
        turn = RotationMatrix.MakeZRotation(k * math.pi / 2.0)
        yield Part(
            f"cells {k}",
            Box(0.03 * r, 0.50 * r, 0.70 * r),
            _PANEL,
            RigidTransform(turn, turn @ [0.70 * r, 0.0, 0.0]),
        )
    to_x = RotationMatrix.MakeYRotation(math.pi / 2.0)
    for name, made, colour, x in (
        ("camera", frustum(0.24 * r, 0.18 * r, 0.16 * r), _DARK, 0.68),
        ("lens", Cylinder(0.13 * r, 0.02 * r), _GLASS, 0.845),
    ):
        yield Part(name, made, colour, RigidTransform(to_x, [x * r, 0.0, 0.0]))


def _solid(craft: Spacecraft, solid: Solid, body: Rgba, scale: float, name: str) -> Part:
    """Shape of a solid of the spacecraft's file, whose frame is G."""
    size = [scale * x for x in solid.size]
    if solid.shape == "mesh":
        corners, faces = triangles(solid.mesh)
        shape: Shape = mesh(corners, faces, size[0])
    elif solid.shape == "cone":
        shape = frustum(size[0], 1e-3 * size[0], size[1])
    else:
        shape = {"box": Box, "cylinder": Cylinder, "sphere": Sphere}[solid.shape](*size)
    turn = RotationMatrix.MakeFromOneVector(np.array(solid.axis), 2)
    position = scale * (np.array(solid.position) - Outline(craft).centre)
    if solid.shape == "cone":
        position = position - turn @ [0.0, 0.0, size[1] / 2.0]
    colour = (
        Rgba(*(int(solid.colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)))
        if solid.colour
        else body
    )
    return Part(name, shape, colour, RigidTransform(turn, position))


def _frames(outline: Outline, at_mouths: bool) -> list[RigidTransform]:
    """Frames in B of the nozzles' mouths or roots, whose z axes point along the exhausts."""
    return [
        RigidTransform(
            RotationMatrix.MakeFromOneVector(nozzle.exhaust, 2),
            nozzle.mouth if at_mouths else nozzle.root,
        )
        for nozzle in outline.nozzles
    ]


def triad(craft: Spacecraft, length: float, width: float, colour: Rgba | None = None) -> list[Part]:
    """Axes of length and radius in units of the spacecraft's radius; in the plane only x."""
    ends = craft.radius * length * np.eye(3)[: 1 if craft.dimension == 2 else 3]
    return [
        Part(f"{name} axis", *rod(np.zeros(3), end, width * craft.radius, colour or own))
        for name, end, own in zip("xyz", ends, AXES, strict=False)
    ]


def rod(
    start: np.ndarray, end: np.ndarray, radius: float, colour: Rgba
) -> tuple[Shape, Rgba, RigidTransform]:
    """A thin cylinder from one point to another, m."""
    axis = end - start
    pose = RigidTransform(RotationMatrix.MakeFromOneVector(axis, 2), (start + end) / 2.0)
    return Cylinder(radius, float(np.linalg.norm(axis))), colour, pose


def frustum(
    bottom: float, top: float, height: float, scale: float = 1.0, sides: int = _SIDES
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
    if sides < _SIDES:
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
    around: list[Sequence[float]] = [*normals]
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
