"""Ten rendered frames in one picture: looked at by colour."""

from __future__ import annotations

import ctypes
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rans.errors import ConfigError
from rans.show.scene import frames, render
from rans.show.scene.frames import save_frames
from rans.show.scene.render import require_egl
from rans.show.scene.scene import SceneMotion
from tests.support.evaluation_flights import flight_of, two_episodes
from tests.support.reference_flights import TRACKING, drifting, lqr_flight

WIDTH = 480
HEIGHT = 420

GREEN = ((0, 170), (120, 235), (80, 220))
"""Ranges of red, green and blue, light and dark sides included."""


@pytest.fixture
def _egl(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip where nothing can be rendered, and say what is missing; rough edges save time."""
    try:
        require_egl()
    except ConfigError as error:
        pytest.skip(str(error))
    monkeypatch.setattr(render, "_SMOOTHING", 1)


def frames_in(file: Path) -> np.ndarray:
    """(10, height, width, 3)."""
    picture = np.asarray(Image.open(file).convert("RGB")).astype(int)
    return picture.reshape(2, HEIGHT, 5, WIDTH, 3).swapaxes(1, 2).reshape(10, HEIGHT, WIDTH, 3)


def share(frame: np.ndarray, colour: tuple[tuple[int, int], ...]) -> float:
    """Of pixels whose colour lies in a range, and is a colour: greys are none."""
    low, high = np.array(colour).T
    inside = ((frame >= low) & (frame <= high)).all(axis=-1)
    return float((inside & (np.ptp(frame, axis=-1) > 25)).mean())


@pytest.mark.slow
@pytest.mark.usefixtures("_egl")
def test_an_episode_from_start_to_goal(tmp_path: Path) -> None:
    flight = lqr_flight(episodes=1)
    save_frames(flight, 0, tmp_path / "episode.png")
    shown = frames_in(tmp_path / "episode.png")
    text = shown[:, 8:40, 8:300].max(axis=(1, 2, 3))
    assert (text > 150).all()  # light letters in every corner
    assert share(shown[0], GREEN) > 0.003  # the ghost, far away
    assert all((first != second).any() for first, second in pairwise(shown))
    # The camera comes nearer: less of the frame is sky.
    sky = (shown < 30).all(axis=-1).mean(axis=(1, 2))
    assert sky[-1] < sky[0] - 0.05


@pytest.mark.parametrize(
    ("episode", "instant", "text"), [(0, 2, ["20.0 cm", "6.0 deg"]), (1, 10, ["6.0 cm", "0.0 deg"])]
)
def test_what_is_written_into_a_frame(episode: int, instant: int, text: list[str]) -> None:
    assert SceneMotion.of(two_episodes(), episode).error_texts(instant) == text


def test_frames_end_a_second_after_the_goal_is_reached_for_good() -> None:
    """There from instant 10 on, of 0.5 s each: up to instant 12. Short flights are shown to their end."""
    distance = np.where(np.arange(41) < 10, 1.0, 0.01)
    distance[3] = 0.01  # passing by is not reaching
    flight = flight_of(np.stack((distance, np.ones(41)), axis=1), 0.0)
    assert frames._instants(flight, 0, 41).tolist() == [0, 1, 3, 4, 5, 7, 8, 9, 11, 12]
    assert frames._instants(flight, 1, 41)[-1] == 40  # never there
    assert frames._instants(flight, 0, 11).tolist() == [0, 1, 2, 3, 4, 6, 7, 8, 9, 10]


def test_missing_libraries_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def missing(name: str) -> None:
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(ctypes, "CDLL", missing)
    monkeypatch.setattr(render.sys, "platform", "linux")
    with pytest.raises(ConfigError, match=r"libEGL.so.1: cannot open .*apt-get install -y libegl1"):
        save_frames(drifting(TRACKING), 0, tmp_path / "no.png")


@pytest.mark.usefixtures("_egl")
def test_an_unknown_format_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"format from the name 'frames.xyz'; use .png"):
        save_frames(drifting(TRACKING), 0, tmp_path / "frames.xyz")
