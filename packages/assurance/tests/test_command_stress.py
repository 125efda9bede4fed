"""``rans stress`` as a user runs it."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest
import rans_assurance.stress.run as run
from rans_assurance.sections.stress import _curves

from rans.cli import main
from tests.support.stress_runs import FIRST

QUICK: str = "--only latency --conditions perfect --episodes 2"


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    # Other processes would take seconds to start.
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0})


@pytest.mark.slow
def test_pages_numbers_and_commands_that_show_it_again(monkeypatch, capsys):
    monkeypatch.setattr(run, "failure_levels", lambda craft: [])
    assert main(f"stress {FIRST} lqr {QUICK}".split()) == 0
    folder = Path("runs/evaluations/pretrained-go-to-pose-2d")
    printed = capsys.readouterr().out
    assert "up to which all of 2 episodes are solved" in " ".join(printed.split())
    # 2 / (2 + 1.96^2), Wilson's lower end without a failure.
    assert "2 episodes cannot show 99 %: with all solved, the share is at least 34.2 %" in printed
    read = json.loads((folder / "stress.json").read_text("utf-8"))
    assert read["effects"]["latency"]["holds_to"]["LQR"] >= 0.1
    lost = read["conditions"]["latency-0.3"]["contestants"]["go-to-pose-2d"]
    assert lost["held"]["value"] == 0.0
    assert lost["episodes"] == 2
    # Its section draws what the file says, the nominal size first.
    (curve,) = [_curves(read["conditions"], "latency", 0.0)["LQR"]]
    assert [mark[:2] for mark in curve][:3] == [(0.0, 100.0), (0.025, 100.0), (0.05, 100.0)]
    assert f"rans view {FIRST} --conditions" in printed
    shown = []
    monkeypatch.setattr("rans.api.pages.Replay.html", lambda replay: shown.extend(replay.flights))
    monkeypatch.setattr("rans.cli.view._serve", lambda page, *_: page())
    command = shlex.split(lost["worst"][-1]["see"])
    assert command[:2] == ["rans", "view"]
    assert main(command[1:]) == 0
    error = shown[0].errors()["position"][-25:].max()
    assert error == pytest.approx(lost["worst"][-1]["errors"]["position, m"], rel=1e-6)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_failure_is_printed_and_the_rest_written(capsys):
    both = "lqr:go-to-pose-2d python:tests.support.policies:broken"
    assert main(f"stress {both} {QUICK} --output here".split()) == 1
    assert "no such layer" in capsys.readouterr().out
    read = json.loads(Path("here/stress.json").read_text("utf-8"))
    assert "no such layer" in read["failures"][0]
    conditions = read["conditions"]
    assert list(conditions["perfect"]["contestants"]) == ["LQR"]


@pytest.mark.usefixtures("undrawn")
def test_interrupted_it_writes_what_was_flown(monkeypatch, capsys):
    monkeypatch.setattr("rans.show.progress._SAVED_EVERY", 0.0)
    true = run._Flyer.flown
    calls = []

    def interrupted(*job):
        calls.append(job)
        if len(calls) > 2:
            assert Path("here/stress.json").exists()  # as a kill would leave it
            raise KeyboardInterrupt
        return true(*job)

    monkeypatch.setattr(run._Flyer, "flown", interrupted)
    assert main(f"stress lqr:go-to-pose-2d {QUICK} --output here".split()) == 130
    read = json.loads(Path("here/stress.json").read_text())
    assert read["is_partial"] is True
    assert "position within 5 cm" in str(read["scope"]["rows"])
    assert ["scenario perfect", "nominal conditions"] in read["scope"]["rows"]
    flown = [name for name, one in read["conditions"].items() if one["contestants"]]
    assert flown == ["perfect", "latency-0.025"]
    assert read["effects"]["latency"]["holds_to"] == {"LQR": None}
    printed = capsys.readouterr()
    assert "0.025 or more, not finished" in " ".join(printed.out.split())
    assert "what was written is kept" in printed.err
