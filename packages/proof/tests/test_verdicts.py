"""What reports and contracts say of certificates that nobody has checked, and of those that were."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import pytest
from rans_proof import verdicts
from rans_proof.pages import proof_entry
from rans_proof.proved import proved, stated
from rans_proof.trap_certificate import FILES, FORMAT, PROPERTY
from rans_proof.verdicts import Stated, record, recorded

from rans.deploy.export import write_export
from rans.pretrained import pretrained_folder
from rans.show.pages.page import Finding
from rans.show.pages.report import report_from_run


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Folder of a shipped agent with a certificate that is false: one cell, far from rest, for all starts."""
    folder = tmp_path / "run"
    shutil.copytree(pretrained_folder("track-velocity-2d"), folder)
    table = {
        "format": FORMAT,
        "property": PROPERTY,
        "agent": {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in FILES},
        "keep": {"speed": 0.0078125, "spin": 0.015625},
        "start": {"speed": 0.0078125, "spin": 0.015625},
        "grid": {"rings": 4, "sectors": 8, "layers": 1, "fine": 8},
        "uncertainty": dict.fromkeys(("mass", "thrust", "velocity", "spin", "delay"), 0.0),
        "cells": [[3, 4, 0, 1, 0, 1]],
    }
    (folder / "proof.json").write_text(json.dumps(table))
    return folder


def certificate(run: Path) -> Stated:
    return stated((run / "proof.json").read_bytes(), "it")


def finding(run: Path) -> Finding:
    """What the report says of the proof; nothing else may say more."""
    section = next(s for s in report_from_run(run).sections if s.title == "Proof")
    (line,) = section.findings
    return line


def test_a_certificate_that_nobody_checked_is_a_claim(run: Path) -> None:
    line = finding(run)
    assert line.passed is None
    assert line.text.startswith("Claimed, not checked here")
    assert "0.0078125 m/s" in line.text
    assert proved(run).verdict == ""


@pytest.mark.parametrize("verdict", ["checked", "proved"])
def test_a_verdict_of_this_computer_counts(run: Path, verdict: verdicts.Verdict) -> None:
    """Only a whole check makes a finding that is passed."""
    assert record(certificate(run), verdict)
    line = finding(run)
    assert line.passed is (True if verdict == "checked" else None)
    assert line.text.startswith("Proved")


def test_a_check_is_not_taken_back_by_a_proof(run: Path) -> None:
    record(certificate(run), "proved")
    record(certificate(run), "checked")
    record(certificate(run), "proved")
    assert recorded(certificate(run)) == "checked"


@pytest.mark.parametrize("name", FILES)
def test_a_verdict_is_about_every_file_of_the_agent(run: Path, name: str) -> None:
    record(certificate(run), "checked")
    (run / name).write_bytes((run / name).read_bytes() + b" ")
    line = finding(run)
    assert line.passed is False
    assert name in line.text


def test_a_verdict_is_about_the_whole_certificate(run: Path) -> None:
    record(certificate(run), "checked")
    file = run / "proof.json"
    file.write_text(file.read_text().replace("0.0078125", "0.0078124"))
    assert finding(run).passed is None


def test_a_run_folder_cannot_bring_its_verdict(run: Path, state: Path) -> None:
    record(certificate(run), "checked")
    shutil.copytree(state, run / "state")
    for file in list(state.rglob("*.json")):
        shutil.copy(file, run)
    shutil.rmtree(state)
    assert finding(run).passed is None


def test_a_verdict_of_an_earlier_checker_does_not_count(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(certificate(run), "checked")
    monkeypatch.setattr(verdicts, "CHECKER", verdicts.CHECKER + 1)
    assert recorded(certificate(run)) == ""


@pytest.mark.parametrize("content", ["", "{}", "[1]", '{"verdict": "checked"}', "\x00"])
def test_a_damaged_verdict_is_none(run: Path, state: Path, content: str) -> None:
    record(certificate(run), "checked")
    (file,) = state.rglob("*.json")
    file.write_text(content)
    assert recorded(certificate(run)) == ""


def test_a_verdict_that_cannot_be_written_is_no_error(run: Path, state: Path) -> None:
    state.write_text("a file where a folder should be")
    assert not record(certificate(run), "checked")
    assert recorded(certificate(run)) == ""


def test_a_damaged_certificate_does_not_hide_the_report(run: Path) -> None:
    (run / "proof.json").write_text('{"format": 1}')
    assert finding(run).passed is False


def test_a_contract_has_what_was_proved_here(run: Path) -> None:
    """And a claim by another name; nothing of another agent, and nothing without a certificate."""
    digest = certificate(run).sha256
    entry = proof_entry(run)
    assert [*entry] == ["claimed"]
    assert entry["claimed"]["sha256"] == digest
    record(certificate(run), "checked")
    entry = proof_entry(run)
    assert [*entry] == ["proved"]
    assert entry["proved"]["sha256"] == digest
    (run / "config.json").write_text((run / "config.json").read_text() + " ")
    assert proof_entry(run) == {}
    (run / "proof.json").unlink()
    assert proof_entry(run) == {}


@pytest.mark.slow
def test_an_export_has_that_entry(run: Path, tmp_path: Path) -> None:
    write_export(run, tmp_path / "exported", "numpy", margins=0)
    contract = json.loads((tmp_path / "exported" / "contract.json").read_text())
    assert contract["claimed"] == proof_entry(run)["claimed"]
