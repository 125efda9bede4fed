"""Flights in the browser, in three dimensions: Drake's Meshcat with a recorded animation.

The browser plays the animation by itself, so watching costs the process that made it nothing, and a
page that was saved needs no process and no network at all.
"""

# Drake's stubs write NumPy's array types with their two parameters exchanged.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat, MeshcatAnimation, MeshcatParams, Rgba
from pydrake.math import RigidTransform

from rans.errors import ConfigError
from rans.files import write_text
from rans.flight import Flight
from rans.show import scene
from rans.show.scene import Motion

_FRAMES_PER_SECOND = 1000.0
"""Meshcat counts time in frames: as milliseconds they fit every control period."""

_STAGE: tuple[tuple[str, str, Any], ...] = (
    ("/Grid", "visible", False), ("/Axes", "visible", False),
    ("/Background", "top_color", [0.93, 0.95, 0.98]), ("/Background", "bottom_color", [1.0, 1.0, 1.0]),
    # Lights that fall off with the distance would leave far tiles in the dark.
    *((f"/Lights/{name}", "visible", False)
      for name in ("SpotLight", "PointLightNegativeX", "PointLightPositiveX")),
    ("/Lights/AmbientLight/<object>", "intensity", 1.6), ("/Lights/FillLight/<object>", "intensity", 1.6),
)
"""Properties of Meshcat's own objects."""


class View:
    """A page that shows flights, again and again, with a slider for the time.

    Every episode has a tile of the floor to itself; every flight (one agent) has a row of tiles and a
    colour of `rans.show.scene.BODIES`. Grid lines are 1 m apart. The port is by default the first free
    one from 7000 to 7099; `ConfigError` if it is taken.
    """

    def __init__(self, port: int | None = None) -> None:
        logging.getLogger("drake").setLevel(logging.WARNING)  # it would announce the page as well
        try:
            self._meshcat = Meshcat(MeshcatParams(host="localhost", port=port))
        except RuntimeError as error:
            raise ConfigError(f"cannot open a page on port {port or '7000 to 7099'} of this computer, it is "
                              "taken; is another viewer running?") from error
        self.url = self._meshcat.web_url()
        for path, name, value in _STAGE:
            self._meshcat.SetProperty(path, name, value)

    def show(self, flights: Sequence[Flight]) -> list[str]:
        """Replace what is shown by all episodes of these flights, and return each one's key of `BODIES`."""
        self._meshcat.Delete("/flights")
        self._animation = MeshcatAnimation(_FRAMES_PER_SECOND)
        colours = list(islice(cycle(scene.BODIES), len(flights)))
        rows = [[Motion.of(flight, k) for k in range(flight.commands.shape[1])] for flight in flights]
        boxes = [motion.box() for row in rows for motion in row]
        low, high = np.min(boxes, axis=0)[0], np.max(boxes, axis=0)[1]
        pitch = np.ceil(high - low) * (1.0, -1.0, 0.0)  # the first agent is farthest from the viewer
        for r, (row, colour) in enumerate(zip(rows, colours, strict=True)):
            for k, motion in enumerate(row):
                path = f"/flights/{r} {motion.controller.replace('/', '-')}/episode {k}"
                self._meshcat.SetTransform(path, RigidTransform(pitch * (k, r, 0)))
                self._add(motion, path, scene.BODIES[colour], float(low[2]))
        high = high + pitch * (max(map(len, rows)) - 1, 0, 0)
        low = low + pitch * (0, len(rows) - 1, 0)
        self._put("/flights/floor", scene.floor_parts(low, high))
        self._look_at(low, high, steep=all(flight.craft.dimension == 2 for flight in flights))
        self._meshcat.SetAnimation(self._animation)
        return colours

    def save(self, file: Path) -> None:
        """Write the page with everything it needs: it replays offline; `ConfigError` if the disk refused."""
        write_text(file, self._meshcat.StaticHtml())

    def _put(self, path: str, parts: Sequence[scene.Part]) -> None:
        for part in parts:
            self._meshcat.SetObject(f"{path}/{part.name}", part.shape, part.colour)
            self._meshcat.SetTransform(f"{path}/{part.name}", part.pose)

    def _add(self, motion: Motion, path: str, body: Rgba, floor: float) -> None:
        """One spacecraft with everything that belongs to it."""
        craft, frames = motion.craft, np.rint(motion.times * _FRAMES_PER_SECOND).astype(int)
        self._put(f"{path}/craft", [*scene.craft_parts(craft, body), *scene.plume_parts(craft)])
        self._put(path, [scene.shadow_part(craft)])
        self._put(f"{path}/goal", scene.goal_parts(craft, motion.wanted))
        for k, frame in enumerate(frames):
            x, y, _ = motion.way[k]
            self._animation.SetTransform(frame, f"{path}/craft", motion.poses[k])
            self._animation.SetTransform(frame, f"{path}/shadow", RigidTransform([x, y, floor]))
            self._animation.SetTransform(frame, f"{path}/goal", motion.goal_at(k))
        for index, firing in enumerate(motion.firing.T):
            self._switch(frames, f"{path}/craft/plume {index}", firing)
        for k, part in scene.trail_parts(motion.way):
            self._put(f"{path}/trail", [part])
            self._switch(frames, f"{path}/trail/{part.name}", np.arange(len(frames)) >= k)
        if "velocity" in motion.wanted:
            self._add_arrow(motion, frames, f"{path}/target velocity", motion.goal_velocities, goal=True)
            self._add_arrow(motion, frames, f"{path}/velocity", motion.velocities, goal=False)

    def _add_arrow(self, motion: Motion, frames: np.ndarray, path: str, velocities: np.ndarray,
                   goal: bool) -> None:
        """From the body's centre, as long as a velocity."""
        self._put(path, scene.velocity_parts(goal))
        for frame, place, velocity in zip(frames, motion.way, velocities, strict=True):
            turn, scale = scene.velocity_arrow(velocity)
            self._animation.SetTransform(frame, path, RigidTransform(turn, place))
            self._animation.SetProperty(frame, path, "scale", [scale] * 3)

    def _switch(self, frames: np.ndarray, path: str, on: np.ndarray) -> None:
        """Make a part visible while it is on; only changes are written."""
        for k in (0, *np.flatnonzero(on[1:] != on[:-1]) + 1):
            self._animation.SetProperty(frames[k], path, "visible", bool(on[k]))

    def _look_at(self, low: np.ndarray, high: np.ndarray, steep: bool) -> None:
        """Obliquely from above, at a ball around everything: Meshcat's camera sees 75 degrees upright."""
        direction = np.array([0.2, -0.7, 0.75 if steep else 0.4])
        radius = float(np.linalg.norm(high - low)) / 2.0
        distance = radius / math.sin(math.radians(75.0 / 2.0)) / float(np.linalg.norm(direction))
        target = (low + high) / 2.0
        self._meshcat.SetCameraPose(target + distance * direction, target)
