"""Films: as long as flights, beside each other, and never half of one."""

from __future__ import annotations

import importlib.util
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from rans.errors import ConfigError
from rans.flight import Flight
from rans.show.scene import render, video
from rans.show.scene.render import require_egl
from rans.show.scene.scene import SceneMotion
from rans.show.scene.video import check_video, save_video
from rans.tasks import GoToPosition
from tests.support.evaluation_flights import flight_of
from tests.support.reference_flights import TRACKING, drifting


@pytest.fixture
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip where nothing can be rendered, and say what is missing; small and rough films save time."""
    try:
        require_egl()
    except ConfigError as error:
        pytest.skip(str(error))
    monkeypatch.setattr(render, "_SMOOTHING", 1)
    monkeypatch.setattr(video, "_SIZE", {".mp4": (160, 120), ".gif": (160, 120)})
    monkeypatch.setattr(video, "_RATE", {".mp4": 10, ".gif": 5})
    monkeypatch.setattr(video, "_REST", 0.0)


def platform_at_goal() -> Flight:
    """At the goal from the start, 0.5 s a period; nothing opens but the first thruster."""
    return flight_of(np.full((3, 1), 0.01), 0.0)


@pytest.mark.slow
@pytest.mark.usefixtures("_small")
def test_a_film_of_two_flights(tmp_path: Path) -> None:
    """Coasting 2 s, thruster 11 open from 0.2 to 0.4 s: at 5 frames a second in the second frame alone."""
    told: list[Any] = []

    def stages(name: str, total: int | None) -> Any:
        told.append((name, total))
        return told.append

    flights = [drifting(TRACKING), platform_at_goal()]
    save_video(flights, tmp_path / "two.gif", stages)
    film = Image.open(io.BytesIO((tmp_path / "two.gif").read_bytes()))
    assert (film.size, film.n_frames) == ((320, 120), 11)  # type: ignore[attr-defined]
    assert told == [("rendering", 11), *[1] * 11]
    orange = []
    bright = []
    for k in range(11):
        film.seek(k)
        frame = np.asarray(film.convert("RGB")).astype(int)
        red, green, blue = np.moveaxis(frame[18:, :160], -1, 0)
        flame = (red > 90) & (2 * blue < red) & (green > 0.35 * red) & (green < 0.75 * red)
        orange.append(int(flame.sum()))
        bright.append([frame[18:, :160].mean(), frame[18:, 160:].mean()])
    assert orange[1] > 2 * max(orange[:1] + orange[2:])  # what else is orange is an axis
    space, laboratory = np.transpose(bright)
    assert space.max() < 60.0 < 150.0 < laboratory.min()


@pytest.mark.usefixtures("_small")
def test_whatever_ends_a_film_leaves_no_half(tmp_path: Path) -> None:
    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        save_video([platform_at_goal()], tmp_path / "half.mp4", lambda *_: interrupt)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("film.avi", r"must end in \.mp4 or \.gif, got .*film\.avi"),
        ("film", "must end in"),
        ("there.mp4", "there.mp4 exists already; choose another name"),
    ],
)
def test_what_cannot_become_a_film_is_a_sentence(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / "there.mp4").write_text("mine")
    with pytest.raises(ConfigError, match=said):
        check_video(tmp_path / name)


def test_a_missing_encoder_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"pip install .*\[video\]"):
        check_video(tmp_path / "film.mp4")


@pytest.mark.usefixtures("_small")
def test_between_instants_a_craft_flies_straight() -> None:
    """At 0.5 m/s along x; it ends where its episode does."""
    motion = SceneMotion.of(drifting(GoToPosition(fail_distance=100.0)), 0)
    renderer = render.Renderer(motion, 16, 16)
    for time, x in ((0.0, 0.0), (0.5, 0.25), (1.23, 0.615), (9.0, 1.0)):
        assert renderer.pose(time).translation() == pytest.approx([x, 0.0, 0.0], abs=1e-12)
    assert [render.instant(motion, time) for time in (0.0, 0.19, 0.2, 0.6, 9.0)] == [0, 0, 1, 3, 10]
