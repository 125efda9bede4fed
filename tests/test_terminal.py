"""Names of other people's making are shown as they are spelt: no mark-up, no command to the terminal."""

from __future__ import annotations

import pytest
from rich.table import Table

from rans.errors import legible
from rans.terminal import Terminal, progress, verdict


def test_names_are_no_markup_and_no_commands(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table("[/red]column", title="[/bold]title")
    table.add_row("\x1b[31mred[/]")
    table.add_row(verdict(False))
    terminal = Terminal()
    terminal.print(table)
    terminal.print("[/]sentence\x07")
    printed = capsys.readouterr().out
    for text in ("[/red]column", "[/bold]title", r"\x1b[31mred[/]", "FAIL", r"[/]sentence\x07"):
        assert text in printed
    assert "\x1b" not in printed


def test_a_bar_takes_any_name() -> None:
    with progress() as bars:
        bars.add_task("flying [/red]x", total=3)
        bars.console.print(bars.get_renderable())


def test_long_values_are_cut() -> None:
    assert legible("é\tz\n\x1b[0m") == "é\\tz\n\\x1b[0m"
    cut = legible("x" * 10_000_000)
    assert cut == "x" * 2000 + " ... (10,000,000 characters)"
    assert legible("y" * 2000) == "y" * 2000


def test_a_file_has_room(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    assert Terminal(room=110).width == 110
    assert Terminal().width == 40
