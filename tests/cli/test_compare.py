"""``rans compare`` at the command line."""

import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import pytest

from rans.api.judging import starts_of
from rans.cli import _parse, main, next_of
from rans.cli.compare import Compare, without_training
from rans.cli.evaluate import Evaluate
from rans.evaluation.compare.bounds import Bound
from rans.evaluation.compare.entrants import at_values, contest_of, enlisted
from rans.evaluation.compare.run import Relaxed
from rans.evaluation.fly.contestant_name import ContestantName
from rans.model.spacecraft_file import load_spacecraft, to_toml

IDLE = "python:tests.support.policies:idle"


@pytest.mark.usefixtures("undrawn")
def test_writes_page_and_numbers(tmp_path, capsys, monkeypatch):
    options = f"--with lqr --episodes 3 --certified 0 --output {tmp_path}"
    command = f"compare lqr:go-to-pose-2d {IDLE} {options}".split()
    monkeypatch.setattr("sys.argv", ["rans", *command])
    assert main(command) == 0
    read = json.loads((tmp_path / "compare.json").read_text())
    assert [row["solved"] for row in read["summary"]] == [3, 0]
    page = (tmp_path / "compare.html").read_text()
    assert "<h1>Comparison: 3 starts of seed 2023, floating-platform" in page
    assert "<dt>command</dt><dd>rans compare lqr:go-to-pose-2d " in page
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines()[1:8])) <= 80  # a row a contestant
    assert re.search(r"│ LQR +│ +100 │ +[0-9.]+ │ +[0-9.]+ │", printed)
    assert "  rans view lqr:go-to-pose-2d\n" in printed  # not beside itself
    # The chart of time and impulse for a paper.
    assert "compare.svg, compare.pdf" in printed
    assert {"compare.svg", "compare.pdf"} <= {file.name for file in tmp_path.iterdir()}


@pytest.mark.usefixtures("undrawn")
def test_interrupted_while_it_certifies_it_prints_what_is_finished(tmp_path, monkeypatch, ran):
    def solve(contest, objective, *_):
        return [Relaxed("time", 0, "solved", True, 0.1, 4.0, 3.25, 7.5)]

    def one_bound(*_):
        assert json.loads((tmp_path / "compare.json").read_text())["is_partial"]  # were it killed
        yield Bound(0, None, 2.75)
        raise KeyboardInterrupt

    monkeypatch.setattr("rans_optimal.relaxed.solve", solve)
    monkeypatch.setattr("rans_bounds.transfers.certified_bounds", one_bound)
    command = f"compare lqr:go-to-pose-2d --with optimal --episodes 1 --full --output {tmp_path}"
    out = ran(command, code=130)
    for part in ("minimum time", "1 of 1", "3.25", "7.5"):
        assert part in out
    read = json.loads((tmp_path / "compare.json").read_text())
    assert read["is_partial"]  # no evidence of a dossier
    (bound,) = read["per_start"]["certified"]
    assert bound["hull"] == 2.75


def test_interrupted_before_anybody_has_flown_it_leaves_what_is_there(tmp_path, monkeypatch, ran):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    for name in ("compare.html", "compare.json"):
        (tmp_path / name).write_text("an earlier one")
    monkeypatch.setattr("rans.evaluation.compare.run.Comparison.fly", interrupted)
    said = ran(f"compare lqr:go-to-pose-2d --output {tmp_path}", code=130)
    assert {file.read_text() for file in tmp_path.iterdir()} == {"an earlier one"}
    assert "before the first contestant had flown: there is no comparison." in said


def test_every_option_reaches_the_comparison(tmp_path, monkeypatch):
    def fill(comparison, flying, names, **given):
        contest = comparison.contest
        facts = contest.episodes, contest.seed, contest.engine
        told.append((facts, tuple(flying), names, given["certified"], given["cache"]))
        asked.append((given["returns"], len(comparison.multiples)))

    told = []
    asked = []
    monkeypatch.setattr("rans.evaluation.compare.run.Comparison.fly", fill)
    options = "--with mpc optimal --episodes 5 --seed 11 --engine drake --certified 2"
    command = f"compare lqr:go-to-pose-2d {IDLE} {options} --output {tmp_path}"
    assert main(command.split()) == 0
    assert told == [
        (
            (5, 11, "drake"),
            ("lqr:go-to-pose-2d", IDLE),
            [],
            2,
            tmp_path / "compare-bounds.json",
        ),
        # The slow ones fly after the quick ones have answered.
        ((5, 11, "drake"), (), ["mpc", "optimal"], 2, tmp_path / "compare-bounds.json"),
    ]
    # What takes longest is asked for by --full, and the curve of impulses by --certified too.
    command = f"compare lqr:go-to-pose-2d --with optimal --output {tmp_path}"
    assert main([*command.split(), "--full"]) == 0
    assert main(command.split()) == 0
    assert asked[1:6:2] == [(False, 6), (True, 6), (False, 1)]


@pytest.mark.slow
def test_an_interrupt_of_the_page_leaves_the_data(monkeypatch, tmp_path, ran):
    """The page is drawn last: scores are printed and written before."""

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("rans.show.pages.comparison_page.page", interrupted)
    options = f"--with switching --episodes 2 --output {tmp_path}"
    said = ran(f"compare switching:go-to-pose-2d {options}", code=130)
    assert "solved, %" in said
    assert (tmp_path / "compare.json").is_file()
    assert not (tmp_path / "compare.html").exists()


@pytest.mark.parametrize(
    ("options", "starts"),
    [
        ({}, (16, 1)),
        ({"full": True}, (128, 4)),
        ({"certified": 0}, (16, 0)),
        ({"certified": 256}, (256, 256)),
        ({"full": True, "episodes": 8}, (8, 4)),
    ],
)
def test_a_comparison_is_small_unless_it_is_asked_to_be_full(options, starts):
    command = Compare(("runs/a",), **options)
    assert starts_of(command.episodes, command.certified, command.full) == starts


def test_the_agent_for_any_craft_is_offered_where_it_can_fly(tmp_path):
    def line(*contestants):
        names = [*map(ContestantName.parse, contestants)]
        return without_training(names, contest_of(names[0], 1))

    own = tmp_path / "mine.toml"
    diagonal = ((2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 2.0))
    heavy = replace(load_spacecraft("floating-platform"), mass=14.2, inertia=diagonal)
    own.write_text(to_toml(heavy))
    first = f"lqr:go-to-pose-2d@{own}"
    assert line(first) == f"any-craft-2d@{own}"
    # Quick to turn: by itself it flies this one at 10 Hz, beside a trained agent at 5.
    assert line("go-to-pose-2d") == "any-craft-2d@floating-platform"
    assert line(first, f"any-craft-2d@{own}") == ""  # it flies
    assert line(str(own)) == ""
    assert line("lqr:track-velocity-2d") == ""  # another task


def test_the_file_of_a_craft_alone_is_the_agent_for_any_craft_from_fast_to_frugal(tmp_path):
    own = tmp_path / "mine.toml"
    own.write_text(to_toml(load_spacecraft("floating-platform")))
    names = at_values(ContestantName.parse(str(own)))
    values = ("0.4", "0", "0.3", "0.5", "1")
    assert [*map(str, names)] == [f"any-craft-2d#{value}@{own}" for value in values]
    for text in (f"{own}#0.3", "go-to-pose-2d"):
        assert [*map(str, at_values(ContestantName.parse(text)))] == [text]
    first = names[0]
    assert isinstance(first, ContestantName)
    contest = contest_of(first, 1)
    found = enlisted(names, contest).values()
    assert [one.name for one in found] == [f"any-craft-2d#{value}" for value in values]
    # It is given the masses and thrusters of the file, as LQR is.
    assert {one.knows for one in found} == {"state, exact model"}


def test_next_commands_have_the_options_of_the_comparison():
    """As far as they have them: a page has no bounds, and a stress test no seed."""
    options = {"seed": 3, "engine": "drake", "episodes": 7, "certified": 0}
    command = Compare(("runs/a", "lqr"), beside=("mpc",), output=Path("o"), **options)
    assert [*command.following()] == [
        "rans compare runs/a lqr --with mpc --episodes 7 --certified 0 --seed 3 --engine drake --output o --full",
        "rans view runs/a --seed 3 --engine drake",
        "rans stress runs/a",
    ]
    for name in ("evaluate", "compare", "view"):
        asked = _parse([name, "avoid-2d", "--guard", "--conditions", "lab", "--trust"])
        for line in next_of(asked):
            assert {"--guard", "lab", "--trust"} <= {*line.split()}
            _parse(shlex.split(line)[1:])
    full = Evaluate(ContestantName.parse("lqr:go-to-pose-2d"), full=True)
    assert [*full.following()] == [
        "rans compare lqr:go-to-pose-2d",
        "rans view lqr:go-to-pose-2d",
    ]
