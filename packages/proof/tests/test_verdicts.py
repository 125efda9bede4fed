"""What reports and contracts say of certificates that nobody has checked, and of those that were."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from rans_proof import verdicts
from rans_proof.pages import proof_entry
from rans_proof.proved import proved, stated
from rans_proof.verdicts import FILES, Stated, record, recorded

from rans.deploy.export import write_export
from rans.show.pages.page import Finding
from rans.show.pages.report import report_from_run


@pytest.fixture
def run(folder: Path, certificate: bytes, tmp_path: Path) -> Path:
    """Folder of an agent with a certificate that is false: one cell, far from rest."""
    run = tmp_path / "run"
    shutil.copytree(folder, run)
    table = json.loads(certificate)
    table["cells"] = {"place": [[3, 4, 5]], "heading": [[3, 4, 5]]}
    table["keep"]["position"] = 0.0078125
    (run / "proof.json").write_text(json.dumps(table))
    return run


def stated_by(run: Path) -> Stated:
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
    assert "0.0078125 m" in line.text
    assert proved(run).verdict == ""


def test_a_verdict_of_this_computer_counts(run: Path) -> None:
    assert record(stated_by(run))
    line = finding(run)
    assert line.passed
    assert line.text.startswith("Proved")


@pytest.mark.parametrize("name", FILES)
def test_a_verdict_is_about_every_file_of_the_agent(run: Path, name: str) -> None:
    record(stated_by(run))
    (run / name).write_bytes((run / name).read_bytes() + b" ")
    line = finding(run)
    assert line.passed is False
    assert name in line.text


def test_a_verdict_is_about_the_whole_certificate(run: Path) -> None:
    record(stated_by(run))
    file = run / "proof.json"
    file.write_text(file.read_text().replace("0.0078125", "0.0078124"))
    assert finding(run).passed is None


def test_a_run_folder_cannot_bring_its_verdict(run: Path, state: Path) -> None:
    record(stated_by(run))
    shutil.copytree(state, run / "state")
    for file in list(state.rglob("*.json")):
        shutil.copy(file, run)
    shutil.rmtree(state)
    assert finding(run).passed is None


def test_a_verdict_of_an_earlier_checker_does_not_count(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(stated_by(run))
    monkeypatch.setattr(verdicts, "CHECKER", verdicts.CHECKER + 1)
    assert recorded(stated_by(run)) == ""


@pytest.mark.parametrize("content", ["", "{}", "[1]", '{"verdict": "checked"}', "\x00"])
def test_a_damaged_verdict_is_none(run: Path, state: Path, content: str) -> None:
    record(stated_by(run))
    (file,) = state.rglob("*.json")
    file.write_text(content)
    assert recorded(stated_by(run)) == ""


def test_a_verdict_that_cannot_be_written_is_no_error(run: Path, state: Path) -> None:
    state.write_text("a file where a folder should be")
    assert not record(stated_by(run))
    assert recorded(stated_by(run)) == ""


def test_a_damaged_certificate_does_not_hide_the_report(run: Path) -> None:
    (run / "proof.json").write_text('{"format": 1}')
    assert finding(run).passed is False


def test_a_contract_has_what_was_proved_here(run: Path) -> None:
    """And a claim by another name; nothing of another agent, and nothing without a certificate."""
    digest = stated_by(run).sha256
    entry = proof_entry(run)
    assert [*entry] == ["claimed"]
    assert entry["claimed"]["sha256"] == digest
    record(stated_by(run))
    entry = proof_entry(run)
    assert [*entry] == ["proved"]
    assert entry["proved"]["sha256"] == digest
    (run / "config.json").write_text((run / "config.json").read_text() + " ")
    assert proof_entry(run) == {}
    (run / "proof.json").unlink()
    assert proof_entry(run) == {}


@pytest.mark.slow
def test_an_export_has_that_entry(run: Path, tmp_path: Path) -> None:
    (run / "card.json").write_text(json.dumps({"training": {"made": "by hand"}}))
    write_export(run, tmp_path / "exported", "numpy", episodes=8)
    contract = json.loads((tmp_path / "exported" / "contract.json").read_text())
    assert contract["claimed"] == proof_entry(run)["claimed"]
