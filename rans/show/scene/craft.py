"""A spacecraft as shapes: what its file says, or a platform on air bearings, or a free flyer; and its plumes.

Lengths are in units of the spacecraft's radius, in the body frame B.
"""

# Drake's stubs write NumPy's array types with their two parameters exchanged.

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from pydrake.geometry import Box, Cylinder, Rgba, Shape, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from rans.model.solids import Solid, triangles
from rans.model.spacecraft import Spacecraft
from rans.outline import BELL, Outline
from rans.show.scene.shapes import SIDES, frustum, mesh, rod

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
    """Two round decks on three air pads, with an air tank (sphere or cylinder) and a computer; r is the radius."""

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
    """A body of eight sides (or round) with solar cells, two tanks and a camera along x; r is the radius."""
    eighth_turn = RotationMatrix.MakeZRotation(math.pi / 8.0)
    yield Part(
        "bus",
        frustum(0.74 * r, 0.74 * r, 0.84 * r, sides=8 if shape == "sphere" else SIDES),
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
