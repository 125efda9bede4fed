"""A page in the browser, read by a client of the standard library."""

import socket
import urllib.error
import urllib.request
from urllib.parse import urlsplit

import pytest

from rans import ConfigError
from rans.show.window import PORTS, Served
from tests.support.processes import PATIENCE


@pytest.mark.parametrize(
    ("host", "path", "answered"),
    [
        ("localhost:{}", "", True),
        ("127.0.0.1:{}", "", True),
        ("evil.example:{}", "", False),
        ("", "", False),
        ("localhost:{}", "/", False),
    ],
)
def test_who_knows_the_address_on_this_computer_is_answered(host, path, answered):
    """The request of a stranger's page has its own name, also where that leads to 127.0.0.1."""
    url = urlsplit(Served(lambda: "secret", PORTS).url)
    asked = urllib.request.Request(
        f"http://{url.netloc}{path or url.path}", headers={"Host": host.format(url.port)}
    )
    try:
        with urllib.request.urlopen(asked, timeout=PATIENCE) as answer:
            text = answer.read()
    except urllib.error.HTTPError as error:
        text = error.read()
    assert (text == b"secret") is answered


def test_a_taken_port_is_a_sentence():
    with socket.create_server(("localhost", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=f"port {port} of this computer, it is taken"):
            Served(lambda: "", [port])


def test_who_asks_nothing_does_not_keep_a_thread(monkeypatch):
    monkeypatch.setattr("rans.show.window._Handler.timeout", 0.05)
    url = Served(lambda: "", PORTS).url
    with socket.create_connection(("127.0.0.1", urlsplit(url).port), PATIENCE) as idle:
        assert idle.recv(1) == b""  # the server closes it
