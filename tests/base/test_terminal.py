"""Names of other people's making are shown as they are spelt: no mark-up, no command to the terminal."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import pytest

from rans.base.errors import legible
from rans.base.table import Table
from rans.base.terminal import Terminal, doing, progress, stages


def test_names_are_no_markup_and_no_commands(capsys):
    named = Table(("[/red]column", ""), [("\x1b[31mred[/]", ""), (False, "")], "[/bold]title")
    terminal = Terminal()
    terminal.table(named)
    terminal.print("[/]sentence\x07 of :rocket:")
    printed = capsys.readouterr().out
    for text in (
        ":rocket:",
        "[/red]column",
        "[/bold]title",
        r"\x1b[31mred[/]",
        "FAIL",
        r"[/]sentence\x07",
    ):
        assert text in printed
    assert "\x1b" not in printed


def test_a_bar_takes_any_name():
    with progress() as bars:
        bars.add_task("flying [/red]x", total=3)
        bars.console.print(bars.get_renderable())


def test_long_values_are_cut():
    assert legible("é\tz\n\x1b[0m") == "é\\tz\n\\x1b[0m"
    cut = legible("x" * 10_000_000)
    assert cut == "x" * 2000 + " ... (10,000,000 characters)"
    assert legible("y" * 2000) == "y" * 2000


def test_a_file_has_room(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    assert Terminal(room=110).width == 110
    assert Terminal().width == 40
    monkeypatch.setenv("COLUMNS", "0")  # of a serial line
    Terminal().table(Table(("",), [("a name of more than twenty letters",)]))
    assert "twenty letters" in capsys.readouterr().out


WIDE = ("score", "go-to-pose-2d-robust", "mpc", "python:my_policy:act")
ROWS = [
    ("settled, %", "100 (97 to 100)", "99", None),
    ("impulse of the whole episode, N s", "27.8", "2", "3"),
]


@pytest.mark.parametrize("columns", [60, 100])
def test_every_cell_of_a_table_is_there_once_and_whole(columns, capsys, monkeypatch):
    """In 60 columns, which are too few, a row is a block of lines."""
    monkeypatch.setenv("COLUMNS", str(columns))
    Terminal().table(Table(WIDE, ROWS, "Title"))
    text = capsys.readouterr().out
    assert text.startswith("Title")
    for cell in ("settled, %", "100 (97 to 100)", "99", "27.8"):
        assert text.count(cell) == 1
    assert text.count("go-to-pose-2d-robust") == (1 if columns == 100 else 2)
    assert max(map(len, text.splitlines())) <= columns


def test_no_word_is_broken(capsys, monkeypatch):
    """Cells break between words; a row without room for its longest words becomes a block of lines."""
    rows = [("engine", "floating-platform, 1,024 environments", "1,460", "steps/s")]
    for columns in (60, 40, 24):
        monkeypatch.setenv("COLUMNS", str(columns))
        Terminal().table(Table(("", "measurement", "value", "unit"), rows))
        text = capsys.readouterr().out
        assert max(len(line.rstrip()) for line in text.splitlines()) <= columns
        words = text.replace("│", " ").replace("┃", " ").split()
        for word in ("floating-platform,", "environments", "1,460", "steps/s"):
            assert word in words, (columns, text)


def test_a_command_is_one_line_to_copy(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setenv("FORCE_COLOR", "1")
    long = "rans view pretrained:go-to-pose-2d --episode 7 --seed 2023"
    Terminal().suggest(long)
    assert f"  {long}\n" in capsys.readouterr().out


def test_a_sentence_breaks_between_words_on_a_terminal_only(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "20")
    Terminal().say("words that are many in a line")
    assert capsys.readouterr().out == "words that are many in a line\n"
    monkeypatch.setenv("FORCE_COLOR", "1")  # what Rich takes for a terminal
    Terminal().say("words that are many in a line")
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert lines == ["words that are many", "in a line"]


class Clock:
    """Stands in for clock and timers of `rans.base.terminal`: time passes when a test says so."""

    def __init__(self) -> None:
        self.now = 0.0
        self.timers: list[Timer] = []

    def passes(self, seconds: float) -> None:
        """Timers whose time is over by then call one after the other."""
        end = self.now + seconds
        while due := [timer for timer in self.timers if timer.at <= end]:
            first = min(due, key=lambda timer: timer.at)
            self.timers.remove(first)
            self.now = first.at
            first.call()
        self.now = end


class Timer:
    """As `threading.Timer`, on such a clock."""

    def __init__(self, clock: Clock, seconds: float, call: Callable[[], object]) -> None:
        self.clock = clock
        self.seconds = seconds
        self.call = call

    def start(self) -> None:
        self.at = self.clock.now + self.seconds
        self.clock.timers.append(self)

    def cancel(self) -> None:
        if self in self.clock.timers:
            self.clock.timers.remove(self)


@pytest.fixture
def clock(monkeypatch) -> Clock:
    made = Clock()
    monkeypatch.setattr("rans.base.terminal.time", SimpleNamespace(monotonic=lambda: made.now))
    timer = SimpleNamespace(Timer=lambda *given: Timer(made, *given))
    monkeypatch.setattr("rans.base.terminal.threading", timer)
    return made


@pytest.mark.parametrize(("units", "said"), [(None, ""), (0, "certified bounds ...\n"), (1, "")])
def test_a_stage_names_itself_in_a_log_before_its_first_unit(units, said, clock, capsys):
    """Not where a unit was done in time, nor where the stage has ended without one (None)."""
    steps = [stages(progress())("certified bounds", 4)]
    if units:
        steps[0](units)
    if units is None:
        steps.clear()
    clock.passes(30.0)
    assert capsys.readouterr().err == said


def test_only_what_takes_long_is_a_line(clock, capsys):
    for seconds, said in ((5.0, ""), (15.0, "writing ...\n")):
        with doing("writing"):
            clock.passes(seconds)
        clock.passes(15.0)
        assert capsys.readouterr().err == said
    with doing("writing", in_log=False):
        clock.passes(15.0)
    assert capsys.readouterr().err == ""


def test_units_of_minutes_tell_the_time_left_from_the_first_on(monkeypatch, capsys):
    """By hand: three of four bounds take 100 s each; before the first nothing is known."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    now = 0.0
    with progress() as bars:
        bars.get_time = lambda: now
        step = stages(bars)("certified bounds", 4)
        texts = []
        for _ in range(4):
            capsys.readouterr()
            bars.refresh()
            texts.append(capsys.readouterr().err)
            now += 100.0
            step(1)
    for text, left in zip(texts, (None, "0:05:00", "0:03:20", "0:01:40"), strict=True):
        assert (f"{left} left" in text) is (left is not None)
