"""A page in the browser by a local web server, as `rans view` and the API's pages are served."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import sys
import threading
import webbrowser
from collections.abc import Callable, Sequence
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from rans.base.errors import ConfigError

PORTS = range(7000, 7100)
"""Ports of pages, of which the first that is free is taken."""


class _Handler(BaseHTTPRequestHandler):
    """Handler of requests that name this computer, as other names may lead to it from a page of a stranger."""

    timeout = 10.0
    """s after which a connection that asks nothing is closed, with its thread."""

    def __init__(self, page: bytes, path: str, *arguments: Any) -> None:
        self._page = page
        self._path = path
        super().__init__(*arguments)

    def parse_request(self) -> bool:
        """Read a request, and refuse one whose host is not this computer, or whose path is not the page's."""
        if not super().parse_request():
            return False
        host = (self.headers.get("Host") or "").partition(":")[0]
        if host not in ("localhost", "127.0.0.1") or self.path != self._path:
            self.send_error(400)
            return False
        return True

    def log_message(self, format: str, *arguments: Any) -> None:
        """Do not log requests."""

    def do_GET(self) -> None:
        """Answer a request."""
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.end_headers()
        with contextlib.suppress(ConnectionError):  # the page was closed
            self.wfile.write(self._page)


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
        # Other users of this computer cannot guess it.
        path = f"/{secrets.token_urlsafe(8)}"
        for port in ports:
            try:
                handler = partial(_Handler, self.content, path)
                server = ThreadingHTTPServer(("127.0.0.1", port), handler)
            except OSError as error:
                refusal = error
                continue
            threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
            self.url = f"http://localhost:{server.server_port}{path}"
            return
        ends = f"{ports[0]} to {ports[-1]}" if len(ports) > 1 else f"{ports[0]}"
        is_taken = refusal.errno == errno.EADDRINUSE
        reason = "it is taken; is another viewer running?" if is_taken else f"{refusal.strerror}."
        raise ConfigError(f"cannot open a page on port {ends} of this computer, {reason}")


def open_browser(url: str) -> None:
    """Open a page in the browser if there is a display; a text browser would occupy the terminal."""
    if sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(url)
