"""An episode as ten rendered frames in one picture, after figure "6dof_episode" of the paper.

Drake's VTK renderer draws them off screen through EGL: it needs neither a display nor a GPU.
"""

# Drake's stubs write NumPy's array types with their two parameters exchanged.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

import ctypes
import math
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from pydrake import geometry
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo, ImageRgba8U

from rans.errors import ConfigError
from rans.evaluation.measure.metrics import DISPLAY
from rans.files import replace_file
from rans.flight import Flight
from rans.show import scene
from rans.show.scene import Motion, Part

_ROWS, _COLUMNS = 2, 5
_WIDTH, _HEIGHT, _SMOOTHING = 480, 420, 2
"""Of one frame, pixels; rendered so many times larger and averaged down, which smooths edges."""
_FIELD_OF_VIEW = math.radians(35.0)
_DIRECTION = {2: (-0.1, -0.75, 0.65), 3: (-0.35, -0.85, 0.4)}
"""Where the camera stands, seen from what it looks at, by dimension."""
_LIGHTS = (("camera", 0.9, [0.4, 0.6, 1.0]), ("camera", 0.45, [-0.8, 0.1, 1.0]),
           ("world", 0.45, [0.0, 0.0, 1.0]))
"""Parallel ones: from above the viewer's shoulder, from his other side, and from below."""


def save_frames(flight: Flight, episode: int, file: Path) -> None:
    """Write the picture: ten instants from the start to shortly after the goal is reached, or the end.

    The camera keeps its direction and comes as near as spacecraft and goal allow; grid lines are 1 m
    apart. Written into every frame are the time and the task's errors. `ConfigError` if the libraries of
    OpenGL are missing, Pillow does not know the format by the file's name, or the disk refused.
    """
    require_egl()
    if file.suffix.lower() not in Image.registered_extensions():
        raise ConfigError(f"cannot tell a picture's format from the name {file.name!r}; use .png.")
    motion = Motion.of(flight, episode)
    picture = Image.new("RGB", (_COLUMNS * _WIDTH, _ROWS * _HEIGHT), "white")
    for index, k in enumerate(_instants(flight, episode, len(motion.poses))):
        frame = Image.fromarray(_render(motion, k)).reduce(_SMOOTHING)
        draw = ImageDraw.Draw(frame)
        draw.rectangle((0, 0, _WIDTH - 1, _HEIGHT - 1), outline="#B8C0CA")
        draw.text((14, 10), _text(flight, episode, k), fill="#1F2933", font=ImageFont.load_default(24))
        row, column = divmod(index, _COLUMNS)
        picture.paste(frame, (column * _WIDTH, row * _HEIGHT))
    replace_file(file, lambda draft: picture.save(draft, optimize=True))


def require_egl() -> None:
    """`ConfigError` if a library is missing that drawing off screen needs: VTK would end the process."""
    if sys.platform != "linux":
        return
    try:
        for name in ("libEGL.so.1", "libOpenGL.so.0"):
            ctypes.CDLL(name)
    except OSError as error:
        raise ConfigError(f"rendering needs OpenGL's libraries ({error}); on Debian and Ubuntu: sudo apt-get "
                          "install -y libegl1 libegl-mesa0 libgl1-mesa-dri libopengl0.") from error


def _instants(flight: Flight, episode: int, count: int) -> np.ndarray:
    """Ten of the first ``count`` instants, evenly spread up to 1 s after the task is solved for good."""
    inside = flight.task.reached(flight.states, flight.goals)[:count, episode]
    outside = np.flatnonzero(~inside)
    solved = outside[-1] + 1 if len(outside) else 0
    end = min(count - 1, solved + round(1.0 / flight.timing.control_period))
    return np.rint(np.linspace(0, max(end, min(count - 1, _ROWS * _COLUMNS)), _ROWS * _COLUMNS)).astype(int)


def _render(motion: Motion, k: int) -> np.ndarray:
    """The scene at one instant, (height, width, 3) uint8."""
    lights = [geometry.LightParameter(type="directional", frame=frame, intensity=intensity, direction=way)
              for frame, intensity, way in _LIGHTS]
    engine = geometry.MakeRenderEngineVtk(geometry.RenderEngineVtkParams(
        default_clear_color=[1.0, 1.0, 1.0], lights=lights))
    for frame, part in _scene(motion, k):
        material = geometry.PerceptionProperties()
        material.AddProperty("phong", "diffuse", part.colour)
        material.AddProperty("label", "id", geometry.RenderLabel.kDontCare)
        engine.RegisterVisual(geometry.GeometryId.get_new_id(), part.shape, material, frame @ part.pose,
                              needs_updates=False)
    engine.UpdateViewpoint(_viewpoint(motion, k))
    width, height = _WIDTH * _SMOOTHING, _HEIGHT * _SMOOTHING
    camera = geometry.ColorRenderCamera(geometry.RenderCameraCore(
        "", CameraInfo(width, height, _FIELD_OF_VIEW), geometry.ClippingRange(0.05, 200.0), RigidTransform()))
    image = ImageRgba8U(width, height)
    engine.RenderColorImage(camera, image)
    return np.array(image.data)[:, :, :3]


def _scene(motion: Motion, k: int) -> Iterator[tuple[RigidTransform, Part]]:
    """Everything at one instant, each part with its frame."""
    craft, pose, world = motion.craft, motion.poses[k], RigidTransform()
    low, high = motion.box()
    yield from ((world, part) for part in scene.floor_parts(low, high))
    x, y, _ = pose.translation()
    yield RigidTransform([x, y, low[2]]), scene.shadow_part(craft)
    yield from ((world, part) for end, part in scene.trail_parts(motion.way) if end <= k)
    yield from ((pose, part) for part in scene.craft_parts(craft, scene.BODIES["grey"]))
    plumes = scene.plume_parts(craft)
    yield from ((pose, plumes[index]) for index in np.flatnonzero(motion.firing[k]))
    yield from ((motion.goal_at(k), part) for part in scene.goal_parts(craft, motion.wanted))
    if "velocity" in motion.wanted:
        for goal, velocity in ((True, motion.goal_velocities[k]), (False, motion.velocities[k])):
            turn, length = scene.velocity_arrow(velocity)
            arrow = RigidTransform(turn, pose.translation())
            yield from ((arrow, part) for part in scene.velocity_parts(goal, length))


def _viewpoint(motion: Motion, k: int) -> RigidTransform:
    """The camera's pose in W: z forwards, x to the right, y downwards."""
    here = motion.poses[k].translation()
    points = np.array([here, motion.goal_at(k).translation()])
    target = points.mean(axis=0)
    arrows = [*motion.velocities, *motion.goal_velocities] if "velocity" in motion.wanted else []
    # What stands out from the spacecraft's centre: axes, plumes and arrows of velocities.
    margin = max([2.9 * motion.craft.radius, *(scene.velocity_arrow(v)[1] for v in arrows)])
    reach = float(np.linalg.norm(points - target, axis=1).max()) + margin
    back = np.array(_DIRECTION[motion.craft.dimension])
    back /= np.linalg.norm(back)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    R_WC = RotationMatrix(np.stack((right, np.cross(right, back), -back), axis=1))
    return RigidTransform(R_WC, target + reach / math.sin(_FIELD_OF_VIEW / 2.0) * back)


def _text(flight: Flight, episode: int, k: int) -> str:
    """Time and errors."""
    return "    ".join([f"{flight.times[k]:.1f} s", *(
        f"{DISPLAY[name][0] * float(error[k, episode]):.1f} {DISPLAY[name][1]}"
        for name, error in flight.errors().items())])
