from __future__ import annotations

import pytest

from campaigns.command import ended
from rans import ConfigError


def mistake() -> int:
    raise ConfigError("starts must be >= 1,\x1b[31m got 0.")


def interrupt() -> int:
    raise KeyboardInterrupt


@pytest.mark.parametrize("code", [0, 1])
def test_a_commands_own_code(code, capsys):
    assert ended("study", lambda: code) == code
    assert capsys.readouterr() == ("", "")


def test_a_users_mistake_is_one_legible_sentence(capsys):
    assert ended("study", mistake) == 2
    said = capsys.readouterr().err
    assert said.startswith("study: starts must be >= 1,")
    assert len(said.splitlines()) == 1
    assert "\x1b" not in said


def test_an_interrupt_shows_no_traceback(capsys):
    assert ended("study", interrupt) == 130
    assert capsys.readouterr().err == ""
