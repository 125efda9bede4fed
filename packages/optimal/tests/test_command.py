from __future__ import annotations

import csv
import json

import pytest
from rans_bounds.problem import SearchEffort

from rans.cli import main

pytestmark = pytest.mark.usefixtures("undrawn")


def run(typed: str) -> int:
    return main(["optimal", *typed.split()])


@pytest.fixture(autouse=True)
def _one_process(monkeypatch) -> None:
    """Others would take seconds to start."""
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0})


@pytest.fixture
def long_periods(monkeypatch) -> None:
    """Commands are held for 0.5 s, so that a trajectory has fewer of them."""
    monkeypatch.setattr("rans_optimal.command._CONTROL_PERIOD", 0.5)


def test_writes_what_it_found(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("rans_optimal.command._INTERVALS", 12)
    assert run(f"go-to-position --episodes 2 --objective time --output {tmp_path}") == 0
    text = capsys.readouterr().out
    assert "2 of 2 solved and flown in Drake" in text
    written = json.loads((tmp_path / "optimal.json").read_text())
    assert [row["sentence"] for row in written["starts"]] == ["solved", "solved"]
    assert "from episode 1" in (tmp_path / "optimal.html").read_text()


@pytest.mark.parametrize(
    ("objective", "measure"),
    [
        ("energy", "energy N^2 s"),
        ("reward", "minus return"),
    ],
)
@pytest.mark.usefixtures("long_periods")
def test_objectives(tmp_path, objective, measure):
    options = f"--episodes 1 --objective {objective} --horizon 4 --output {tmp_path}"
    assert run(f"track-velocity {options}") == 0
    assert json.loads((tmp_path / "optimal.json").read_text())["measure"] == measure


@pytest.mark.slow
def test_lost_starts_are_told_and_the_rest_is_made(capsys, tmp_path):
    """1.8 s is too short from 3 m; bounds are printed all the same."""
    options = "--episodes 2 --horizon 1.8 --certify --spacecraft free-flyer-shared"
    assert run(f"go-to-pose {options} --output {tmp_path}") == 1
    text = " ".join(capsys.readouterr().out.split())
    assert "Start 0, 1: the optimiser found no trajectory that arrives" in text
    assert "No tight certificate exists" in text
    assert "0 of 2 solved" in text
    assert "--horizon 3.6" in text
    assert len(json.loads((tmp_path / "optimal.json").read_text())["starts"]) == 2


def test_certify_bounds_craft_with_wheels_without_a_trajectory(capsys, tmp_path):
    """Without --certify nothing can be computed for a wheel, which is an error as before."""
    command = f"go-to-pose --spacecraft pingu --episodes 1 --output {tmp_path}"
    assert run(f"{command} --certify") == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "has 1 reaction wheel" in text
    assert "tube bound" in text
    [bound] = json.loads((tmp_path / "optimal.json").read_text())["bounds"]
    assert min(bound["hull"], bound["tube"]) > 0.0
    assert not (tmp_path / "optimal.csv").exists()
    assert run(command) == 2


@pytest.mark.usefixtures("long_periods")
def test_guesses_are_tried_and_the_certificate_has_the_time_it_is_given(tmp_path, monkeypatch):
    """Each answer counts its guesses; the questions are looked at, not answered."""
    asked = []
    monkeypatch.setattr(
        "rans_bounds.transfers.bounds_in_parallel",
        lambda *given, **_: asked.append(given) or (),
    )
    monkeypatch.setattr("rans_optimal.optima.usual_guesses", lambda *_: 2)
    options = "--episodes=1 --horizon=8 --certify --certify-seconds 3.5"
    assert run(f"go-to-position {options} --output {tmp_path}") == 0
    written = json.loads((tmp_path / "optimal.json").read_text())
    assert (written["starts"][0]["attempts"], written["seed"]) == (2, 2023)
    [([question], starts)] = asked
    assert (question.effort, question.horizon, question.period) == (SearchEffort(3.5), 8.0, 0.5)
    assert list(starts) == [0]


@pytest.mark.usefixtures("long_periods")
def test_a_start_of_ones_own(tmp_path):
    """From 1 m away; rows of the table are instants, with the start first."""
    own = "--start -1 0 0.5rad --goal 0 0.5 0 --horizon 8"
    assert run(f"go-to-pose {own} --output {tmp_path}") == 0
    with (tmp_path / "optimal.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 17
    assert [float(rows[0][key]) for key in ("time", "p.x", "heading")] == [0.0, -1.0, 0.5]
    assert [float(rows[-1][key]) for key in ("time", "p.x", "p.y")] == pytest.approx(
        [8.0, 0.0, 0.5], abs=1e-6
    )
    assert rows[-1]["command.7"] == ""
