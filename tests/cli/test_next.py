"""Every command suggests the next one."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace

import pytest
from rans_any_craft.networks import authority

from rans import TASKS, ConfigError, cli
from rans.base.terminal import Terminal
from rans.cli import COMMANDS
from rans.cli.compare import Compare
from rans.cli.list import List
from rans.cli.next_commands import with_spacecraft
from rans.cli.train import Train
from rans.evaluation.fly.contestants import contestant
from rans.model.spacecraft_file import SPACECRAFT, load_spacecraft
from validation.commands.validate import Validate


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_a_next_one(name):
    """Whatever its help shows is followed by commands that exist, with options that they have."""
    for example in COMMANDS[name].examples:
        words = shlex.split(example)
        command = cli._parse(words[words.index("rans") + 1 :])
        if name == "list":  # it reads the file, as the next one
            command = replace(command, name=command.name and "floating-platform")
        if name == "validate":
            command = replace(command, spacecraft="floating-platform")
        following = cli.next_of(command)
        assert following
        for line in following:
            program, *arguments = shlex.split(line)
            assert program == "rans"
            assert arguments[0] in COMMANDS
            cli._parse(arguments)  # whose refusal or warning would be an error


@pytest.mark.parametrize(
    ("name", "task"),
    [
        ("floating-platform", "go-to-pose"),
        # All of its thrusters push through its centre of mass.
        ("afrl-deputy", "go-to-position"),
        # It has wheels alone.
        ("innocube", "go-to-attitude"),
        # Its engines cannot be shut.
        ("mars-lander-steered", None),
    ],
)
def test_a_spacecraft_can_do_what_comes_next(name, task):
    lines = {*List(name).following(), *Validate(name).following()}
    if task is None:
        assert lines == {"rans list TASKS"}
        return
    for line in lines:
        command = cli._parse(shlex.split(line)[1:])
        if isinstance(command, Train):
            assert (command.task, command.spacecraft) == (task, name)
            continue
        if isinstance(command, Compare):
            continue
        run = contestant(command.agent)  # whose refusal would be an error
        assert run.craft.name == name
        assert isinstance(run.task, TASKS[task])


def test_the_agent_for_any_craft_is_suggested_for_craft_that_it_flies():
    """What is asked without its network is what the network refuses or takes."""
    for name in SPACECRAFT.built_in:
        craft = load_spacecraft(name)
        try:
            authority(craft, 0.2)
        except ConfigError:
            flies = False
        else:
            flies = True
        suggested = any("any-craft" in line for line in with_spacecraft(craft, name))
        assert suggested == flies, name


def test_the_names_of_files_are_quoted():
    craft = load_spacecraft("innocube")
    assert shlex.split(with_spacecraft(craft, "my craft.toml")[-1])[-1] == "my craft.toml"


def test_what_follows_trusts_what_the_command_trusted():
    """Without --trust it would be refused."""
    own = "my_module:Mine:go-to-pose-2d"
    view = cli._parse(["view", own, "--trust"])
    assert [shlex.split(line) for line in cli.next_of(view)] == [
        ["rans", "compare", own, "--trust"]
    ]


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
def test_what_comes_next_is_printed_once_and_after_success(command, printed, capsys):
    assert cli._followed(command) == command.code
    assert capsys.readouterr().out == printed
