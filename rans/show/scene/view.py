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

from rans.files import write_text
from rans.flight import Flight
from rans.show.scene import craft, overlay, scene
from rans.show.scene.camera import fitted_camera
from rans.show.scene.scene import SceneMotion
from rans.window import PORTS, Served

_FRAMES_PER_SECOND = 1000.0
"""Meshcat counts time in frames: as milliseconds they fit every control period."""
_ROUNDS = 1000
"""The animation begins again so often."""

UPRIGHT = math.radians(40.0)
ASPECT = 1.6
"""What the camera sees: from the lower to the upper edge; width over height (the page adapts it)."""
DIRECTION = {True: (0.25, -0.75, 0.75), False: (0.25, -0.8, 0.42)}
"""Where it stands, seen from the flights: above where all fly in the plane."""
CAMERA = "/Cameras/default/rotated/<object>"

STAGE: tuple[tuple[str, str, Any], ...] = (
    ("/Grid", "visible", False),
    ("/Axes", "visible", False),
    # Lights that fall off with the distance would leave far tiles in the dark.
    *(
        (f"/Lights/{name}", "visible", False)
        for name in ("SpotLight", "PointLightNegativeX", "PointLightPositiveX")
    ),
    ("/Lights/AmbientLight/<object>", "intensity", 2.2),
    ("/Lights/FillLight/<object>", "intensity", 1.6),
    (CAMERA, "fov", math.degrees(UPRIGHT)),
)
"""Properties of Meshcat's own objects."""
SKY = {
    False: ([0.84, 0.88, 0.93], [0.97, 0.98, 0.99]),
    True: ([0.01, 0.015, 0.04], [0.03, 0.05, 0.10]),
}
"""Background at the top and at the bottom of the picture: in a laboratory and in space."""


class View:
    """A page that shows flights, again and again, with a slider for the time.

    Every episode has a tile of the floor to itself; every flight (one agent) has a row of tiles and a
    colour of `rans.show.scene.scene.BODIES`. Grid lines are 1 m apart. If nobody flies in the plane, there are
    stars instead of a floor. Over it stand a title, the time, each one's errors and what the colours mean.
    """

    def __init__(self) -> None:
        logging.getLogger("drake").setLevel(logging.WARNING)  # it would announce a page of its own
        self._meshcat = Meshcat(MeshcatParams(host="localhost", port=0))
        self._overlay = ""
        for path, name, value in STAGE:
            self._meshcat.SetProperty(path, name, value)

    def show(self, flights: Sequence[Flight], title: str = "") -> list[str]:
        """Replace what is shown by all episodes of these flights, and return each one's key of `BODIES`."""
        self._meshcat.Delete("/flights")
        self._animation = MeshcatAnimation(_FRAMES_PER_SECOND)
        colours = list(islice(cycle(scene.BODIES), len(flights)))
        rows = [
            [SceneMotion.of(flight, k) for k in range(flight.commands.shape[1])]
            for flight in flights
        ]
        boxes = [motion.box() for row in rows for motion in row]
        low = np.min(boxes, axis=0)[0]
        high = np.max(boxes, axis=0)[1]
        pitch = np.ceil(high - low) * (
            1.0,
            -1.0,
            0.0,
        )  # the first agent is farthest from the viewer
        paths = []
        points = []
        for r, (row, colour) in enumerate(zip(rows, colours, strict=True)):
            for k, motion in enumerate(row):
                paths.append(f"/flights/{r} {motion.controller.replace('/', '-')}/episode {k}")
                self._meshcat.SetTransform(paths[-1], RigidTransform(pitch * (k, r, 0)))
                self._add(motion, paths[-1], scene.BODIES[colour], float(low[2]))
                points.append(motion.points() + pitch * (k, r, 0))
        all_points = np.concatenate(points)
        planar = [flight.craft.dimension == 2 for flight in flights]
        self._surround(all_points, space=not any(planar), steep=all(planar))
        self._animation.set_repetitions(_ROUNDS)
        self._meshcat.SetAnimation(self._animation)
        self._overlay = overlay.html(flights, rows, paths, colours, title, ASPECT)
        return colours

    def html(self) -> str:
        """The page with everything it needs: it replays offline."""
        return overlay.laid_over(self._meshcat.StaticHtml(), self._overlay)

    def save(self, file: Path) -> None:
        """Write the page; `ConfigError` if the disk refused."""
        write_text(file, self.html())

    def serve(self, port: int | None = None) -> Served:
        """Show the page to browsers of this computer, and again whenever it has changed.

        By default on the first free port from 7000 to 7099; `ConfigError` if it is taken.
        """
        return Served(self.html, [port] if port else PORTS)

    def _put(self, path: str, parts: Sequence[craft.Part]) -> None:
        for part in parts:
            self._meshcat.SetObject(f"{path}/{part.name}", part.shape, part.colour)
            self._meshcat.SetTransform(f"{path}/{part.name}", part.pose)

    def _add(self, motion: SceneMotion, path: str, body: Rgba, floor: float) -> None:
        """One spacecraft with everything that belongs to it."""
        spacecraft = motion.craft
        frames = np.rint(motion.times * _FRAMES_PER_SECOND).astype(int)
        self._put(f"{path}/craft", craft.craft_parts(spacecraft, body))
        self._put(f"{path}/goal", scene.goal_parts(spacecraft, motion.wanted))
        for k, frame in enumerate(frames):
            self._animation.SetTransform(frame, f"{path}/craft", motion.poses[k])
            self._animation.SetTransform(frame, f"{path}/goal", motion.goal_at(k))
        for number, shape in enumerate(motion.scenery):
            parts = scene.scenery_parts(scene.at_instant(shape, 0), motion.reach)
            self._put(f"{path}/scenery {number}", parts)
            for k, frame in enumerate(frames):
                pose = scene.scenery_pose(scene.at_instant(shape, k))
                self._animation.SetTransform(frame, f"{path}/scenery {number}", pose)
        if spacecraft.dimension == 2:
            self._put(path, [scene.shadow_part(spacecraft)])
            for frame, (x, y, _) in zip(frames, motion.path, strict=True):
                self._animation.SetTransform(frame, f"{path}/shadow", RigidTransform([x, y, floor]))
        for index, frame in enumerate(craft.plumes(spacecraft)):
            self._put(f"{path}/craft/plume {index}", craft.plume_parts(spacecraft))
            self._meshcat.SetTransform(f"{path}/craft/plume {index}", frame)
            self._blow(frames, f"{path}/craft/plume {index}", motion.opening[:, index])
        for k, part in scene.trail_parts(motion.path):
            self._put(f"{path}/trail", [part])
            self._switch(frames, f"{path}/trail/{part.name}", np.arange(len(frames)) >= k)
        if "velocity" in motion.wanted:
            self._add_arrow(
                motion, frames, f"{path}/target velocity", motion.goal_velocities, goal=True
            )
            self._add_arrow(motion, frames, f"{path}/velocity", motion.velocities, goal=False)

    def _add_arrow(
        self, motion: SceneMotion, frames: np.ndarray, path: str, velocities: np.ndarray, goal: bool
    ) -> None:
        """From the body's centre, as long as a velocity."""
        self._put(path, scene.velocity_parts(goal))
        for frame, position, velocity in zip(frames, motion.path, velocities, strict=True):
            turn, scale = scene.velocity_arrow(velocity)
            self._animation.SetTransform(frame, path, RigidTransform(turn, position))
            self._animation.SetProperty(frame, path, "scale", [scale] * 3)

    def _blow(self, frames: np.ndarray, path: str, opening: np.ndarray) -> None:
        """A plume as long as its command, which holds from one instant to the next and never slides."""
        self._switch(frames, path, opening > 0.0)
        if not np.isin(opening, (0.0, 1.0)).all():
            for frame, until, command in zip(frames[:-1], frames[1:], opening[:-1], strict=True):
                for at in (frame, until - 1):
                    self._animation.SetProperty(
                        at, path, "scale", [1.0, 1.0, max(float(command), 1e-3)]
                    )

    def _switch(self, frames: np.ndarray, path: str, on: np.ndarray) -> None:
        """Make a part visible while it is on; only changes are written."""
        for k in (0, *np.flatnonzero(on[1:] != on[:-1]) + 1):
            self._animation.SetProperty(frames[k], path, "visible", bool(on[k]))

    def _surround(self, points: np.ndarray, space: bool, steep: bool) -> None:
        """Floor or stars, and the camera where all points are in sight."""
        low = points.min(axis=0)
        high = points.max(axis=0)
        self._put("/flights/ground", scene.ground_parts(low, high, space))
        for end, colour in zip(("top", "bottom"), SKY[space], strict=True):
            self._meshcat.SetProperty("/Background", f"{end}_color", colour)
        size = float(np.linalg.norm(high - low))
        self._meshcat.SetProperty(CAMERA, "near", 2e-3 * size)
        self._meshcat.SetProperty(CAMERA, "far", 3.0 * scene.STARS * size)
        camera, target = fitted_camera(points, DIRECTION[steep], UPRIGHT, ASPECT)
        self._meshcat.SetCameraPose(camera, target)
