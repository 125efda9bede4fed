"""The browser Chromium without a window, and pages of strangers' texts."""

from __future__ import annotations

import shutil
import subprocess
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from html.parser import HTMLParser
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from tests.support.processes import PATIENCE

HOSTILE = (
    "\\'\"></title></style></script><script>hostile()</script>"
    "<img src=hostile onerror=\"new Image().src='/ran?'+document.title\"><!--<script>\u2028`${hostile()}`"
)
"""Ends strings, attributes and elements, and then runs; it tells a server at /ran that it has run."""
HOSTILE_NAME = "'\"></title></script><img src=hostile onerror=\"new Image().src='/ran?'+document.title\"><!--$x^$"
"""The same in what may be the name of a spacecraft."""
_RUNS = "<img src=hostile onerror=\"new Image().src='/ran?control'\">"


def chromium(*arguments: str, profile: Path) -> str:
    """What Chromium prints for these arguments; a test is skipped where there is no such browser."""
    names = ("chromium", "google-chrome", "chromium-browser")
    browser = next(filter(None, map(shutil.which, names)), None)
    if browser is None:
        pytest.skip("needs the browser Chromium: sudo apt-get install -y chromium")
    done = subprocess.run(
        [
            browser,
            "--headless",
            "--no-sandbox",
            "--disable-background-networking",
            "--disable-component-update",
            f"--user-data-dir={profile}",
            *arguments,
        ],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=True,
    )
    return done.stdout


class _Live(HTMLParser):
    """Elements and attributes of a page that its text, and not RANS, has made."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.live: list[str] = []
        self._in_script = False
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._in_script = tag == "script"
        if any(name.startswith("on") or value == "hostile" for name, value in attrs):
            self.live.append(self.get_starttag_text() or tag)

    def handle_endtag(self, tag: str) -> None:
        self._in_script = False

    def handle_data(self, data: str) -> None:
        if self._in_script and (data.startswith("hostile") or "<script" in data or "<!--" in data):
            self.live.append(f"script: {data[:60]}")


def live(html: str) -> list[str]:
    """Elements, attributes and scripts of a page that a text of `HOSTILE` has made: none is right."""
    return _Live(html).live


@contextmanager
def served(pages: Mapping[str, str]) -> Iterator[tuple[str, list[str]]]:
    """Serve pages by their paths; gives the address, and what they ask for at /ran? while they are served."""
    reports: list[str] = []

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            path, _, rest = self.path.partition("?")
            if path == "/ran":
                reports.append(rest)
            page = pages.get(path)
            self.send_response(404 if page is None else 200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.end_headers()
            self.wfile.write((page or "").encode())

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Answer) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}", reports
        server.shutdown()


def ran(pages: Mapping[str, str], profile: Path) -> list[str]:
    """Titles of pages in whose browser a text of `HOSTILE` has run; "control" is a page in which it does."""
    texts = {f"/{number}": text for number, text in enumerate([_RUNS, *pages.values()])}
    texts["/"] = "".join(f'<iframe src="{path}"></iframe>' for path in texts)
    with served(texts) as (address, reports):
        opened(f"{address}/", profile)
    return reports


def opened(address: str, profile: Path) -> str:
    """The page at an address after its scripts have run."""
    return chromium("--virtual-time-budget=5000", "--dump-dom", address, profile=profile)
