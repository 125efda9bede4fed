"""Frames of the motion of a spacecraft, and lines of what it flies among.

Lengths are in m in W; pixels come last. Frames of equal states are equal (`tests/episode/test_drawing.py`).

Raises:
    MissingPackage: when it is imported, where Pillow is missing.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from rans.base.errors import require
from rans.episode.outline import Nozzle, nozzles
from rans.model.fields import Vec2, Vector
from rans.model.spacecraft import Spacecraft
from rans.tasks import Task
from rans.tasks.shapes import Ball, Cone, GlideSlope, Shape

require("PIL")
from PIL import Image, ImageDraw, ImageFont  # noqa: E402

_BODY = "#DCE6F0"
_EDGE = "#1F2933"
_NOZZLE = "#52606D"
_FLAME = "#E69F00"
_GRID = "#E4E7EB"
_SHADOW = "#B8C0CA"
_TRAIL = "#0072B2"
_KEEP_OUT = "#D55E00"
_KEEP_IN = "#56B4E9"
_GOAL = "#009E73"
_BODY_AXES = ("#D55E00", "#009E73", "#0072B2")

_SMOOTHING = 2
"""Factor by which frames are drawn larger and then averaged down, for smooth edges."""
_SECONDS = 2.0
"""Length of a velocity arrow as the distance travelled in this time, s."""
_AZIMUTH = math.radians(-60.0)
_ELEVATION = math.radians(25.0)
"""Azimuth and elevation of the view in space."""

_AROUND = np.linspace(0.0, math.tau, 49)
"""Angles of the points of a circle, rad."""
_SIDES = 8
"""Number of lines from the apex of a cone in space to its rim."""


class Scene:
    """Renderer of frames of one spacecraft, from above in the plane and obliquely in space.

    The view is an orthographic projection. The body is a disc of its outer radius, with great circles in space.
    The view contains the craft, its trail and the goal position. Grid lines are 1 m apart; in space they lie at
    the height z of the goal, or of the start, and a thin line connects the craft with that plane. The axes x, y, z
    of the body are red, green and blue.

    Keep-out zones of the task are red outlines; approach cones and glide slopes are blue outlines. The goal is
    green and on top: a ring with axes for a pose, a dot for a position, longer axes on the craft for an attitude
    alone, and an arrow for a velocity beside a blue one for that of the craft.

    Args:
        craft: spacecraft.
        task: task, which determines goal and scenery.
        width: width of a frame, pixels.
        height: height of a frame, pixels.
    """

    def __init__(self, craft: Spacecraft, task: Task, width: int = 640, height: int = 480) -> None:
        self.craft = craft
        self.task = task
        self.width = width
        self.height = height
        self._view = _view(craft.dimension)
        self._nozzles = nozzles(craft)
        self._font = ImageFont.load_default(13 * _SMOOTHING)

    def render(
        self,
        state: Any,
        goal: Any,
        command: Sequence[float] | np.ndarray,
        trail: Sequence[Sequence[float]] | np.ndarray = (),
        further: Sequence[Sequence[float]] | np.ndarray = (),
    ) -> np.ndarray:
        """Frame (height, width, 3), uint8. Sets the view and the pen that the private methods draw with.

        Args:
            state: state of numbers.
            goal: goal of numbers.
            command: commands from 0 (shut) to 1 (open), which are the lengths of the flames.
            trail: earlier positions in W, (K, 2 or 3), m.
            further: positions that the picture has room for too, so that the view of a film stays, (K, 2 or 3), m.
        """
        # What is drawn, all of which is in the picture: trail, craft, goal and tips of velocities.
        position = columns(state.p)
        goal_position = columns(goal.p)
        turn = rotations(state)
        goal_turn = rotations(goal)
        toleranced = self.task.task_of(goal).tolerances()
        path, room = ([np.resize([*p, 0.0], 3) for p in points] for points in (trail, further))
        path.append(position)
        target = goal_position if "position" in toleranced else path[0]
        arrows = ((state.v, _TRAIL), (goal.v, _GOAL)) if "velocity" in toleranced else ()
        tips = [(position + _SECONDS * columns(velocity), colour) for velocity, colour in arrows]
        self._look_at([*path, *room, target, *(tip for tip, _ in tips)])
        # From the back to the front, several times too large, then reduced: smooth edges.
        image = Image.new("RGB", (self.width * _SMOOTHING, self.height * _SMOOTHING), "white")
        self._pen = ImageDraw.Draw(image)
        self._draw_grid(target)
        for shape in self.task.scenery(goal):
            colour = _KEEP_OUT if isinstance(shape, Ball) else _KEEP_IN
            for outline in outlines(shape, self._reach.max()):
                self._line(list(outline), colour, 1.5)
        self._line(path, _TRAIL, 2.0)
        if self.craft.dimension == 3:
            self._line([position, np.array([position[0], position[1], target[2]])], _SHADOW, 1.0)
        self._draw_craft(position, turn, np.asarray(command, dtype=float))
        self._draw_goal(target if "position" in toleranced else position, goal_turn, toleranced)
        for tip, colour in tips:
            self._arrow(position, tip, colour)
        return np.asarray(image.reduce(_SMOOTHING))

    def _look_at(self, points: list[np.ndarray]) -> None:
        """Set the centre and the scale of the picture so that it contains these points of W. Points are (3,), m.

        `_pixels` and all that draws reads what this sets.
        """
        flat = np.array(points) @ self._view.T[:, :2]
        low = flat.min(axis=0)
        high = flat.max(axis=0)
        self._centre = (low + high) / 2.0
        self._reach = np.maximum(
            (high - low) / 2.0 + 3.0 * self.craft.radius, 5.0 * self.craft.radius
        )
        self._scale = _SMOOTHING * 0.5 * float(np.min((self.width, self.height) / self._reach))

    def _pixels(self, points: Sequence[np.ndarray]) -> list[tuple[float, float]]:
        """Pixel coordinates of K points (3,) of W, m; the y axis of pixels points down."""
        flat = (np.array(points) @ self._view.T[:, :2] - self._centre) * self._scale
        x = _SMOOTHING * self.width / 2.0 + flat[:, 0]
        y = _SMOOTHING * self.height / 2.0 - flat[:, 1]
        return list(zip(x.tolist(), y.tolist(), strict=True))

    def _line(self, points: Sequence[np.ndarray], colour: str, width: float) -> None:
        self._pen.line(
            self._pixels(points), fill=colour, width=round(width * _SMOOTHING), joint="curve"
        )

    def _disc(self, centre: np.ndarray, fill: str | None, edge: str, size: float = 1.0) -> None:
        radius = size * self.craft.radius * self._scale
        self._pen.circle(self._pixels([centre])[0], radius, fill, edge, round(1.5 * _SMOOTHING))

    def _draw_goal(
        self, position: np.ndarray, turn: np.ndarray, toleranced: Collection[str]
    ) -> None:
        """Draw position (3,), pose or attitude (3, 3) of the goal in W, depending on the task's tolerances."""
        if "attitude" in toleranced:
            self._draw_axes(
                position, turn, (True, False), _GOAL, 1.5 if "position" in toleranced else 2.3
            )
        if {"position", "attitude"} <= set(toleranced):
            self._disc(position, None, _GOAL)
        elif "position" in toleranced:
            self._disc(position, _GOAL, _GOAL, 0.25)

    def _arrow(self, start: np.ndarray, tip: np.ndarray, colour: str) -> None:
        """Draw an arrow between two points of W (3,), m, unless they coincide in the picture."""
        (x, y), (tip_x, tip_y) = self._pixels([start, tip])
        length = math.hypot(tip_x - x, tip_y - y)
        if length < 2.0 * _SMOOTHING:
            return
        along = np.array([tip_x - x, tip_y - y]) / length
        head = min(8.0 * _SMOOTHING, length)
        neck = np.array([tip_x, tip_y]) - head * along
        side = 0.45 * head * np.array([-along[1], along[0]])
        self._pen.line([(x, y), (neck[0], neck[1])], fill=colour, width=round(2.5 * _SMOOTHING))
        corners = [(float(a), float(b)) for a, b in (neck + side, neck - side)]
        self._pen.polygon([(tip_x, tip_y), *corners], fill=colour)

    def _draw_grid(self, target: np.ndarray) -> None:
        """Draw lines at whole metres around a point (3,) of W; in the plane they extend beyond the picture."""
        visible = _SMOOTHING * max(self.width, self.height) / self._scale
        half = math.ceil(visible if self.craft.dimension == 2 else float(self._reach.max()))
        middle = np.append(np.round(target[:2]), target[2])
        for k in range(-half, half + 1):
            for a, b in (((k, -half, 0), (k, half, 0)), ((-half, k, 0), (half, k, 0))):
                self._line([middle + a, middle + b], _GRID, 1.0)
        corner = (8 * _SMOOTHING, (self.height - 22) * _SMOOTHING)
        self._pen.text(corner, "grid 1 m", fill=_NOZZLE, font=self._font)

    def _draw_axes(
        self,
        centre: np.ndarray,
        turn: np.ndarray,
        sides: tuple[bool, ...],
        colour: str | None = None,
        length: float = 1.5,
    ) -> None:
        """Draw the heading, or in space the body axes that point to the viewer (True) or away (False)."""
        count = 1 if self.craft.dimension == 2 else 3
        for axis, usual in zip(turn.T[:count], _BODY_AXES, strict=False):
            if bool(axis @ self._view[2] >= 0.0) in sides:
                tip = centre + length * self.craft.radius * axis
                self._line([centre, tip], colour or usual, 2.5)

    def _draw_great_circles(self, centre: np.ndarray, turn: np.ndarray) -> None:
        """Draw the visible halves of the sphere's great circles in the coordinate planes of the body."""
        for first, second in combinations(turn.T, 2):
            ring = _circle(first, second, self.craft.radius)
            in_front = ring @ self._view[2] > 0.0
            for start in np.flatnonzero(in_front[:-1] & in_front[1:]):
                self._line(list(centre + ring[start : start + 2]), _SHADOW, 1.0)

    def _draw_craft(self, position: np.ndarray, turn: np.ndarray, command: np.ndarray) -> None:
        """Draw the craft from back to front: thrusters and axes behind the body, the body, those before it.

        The position is (3,), m, and ``turn`` (3, 3) takes B to W.
        """
        turned = [
            Nozzle(turn @ nozzle.root, turn @ nozzle.mouth, turn @ nozzle.exhaust, nozzle.strength)
            for nozzle in self._nozzles
        ]
        in_front = np.array([nozzle.root @ self._view[2] >= -1e-9 for nozzle in turned])
        for near in (False, True):
            if near:
                self._disc(position, _BODY, _EDGE)
                if self.craft.dimension == 3:
                    self._draw_great_circles(position, turn)
            self._draw_axes(position, turn, (near,))
            for index in np.flatnonzero(in_front == near):
                self._draw_thruster(position, turned[index], command[index])

    def _draw_thruster(self, position: np.ndarray, nozzle: Nozzle, opening: float) -> None:
        """Draw a nozzle of a craft at a position (3,), m; its vectors are in W, and ``opening`` is 0 to 1."""
        radius = self.craft.radius
        mouth = position + nozzle.mouth
        if opening > 0.0:
            side = np.cross(nozzle.exhaust, self._view[2]) * 0.13 * radius
            tip = mouth + opening * 1.1 * radius * nozzle.exhaust
            self._pen.polygon(self._pixels([mouth - side, tip, mouth + side]), fill=_FLAME)
        width = 0.16 * radius * self._scale / _SMOOTHING
        self._line([position + nozzle.root, mouth], _NOZZLE, width)


def _view(dimension: int) -> np.ndarray:
    """Unit vectors of the picture in W, one per row: right, up, and towards the viewer."""
    if dimension == 2:
        return np.eye(3)
    (c, s), (ce, se) = ((math.cos(a), math.sin(a)) for a in (_AZIMUTH, _ELEVATION))
    return np.array([(-s, c, 0.0), (-se * c, -se * s, ce), (ce * c, ce * s, se)])


def rotations(state: Any) -> np.ndarray:
    """Rotation matrices R_WB, (..., 3, 3), of planar or spatial states whose fields have shape (...)."""
    axes = [state.attitude.rotate(type(state.p)(*unit)) for unit in np.eye(len(state.p.columns()))]
    axis_columns = [columns(axis) for axis in axes]
    return np.stack(
        [*axis_columns, np.broadcast_to((0.0, 0.0, 1.0), axis_columns[0].shape)][:3], axis=-1
    )


def columns(vector: Vector) -> np.ndarray:
    """Array (..., 3) of a vector with fields (...); z = 0 in the plane."""
    return np.stack(np.broadcast_arrays(*vector.columns(), 0.0)[:3], axis=-1)


def outlines(shape: Shape, reach: float) -> list[np.ndarray]:
    """Lines that outline a shape, each (K, 3) in W, m; empty for a shape without an extent, such as a speed limit.

    A ball is a circle in the plane and three great circles in space; a cone is its sides and its rim.

    Args:
        shape: shape whose fields are numbers.
        reach: length to which an infinite glide slope is drawn, m.
    """
    if isinstance(shape, Ball):
        centre = columns(shape.centre)
        axes = np.eye(3)[: len(shape.centre.columns())]
        return [centre + _circle(a, b, float(shape.radius)) for a, b in combinations(axes, 2)]
    if isinstance(shape, Cone):
        return _cone_lines(shape.apex, shape.axis, float(shape.half_angle), float(shape.length))
    if isinstance(shape, GlideSlope):
        return _cone_lines(shape.apex, shape.up, math.pi / 2.0 - float(shape.angle), reach)
    return []


def perpendicular(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors at right angles to a unit vector, (3,), and to each other."""
    first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    first = first / np.linalg.norm(first)
    return first, np.cross(axis, first)


def _circle(first: np.ndarray, second: np.ndarray, radius: float) -> np.ndarray:
    angle = _AROUND[:, None]
    return radius * (np.cos(angle) * first + np.sin(angle) * second)


def _cone_lines(apex: Any, axis: Any, half_angle: float, length: float) -> list[np.ndarray]:
    """Sides of a cone (apex in m, unit axis), and between their ends an arc (plane) or a rim (space), (K, 3)."""
    tip = columns(apex)
    along = columns(axis)
    if isinstance(apex, Vec2):
        aside = np.array([-along[1], along[0], 0.0])
        angles = np.linspace(-half_angle, half_angle, 13)[:, None]
        arc = tip + length * (np.cos(angles) * along + np.sin(angles) * aside)
        return [np.concatenate(([tip], arc, [tip]))]
    first, second = perpendicular(along)
    middle = tip + length * math.cos(half_angle) * along
    rim = middle + _circle(first, second, length * math.sin(half_angle))
    step = (len(_AROUND) - 1) // _SIDES
    return [rim, *(np.stack([tip, point]) for point in rim[:-1:step])]
