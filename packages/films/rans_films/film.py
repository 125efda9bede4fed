"""Flights as a film, side by side, drawn by `rans.episode.drawing.Scene`."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator, Sequence
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from rans.episode.drawing import Scene
from rans.extend import (
    QUANTITIES,
    ConfigError,
    Flight,
    Stages,
    map_leaves,
    replace_file,
    unseen_stages,
)

_RATE = {".mp4": 25, ".gif": 12}
"""Frames a second."""
_SIZE = {".mp4": (640, 480), ".gif": (432, 324)}
"""Width and height of one flight in a film, pixels; even, as the codec wants."""
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
_HEAD = 0.15
"""Part of the height for what stands above a frame."""
_INK = "#1F2933"
_BORDER = "#B8C0CA"


def save_video(
    flights: Sequence[Flight], file: Path, stages: Stages = unseen_stages, check: bool = False
) -> None:
    """Write a film: a column for each flight, a row for each episode, each in a view that has all of it.

    In each stand who flies, the time and the task's errors. Progress is reported frame by frame. Whatever ends it,
    no half film is left.

    Args:
        flights: what is filmed.
        file: its name ends in .mp4 or .gif.
        stages: reports progress.
        check: whether to refuse only what could not be written.

    Raises:
        ConfigError: something is in the file's place, FFmpeg fails, or the disk refused.
    """
    if file.exists():
        raise ConfigError(f"{file} exists already; choose another name for the film.")
    if check:
        return
    ending = file.suffix.lower()
    width, height = _SIZE[ending]
    episodes = max(flight.commands.shape[1] for flight in flights)
    panels = [
        (column, row, Episode(flight, row, width, height))
        for row in range(episodes)
        for column, flight in enumerate(flights)
        if row < flight.commands.shape[1]
    ]
    duration = max(float(panel.times[panel.solved]) for *_, panel in panels) + _REST
    times = np.arange(0.0, duration + 1e-9, 1.0 / _RATE[ending])
    size = (len(flights) * width, episodes * height)

    def frames() -> Iterator[Image.Image]:
        """Frames of all panels at each time (s), side by side; reports progress."""
        progress = stages("rendering", len(times))
        for time in times:
            picture = Image.new("RGB", size, "white")
            for column, row, panel in panels:
                shown = panel.picture(panel.instant(float(time)), panel.flight.controller)
                picture.paste(shown, (column * width, row * height))
            yield picture
            progress(1)

    replace_file(file, lambda draft: _encode(draft, size, ending, frames()))


class Episode:
    """Frames of one episode of a flight, by its index in the batch, up to its end or its failure."""

    def __init__(self, flight: Flight, episode: int, width: int, height: int) -> None:
        self.flight = flight
        instants = np.zeros(len(flight.times))
        self._states = map_leaves(lambda x: x[:, episode], flight.states)
        self._goals = map_leaves(lambda x: x[..., episode] + instants, flight.goals)
        # It ends where the task fails, the mission succeeds, or a constraint is violated that ends it.
        failed = np.asarray(flight.task.failed(self._states, self._goals))
        end = int(failed.argmax()) + 1 if failed.any() else len(failed)
        if flight.lengths is not None:
            end = min(end, int(flight.lengths[episode]) + 1)
        if flight.task.violation_ends and flight.violated_when()[:, episode].any():
            end = min(end, int(flight.violated_when()[:, episode].argmax()) + 2)
        self.times = flight.times[:end]
        self._openings = np.zeros((end, flight.craft.thruster_count))
        self._openings[:-1] = flight.openings[: end - 1, episode]
        errors = flight.errors()
        self._errors = {name: errors[name][:end, episode] for name in flight.task.tolerances()}
        inside = flight.task.reached(flight.states, flight.goals)[:end, episode]
        outside = np.flatnonzero(~inside)
        self.solved = min(int(outside[-1]) + 1 if len(outside) else 0, end - 1)
        """The instant from which the task stays solved; the last one if there is none."""
        place = self._states.p.columns()
        self._path = np.stack(np.broadcast_arrays(*place, 0.0)[:3], axis=-1)[:end]
        self._size = width, height
        self._scene = Scene(flight.craft, flight.task, width, height - round(_HEAD * height))

    def instant(self, time: float) -> int:
        """The last instant that is not after a time, s."""
        return int(np.searchsorted(self.times, time + 1e-9, side="right")) - 1

    def error_texts(self, k: int) -> list[str]:
        """Errors at an instant, each with its unit."""
        return [
            f"{QUANTITIES[name].display[0] * float(error[k]):.1f} {QUANTITIES[name].display[1]}"
            for name, error in self._errors.items()
        ]

    def picture(self, k: int, name: str = "") -> Image.Image:
        """The frame of an instant: what has ended stays as it was."""
        state, goal = (
            map_leaves(lambda x: float(x[k]), tree) for tree in (self._states, self._goals)
        )
        drawn = self._scene.render(state, goal, self._openings[k], self._path[: k + 1], self._path)
        frame = Image.new("RGB", self._size, "white")
        frame.paste(Image.fromarray(drawn), (0, frame.height - len(drawn)))
        draw = ImageDraw.Draw(frame)
        draw.rectangle((0, 0, frame.width - 1, frame.height - 1), outline=_BORDER)
        text = "   ".join([f"{self.times[k]:.1f} s", *self.error_texts(k)])
        for line, words in enumerate(filter(None, (name, text))):
            size = frame.height // 20
            while ImageFont.load_default(size).getlength(words) > 0.94 * frame.width:
                size -= 1
            draw.text(
                (0.03 * frame.width, (0.02 + 0.065 * line) * frame.height),
                words,
                fill=_INK,
                font=ImageFont.load_default(size),
            )
        return frame


def _encode(file: Path, size: tuple[int, int], ending: str, frames: Iterator[Image.Image]) -> None:
    """Write frames as a film by ffmpeg; whoever calls removes a half one."""
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
