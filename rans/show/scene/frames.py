"""An episode as ten rendered frames in one picture, after figure "6dof_episode" of the paper."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from rans.errors import ConfigError
from rans.files import replace_file
from rans.flight import Flight
from rans.show.scene import scene
from rans.show.scene.camera import Camera
from rans.show.scene.render import DIRECTION, FIELD_OF_VIEW, INK, Renderer, solved_at
from rans.show.scene.scene import SceneMotion

_ROWS = 2
_COLUMNS = 5
_WIDTH = 480
_HEIGHT = 420
"""Of one frame, pixels."""


def save_frames(flight: Flight, episode: int, file: Path) -> None:
    """Write the picture: ten instants from the start to shortly after the goal is reached, or the end.

    The camera keeps its direction and comes as near as spacecraft and goal allow; lines on the floor are 1 m
    apart. Written into every frame are the time and the task's errors. `ConfigError` if the libraries of
    OpenGL are missing, Pillow does not know the format by the file's name, or the disk refused.
    """
    if file.suffix.lower() not in Image.registered_extensions():
        raise ConfigError(f"cannot tell a picture's format from the name {file.name!r}; use .png.")
    motion = SceneMotion.of(flight, episode)
    renderer = Renderer(motion, _WIDTH, _HEIGHT)
    picture = Image.new("RGB", (_COLUMNS * _WIDTH, _ROWS * _HEIGHT), "white")
    for index, k in enumerate(_instants(flight, episode, len(motion.poses))):
        frame = renderer.picture(float(motion.times[k]), _camera(motion, k))
        draw = ImageDraw.Draw(frame)
        draw.rectangle((0, 0, _WIDTH - 1, _HEIGHT - 1), outline="#B8C0CA")
        ink = INK[motion.craft.dimension]
        text = "    ".join([f"{motion.times[k]:.1f} s", *motion.error_texts(k)])
        size = 24
        while ImageFont.load_default(size).getlength(text) > _WIDTH - 28:
            size -= 1
        draw.text((14, 10), text, fill=ink, font=ImageFont.load_default(size))
        row, column = divmod(index, _COLUMNS)
        picture.paste(frame, (column * _WIDTH, row * _HEIGHT))
    replace_file(file, lambda draft: picture.save(draft, optimize=True))


def _instants(flight: Flight, episode: int, count: int) -> np.ndarray:
    """Ten of the first ``count`` instants, evenly spread up to 1 s after the task is solved for good."""
    end = min(
        count - 1, solved_at(flight, episode, count) + round(1.0 / flight.timing.control_period)
    )
    return np.rint(
        np.linspace(0, max(end, min(count - 1, _ROWS * _COLUMNS)), _ROWS * _COLUMNS)
    ).astype(int)


def _camera(motion: SceneMotion, k: int) -> Camera:
    """Camera at instant k, looking at the middle between spacecraft and goal from so far that both are in sight."""
    points = np.array([motion.poses[k].translation(), motion.goal_at(k).translation()])
    target = points.mean(axis=0)
    arrows = [*motion.velocities, *motion.goal_velocities] if "velocity" in motion.wanted else []
    # What stands out from the spacecraft's centre: axes, plumes and arrows of velocities.
    margin = max([2.7 * motion.craft.radius, *(scene.velocity_arrow(v)[1] for v in arrows)])
    reach = float(np.linalg.norm(points - target, axis=1).max()) + margin
    back = np.array(DIRECTION[motion.craft.dimension])
    return Camera(
        target + reach / math.sin(FIELD_OF_VIEW / 2.0) * back / np.linalg.norm(back), target
    )
