"""What there is to see of a flight: poses, instant by instant, and everything as Drake's shapes.

One description serves the browser (`rans.show.view`) and rendered pictures (`rans.show.frames`).
"""

# Drake's stubs write NumPy's array types with their two parameters exchanged.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import Cylinder, InMemoryMesh, Mesh, Rgba, Shape, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from rans.drawing import columns, rotations
from rans.flight import Flight
from rans.model.fields import map_leaves
from rans.model.spacecraft import Spacecraft

BODIES = {"grey": Rgba(0.86, 0.90, 0.94), "orange": Rgba(0.99, 0.82, 0.60), "green": Rgba(0.70, 0.90, 0.80),
          "purple": Rgba(0.85, 0.77, 0.93), "red": Rgba(0.98, 0.75, 0.75)}
"""Colours of bodies: one per agent, then again from the first."""
_NOZZLE, _PLUME, _TRAIL = Rgba(0.25, 0.30, 0.35), Rgba(1.0, 0.55, 0.05, 0.9), Rgba(0.0, 0.45, 0.70)
_GOAL, _GHOST, _GRID = Rgba(0.0, 0.62, 0.45), Rgba(0.0, 0.62, 0.45, 0.22), Rgba(0.62, 0.66, 0.70)
_SHADOW = Rgba(0.78, 0.80, 0.83)
_AXES = (Rgba(0.84, 0.30, 0.0), Rgba(0.0, 0.62, 0.30), Rgba(0.0, 0.35, 0.80))

_SECONDS = 2.0
"""A velocity's arrow is as long as the way of so many seconds."""
_STRIDE = 0.03
"""Shortest piece of a trail, m."""
_SIDES = 20
"""Of the polygon that stands for a circle."""


@dataclass(frozen=True)
class Motion:
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
    firing: np.ndarray
    """(K, thrusters) bool: open from this instant on; at the last none is."""
    goals: list[RigidTransform]
    """The goal's pose in W at every instant; where the task bounds no position, only its rotation counts."""
    goal_velocities: np.ndarray
    """(K, 3) m/s in W."""

    @classmethod
    def of(cls, flight: Flight, episode: int) -> Motion:
        """Of one episode of a flight, by its index in the batch."""
        states = map_leaves(lambda x: x[:, episode], flight.states)
        instants = np.zeros(len(flight.times))
        goal = map_leaves(lambda x: x[..., episode] + instants, flight.goals)
        failed = np.asarray(flight.task.failed(states, goal))
        end = int(failed.argmax()) + 1 if failed.any() else len(failed)
        firing = np.zeros((end, len(flight.craft.thrusters)), dtype=bool)
        firing[:-1] = flight.commands[:end - 1, episode] > 0.0
        return cls(flight.craft, flight.controller, frozenset(flight.task.tolerances()), flight.times[:end],
                   _poses(states)[:end], columns(states.v)[:end], firing,
                   _poses(goal)[:end], columns(goal.v)[:end])

    @property
    def way(self) -> np.ndarray:
        """Positions in W, (K, 3) m."""
        return np.array([pose.translation() for pose in self.poses])

    def goal_at(self, instant: int) -> RigidTransform:
        """Where to draw the goal: at its place, or else where the spacecraft is."""
        if "position" in self.wanted:
            return self.goals[instant]
        return RigidTransform(self.goals[instant].rotation(), self.poses[instant].translation())

    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner in W, (3,) m, of all that is drawn."""
        goals = [goal.translation() for goal in self.goals] if "position" in self.wanted else []
        points = np.array([*self.way, *goals])
        margin = 2.0 * self.craft.radius
        return points.min(axis=0) - margin, points.max(axis=0) + margin


class Part(NamedTuple):
    """One shape, fixed in the frame that it belongs to."""

    name: str
    shape: Shape
    colour: Rgba
    pose: RigidTransform


def craft_parts(craft: Spacecraft, body: Rgba) -> list[Part]:
    """Body, axes x, y, z (red, green, blue; in the plane only x, the heading) and nozzles, in B."""
    r = craft.radius
    # The file says nothing of a cylinder's height.
    shape = Sphere(r) if craft.shape == "sphere" else Cylinder(r, 0.8 * r)
    parts = [Part("body", shape, body, RigidTransform()), *_triad(craft, 1.7, 0.045)]
    return parts + [Part(f"nozzle {i}", _frustum(0.05 * r, 0.11 * r, 0.3 * r), _NOZZLE, pose)
                    for i, pose in enumerate(_exhausts(craft, 0.0))]


def plume_parts(craft: Spacecraft) -> list[Part]:
    """The flame of each thruster, in B."""
    r = craft.radius
    return [Part(f"plume {i}", _frustum(0.10 * r, 0.02 * r, 1.1 * r), _PLUME, pose)
            for i, pose in enumerate(_exhausts(craft, 0.3))]


def goal_parts(craft: Spacecraft, wanted: Collection[str]) -> list[Part]:
    """What there is to reach, in the goal's frame: a ghost with axes, axes alone, or a pin.

    Wanted are the errors that the task bounds, the keys of `Task.tolerances`.
    """
    r = craft.radius
    if "attitude" in wanted:
        ghost = [Part("ghost", Sphere(0.9 * r), _GHOST, RigidTransform())] if "position" in wanted else []
        return [*ghost, *_triad(craft, 2.3, 0.025, _GOAL if craft.dimension == 2 else None)]
    pin = [Part("needle", _frustum(0.001 * r, 0.08 * r, 2.2 * r), _GOAL, RigidTransform()),
           Part("head", Sphere(0.3 * r), _GOAL, RigidTransform([0.0, 0.0, 2.2 * r]))]
    return pin if "position" in wanted else []


def velocity_parts(goal: bool, length: float = 1.0) -> list[Part]:
    """An arrow along x of this length in m, green for the goal's velocity, blue for one's own."""
    colour, to_x = _GOAL if goal else _TRAIL, RotationMatrix.MakeYRotation(math.pi / 2.0)
    shaft, head = _frustum(0.025, 0.025, 0.8, length), _frustum(0.08, 0.001, 0.2, length)
    return [Part("shaft", shaft, colour, RigidTransform(to_x, [0.0, 0.0, 0.0])),
            Part("head", head, colour, RigidTransform(to_x, [0.8 * length, 0.0, 0.0]))]


def velocity_arrow(velocity: np.ndarray) -> tuple[RotationMatrix, float]:
    """How to turn and scale the arrow of `velocity_parts` for a velocity in W, (3,) m/s."""
    length = float(np.linalg.norm(velocity))
    if length < 1e-6:
        return RotationMatrix(), 1e-3
    return RotationMatrix.MakeFromOneVector(velocity, 0), _SECONDS * length


def trail_parts(way: np.ndarray) -> Iterator[tuple[int, Part]]:
    """Pieces of a path in W, (K, 3) m, each with the index at which it is complete."""
    last = way[0]
    for k, point in enumerate(way):
        if np.linalg.norm(point - last) >= _STRIDE:
            yield k, Part(f"trail {k}", *_rod(last, point, 0.008, _TRAIL))
            last = point


def floor_parts(low: np.ndarray, high: np.ndarray) -> list[Part]:
    """Grid lines 1 m apart at height low[2], around a box of W with these corners, (3,) m."""
    (x0, y0), (x1, y1), z = np.floor(low[:2]), np.ceil(high[:2]), low[2]
    ends = [((x, y0, z), (x, y1, z)) for x in np.arange(x0, x1 + 0.5)]
    ends += [((x0, y, z), (x1, y, z)) for y in np.arange(y0, y1 + 0.5)]
    return [Part(f"line {k}", *_rod(np.array(a), np.array(b), 0.006, _GRID)) for k, (a, b) in enumerate(ends)]


def shadow_part(craft: Spacecraft) -> Part:
    """A disc on the floor below the spacecraft, which shows how high it is."""
    return Part("shadow", Cylinder(craft.radius, 0.002), _SHADOW, RigidTransform())


def _exhausts(craft: Spacecraft, along: float) -> list[RigidTransform]:
    """Frames in B whose z axes point along the exhausts, so many radii from the thrusters."""
    away = [-np.array(thruster.direction) for thruster in craft.thrusters]
    places = [np.array(thruster.position) - craft.centre_of_mass for thruster in craft.thrusters]
    return [RigidTransform(RotationMatrix.MakeFromOneVector(z, 2), place + along * craft.radius * z)
            for z, place in zip(away, places, strict=True)]


def _triad(craft: Spacecraft, length: float, width: float, colour: Rgba | None = None) -> list[Part]:
    """Axes of length and radius in units of the spacecraft's radius; in the plane only x."""
    ends = craft.radius * length * np.eye(3)[:1 if craft.dimension == 2 else 3]
    return [Part(f"{name} axis", *_rod(np.zeros(3), end, width * craft.radius, colour or own))
            for name, end, own in zip("xyz", ends, _AXES, strict=False)]


def _rod(start: np.ndarray, end: np.ndarray, radius: float,
         colour: Rgba) -> tuple[Shape, Rgba, RigidTransform]:
    way = end - start
    pose = RigidTransform(RotationMatrix.MakeFromOneVector(way, 2), (start + end) / 2.0)
    return Cylinder(radius, float(np.linalg.norm(way))), colour, pose


def _frustum(bottom: float, top: float, height: float, scale: float = 1.0) -> Mesh:
    """A closed cone, cut off, along z: radii at z = 0 and z = height, all of them times a scale.

    As a text in the format OBJ: points (v), normals (vn), and faces (f) of "point//normal", from 1.
    """
    n, angles = _SIDES, np.linspace(0.0, math.tau, _SIDES, endpoint=False)
    around = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    points = [*((*(bottom * a), 0.0) for a in around), *((*(top * a), height) for a in around)]
    points += [(0.0, 0.0, 0.0), (0.0, 0.0, height)]
    normals = [*((*a, (bottom - top) / height) for a in around), (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)]
    faces = []
    for i in range(1, n + 1):
        j = i % n + 1
        faces += [((i, i), (j, j), (n + j, j)), ((i, i), (n + j, j), (n + i, i)),
                  ((2 * n + 1, n + 1), (j, n + 1), (i, n + 1)),
                  ((2 * n + 2, n + 2), (n + i, n + 2), (n + j, n + 2))]
    lines = [*("v {:.5g} {:.5g} {:.5g}".format(*p) for p in points),
             *("vn {:.5g} {:.5g} {:.5g}".format(*v) for v in normals),
             *("f " + " ".join(f"{point}//{normal}" for point, normal in face) for face in faces)]
    return Mesh(InMemoryMesh(mesh_file=MemoryFile("\n".join(lines), ".obj", "frustum.obj")), scale)


def _poses(states: Any) -> list[RigidTransform]:
    """Poses in W of planar or spatial states whose fields are arrays (K,)."""
    return [RigidTransform(RotationMatrix.ProjectToRotationMatrix(R), p)
            for R, p in zip(rotations(states), columns(states.p), strict=True)]
