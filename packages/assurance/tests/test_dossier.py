"""Dossiers: rows come from results of this very agent, and what is false in one is found."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import pytest
from rans_assurance.dossier import SOURCES, UNPROVED, Dossier

from rans.base.pretrained import pretrained_folder
from rans.cli import _parse, main
from rans.show.pages.page import Part
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
    (failed,) = [row for row in rows if row["what"] == "flights that failed"]
    assert failed["value"] == f"{bound['failures']} of 200"
    assert failed["command"] == f"rans {ASSURE}"
    assert re.fullmatch(r"20\d\d-\d\d-\d\d \d\d:\d\d\+00:00", failed["date"])
    assert failed["agent"] == read["hashes"]["weights (agent.safetensors)"]
    # The other questions stand empty, without a verdict, in every part that has none.
    empty = [row for row in rows if not row["value"]]
    asked = {what for source in SOURCES for _, what in source.questions}
    assert {row["what"] for row in empty} < asked | {UNPROVED.what}
    assert len(empty) >= 7
    assert all(row["passed"] is None and row["command"] in printed for row in empty)
    page = (folder / "dossier.html").read_text("utf-8")
    places = [page.index(f">{section.title}</h2>") for section in Dossier(AGENT).parts()]
    assert places == sorted(places)
    assert len(places) == len(get_args(Part))


def test_every_command_of_a_dossier_can_be_typed(folder):
    for row in Dossier(str(folder)).rows:
        if row is UNPROVED:
            continue
        first, *words = shlex.split(row.command)
        assert first == "rans"
        _parse(words)  # exits where there is no such option


def _value(content: Any) -> None:
    (row,) = [row for row in content["rows"] if row["what"].startswith("failure probability")]
    row["value"] = "0.001"


def _verdict(content: Any) -> None:
    content["rows"][-1]["passed"] = True


def _bound(content: Any) -> None:
    content["bounds"]["any"]["failures"] = 77


PLANTED: dict[str, tuple[str, Callable[[Any], None]]] = {
    "value": ("dossier.json", _value),
    "verdict": ("dossier.json", _verdict),
    "evidence": ("assurance.json", _bound),
}


@pytest.mark.parametrize("planted", [*PLANTED, "agent"])
def test_what_is_false_is_found_in_the_files(planted, folder, capsys):
    """A value or a verdict changed by hand, evidence changed after the dossier, or another agent in its place."""
    assert main(["dossier", AGENT]) == 0
    assert [*Dossier(AGENT).falsehoods()] == []
    if planted == "agent":
        other = pretrained_folder("go-to-pose-2d-robust") / "agent.safetensors"
        shutil.copy(other, folder / "agent.safetensors")
    else:
        name, change = PLANTED[planted]
        content = json.loads((folder / name).read_text("utf-8"))
        before = json.dumps(content)
        change(content)
        assert json.dumps(content) != before
        (folder / name).write_text(json.dumps(content), "utf-8")
    capsys.readouterr()
    assert main(["dossier", AGENT, "--check"]) == 1
    assert "FALSE: " in capsys.readouterr().out


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
    file = folder / "assurance.json"
    content = json.loads(file.read_text("utf-8"))
    content["bounds"]["any"] |= {"failures": 7, "at most": 0.001}
    file.write_text(json.dumps(content), "utf-8")
    assert main(["dossier", AGENT]) == 0
    assert [*Dossier(AGENT).falsehoods()] == []
    assert main(["dossier", AGENT, "--check"]) == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert (
        "flights that failed (assurance.json): the dossier says 7 of 200, its command gives"
        in printed
    )


def test_a_result_of_another_agent_is_no_evidence(folder):
    other = pretrained_folder("go-to-pose-2d-robust") / "agent.safetensors"
    shutil.copy(other, folder / "agent.safetensors")
    rows = Dossier(AGENT).rows
    assert not any(row.value for row in rows)
    assert any("assurance.json is of another weights" in row.what for row in rows)


def test_what_was_interrupted_is_no_evidence(folder):
    file = folder / "assurance.json"
    content = json.loads(file.read_text("utf-8"))
    file.write_text(json.dumps(content | {"is_partial": True}), "utf-8")
    rows = Dossier(AGENT).rows
    assert not any(row.value for row in rows)
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
    dossier = Dossier(AGENT)
    row = next(row for row in dossier.rows if row.file)
    assert [*dossier.repeated(row)] == [f"assurance.json names no command of a dossier: {command}"]
