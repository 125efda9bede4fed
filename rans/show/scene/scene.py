"""Scene of a flight: poses, instant by instant, and Drake's shapes.

It serves films (`rans.show.scene.video`) and rendered pictures (`rans.show.scene.frames`).
"""

# Drake's stubs write NumPy's array types with their two parameters exchanged.

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.geometry import Box, Cylinder, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from rans.drawing import columns, outlines, rotations
from rans.flight import Flight
from rans.model.fields import Vec2, map_leaves
from rans.model.spacecraft import Spacecraft
from rans.show.scene.craft import FLOOR, Part, hull_parts, triad
from rans.show.scene.shapes import frustum, mesh, rod
from rans.tasks.quantities import QUANTITIES
from rans.tasks.shapes import Ball, Cone, GlideSlope, Shape

BODIES = {
    "grey": Rgba(0.62, 0.68, 0.75),
    "orange": Rgba(0.93, 0.60, 0.25),
    "green": Rgba(0.36, 0.72, 0.55),
    "purple": Rgba(0.66, 0.50, 0.85),
    "red": Rgba(0.88, 0.42, 0.42),
}
"""Colours of bodies: one per agent, then again from the first."""
_TRAIL = Rgba(0.10, 0.52, 0.85)
_GOAL = Rgba(0.0, 0.70, 0.50)
_GHOST = Rgba(0.0, 0.75, 0.52, 0.28)
_KEEP_OUT = Rgba(0.86, 0.27, 0.10, 0.30)
_KEEP_IN = Rgba(0.16, 0.55, 0.90)
_CONE = Rgba(0.16, 0.55, 0.90, 0.18)
_GRID = Rgba(0.70, 0.73, 0.77)
_FLOOR = Rgba(0.88, 0.90, 0.92)
_SHADOW = Rgba(0.66, 0.69, 0.73)

STARS = 30.0
"""So many times as far away as what they surround is large."""
_SECONDS = 2.0
"""A velocity's arrow is as long as the way of so many seconds."""
_STRIDE = 0.03
"""Shortest piece of a trail, m."""
_DISC = 0.12
"""Height of a keep-out disc, m."""
_MARGIN = 2.2
"""Around a spacecraft's centre, in radii: what stands out, and room for its name."""


@dataclass(frozen=True)
class SceneMotion:
    """K instants of one spacecraft, up to the end of its episode or its failure."""

    craft: Spacecraft
    controller: str
    wanted: frozenset[str]
    """Errors that the task bounds: "position", "attitude", "velocity", "spin"."""
    times: np.ndarray
    """(K,) s."""
    poses: list[RigidTransform]
    """X_WB at every instant."""
    velocities: np.ndarray
    """(K, 3) m/s in W."""
    opening: np.ndarray
    """(K, thrusters) commands, 0 to 1, from this instant on; at the last none is open."""
    goals: list[RigidTransform]
    """The goal's pose in W at every instant; where the task bounds no position, only its rotation counts."""
    goal_velocities: np.ndarray
    """(K, 3) m/s in W."""
    errors: dict[str, np.ndarray]
    """(K,) of each error that the task bounds."""
    scenery: tuple[Shape, ...] = ()
    """Zones, cones and limits of the task, whose fields are arrays (K,)."""

    @classmethod
    def of(cls, flight: Flight, episode: int) -> SceneMotion:
        """Motion of one episode of a flight, by its index in the batch."""
        states = map_leaves(lambda x: x[:, episode], flight.states)
        instants = np.zeros(len(flight.times))
        goal = map_leaves(lambda x: x[..., episode] + instants, flight.goals)
        failed = np.asarray(flight.task.failed(states, goal))
        end = int(failed.argmax()) + 1 if failed.any() else len(failed)
        if flight.lengths is not None:
            end = min(end, int(flight.lengths[episode]) + 1)
        if flight.task.violation_ends and flight.violated_when()[:, episode].any():
            end = min(end, int(flight.violated_when()[:, episode].argmax()) + 2)
        opening = np.zeros((end, flight.craft.thruster_count))
        opening[:-1] = flight.openings[: end - 1, episode]
        errors = flight.errors()
        return cls(
            flight.craft,
            flight.controller,
            frozenset(flight.task.tolerances()),
            flight.times[:end],
            poses(states)[:end],
            columns(states.v)[:end],
            opening,
            poses(goal)[:end],
            columns(goal.v)[:end],
            {name: errors[name][:end, episode] for name in flight.task.tolerances()},
            tuple(
                map_leaves(lambda x: (np.asarray(x, dtype=float) + instants)[:end], shape)
                for shape in flight.task.scenery(goal)
            ),
        )

    @property
    def path(self) -> np.ndarray:
        """Positions in W, (K, 3) m."""
        return np.array([pose.translation() for pose in self.poses])

    @property
    def reach(self) -> float:
        """Largest distance between the goal and the spacecraft, m: how far slopes without an end are drawn."""
        goals = np.array([goal.translation() for goal in self.goals])
        return float(np.linalg.norm(self.path - goals, axis=1).max())

    def error_texts(self, instant: int) -> list[str]:
        """Errors at an instant, each with its unit."""
        return [
            f"{QUANTITIES[name].display[0] * float(error[instant]):.1f} {QUANTITIES[name].display[1]}"
            for name, error in self.errors.items()
        ]

    def goal_at(self, instant: int) -> RigidTransform:
        """Position at which the goal is drawn: its own, or else that of the spacecraft."""
        if "position" in self.wanted:
            return self.goals[instant]
        return RigidTransform(self.goals[instant].rotation(), self.poses[instant].translation())

    def points(self) -> np.ndarray:
        """Corners in W, (8 K, 3) m, of boxes around all that is to be seen at each instant."""
        r = self.craft.radius
        flat = self.craft.dimension == 2
        corners = (
            np.array(
                [
                    (x, y, z)
                    for x in (-_MARGIN, _MARGIN)
                    for y in (-_MARGIN, _MARGIN)
                    for z in ((FLOOR, 1.1) if flat else (-_MARGIN, _MARGIN))
                ]
            )
            * r
        )
        points = [*self.path]
        if "position" in self.wanted:
            points += [goal.translation() for goal in self.goals]
        for shape in self.scenery:
            for k in {0, len(self.poses) - 1}:
                points += [*np.concatenate(outlines(at_instant(shape, k), 0.0) or [self.path[:1]])]
        if "velocity" in self.wanted:
            arrows = _SECONDS * np.array([*self.velocities, *self.goal_velocities])
            points += [*(np.tile(self.path, (2, 1)) + arrows)]
        return (np.array(points)[:, None] + corners).reshape(-1, 3)

    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner in W, (3,) m, of `points`; in the plane the floor is the lowest."""
        points = self.points()
        return points.min(axis=0), points.max(axis=0)


def goal_parts(craft: Spacecraft, bounded: Collection[str]) -> list[Part]:
    """Shapes of a goal, in its frame: a ghost with axes, axes alone, or a pin.

    Wanted are the errors that the task bounds, the keys of `Task.tolerances`.
    """
    r = craft.radius
    if "attitude" in bounded:
        # A little larger, so that no surface of the craft lies in one of its ghost.
        hull = hull_parts(craft, _GHOST, 1.04, one_colour=True) if "position" in bounded else []
        ghost = [part._replace(name=f"ghost {part.name}") for part in hull]
        return [*ghost, *triad(craft, 2.1, 0.03, _GOAL if craft.dimension == 2 else None)]
    pin = [
        Part("needle", frustum(0.001 * r, 0.08 * r, 2.2 * r), _GOAL, RigidTransform()),
        Part("head", Sphere(0.3 * r), _GOAL, RigidTransform([0.0, 0.0, 2.2 * r])),
    ]
    return pin if "position" in bounded else []


def at_instant(shape: Shape, k: int) -> Shape:
    """A shape of numbers, of one whose fields are arrays over instants."""
    return map_leaves(lambda x: float(x[k]), shape)


def scenery_parts(shape: Shape, reach: float) -> list[Part]:
    """A shape of numbers in its own frame (`scenery_pose`): a ball, a disc in the plane, or a cone.

    What has no place, such as a speed limit, is not drawn. A slope without an end is drawn as far as ``reach``, m.
    """
    if isinstance(shape, Ball):
        flat = isinstance(shape.centre, Vec2)
        radius = float(shape.radius)
        solid = Cylinder(radius, _DISC) if flat else Sphere(radius)
        return [Part("keep-out zone", solid, _KEEP_OUT, RigidTransform())]
    if isinstance(shape, Cone):
        return _cone_parts(float(shape.half_angle), float(shape.length), shape.apex)
    if isinstance(shape, GlideSlope):
        return _cone_parts(math.pi / 2.0 - float(shape.angle), reach, shape.apex)
    return []


def scenery_pose(shape: Shape) -> RigidTransform:
    """Pose in W of a shape's own frame: at its centre or apex, with z along a cone's axis."""
    if isinstance(shape, Ball):
        return RigidTransform(columns(shape.centre))
    if isinstance(shape, Cone | GlideSlope):
        axis = columns(shape.axis if isinstance(shape, Cone) else shape.up)
        if isinstance(shape.apex, Vec2):
            # In the plane the cone is a sector of the floor, whose x axis is the cone's.
            return RigidTransform(RotationMatrix.MakeFromOneVector(axis, 0), columns(shape.apex))
        return RigidTransform(RotationMatrix.MakeFromOneVector(axis, 2), columns(shape.apex))
    return RigidTransform()


def _cone_parts(half_angle: float, length: float, apex: Any) -> list[Part]:
    """A cone of an angle (rad) and slant length (m) along z; in the plane the two sides of a sector along x."""
    if isinstance(apex, Vec2):
        sides = []
        for name, angle in (("left side", half_angle), ("right side", -half_angle)):
            end = length * np.array([math.cos(angle), math.sin(angle), 0.0])
            sides.append(Part(name, *rod(np.zeros(3), end, 0.02, _KEEP_IN)))
        return sides
    height = length * math.cos(half_angle)
    # A frustum's apex of a millimetre: a mesh has no face of no area.
    return [
        Part("cone", frustum(0.001, height * math.tan(half_angle), height), _CONE, RigidTransform())
    ]


def velocity_parts(goal: bool, length: float = 1.0) -> list[Part]:
    """An arrow along x of this length in m, green for the goal's velocity, blue for one's own."""
    colour = _GOAL if goal else _TRAIL
    to_x = RotationMatrix.MakeYRotation(math.pi / 2.0)
    shaft = frustum(0.025, 0.025, 0.8, length)
    head = frustum(0.08, 0.001, 0.2, length)
    return [
        Part("shaft", shaft, colour, RigidTransform(to_x, [0.0, 0.0, 0.0])),
        Part("head", head, colour, RigidTransform(to_x, [0.8 * length, 0.0, 0.0])),
    ]


def velocity_arrow(velocity: np.ndarray) -> tuple[RotationMatrix, float]:
    """Rotation and scale of the arrow of `velocity_parts` for a velocity in W, (3,) m/s."""
    length = float(np.linalg.norm(velocity))
    if length < 1e-6:
        return RotationMatrix(), 1e-3
    return RotationMatrix.MakeFromOneVector(velocity, 0), _SECONDS * length


def trail_parts(path: np.ndarray) -> Iterator[tuple[int, Part]]:
    """Pieces of a path in W, (K, 3) m, each with the index at which it is complete."""
    last = path[0]
    for k, point in enumerate(path):
        if np.linalg.norm(point - last) >= _STRIDE:
            yield k, Part(f"trail {k}", *rod(last, point, 0.008, _TRAIL))
            last = point


def ground_parts(low: np.ndarray, high: np.ndarray, space: bool) -> list[Part]:
    """Surroundings of a box of W with these corners, (3,) m: a floor with lines 1 m apart; in space stars."""
    if space:
        return [_stars((low + high) / 2.0, STARS * float(np.linalg.norm(high - low)))]
    (x0, y0) = np.floor(low[:2]) - 1.0
    (x1, y1) = np.ceil(high[:2]) + 1.0
    z = low[2]
    ends = [((x, y0, z), (x, y1, z)) for x in np.arange(x0, x1 + 0.5)]
    ends += [((x0, y, z), (x1, y, z)) for y in np.arange(y0, y1 + 0.5)]
    middle = RigidTransform([(x0 + x1) / 2.0, (y0 + y1) / 2.0, z - 0.05])
    lines = [
        Part(f"line {k}", *rod(np.array(a), np.array(b), 0.006, _GRID))
        for k, (a, b) in enumerate(ends)
    ]
    return [Part("floor", Box(x1 - x0, y1 - y0, 0.1), _FLOOR, middle), *lines]


def shadow_part(craft: Spacecraft) -> Part:
    """A disc on the floor below the spacecraft."""
    return Part("shadow", Cylinder(0.95 * craft.radius, 0.004), _SHADOW, RigidTransform())


def _stars(middle: np.ndarray, distance: float) -> Part:
    """Points of light around ``middle`` (3,), m, as one mesh of tetrahedra; always the same ones (a fixed seed)."""
    random = np.random.default_rng(0)
    directions = random.normal(size=(700, 3))
    sizes = distance * random.uniform(6e-4, 2.2e-3, 700)
    corners = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]) / math.sqrt(3.0)
    stars = distance * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    points = (stars[:, None] + sizes[:, None, None] * corners).reshape(-1, 3)
    faces = [
        (k + a, k + b, k + c)
        for k in range(0, len(points), 4)
        for a, b, c in ((0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2))
    ]
    return Part(
        "stars", mesh(points.tolist(), faces, 1.0), Rgba(1.0, 1.0, 1.0), RigidTransform(middle)
    )


def poses(states: Any) -> list[RigidTransform]:
    """Poses in W of planar or spatial states whose fields are arrays (K,)."""
    return [
        RigidTransform(RotationMatrix.ProjectToRotationMatrix(R), p)
        for R, p in zip(rotations(states), columns(states.p), strict=True)
    ]
