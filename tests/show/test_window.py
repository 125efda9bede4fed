"""A page in the browser, read by a client of the standard library."""

import socket
import urllib.error
import urllib.request

import pytest

from rans import ConfigError
from rans.show.window import PORTS, Served
from tests.support.processes import PATIENCE


@pytest.mark.parametrize(
    ("host", "answered"),
    [("localhost:{}", True), ("127.0.0.1:{}", True), ("evil.example:{}", False), ("", False)],
)
def test_only_this_computer_may_be_asked_for(host, answered):
    """The request of a stranger's page has its own name, also where that leads to 127.0.0.1."""
    url = Served(lambda: "secret", PORTS).url
    asked = urllib.request.Request(url, headers={"Host": host.format(url.rpartition(":")[2])})
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
    with socket.create_connection(("127.0.0.1", int(url.rpartition(":")[2])), PATIENCE) as idle:
        assert idle.recv(1) == b""  # the server closes it
