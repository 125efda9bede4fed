"""Help of commands: it fits, explains each option, and its examples are commands."""

from typing import get_type_hints

import pytest

from rans import cli
from rans.cli.commands import COMMANDS
from rans.cli.options import is_in_help, texts_of
from tests.support.command_codes import code_of


def test_nothing_typed_shows_the_help(capsys):
    assert code_of([]) == 0
    printed = capsys.readouterr().out
    assert all(f"\n  {command} " in printed for command in COMMANDS)
    titles = [line for line in printed.splitlines() if line.endswith(":")]
    assert len({*titles}) == len(titles) <= 10


@pytest.mark.parametrize("word", cli._MEANT)
def test_words_of_other_programs_lead_to_commands(word, ran):
    said = ran(word, code=2)
    assert f"did you mean {cli._MEANT[word]}?" in said
    assert cli._MEANT[word].split()[0] in COMMANDS


@pytest.mark.parametrize("columns", ["1", "3", "5"])
def test_help_ends_in_a_few_columns(columns, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", columns)
    assert code_of(["evaluate", "--help"]) == 0
    assert "--seed" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_fits_and_keeps_words_whole(command, monkeypatch, capsys):
    columns = 60
    monkeypatch.setenv("COLUMNS", str(columns))
    assert code_of([*command.split(), "--help"]) == 0
    printed = capsys.readouterr().out
    lines = printed.splitlines()
    assert max(len(line) for line in lines if not line.startswith("usage: ")) <= columns
    assert "{None}" not in printed
    about = cli._ABOUT
    if command:
        about = COMMANDS[command].__doc__ or ""
    assert " ".join(about.split()[:12]) in " ".join(printed.split())


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_its_options(command, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "500")  # beside one another, columns would mix
    assert code_of([command, "--help"]) == 0
    printed = " ".join(capsys.readouterr().out.replace("│", " ").replace("`", "").split())
    assert "(default: False)" not in printed
    described = COMMANDS[command]
    assert f"usage: rans {command}" in printed
    hints = get_type_hints(described, include_extras=True)
    for field, explanation in texts_of(described).items():
        if is_in_help(hints[field]):
            assert " ".join(explanation.replace("`", "").split()) in printed
