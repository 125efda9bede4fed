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
from collections.abc import Callable, Iterable, Iterator, Sequence
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
        # Empty before the first frame, None after the last: `_stream` waits until it is another object.
        self._jpeg: bytes | None = b""
        self._server, self.url = _serve(self._answer, 0)
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

    def _answer(self, path: str) -> tuple[str, Iterable[bytes]]:
        """The page, or the frames as a stream of pictures, which lasts until the browser closes it."""
        if path == "/film":
            return "multipart/x-mixed-replace; boundary=frame", self._stream()
        return "text/html", [_PAGE]

    def _stream(self) -> Iterator[bytes]:
        last: bytes | None = b""
        while True:
            with self._changed:
                self._changed.wait_for(lambda seen=last: self._jpeg is not seen)
                last = self._jpeg
            if last is None:
                return
            yield _PART % len(last) + last + b"\r\n"

    def _publish(self, jpeg: bytes | None) -> None:
        with self._changed:
            self._jpeg = jpeg
            self._changed.notify_all()


_Answer = Callable[[str], tuple[str, Iterable[bytes]]]
"""Function of a request's path that returns the type of the content and its parts."""


class _Handler(BaseHTTPRequestHandler):
    """Handler of requests that name this computer, as other names may lead to it from a page of a stranger."""

    def __init__(self, answer: _Answer, *arguments: Any) -> None:
        self._answer = answer
        super().__init__(*arguments)

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

    def do_GET(self) -> None:
        """Answer a request."""
        kind, parts = self._answer(self.path)
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.end_headers()
        with contextlib.suppress(ConnectionError):  # the page was closed
            for part in parts:
                self.wfile.write(part)


def _serve(answer: _Answer, port: int) -> tuple[ThreadingHTTPServer, str]:
    """A server in a thread of its own, and its address; port 0: any that is free."""
    server = ThreadingHTTPServer(("127.0.0.1", port), partial(_Handler, answer))
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    return server, f"http://localhost:{server.server_port}"


class Served:
    """Local server of a page.

    Args:
        page: returns the HTML of the page.
        ports: ports to try in order.

    Raises:
        ConfigError: all ports are taken, or the system refuses the last one for another reason.
    """

    def __init__(self, page: Callable[[], str], ports: Sequence[int]) -> None:
        self.content = page().encode()
        refusal = OSError(errno.EADDRINUSE, "")
        for port in ports:
            try:
                _, self.url = _serve(lambda _: ("text/html; charset=utf-8", [self.content]), port)
                return
            except OSError as error:
                refusal = error
        ends = f"{ports[0]} to {ports[-1]}" if len(ports) > 1 else f"{ports[0]}"
        is_taken = refusal.errno == errno.EADDRINUSE
        reason = "it is taken; is another viewer running?" if is_taken else f"{refusal.strerror}."
        raise ConfigError(f"cannot open a page on port {ends} of this computer, {reason}")


def open_browser(url: str) -> None:
    """Open a page in the browser if there is a display; a text browser would occupy the terminal."""
    if sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(url)
