"""Flights as a film, side by side, rendered off screen (see `rans.show.scene.render`) and encoded by FFmpeg."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from rans.errors import ConfigError, MissingPackage, is_installed
from rans.files import replace_file
from rans.flight import Flight
from rans.progress import Stages, unseen_stages
from rans.show.scene.camera import fitted_camera
from rans.show.scene.render import (
    DIRECTION,
    FIELD_OF_VIEW,
    INK,
    SKY,
    Renderer,
    instant,
    require_egl,
    solved_at,
)
from rans.show.scene.scene import SceneMotion

SUFFIXES = (".mp4", ".gif")
_RATE = {".mp4": 25, ".gif": 12}
"""Frames a second."""
_SIZE = {".mp4": (640, 480), ".gif": (432, 324)}
"""Of one flight, pixels; even, as the codec wants."""
_HEAD = 0.15
"""Part of the height for what stands above the picture."""
_ENCODER = {
    ".mp4": {
        "codec": "libx264",
        "pix_fmt_out": "yuv420p",
        "output_params": ["-movflags", "+faststart"],
    },
    # Colours of its own, of what moves; the dither is one that compresses.
    ".gif": {
        "codec": "gif",
        "pix_fmt_out": "pal8",
        "output_params": [
            "-filter_complex",
            "split[a][b];[a]palettegen=max_colors=128:stats_mode=full[p];"
            "[b][p]paletteuse=dither=bayer:bayer_scale=4:diff_mode=rectangle",
            "-loop",
            "0",
        ],
    },
}
_REST = 2.0
"""The film goes on so long after the last has solved its task, s."""


def check_video(file: Path) -> None:
    """Refuse, before anything flies, what cannot become a film.

    Raises:
        ConfigError: another ending than `SUFFIXES`, a folder or device in its place, no FFmpeg or no OpenGL.
    """
    if file.suffix.lower() not in SUFFIXES:
        raise ConfigError(
            f"--video writes a film, whose name must end in .mp4 or .gif, got {str(file)!r}."
        )
    if file.exists():
        raise ConfigError(f"{file} exists already; choose another name for the film.")
    if not is_installed("imageio_ffmpeg"):
        raise MissingPackage("imageio_ffmpeg")
    require_egl()


def save_video(flights: Sequence[Flight], file: Path, stages: Stages = unseen_stages) -> None:
    """Write a film: a column for each flight, a row for each episode, each with a camera of its own.

    In each stand who flies, the time and the task's errors. Progress is reported frame by frame.
    `ConfigError` if FFmpeg fails or the disk refused; whatever ends it, no half film is left.
    """
    ending = file.suffix.lower()
    panels = [
        [_Panel(flight, k, ending) for flight in flights if k < flight.commands.shape[1]]
        for k in range(max(flight.commands.shape[1] for flight in flights))
    ]
    duration = max(panel.end for row in panels for panel in row)
    times = np.arange(0.0, duration + 1e-9, 1.0 / _RATE[ending])
    width, height = _SIZE[ending]
    size = (len(flights) * width, len(panels) * height)

    def frames() -> Iterator[Image.Image]:
        """Frames of all panels at each time (s), side by side; reports progress."""
        progress = stages("rendering", len(times))
        for time in times:
            picture = Image.new("RGB", size, "white")
            for row, some in enumerate(panels):
                for column, panel in enumerate(some):
                    picture.paste(panel.draw(float(time)), (column * width, row * height))
            yield picture
            progress(1)

    replace_file(file, lambda draft: _encode(draft, size, ending, frames()))


class _Panel:
    """One episode: its renderer and a camera that sees all of it."""

    def __init__(self, flight: Flight, episode: int, ending: str) -> None:
        width, height = _SIZE[ending]
        self.motion = SceneMotion.of(flight, episode)
        dimension = self.motion.craft.dimension
        count = len(self.motion.times)
        below = height - round(_HEAD * height)
        self._renderer = Renderer(self.motion, width, below)
        self._camera = fitted_camera(
            self.motion.points(), DIRECTION[dimension], FIELD_OF_VIEW, width / below
        )
        self._ground = Image.new(
            "RGB", (width, height), tuple(round(255.0 * x) for x in SKY[dimension])
        )
        self._colour = INK[dimension]
        self._size = height // 20
        self.end = (
            float(self.motion.times[min(count - 1, solved_at(flight, episode, count))]) + _REST
        )

    def draw(self, time: float) -> Image.Image:
        """Picture of a time (s): what has ended stays as it was, so that films of several lengths fit."""
        motion = self.motion
        k = instant(self.motion, time)
        frame = self._ground.copy()
        picture = self._renderer.picture(time, self._camera)
        frame.paste(picture, (0, frame.height - picture.height))
        draw = ImageDraw.Draw(frame)
        font = ImageFont.load_default(self._size)
        line = 1.35 * self._size
        draw.text((0.7 * line, 0.4 * line), motion.controller, fill=self._colour, font=font)
        clock = f"{min(time, float(motion.times[-1])):.1f} s"
        draw.text(
            (frame.width - 0.7 * line, 0.4 * line), clock, fill=self._colour, font=font, anchor="ra"
        )
        draw.text(
            (0.7 * line, 1.4 * line),
            "   ".join(motion.error_texts(k)),
            fill=self._colour,
            font=font,
        )
        return frame


def _encode(file: Path, size: tuple[int, int], ending: str, frames: Iterator[Image.Image]) -> None:
    """Write frames as a film by ffmpeg; whoever calls removes a half one."""
    import imageio_ffmpeg

    logging.getLogger("imageio_ffmpeg").setLevel(logging.ERROR)
    writer = imageio_ffmpeg.write_frames(
        str(file),
        size,
        fps=_RATE[ending],
        macro_block_size=1,
        ffmpeg_log_level="error",
        **_ENCODER[ending],
    )
    with contextlib.closing(writer):  # also after Ctrl-C: FFmpeg ends, and the draft is removed
        writer.send(None)
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
