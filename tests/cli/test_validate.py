"""``rans validate`` as a user runs it."""

import json
import shutil
from dataclasses import replace

import pytest

import validation.study.study
from rans.cli import main
from rans.model.spacecraft_file import load_spacecraft, to_toml
from rans.show.pages.report import report_from_run
from validation.study.study import Scope


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_quick_validation_passes_and_is_written(tmp_path, capsys, monkeypatch):
    """And one layer alone repeats what the study found; of one flight, not of sixteen."""
    monkeypatch.setattr(
        validation.study.study,
        "Scope",
        lambda craft, seed, states, _, conditions: Scope(craft, seed, states, 1, conditions),
    )
    folder = tmp_path / "checked"
    code = main(f"validate --quick --output {folder}".split())
    printed = capsys.readouterr().out
    assert code == 0, printed
    (thrusters,) = [line for line in printed.splitlines() if "thrusters" in line]
    assert "2 of 2" in thrusters
    read = json.loads((folder / "validation.json").read_text("utf-8"))
    assert read["passed"]
    assert read["settings"]["spacecraft"] == "floating-platform"
    assert read["settings"]["seed"] == 0
    assert str(len(read["checks"])) in printed
    page = report_from_run(folder)
    assert all(passed for passed, _ in page.checks)
    assert page.passed is None  # no agent has flown
    assert len(page.sections[0].pictures) == len({curve["figure"] for curve in read["curves"]}) > 1

    alone = tmp_path / "alone"
    assert main(f"validate --quick --layer bang-bang --output {alone}".split()) == 0
    again = json.loads((alone / "validation.json").read_text("utf-8"))["checks"]
    assert again == [check for check in read["checks"] if check["layer"] == "bang-bang"]
    assert len(again) == 4


def test_an_interrupted_validation_has_not_passed(tmp_path, monkeypatch, ran):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setitem(validation.study.study.LAYERS, "commands", interrupted)
    ran(f"validate --quick --output {tmp_path}", code=130)
    read = json.loads((tmp_path / "validation.json").read_text("utf-8"))
    assert (read["passed"], len(read["checks"])) == (False, 2)


def test_valves_that_pulse_are_validated(ran):
    """Against Drake, which switches them itself; thrust of the same impulse is 0.1 mm off in a period."""
    ran("validate --quick atmos --layer period")


def test_a_spacecraft_drake_refuses_is_one_sentence(tmp_path, refused):
    """A flat plate off the triangle inequality by less than our check's 1e-9."""
    flat = replace(
        load_spacecraft("free-flyer"),
        inertia=((0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.2 * (1 + 5e-10))),
    )
    file = tmp_path / "flat.toml"
    file.write_text(to_toml(flat), "utf-8")
    assert "Drake refuses its inertia" in refused(f"validate --quick {file}")


def test_what_could_not_be_checked_is_said(monkeypatch, ran):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    printed = ran("validate --layer compiled", code=1)
    assert "not run" in printed
    assert "Nothing could be checked" in printed
    assert "C++ compiler" in printed


def test_valves_that_cannot_do_what_is_asked_are_told_before_anything_is_checked(
    tmp_path, refused, monkeypatch
):
    file = tmp_path / "slow.toml"
    file.write_text("[thrusters]\nleast_on = 0.1\n", "utf-8")
    monkeypatch.setattr(validation.study.study, "_chosen", None)
    said = refused(f"validate --quick atmos --conditions {file}")
    assert "which is for on/off valves; the thrusters of 'atmos' are pulsed" in said
