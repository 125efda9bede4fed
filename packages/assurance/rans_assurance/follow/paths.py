"""Paths to fly along, and the planner that turns a path into velocity commands.

Positions are (d,) in W, m.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rans.errors import meant
from rans.extend import ConfigError, brief

SPACING = 0.005
"""Largest distance along a path between neighbouring points, m: a fiftieth of the paper's look-ahead. A
corner that falls between two points is cut by less than a millimetre or two."""
_USUAL_RADIUS = 0.25
"""Look-ahead distance of the paper, m."""
_DRAWN = 3600
"""Points of a curve per turn before they are spaced (original system)."""


@dataclass(frozen=True)
class Path:
    """A path in the plane or in space, open or closed, as equally spaced points."""

    name: str
    points: np.ndarray
    """(P, 2) or (P, 3) in W, m. A closed path does not repeat its first point."""
    closed: bool

    @classmethod
    def through(cls, name: str, points: np.ndarray, closed: bool) -> Path:
        """Path of straight lines between points (n, 2) or (n, 3), m."""
        corners = np.concatenate((points, points[:1])) if closed else points
        along = np.append(0.0, np.linalg.norm(np.diff(corners, axis=0), axis=1).cumsum())
        count = math.ceil(along[-1] / SPACING - 1e-9)  # 12 m are 2400 gaps in spite of rounding
        stations = np.linspace(0.0, along[-1], count + 1)
        spaced = np.stack([np.interp(stations, along, column) for column in corners.T], axis=1)
        return cls(name, spaced[:-1] if closed else spaced, closed)

    @property
    def dimension(self) -> int:
        """Dimension of its points: 2 or 3."""
        return self.points.shape[1]

    @property
    def length(self) -> float:
        """Length, m; of a closed path that of one lap."""
        return float(
            np.linalg.norm(np.diff(self.at(np.arange(self.last + 1)), axis=0), axis=1).sum()
        )

    @property
    def extent(self) -> float:
        """Largest distance of a point from the centre of all points, m; of a circle its radius."""
        return float(np.linalg.norm(self.points - self.points.mean(axis=0), axis=1).max())

    @property
    def last(self) -> int:
        """Index of the last point; of a closed path that of point 0 after one lap."""
        return len(self.points) if self.closed else len(self.points) - 1

    def at(self, index: np.ndarray) -> np.ndarray:
        """Points (..., d) at any indices, which go round a closed path and stop at the ends of an open one."""
        return self.points[
            index % len(self.points) if self.closed else np.clip(index, 0, self.last)
        ]

    def in_space(self) -> Path:
        """The path in space: a planar one with z = 0, one in space as it is."""
        return replace(self, points=np.pad(self.points, ((0, 0), (0, 3 - self.dimension))))

    def cross_track(self, position: np.ndarray, progress: np.ndarray, reach: float) -> np.ndarray:
        """Distance (N,) m of positions (N, d) from the part of the path near each flight's progress.

        The progress (N,) is an index of points; the reach is the length of that part before and beyond it, m.
        """
        count = math.ceil(reach / SPACING)
        around = self.at(progress[:, None] + np.arange(-count, count + 1))
        start = around[:, :-1]
        segments = np.diff(around, axis=1)
        squared = np.maximum(
            (segments * segments).sum(axis=2), np.finfo(float).tiny
        )  # Beyond an open end the length is 0.
        fraction = (((position[:, None] - start) * segments).sum(axis=2) / squared).clip(0.0, 1.0)
        nearest = start + fraction[:, :, None] * segments
        return np.linalg.norm(position[:, None] - nearest, axis=2).min(axis=1)


def circle(radius: float = 1.5) -> Path:
    """A circle about the origin, counter-clockwise from (radius, 0) (original system)."""
    return Path.through("circle", _around(1.0, radius, radius)[:-1], closed=True)


def square(side: float = 3.0) -> Path:
    """A square about the origin, counter-clockwise from its lower left corner (original system)."""
    corners = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    return Path.through("square", 0.5 * side * corners, closed=True)


def spiral(inner: float = 0.5, outer: float = 2.0, turns: float = 5.0) -> Path:
    """An Archimedean spiral outwards about the origin, counter-clockwise (original system)."""
    return Path.through("spiral", _around(turns, inner, outer), closed=False)


def lemniscate(size: float = 1.5) -> Path:
    """Bernoulli's lemniscate, from its right end at (size, 0) (original system's "infinite").

    x = a cos t / (1 + sin^2 t), y = a sin t cos t / (1 + sin^2 t).
    """
    cos, sin = _around(1.0, 1.0, 1.0)[:-1].T
    points = size / (1.0 + sin**2) * np.stack((cos, sin * cos))
    return Path.through("lemniscate", points.T, closed=True)


def helix(radius: float = 1.5, pitch: float = 0.5, turns: float = 3.0) -> Path:
    """A helix about the z axis, centred at the origin, upwards from (radius, 0, -pitch * turns / 2)."""
    around = _around(turns, radius, radius)
    z = pitch * turns * np.linspace(-0.5, 0.5, len(around))
    return Path.through("helix", np.column_stack((around, z)), closed=False)


def _around(turns: float, inner: float, outer: float) -> np.ndarray:
    """Points (n, 2) counter-clockwise about the origin from (inner, 0) to the radius ``outer``, m."""
    angle = np.linspace(0.0, math.tau * turns, math.ceil(_DRAWN * turns) + 1)
    return np.linspace(inner, outer, len(angle))[:, None] * np.stack(
        (np.cos(angle), np.sin(angle)), axis=1
    )


PATHS: dict[str, Callable[[], Path]] = {
    make.__name__: make for make in (circle, spiral, square, lemniscate, helix)
}
"""Functions that make the paths, by the names of the command line."""


def find_path(name: str) -> Path:
    """The path of a name.

    Raises:
        ConfigError: there is no such path.
    """
    if name in PATHS:
        return PATHS[name]()
    raise ConfigError(
        f"there is no path named {brief(name)}{meant(name, PATHS)}; known are {', '.join(PATHS)}."
    )


@dataclass(frozen=True)
class LookAhead:
    """The paper's planner (section 4.2): fly towards the farthest point of the path within a radius.

    The paper takes the farthest point within 25 cm of the spacecraft, or the closest one if none is.
    On a path that crosses itself, closes, or runs beside itself, the farthest point could be one of an earlier or
    of a much later part. So the planner keeps each flight's progress along the path. The progress moves on to the
    closest point within a window beyond it and never goes back; the target is the point farthest along the path
    within the radius and a window beyond the progress. The original system keeps a list of points, of which it
    removes those that were passed and searches the first 60.

    Raises:
        ConfigError: the speed is not a finite number > 0, or the radius not one from 0.01 m to the path's extent.
    """

    path: Path
    speed: float = 0.25
    """Length of the velocity command, m/s (paper: 0.25)."""
    radius: float = _USUAL_RADIUS
    """Look-ahead distance, m (paper: 0.25)."""

    def __post_init__(self) -> None:
        if not 0 < self.speed < math.inf:
            raise ConfigError(f"the speed must be a finite number > 0 m/s, got {self.speed}.")
        if not 2 * SPACING <= self.radius < math.inf:
            raise ConfigError(
                f"the look-ahead must be a finite number >= {2 * SPACING} m, which is two "
                f"gaps between a path's points, got {self.radius}."
            )
        if self.radius > (largest := max(_USUAL_RADIUS, self.path.extent)):
            raise ConfigError(
                f"the look-ahead must be at most {largest:.3g} m, the distance of the farthest point of the path "
                f"{self.path.name} from its centre, got {self.radius:g}: the craft would cut across it."
            )

    @property
    def window(self) -> int:
        """Number of points beyond the progress that are searched.

        One and a half radii of path, as it takes 1.41 of them to leave the radius around a right-angled
        corner; never more than half of the path.
        """
        return min(math.ceil(1.5 * self.radius / SPACING), max(1, self.path.last // 2))

    @property
    def approach(self) -> int:
        """Number of points that are passed before errors count: four radii of path, at most half of it.

        A perfect follower's distance from a straight path falls to 1/e over one radius, so that 2 % of
        the start's are left.
        """
        return min(math.ceil(4.0 * self.radius / SPACING), self.path.last // 2)

    @property
    def end(self) -> int:
        """Progress at the end of a flight: the end of an open path, or the approach and a lap of a closed one."""
        return self.path.last + (self.approach if self.path.closed else 0)

    def plan(self, position: np.ndarray, progress: np.ndarray) -> tuple[np.ndarray, ...]:
        """Plan a period: the new progress (N,), the target's index (N,), and the velocity command (N, d), m/s.

        The position is (N, d), m. The progress is an index of points, which goes on over the laps of a closed path.
        The velocity is zero at the end.
        """
        ahead, distance = self._look(position, progress)
        closest = ahead[np.arange(len(ahead)), distance.argmin(axis=1)]
        ahead, distance = self._look(position, closest)
        farthest = np.where(distance <= self.radius, ahead, -1).max(axis=1)
        target = np.where(farthest >= 0, farthest, closest)
        heading = self.path.at(target) - position
        length = np.maximum(
            np.linalg.norm(heading, axis=1), 1e-9
        )  # A target at the position itself has no direction.
        target_speed = np.where(closest < self.end, self.speed, 0.0)
        return closest, target, heading * (target_speed / length)[:, None]

    def _look(self, position: np.ndarray, progress: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the window beyond the progress, and their distances from the position, m."""
        ahead = progress[:, None] + np.arange(self.window + 1)
        ahead = ahead if self.path.closed else np.minimum(ahead, self.path.last)
        return ahead, np.linalg.norm(self.path.at(ahead) - position[:, None], axis=2)
