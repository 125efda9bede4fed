"""One instant of a flight as a picture: Drake's VTK renderer, off screen, without a display or a GPU."""

# Drake's stubs write NumPy's array types with their two parameters exchanged.

from __future__ import annotations

import ctypes
import math
import sys
from collections.abc import Iterator

import numpy as np
from PIL import Image
from pydrake import geometry
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo, ImageRgba8U
from pydrake.trajectories import PiecewisePose

from rans.errors import ConfigError
from rans.flight import Flight
from rans.show.scene import craft, scene
from rans.show.scene.camera import Camera
from rans.show.scene.craft import Part
from rans.show.scene.scene import SceneMotion

FIELD_OF_VIEW = math.radians(35.0)
DIRECTION = {2: (-0.1, -0.75, 0.65), 3: (-0.35, -0.85, 0.4)}
"""Where the camera stands, seen from what it looks at, by dimension."""
SKY = {2: (0.95, 0.97, 0.99), 3: (0.02, 0.03, 0.07)}
"""Behind everything, by dimension: a laboratory, or space."""
INK = {2: "#1F2933", 3: "#EEF2F6"}
"""Of texts on it."""
_SMOOTHING = 2
"""Rendered so many times larger and averaged down, which smooths edges."""
_LIGHTS = (
    ("camera", 0.9, [0.4, 0.6, 1.0]),
    ("camera", 0.45, [-0.8, 0.1, 1.0]),
    ("world", 0.45, [0.0, 0.0, 1.0]),
)
"""Parallel ones: from above the viewer's shoulder, from his other side, and from below."""


class Renderer:
    """Pictures of one episode, with all that `rans.show.scene.scene` knows of it; a floor or stars are around.

    `ConfigError` if the libraries of OpenGL are missing.
    """

    def __init__(self, motion: SceneMotion, width: int, height: int) -> None:
        require_egl()
        self.motion = motion
        self.width = width
        self.height = height
        low, high = motion.box()
        self._far = 2.0 * scene.STARS * float(np.linalg.norm(high - low))
        self._poses = (
            PiecewisePose.MakeLinear(motion.times, motion.poses) if len(motion.times) > 1 else None
        )
        self._engine = geometry.MakeRenderEngineVtk(
            geometry.RenderEngineVtkParams(
                default_clear_color=SKY[motion.craft.dimension],
                lights=[
                    geometry.LightParameter(
                        type="directional", frame=frame, intensity=intensity, direction=direction
                    )
                    for frame, intensity, direction in _LIGHTS
                ],
            )
        )
        for part in scene.ground_parts(low, high, space=motion.craft.dimension == 3):
            self._register(part.pose, part)
        self._trail = list(scene.trail_parts(motion.path))
        self._shown = 0

    def picture(self, time: float, camera: Camera) -> Image.Image:
        """Everything at a time of the episode, s; times do not go back.

        Parts of the trail are added for good, which is why.
        """
        k = instant(self.motion, time)
        while self._shown < len(self._trail) and self._trail[self._shown][0] <= k:
            part = self._trail[self._shown][1]
            self._register(part.pose, part)
            self._shown += 1
        passing = [self._register(frame @ part.pose, part) for frame, part in self._moving(time, k)]
        R_WC = RotationMatrix(np.stack((camera.axes[0], -camera.axes[1], -camera.axes[2]), axis=1))
        self._engine.UpdateViewpoint(RigidTransform(R_WC, camera.position))
        width = self.width * _SMOOTHING
        height = self.height * _SMOOTHING
        image = ImageRgba8U(width, height)
        self._engine.RenderColorImage(
            geometry.ColorRenderCamera(
                geometry.RenderCameraCore(
                    "",
                    CameraInfo(width, height, FIELD_OF_VIEW),
                    geometry.ClippingRange(1e-4 * self._far, self._far),
                    RigidTransform(),
                )
            ),
            image,
        )
        for passing_part in passing:
            self._engine.RemoveGeometry(passing_part)
        return Image.fromarray(np.array(image.data)[:, :, :3]).reduce(_SMOOTHING)

    def pose(self, time: float) -> RigidTransform:
        """X_WB, straight between instants."""
        if self._poses is None or time >= self.motion.times[-1]:
            return self.motion.poses[-1]
        return self._poses.GetPose(time)

    def _moving(self, time: float, k: int) -> Iterator[tuple[RigidTransform, Part]]:
        """Everything that is elsewhere at another time (s) or instant k, each part with its frame in W."""
        motion = self.motion
        pose = self.pose(time)
        if motion.craft.dimension == 2:
            x, y, _ = pose.translation()
            yield RigidTransform([x, y, motion.box()[0][2]]), scene.shadow_part(motion.craft)
        yield from ((pose, part) for part in craft.craft_parts(motion.craft, scene.BODIES["grey"]))
        for frame, command in zip(craft.plumes(motion.craft), motion.opening[k], strict=True):
            if command > 0.0:
                yield from (
                    (pose @ frame, part) for part in craft.plume_parts(motion.craft, float(command))
                )
        goal = motion.goal_at(k)
        if "position" not in motion.wanted:
            goal = RigidTransform(goal.rotation(), pose.translation())
        yield from ((goal, part) for part in scene.goal_parts(motion.craft, motion.wanted))
        for shape in motion.scenery:
            posed = scene.at_instant(shape, k)
            origin = scene.scenery_pose(posed)
            yield from ((origin, part) for part in scene.scenery_parts(posed, motion.reach))
        if "velocity" in motion.wanted:
            for own, velocity in ((True, motion.goal_velocities[k]), (False, motion.velocities[k])):
                turn, length = scene.velocity_arrow(velocity)
                arrow = RigidTransform(turn, pose.translation())
                yield from ((arrow, part) for part in scene.velocity_parts(own, length))

    def _register(self, pose: RigidTransform, part: Part) -> geometry.GeometryId:
        """Add a part to the scene of the renderer."""
        material = geometry.PerceptionProperties()
        name = geometry.GeometryId.get_new_id()
        material.AddProperty("phong", "diffuse", part.colour)
        material.AddProperty("label", "id", geometry.RenderLabel.kDontCare)
        self._engine.RegisterVisual(name, part.shape, material, pose, needs_updates=False)
        return name


def instant(motion: SceneMotion, time: float) -> int:
    """The last instant that is not after a time, s."""
    return int(np.searchsorted(motion.times, time + 1e-9, side="right")) - 1


def solved_at(flight: Flight, episode: int, count: int) -> int:
    """The instant, of the first ``count``, from which the task stays solved; ``count`` if there is none."""
    inside = flight.task.reached(flight.states, flight.goals)[:count, episode]
    outside = np.flatnonzero(~inside)
    return int(outside[-1]) + 1 if len(outside) else 0


def require_egl() -> None:
    """`ConfigError` if a library is missing that drawing off screen needs: VTK would end the process."""
    if sys.platform != "linux":
        return
    try:
        for name in ("libEGL.so.1", "libOpenGL.so.0"):
            ctypes.CDLL(name)
    except OSError as error:
        raise ConfigError(
            f"rendering needs OpenGL's libraries ({error}); on Debian and Ubuntu: sudo apt-get "
            "install -y libegl1 libegl-mesa0 libgl1-mesa-dri libopengl0."
        ) from error
