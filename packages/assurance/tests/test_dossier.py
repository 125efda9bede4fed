"""Dossiers: rows come from results of this very agent, and what is false in one is found."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import pytest
from rans_assurance import dossier
from rans_assurance.dossier import SOURCES, UNPROVED, Dossier

from rans.base.pretrained import pretrained_folder
from rans.base.registry import allow_current_folder
from rans.cli import _parse, main
from rans.evaluation.fly import evidence
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.evidence import question_hashes
from rans.show.pages.page import Fact, Page, Part, Section
from tests.support.damage import check

AGENT = "mine"
ASSURE = f"assure {AGENT} --episodes 200"


@pytest.fixture(scope="module")
def assured(tmp_path_factory) -> Path:
    """A run folder with an agent and a bound on its failures."""
    folder = tmp_path_factory.mktemp("assured")
    shutil.copytree(pretrained_folder("go-to-pose-2d"), folder / AGENT)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("sys.argv", ["rans", *ASSURE.split()])
        assert main([*ASSURE.split()]) == 0
    return folder / AGENT


@pytest.fixture
def folder(assured, tmp_path, monkeypatch) -> Path:
    """A copy in the current folder, which a test may spoil."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(assured, AGENT)
    return Path(AGENT)


def test_a_row_has_its_evidence_or_the_command_that_makes_it(folder, capsys):
    assert main(["dossier", AGENT]) == 0
    printed = capsys.readouterr().out
    read = json.loads((folder / "dossier.json").read_text("utf-8"))
    rows = read["rows"]
    bound = json.loads((folder / "assurance.json").read_text("utf-8"))["bounds"]["any"]
    (failed,) = [row for row in rows if row["what"].startswith("flights that failed")]
    assert failed["value"] == f"{bound['failures']} of 200"
    assert failed["command"] == f"rans {ASSURE}"
    assert re.fullmatch(r"20\d\d-\d\d-\d\d \d\d:\d\d\+00:00", failed["date"])
    # The other questions stand empty, without a verdict, in every part that has none.
    empty = [row for row in rows if not row["value"]]
    asked = {what for source in SOURCES for _, what in source.questions}
    assert {row["what"] for row in empty} < asked | {UNPROVED.what}
    assert len(empty) >= 7
    commands = [row["command"].format(**read["names"]) for row in empty]
    assert all(command in printed for command in commands)
    assert all(row["passed"] is None for row in empty)
    page = (folder / "dossier.html").read_text("utf-8")
    places = [page.index(f">{section.title}</h2>") for section in Dossier(AGENT).parts()]
    assert places == sorted(places)
    assert len(places) == len(get_args(Part))


def test_every_command_of_a_dossier_can_be_typed(folder):
    for row in Dossier(str(folder)).rows:
        if not row.command:
            continue
        first, *words = shlex.split(Dossier(str(folder)).command(row))
        assert first == "rans"
        _parse(words)  # exits where there is no such option


def changed(file: Path, old: str, new: str) -> None:
    """Put a text in the place of another one, which is there."""
    text = file.read_text("utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), "utf-8")


PLANTED = {
    "value": ("dossier.json", "0 of 200", "9 of 200"),
    "verdict": ("dossier.json", '"passed": null', '"passed": true'),
    "evidence": ("assurance.json", '"failures": 0', '"failures": 7'),
    "page": ("dossier.html", "0 of 200", "0 of 2,000"),
    "task": ("dossier.json", '"task and timing": "', '"task and timing": "0'),
}


@pytest.mark.parametrize("planted", [*PLANTED, "agent"])
def test_what_is_false_is_found_in_files_and_page(planted, folder, capsys):
    """What was changed by hand after the dossier was written, or another agent in its place."""
    assert main(["dossier", AGENT]) == 0
    assert [*Dossier(AGENT).falsehoods()] == []
    if planted == "agent":
        other = pretrained_folder("go-to-pose-2d-robust") / "agent.safetensors"
        shutil.copy(other, folder / "agent.safetensors")
    else:
        name, *change = PLANTED[planted]
        changed(folder / name, *change)
    capsys.readouterr()
    assert main(["dossier", AGENT, "--check"]) == 1
    assert 1 <= capsys.readouterr().out.count("\nFALSE: ") + 1 <= 12


def test_a_folder_that_was_moved_is_what_it_was(folder):
    assert main(["dossier", AGENT]) == 0
    moved = folder.rename(Path("theirs"))
    assert [*Dossier("theirs").falsehoods()] == []
    changed(moved / "dossier.json", "0 of 200", "9 of 200")
    (false,) = Dossier("theirs").falsehoods()
    assert "flights that failed under own conditions" in false
    assert "9 of 200" in false


@pytest.mark.parametrize(
    ("old", "new", "is_found"),
    [
        ('"failures": 0', '"failures": 1', True),
        ('"below": null', '"below": false', True),
        ('"text": "4.4 us a command"', '"text": "0.3 us a command"', True),
        ('"text": "4.4 us a command"', '"text": "9.1 us a command"', False),
        ('"text": "4.4 us a command"', '"text": "4.4 us a flight"', True),
        ("nominal conditions", "noise of 0.5 m", True),
        ('"code of RANS": "', '"code of RANS": "0', True),
        ('"confidence": 0.99', '"confidence": 0.95', True),
        ('"confidence": 0.99', '"confidence": 0.99000001', False),
        ('"ways"', '"routes"', True),
        ('"listed": {', '"listed": {"LOST": [3], ', True),
        ('"processor": "', '"processor": "another ', False),
        ('"seconds": ', '"seconds": 9', False),
    ],
)
def test_all_that_a_command_writes_is_compared(old, new, is_found, folder, monkeypatch):
    """By the same rule whatever the file says of its machine; what every run has of its own is left out."""
    file = folder / "assurance.json"
    changed(file, '"decision"', '"text": "4.4 us a command", "decision"')
    honest = json.loads(file.read_text("utf-8"))
    monkeypatch.setattr(dossier, "_again", lambda *_: honest)
    changed(file, old, new)
    here = Dossier(AGENT)
    found = [*here.repeated(next(row for row in here.rows if row.file))]
    assert bool(found) == is_found
    assert len(found) <= 2


def test_another_processor_is_told(folder):
    changed(folder / "assurance.json", '"processor": "', '"processor": "another ')
    here = Dossier(AGENT)
    (row, *_) = (row for row in here.rows if row.file)
    assert here.made_elsewhere(row).startswith("processor another ")


@pytest.mark.parametrize(
    ("one", "other", "key"),
    [
        ("multi-task-2d#track-velocity", "multi-task-2d#track-twist", "task and timing"),
        ("go-to-pose-2d-trade-off#0", "go-to-pose-2d-trade-off#1", "task and timing"),
        ("any-craft-2d#0", "any-craft-2d#1", "task and timing"),
        ("lqr:go-to-pose-2d", "lqr:go-to-pose-2d@atmos", "spacecraft"),
        ("lqr:go-to-pose-2d", "lqr:go-to-position-2d", "task and timing"),
    ],
)
def test_a_question_is_of_its_task_and_trade_off(one, other, key):
    hashes = [question_hashes(name, contestant(name).judged) for name in (one, other)]
    assert hashes[0][key] != hashes[1][key]
    assert hashes[0].keys() == hashes[1].keys()
    assert hashes[0] == question_hashes(one, contestant(one).judged)


def test_a_question_is_of_what_a_controller_flies_by(tmp_path, monkeypatch):
    """Tuned settings, weights of a value function, and the module of a user."""
    monkeypatch.chdir(tmp_path)
    allow_current_folder()
    Path("own_law.py").write_text("from rans import LQR as Law\n", "utf-8")
    names = ("lqr:go-to-pose-2d", "value:go-to-pose-2d", "own_law:Law:go-to-pose-2d")
    (setup, *_) = (contestant(name).judged for name in names)
    before = [question_hashes(name, setup) for name in names]
    best: Any = SimpleNamespace(settings={"gain": 2.0})
    monkeypatch.setattr(evidence, "tuned", lambda *_: best)
    monkeypatch.setattr(evidence, "read_bytes", lambda file, _: b"other weights")
    after = [question_hashes(name, setup) for name in names]
    assert before[0]["settings"] != after[0]["settings"]
    differing = {key for key in after[1] if before[1][key] != after[1][key]}
    assert any(key.startswith("weights") for key in differing)
    assert any(key.startswith("module") for key in after[2])


@pytest.mark.slow
def test_a_damaged_dossier_is_a_sentence(folder):
    assert main(["dossier", AGENT]) == 0
    check([folder / "dossier.json"], lambda: [*Dossier(AGENT).falsehoods()], 0.5)


@pytest.mark.slow
def test_evidence_that_was_changed_before_the_dossier_is_found_by_its_command(folder, capsys):
    """Files that agree with each other are right only if the command gives the same; an honest one is accepted."""
    assert main(["dossier", AGENT]) == 0
    assert main(["dossier", AGENT, "--check"]) == 0, capsys.readouterr()
    assert "1 file" in capsys.readouterr().out
    changed(folder / "assurance.json", '"failures": 0', '"failures": 7')
    moved = folder.rename(Path("theirs"))
    assert main(["dossier", str(moved)]) == 0
    assert [*Dossier("theirs").falsehoods()] == []
    assert main(["dossier", "theirs", "--check"]) == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert "FALSE: bounds, any, failures: assurance.json says 7, its command 0." in printed
    assert printed.count("FALSE") == 1


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('"weights (agent.safetensors)": "', '"weights (agent.safetensors)": "0', "is of another"),
        ('"weights (agent.safetensors)"', '"weights"', "says nothing of its"),
        ('"task and timing": "', '"task and timing": "0', "is of another"),
        ('"hashes"', '"sums"', "says nothing of its"),
    ],
)
def test_a_result_of_another_question_is_no_evidence(old, new, why, folder):
    changed(folder / "assurance.json", old, new)
    here = Dossier(AGENT)
    assert not any(row.file for row in here.rows)
    assert any(f"assurance.json {why}" in row.what for row in here.rows)
    # An export is of an agent for all of its tasks, and a validation of its spacecraft alone.
    of = {source.of: here._other(source, folder / "assurance.json") for source in SOURCES}
    assert (not of["agent"]) == old.startswith('"task')
    assert (not of["spacecraft"]) == (old != '"hashes"')


def test_a_page_is_green_by_flights_of_its_agent_and_all_bounds_alone():
    """Checks of a craft are no judgement of who flies it, nor are bounds that so few flights leave open."""
    craft = Section("Validation", facts=[Fact("checks", "3 of 3", passed=True)])
    bound = Fact("solved", "100 %", passed=True, is_asked=True)
    for flown, passed in (
        ((), None),
        ((Section("Assurance", facts=[bound], flies=True),), True),
        ((Section("Assurance", facts=[bound._replace(passed=None)], flies=True),), None),
        ((Section("Assurance", facts=[bound._replace(passed=False)], flies=True),), False),
    ):
        page = Page("it", [craft, *flown], sheet=True)
        assert page.passed is passed
        assert ("no flight of an agent" in page.verdict) == (not flown)
        assert ("undecided" in page.verdict) == (bool(flown) and passed is None)
        assert ("verdict good" in page.html()) == (passed is True)
    assert Page("of a craft", [craft]).passed


def test_a_dossier_begins_with_what_matters(folder):
    """Its bound under its conditions, and what nobody has flown."""
    verdict = Dossier(AGENT).verdict
    assert verdict.startswith("failure probability under own conditions, at most: 0.0228;")
    assert "readings late by: not flown" in verdict
    assert "bounds: none" in verdict


def test_a_result_of_another_agent_is_no_evidence(folder):
    other = pretrained_folder("go-to-pose-2d-robust") / "agent.safetensors"
    shutil.copy(other, folder / "agent.safetensors")
    rows = Dossier(AGENT).rows
    assert not any(row.file for row in rows)


def test_what_was_interrupted_is_no_evidence(folder):
    file = folder / "assurance.json"
    content = json.loads(file.read_text("utf-8"))
    file.write_text(json.dumps(content | {"is_partial": True}), "utf-8")
    rows = Dossier(AGENT).rows
    assert not any(row.file for row in rows)
    assert any("assurance.json is of an interrupted command" in row.what for row in rows)


@pytest.mark.parametrize(
    "command",
    [
        "rans",
        "rans 'assure",
        "rans train go-to-pose",
        "rans assure mine --trust",
        "rans evaluate python:mine.policy:fly:go-to-pose-2d",
        "rans compare mine --executor=os:abort",
        f"rans export mine --output={99 * '../'}home",
        "rm -r mine",
    ],
)
def test_a_command_of_a_stranger_does_not_run(command, folder, monkeypatch):
    monkeypatch.setattr("subprocess.run", None)
    content = json.loads((folder / "assurance.json").read_text("utf-8"))
    (folder / "assurance.json").write_text(json.dumps(content | {"command": command}), "utf-8")
    here = Dossier(AGENT)
    row = next(row for row in here.rows if row.file)
    assert [*here.repeated(row)] == [f"assurance.json names no command of a dossier: {command}"]
