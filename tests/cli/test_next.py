"""Every command suggests the next one, which this installation can run or says what it lacks."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace

import pytest

from rans import cli
from rans.cli import COMMANDS
from rans.errors import EXTRAS
from rans.terminal import Terminal, lacking


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_a_next_one(name: str) -> None:
    """Whatever its help shows is followed by commands that exist, with options that they have."""
    for example in COMMANDS[name].examples:
        words = shlex.split(example)
        command = cli._parse(words[words.index("rans") + 1 :])
        if name == "list":  # it reads the file
            command = replace(command, name=command.name and "floating-platform")
        following = command.following()
        assert following
        for line in following:
            program, *arguments = shlex.split(line)
            assert program == "rans"
            assert arguments[0] in COMMANDS
            cli._parse(arguments)  # whose refusal or warning would be an error


class Working:
    """A command with a result."""

    def __init__(self, code: int, own: Sequence[str] = ()) -> None:
        self.code = code
        self.own = own

    def run(self) -> int:
        if self.own:
            Terminal().suggest(*self.own)
        return self.code

    def following(self) -> Sequence[str]:
        return ("rans list",)


@pytest.mark.parametrize(
    ("command", "printed"),
    [
        (Working(0), "Next:\n  rans list\n"),
        (Working(0, ["rans evaluate x"]), "Next:\n  rans evaluate x\n"),  # no second list
        (Working(1), ""),
    ],
)
def test_what_comes_next_is_printed_once_and_after_success(
    command: Working, printed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli._followed(command) == command.code
    assert capsys.readouterr().out == printed


def test_for_programs_nothing_follows(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["list", "floating-platform", "--json"]) == 0
    assert "Next" not in capsys.readouterr().out


def test_a_suggestion_says_what_is_not_installed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the core alone two of a training's first suggestions stopped for want of a package."""
    monkeypatch.setattr("rans.terminal.is_installed", lambda module: module not in EXTRAS)
    Terminal().suggest(
        "rans evaluate runs/a",
        "rans compare runs/a",
        "rans report runs/a",
        "rans view runs/a --play",
        "rans view runs/a",
        "rans evaluate runs/a --engine drake",
    )
    lines = capsys.readouterr().out.splitlines()[1:]
    extras = ["", "optimal", "plots", "verify", "", "verify"]
    assert [line.partition("rans[")[2].partition("]")[0] for line in lines] == extras
    monkeypatch.setattr("rans.terminal.is_installed", lambda module: True)
    assert lacking("rans compare runs/a") == ""
