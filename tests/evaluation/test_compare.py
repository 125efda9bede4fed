"""Comparisons: fair starts, honest rows for what failed, files that others can read."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from rans.cli.compare import Compare
from rans.errors import ConfigError
from rans.evaluation.compare import Comparison, bounds, compare
from rans.evaluation.report import comparison_section
from rans.flight import fly, scenarios
from rans.optimal.lqr import LQR
from rans.optimal.objectives import MinimumFuel, MinimumTime
from rans.spacecraft_file import load_spacecraft
from rans.tasks import GoToPose
from rans.timing import Timing

CRAFT, TASK, TIMING = load_spacecraft("floating-platform"), GoToPose(spawn_distance=(3.0, 4.0)), Timing()


class Idle:
    """Never opens a thruster."""

    name = "idle"

    def reset(self, count: int) -> None:
        self.shape = (count, len(CRAFT.thrusters))

    def act(self, state: object, goal: object, observation: np.ndarray) -> np.ndarray:
        return np.zeros(self.shape)


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    objectives = (*bounds(TIMING), MinimumFuel(2.0))
    return compare([LQR(CRAFT, TIMING), Idle()], CRAFT, TASK, TIMING, 4, 3, objectives, workers=1)


def test_everyone_flies_every_start(comparison: Comparison) -> None:
    groups = list(comparison.contestants().values())
    assert [[row.start for row in rows] for rows in groups] == [[0, 1, 2]] * 5
    assert [rows[0].kind for rows in groups] == ["controller"] * 2 + ["bound"] * 3


def test_bounds_bound(comparison: Comparison) -> None:
    """The thriftiest trajectory spends less than the LQR, the quickest settles sooner, and both fly in
    Drake as they were planned, to within the millimetre asked of them."""
    lqr, _, quick, thrifty, _ = comparison.contestants().values()
    for controller, fast, frugal in zip(lqr, quick, thrifty, strict=False):
        assert controller.settling_time is not None
        assert fast.settling_time is not None
        assert fast.settling_time <= controller.settling_time
        assert frugal.impulse is not None
        assert frugal.impulse < controller.impulse  # type: ignore[operator]
        for row in (fast, frugal):
            assert row.replay_error is not None
            assert row.replay_error < 1e-3
            assert row.errors is not None
            assert row.errors["position"] < 1e-3


def test_optimum_costs_no_more_than_lqr_at_the_same_horizon() -> None:
    timing = Timing(episode_steps=50)
    objective = MinimumFuel(10.0)
    rows = compare([LQR(CRAFT, timing)], CRAFT, TASK, timing, 6, 3, [objective], workers=1).contestants()
    lqr, optimum = rows.values()
    for controller, best in zip(lqr, optimum, strict=True):
        assert controller.settling_time is not None  # it has arrived, so the comparison is fair
        assert best.impulse < controller.impulse  # type: ignore[operator]


def test_who_never_settles_has_no_time(comparison: Comparison) -> None:
    rows = comparison.contestants()["idle"]
    assert [row.settling_time for row in rows] == [None] * 3
    assert [row.impulse for row in rows] == [0.0] * 3
    start = scenarios(TASK, CRAFT, 4, 3).start
    assert [row.errors["position"] for row in rows if row.errors] == pytest.approx(list(start.p.norm()))
    summary = next(s for s in comparison.summary() if s["contestant"] == "idle")
    assert (summary["settled"], summary["median_settling_time"]) == (0, None)


def test_unsolved_is_a_row_that_says_so(comparison: Comparison) -> None:
    rows = comparison.unsolved
    assert [row.status for row in rows] == ["Infeasible_Problem_Detected"] * 3
    assert [row.impulse for row in rows] == [None] * 3
    table, summary = comparison.tables()
    console = Console(width=200, file=io.StringIO(), record=True)
    console.print(table, summary)
    assert console.export_text().count("Infeasible_Problem_Detected") == 3


def test_result_is_plain_json_that_the_report_draws(comparison: Comparison) -> None:
    read = json.loads(json.dumps(comparison.to_json(), allow_nan=False))
    first = read["starts"][0]
    flight = fly(CRAFT, TASK, LQR(CRAFT, TIMING), scenarios(TASK, CRAFT, 4, 3), TIMING)
    last_fifth = np.linalg.norm([flight.states.p.x[-25:, 0], flight.states.p.y[-25:, 0]], axis=0)
    assert first["position_error_cm"] == pytest.approx(100 * last_fifth.mean())
    assert first["on_time"] == pytest.approx(0.2 * flight.commands[:, 0].sum())
    solvable = {**read, "starts": [row for row in read["starts"] if row["on_time"] is not None]}
    section = comparison_section(solvable)
    assert len(section.tables) == 2
    assert len(section.pictures) == 1


def test_bounds_leave_the_last_fifth_to_rest() -> None:
    quick, thrifty = bounds(Timing(control_period=0.1, episode_steps=100))
    assert isinstance(quick, MinimumTime)
    assert isinstance(thrifty, MinimumFuel)
    assert (thrifty.horizon, thrifty.control_period) == (pytest.approx(8.0), 0.1)


def test_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                 capsys: pytest.CaptureFixture[str]) -> None:
    def load(run: Path) -> object:
        return Idle(), CRAFT, GoToPose(), TIMING

    monkeypatch.setitem(sys.modules, "rans.evaluation.agent", SimpleNamespace(load_agent=load))
    assert Compare(tmp_path, episodes=1).run() == 0
    read = json.loads((tmp_path / "compare.json").read_text())
    assert [row["contestant"] for row in read["summary"]] == [
        "idle", "LQR", "minimum time (bound)", "minimum fuel in 20 s (bound)"]
    # the idle agent stays where it starts
    assert 300 <= read["starts"][0]["position_error_cm"] <= 400
    assert "1 starts of seed 2023, floating-platform" in capsys.readouterr().out
    with pytest.raises(ConfigError, match="--episodes must be at least 1, got 0"):
        Compare(tmp_path, episodes=0).run()
