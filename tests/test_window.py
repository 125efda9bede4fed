"""The film in the browser, watched by a client of the standard library."""

from __future__ import annotations

import io
import socket
import urllib.error
import urllib.request
from collections.abc import Iterator
from http.client import HTTPResponse
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from rans import ConfigError
from rans.window import PORTS, Served, Window
from tests.support.processes import PATIENCE


@pytest.fixture
def window(monkeypatch) -> Iterator[Window]:
    """One that opens no browser."""
    for display in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(display, raising=False)
    shown = Window(fps=20.0)
    yield shown
    shown.close()


def flat(colour: tuple[int, int, int]) -> np.ndarray:
    return np.full((30, 40, 3), colour, dtype=np.uint8)


def next_frame(film: HTTPResponse) -> np.ndarray:
    """The next picture of the stream."""
    while not (line := film.readline()).startswith(b"Content-Length"):
        assert line, "the film has ended"
    film.readline()
    return np.asarray(Image.open(io.BytesIO(film.read(int(line.split()[1])))))


def test_frames_reach_the_browser(window, capsys):
    with urllib.request.urlopen(window.url, timeout=PATIENCE) as page:
        assert b'<img src="/film"' in page.read()
    window.show(flat((200, 30, 30)))
    with urllib.request.urlopen(f"{window.url}/film", timeout=PATIENCE) as film:
        # Whoever comes late sees the newest frame at once. The format, JPEG, rounds colours.
        for colour in ((200, 30, 30), (30, 200, 30)):
            np.testing.assert_allclose(next_frame(film).mean(axis=(0, 1)), colour, atol=5.0)
            window.show(flat((30, 200, 30)))


def test_frames_are_a_period_apart(window, monkeypatch):
    """Each is a twentieth of a second after the one before; after a late one nobody hurries."""
    now = 100.0

    def sleep(seconds):
        nonlocal now
        now += seconds

    clock = SimpleNamespace(monotonic=lambda: now, sleep=sleep)
    monkeypatch.setattr("rans.window.time", clock)
    shown = []
    for work in (0.0, 0.02, 0.2, 0.0, 0.04):
        now += work
        window.show(flat((0, 0, 0)))
        shown.append(now)
    assert shown == pytest.approx([100.0, 100.05, 100.25, 100.3, 100.35])


@pytest.mark.parametrize(
    ("host", "answered"),
    [("localhost:{}", True), ("127.0.0.1:{}", True), ("evil.example:{}", False), ("", False)],
)
def test_only_this_computer_may_be_asked_for(host, answered, window):
    """The request of a stranger's page has its own name, also where that leads to 127.0.0.1."""
    for url in (Served(lambda: "secret", PORTS).url, window.url):
        asked = urllib.request.Request(url, headers={"Host": host.format(url.rpartition(":")[2])})
        try:
            with urllib.request.urlopen(asked, timeout=PATIENCE) as answer:
                status = answer.status
        except urllib.error.HTTPError as error:
            status = error.code
        assert (status == 200) is answered


def test_a_taken_port_is_a_sentence():
    with socket.create_server(("localhost", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=f"port {port} of this computer, it is taken"):
            Served(lambda: "", [port])
