"""Shapes that draw a spacecraft: boxes, cylinders, cones, spheres and meshes."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

from rans.errors import ConfigError, brief
from rans.files import read_text

_SIZES = {
    "box": ("x", "y", "z"),
    "cylinder": ("radius", "length"),
    "cone": ("radius", "length"),
    "sphere": ("radius",),
    "mesh": ("scale",),
}
"""Meaning of the numbers in the size of a solid, m; a mesh has a factor."""
_COLOUR = re.compile("#[0-9a-fA-F]{6}")
_LARGEST = 1_000_000
"""Largest number of characters of a mesh, which is stored with the spacecraft in every run folder and page."""
_FARTHEST = 1e6
"""Largest coordinate of a solid or of a corner of a mesh, m: beyond, drawings lose the spacecraft."""
_NAMED = re.compile(r"""(?m)^([ \t]*mesh[ \t]*=[ \t]*)(?:"([^"\\\n]*\.obj)"|'([^'\n]*\.obj)')""")

MOST_SOLIDS = 200
"""Largest number of solids of a spacecraft; more would make pages slow and should be one mesh."""


@dataclass(frozen=True)
class Solid:
    """One shape that is fixed to the spacecraft, for drawings only; it has no mass.

    Raises:
        ConfigError: a value cannot be drawn.
    """

    shape: Literal["box", "cylinder", "cone", "sphere", "mesh"]
    size: tuple[float, ...]
    """Size, m: lengths of a box along x, y and z; radius and length of a cylinder along z, or of a cone, which
    points along z; radius of a sphere. For a mesh, a scale factor."""
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of the centre (of a mesh: of its origin) in G, m."""
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Direction of the solid's z axis in G, of any length above zero."""
    colour: str = ""
    """Colour "#rrggbb"; by default the colour that distinguishes agents."""
    mesh: str = ""
    """Text of a mesh in the OBJ format; its lines v and f are read."""

    def __post_init__(self) -> None:
        # Each value on its own: whether it holds, what it must be, and the value.
        size_names = _SIZES.get(self.shape, ())
        for holds, what, value in (
            (bool(size_names), f"shape must be one of {', '.join(_SIZES)}", self.shape),
            (
                len(self.size) == len(size_names) and all(1e-6 <= x <= 1e6 for x in self.size),
                f"size of a {self.shape} must be [{', '.join(size_names)}], each from 1e-6 to 1e6",
                self.size,
            ),
            (
                all(abs(x) <= _FARTHEST for x in self.position),
                "position must lie within 1e6 m",
                self.position,
            ),
            (
                math.isfinite(length := math.hypot(*self.axis)) and length > 1e-9,
                "axis must be three finite numbers that are not all zero",
                self.axis,
            ),
            (
                not self.colour or _COLOUR.fullmatch(self.colour),
                'colour must be "#rrggbb"',
                self.colour,
            ),
        ):
            if not holds:
                raise ConfigError(f"{what}, got {brief(value)}")
        if (self.shape == "mesh") is not bool(self.mesh):
            raise ConfigError('the key mesh belongs to the shape "mesh", and no other')
        if self.mesh:
            triangles(self.mesh)


def triangles(text: str) -> tuple[list[tuple[float, ...]], list[tuple[int, int, int]]]:
    """Vertices (m) and triangles of a mesh, each with three indices of vertices; polygons become triangle fans.

    Raises:
        ConfigError: the text is not in the OBJ format, has no triangle, or is too large.
    """
    if "\n" not in text or len(text) > _LARGEST:
        raise ConfigError(
            "mesh must be the name of an .obj file beside the spacecraft's file, of at most "
            f"{_LARGEST:,} characters, got {brief(text)}"
        )
    corners: list[tuple[float, ...]] = []
    faces: list[tuple[int, int, int]] = []
    for number, line in enumerate(text.splitlines(), 1):
        key, *values = line.split() or [""]
        try:
            if key == "v":
                corners.append(_vertex(values))
            elif key == "f":
                first, *others = _polygon(values, len(corners))
                faces += [(first, *pair) for pair in pairwise(others)]
        except ValueError as error:
            raise ConfigError(
                f"line {number} of the mesh must be `v x y z`, or `f i j k` with earlier "
                f"corners from 1 on, got {brief(line)}"
            ) from error
    if not faces:
        raise ConfigError("the mesh has no triangle: no line begins with f")
    return corners, faces


def _vertex(values: Sequence[str]) -> tuple[float, ...]:
    """Position of a vertex of a line v, m; raises `ValueError`."""
    vertex = tuple(float(x) for x in values[:3])
    if len(vertex) < 3 or not all(abs(x) <= _FARTHEST for x in vertex):
        raise ValueError(values)
    return vertex


def _polygon(values: Sequence[str], vertices: int) -> list[int]:
    """Indices from 0 of a line f, whose entries are i, i/t, i//n or i/t/n from 1; raises `ValueError`."""
    indices = [int(value.partition("/")[0]) - 1 for value in values]
    if len(indices) < 3 or not all(0 <= index < vertices for index in indices):
        raise ValueError(values)
    return indices


def with_meshes(text: str, folder: Path) -> str:
    """TOML text of a spacecraft with the text of its meshes in place of the names of their files.

    The result needs no other file.

    Raises:
        ConfigError: a file cannot be read, or is not beside the spacecraft's file.
    """

    def found(match: re.Match[str]) -> str:
        name = match[2] or match[3]
        file = folder / name
        if Path(name).name != name or file.resolve().parent != folder.resolve():
            raise ConfigError(
                f"mesh must be the name of a file beside the spacecraft's file, got {brief(name)}."
            )
        return match[1] + json.dumps(read_text(file, _LARGEST, "the mesh "))

    count = sum(1 for _ in _NAMED.finditer(text))
    if count > MOST_SOLIDS:  # each one would be read
        raise ConfigError(f"a spacecraft may have at most {MOST_SOLIDS} meshes, got {count:,}.")
    return _NAMED.sub(found, text)
