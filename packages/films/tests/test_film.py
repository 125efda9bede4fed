"""Films: as long as flights, with what happens in them, and never half of one."""

from __future__ import annotations

import io
import sys
from typing import Any

import numpy as np
import pytest
from PIL import Image
from rans_films import film
from rans_films.film import Episode, save_video

from rans import ConfigError
from rans.base.errors import MissingPackage
from rans.base.registry import resolve
from rans.episode.flight import Flight
from tests.support.evaluation_flights import flight_of, two_episodes
from tests.support.reference_flights import TRACKING, drifting

FLAME = (230, 159, 0)


@pytest.fixture
def _small(monkeypatch) -> None:
    """Small and rough films save time."""
    monkeypatch.setattr(film, "_SIZE", {".mp4": (160, 120), ".gif": (160, 120)})
    monkeypatch.setattr(film, "_RATE", {".mp4": 10, ".gif": 5})
    monkeypatch.setattr(film, "_REST", 0.0)


def platform_at_goal() -> Flight:
    """At the goal from the start, 0.5 s a period; nothing opens but the first thruster."""
    return flight_of(np.full((3, 1), 0.01), 0.0)


def flames(picture: Any) -> int:
    """Pixels of the colour of flames; the codec of films shifts colours by up to 40."""
    return int((np.abs(np.asarray(picture.convert("RGB")).astype(int) - FLAME) < 40).all(-1).sum())


@pytest.mark.usefixtures("_small")
def test_a_film_of_two_flights(tmp_path):
    """Coasting 2 s, thruster 11 open from 0.2 to 0.4 s: at 5 frames a second in the second frame alone."""
    told: list[Any] = []

    def stages(name: str, total: int | None) -> Any:
        told.append((name, total))
        return told.append

    save_video([drifting(TRACKING), platform_at_goal()], tmp_path / "two.gif", stages)
    shown: Any = Image.open(io.BytesIO((tmp_path / "two.gif").read_bytes()))
    assert (shown.size, shown.n_frames) == ((320, 120), 11)
    assert told == [("rendering", 11), *[1] * 11]
    left = []
    for k in range(11):
        shown.seek(k)
        left.append(flames(shown.crop((0, 0, 160, 120))))
    assert left[1] > 2 * max(left[:1] + left[2:])


@pytest.mark.usefixtures("_small")
def test_whatever_ends_a_film_leaves_no_half(tmp_path):
    def interrupt(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        save_video([platform_at_goal()], tmp_path / "half.mp4", lambda *_: interrupt)
    assert not list(tmp_path.iterdir())


def test_what_is_there_is_no_film(tmp_path):
    (tmp_path / "there.mp4").write_text("mine")
    with pytest.raises(ConfigError, match=r"there\.mp4 exists already; choose another name"):
        save_video((), tmp_path / "there.mp4", check=True)


@pytest.mark.parametrize("module", ["imageio_ffmpeg", "PIL"])
def test_what_is_missing_is_named(monkeypatch, module):
    monkeypatch.delitem(sys.modules, "rans_films")
    monkeypatch.delitem(sys.modules, "rans_films.film")
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingPackage, match=f"needs the package {module}"):
        resolve("rans_films.film:save_video")


@pytest.mark.parametrize(
    ("episode", "instant", "text"), [(0, 2, ["20.0 cm", "6.0 deg"]), (1, 10, ["6.0 cm", "0.0 deg"])]
)
def test_what_is_written_into_a_frame(episode, instant, text):
    assert Episode(two_episodes(), episode, 64, 48).error_texts(instant) == text
