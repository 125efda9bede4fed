"""Each argument is declared once: a command has those of its Python function, with the same defaults and texts."""

from __future__ import annotations

import ast
import dataclasses
import inspect
from pathlib import Path
from typing import Any

import pytest

import rans
from rans.cli.commands import COMMANDS
from rans.cli.door import Options, argument_texts, command_of
from rans.cli.options import texts_of

DOORS: dict[str, Any] = {
    name: COMMANDS[name] for name in COMMANDS if issubclass(COMMANDS[name], Options)
}
"""Commands made from functions, by name, with those of installed packages."""
OTHERWISE = {
    ("train", "task"): "--resume and the config.json of a run stand in its place",
    ("optimal", "task"): "a terminal asks for it",
    ("optimal", "start"): "Python counts the starts, and the terminal has --episodes",
}
"""Arguments whose default differs, with the reason."""


def function(length: int, *, width: float = 0.5, trust: bool = False) -> float:
    """Multiply.

    Args:
        length: number of rows,
            counted from 1.
        width: whether to be wide: a number.
        trust: see `rans.api.judging.compare`.
    """
    return length * width if trust else 0.0


def test_every_command_with_a_function_is_a_door():
    """The rest has no function: they print what is there, or run a campaign."""
    assert {*COMMANDS} - {*DOORS} == {"dossier", "list"}
    for each in DOORS.values():
        if (public := each.function.__name__) in dir(rans):
            assert getattr(rans, public) is each.function


@pytest.mark.parametrize("name", DOORS)
def test_an_argument_has_one_default_and_one_text(name):
    """The text of help is that of the docstring, which nothing else declares."""
    door = DOORS[name]
    declared = inspect.unwrap(door.function)
    parameters = inspect.signature(declared).parameters
    shared = {field.name: field for field in dataclasses.fields(door) if field.name in parameters}
    told = texts_of(door)
    for option, field in shared.items():
        if (name, option) not in OTHERWISE:
            default = parameters[option].default
            nothing = field.default == () and default is None
            assert nothing or field.default == default or default is inspect.Parameter.empty
        if option != "trust":  # which the lines about every command explain
            text = argument_texts(declared)[option].removeprefix("whether to ")
            assert text[1:60] in told[option], option


def test_annotations_may_be_types_or_texts():
    """As a module without `from __future__ import annotations` has them."""
    names = {}
    source = 'def double(length: int = 3) -> int:\n    """Double.\n\n    Args:\n        length: of it.\n    """'
    exec(compile(source, "own", "exec", dont_inherit=True), names)

    @command_of(names["double"])
    class Double(Options):
        """Double a length."""

    assert {field.name: field.default for field in dataclasses.fields(Double)}["length"] == 3


def test_what_python_declares_cannot_be_declared_again():
    """Neither with another default nor under another text."""
    with pytest.raises(TypeError, match="Twice declares width of its function again"):

        @command_of(function)
        class Twice(Options):
            width: float = 0.5


def test_an_argument_without_a_text_is_refused():
    def silent(length=1):
        """Args:
        width: of another argument.
        """
        return length

    with pytest.raises(TypeError, match="the docstring of silent has no text for length"):

        @command_of(silent)
        class Silent(Options):
            pass


def test_a_command_is_made_of_signature_and_docstring():
    @command_of(function, without=("trust",))
    class Multiply(Options):
        """Multiply in a terminal."""

        loud: bool = False
        """Print it."""

    made = Multiply(3)
    assert (made.length, made.width, made.loud) == (3, 0.5, False)
    assert [field.name for field in dataclasses.fields(Multiply)] == ["length", "width", "loud"]
    assert texts_of(Multiply)["length"] == "Number of rows, counted from 1."
    assert texts_of(Multiply)["width"] == "Be wide: a number."
    assert argument_texts(function)["trust"] == argument_texts(rans.compare)["trust"]
    assert Multiply(3, width=2.0, loud=True).changed("loud", "width") == ["--loud", "--width", "2"]
    assert Multiply(3, width=0.0333333333).changed("width") == ["--width", "0.0333333333"]


@pytest.mark.parametrize("name", DOORS)
def test_a_command_reads_options_that_it_has(name):
    """Type checkers do not see options that a function declares: a misspelt one would fail at run time only."""
    door = DOORS[name]
    (described,) = (
        node
        for node in ast.parse(Path(inspect.getfile(door)).read_text()).body
        if isinstance(node, ast.ClassDef) and node.name == door.__name__
    )
    read = {
        node.attr
        for node in ast.walk(described)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "self"
    }
    assert sorted(word for word in read if not hasattr(door, word)) == sorted(
        field.name
        for field in dataclasses.fields(door)
        if field.default is dataclasses.MISSING and field.name in read
    )
