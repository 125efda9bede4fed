"""Display of frames in the browser by a local web server, which needs no window toolkit.

Environments show their frames in it, and `rans view` and the API's pages are served by it.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Sequence
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np

from rans.errors import ConfigError
from rans.system import to_stderr

_PAGE = b"""<!doctype html><title>RANS</title>
<body style="margin: 0; display: grid; place-items: center; height: 100vh">
<img src="/film" style="max-width: 100vw; max-height: 100vh">"""
_PART = b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n"


PORTS = range(7000, 7100)
"""Ports of pages, of which the first that is free is taken."""


class Window:
    """Page in the browser that displays frames in real time.

    It needs only a browser. The page of a remote machine can be reached with ``ssh -L``.

    Args:
        fps: largest number of frames per second; `show` waits accordingly.
    """

    def __init__(self, fps: float) -> None:
        self._period = 1.0 / fps
        self._due = 0.0
        self._changed = threading.Condition()
        # Empty before the first frame, None after the last: `next` waits until it is another object.
        self._jpeg: bytes | None = b""
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, self))
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()
        self.url = f"http://localhost:{self._server.server_port}"
        to_stderr(f"The spacecraft flies at {self.url}")
        open_browser(self.url)

    def show(self, frame: np.ndarray) -> None:
        """Display a frame (height, width, 3), uint8, when it is due: it waits until then.

        The next frame is due a period after this one was displayed.
        """
        from PIL import Image  # which pages without frames do not need

        time.sleep(max(0.0, self._due - time.monotonic()))
        self._due = time.monotonic() + self._period
        file = io.BytesIO()
        Image.fromarray(frame).save(file, "jpeg", quality=90)
        self._publish(file.getvalue())

    def close(self) -> None:
        """End the display and the server."""
        self._publish(None)
        self._server.shutdown()
        self._server.server_close()

    def next(self, last: bytes | None) -> bytes | None:
        """Wait for the next frame after ``last`` and return it as JPEG; None: there are no more."""
        with self._changed:
            self._changed.wait_for(lambda: self._jpeg is not last)
            return self._jpeg

    def _publish(self, jpeg: bytes | None) -> None:
        with self._changed:
            self._jpeg = jpeg
            self._changed.notify_all()


class _Quiet(BaseHTTPRequestHandler):
    """Handler of requests that name this computer, as other names may lead to it from a page of a stranger."""

    def parse_request(self) -> bool:
        """Read a request, and refuse one whose host is not this computer."""
        if not super().parse_request():
            return False
        host = (self.headers.get("Host") or "").partition(":")[0]
        if host not in ("localhost", "127.0.0.1"):
            self.send_error(400)
            return False
        return True

    def log_message(self, format: str, *arguments: Any) -> None:
        """Do not log requests."""


class _Handler(_Quiet):
    """Handler of requests: the page, and the frames as a stream of pictures ("multipart/x-mixed-replace")."""

    def __init__(self, window: Window, *arguments: Any) -> None:
        self._window = window
        super().__init__(*arguments)

    def do_GET(self) -> None:
        """Answer a request; the stream of frames lasts until the browser closes it."""
        film = self.path == "/film"
        self.send_response(200)
        self.send_header(
            "Content-Type", "multipart/x-mixed-replace; boundary=frame" if film else "text/html"
        )
        self.end_headers()
        with contextlib.suppress(ConnectionError):  # the page was closed
            if film:
                self._stream()
            else:
                self.wfile.write(_PAGE)

    def _stream(self) -> None:
        jpeg: bytes | None = b""
        while (jpeg := self._window.next(jpeg)) is not None:
            self.wfile.write(_PART % len(jpeg) + jpeg + b"\r\n")


class Served:
    """Local server of a page.

    Args:
        page: returns the HTML of the page.
        ports: ports to try in order.

    Raises:
        ConfigError: all ports are taken, or the system refuses the last one for another reason.
    """

    def __init__(
        self,
        page: Callable[[], str],
        ports: Sequence[int],
    ) -> None:
        self.content = page().encode()
        refusal = OSError(errno.EADDRINUSE, "")
        for port in ports:
            try:
                server = ThreadingHTTPServer(("127.0.0.1", port), partial(_Page, self))
                break
            except OSError as error:
                refusal = error
        else:
            ends = f"{ports[0]} to {ports[-1]}" if len(ports) > 1 else f"{ports[0]}"
            is_taken = refusal.errno == errno.EADDRINUSE
            reason = (
                "it is taken; is another viewer running?" if is_taken else f"{refusal.strerror}."
            )
            raise ConfigError(f"cannot open a page on port {ends} of this computer, {reason}")
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        self.url = f"http://localhost:{server.server_port}"


class _Page(_Quiet):
    def __init__(self, served: Served, *arguments: Any) -> None:
        self._served = served
        super().__init__(*arguments)

    def do_GET(self) -> None:
        """Answer a request with the page."""
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.end_headers()
        with contextlib.suppress(ConnectionError):  # the page was closed
            self.wfile.write(self._served.content)


def open_browser(url: str) -> None:
    """Open a page in the browser if there is a display; a text browser would occupy the terminal."""
    if sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(url)
