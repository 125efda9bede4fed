from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from campaigns import agents
from campaigns.agent_rows import ROWS, Goal, Row
from campaigns.agents import Agents, Line, conditions_of, means
from campaigns.runner import run, texts
from campaigns.table import CAMPAIGNS
from rans.errors import ConfigError
from rans.model.timing import Timing
from rans.tasks import GoToPosition, TrackVelocity
from tests.support.training import CONFIG, tiny_trainer

PAGE = "before\n<!-- table: agents -->\nold\n<!-- end of table -->\nafter\n"


def line(at_least: bool, *runs: tuple[float, ...]) -> Line:
    return Line(
        "row",
        "what",
        "%",
        "-",
        (90.0, 80.0),
        at_least,
        {f"seed{k}": values for k, values in enumerate(runs)},
        "rans evaluate x",
    )


def test_the_worst_training_counts_figure_by_figure() -> None:
    good = line(True, (95.0, 81.0), (91.0, 99.0))
    bad = line(True, (95.0, 79.0), (91.0, 99.0))
    assert (good.worst, good.passed) == ((91.0, 81.0), True)
    assert (bad.worst, bad.passed) == ((91.0, 79.0), False)
    assert line(False, (10.0, 79.0), (89.0, 20.0)).passed
    assert not line(False, (10.0, 79.0), (91.0, 20.0)).passed
    assert not line(True, (math.nan, 99.0)).passed
    assert "(of 2)" in good.cells()["ours"]


@pytest.mark.slow
def test_a_folder_of_runs_becomes_a_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Agents that know nothing, of two tasks, and a path: the rows of other tasks are left out."""
    paths = [row for row in ROWS if row.path]
    monkeypatch.setattr(agents, "ROWS", [row for row in ROWS if row not in paths[1:]])
    for name, task, settings in (
        ("go-to-position-3d-seed0", "go-to-position", GoToPosition()),
        ("track-velocity-2d-seed0", "track-velocity", TrackVelocity()),
        ("track-velocity-2d-seed1", "track-velocity", TrackVelocity()),
    ):
        craft = "free-flyer" if "3d" in name else "floating-platform"
        config = replace(
            CONFIG,
            task=task,
            settings=settings,
            spacecraft=craft,
            seed=int(name[-1]),
            timing=Timing(episode_steps=30),
        )
        trainer = tiny_trainer(tmp_path / "runs" / name, config)
        trainer.save()
    (tmp_path / "agents.md").write_text(PAGE)
    plan = Agents(tmp_path / "runs", episodes=8, starts=1)
    assert run(CAMPAIGNS["agents"], plan, tmp_path) == 1
    read = json.loads((tmp_path / "validation" / "agents.json").read_text("utf-8"))
    lines = read["lines"]
    assert [line["row"].partition(",")[0] for line in lines] == [
        *["6DoF go to position"] * 3,
        *["3DoF track velocity"] * 2,
        "3DoF follow the circle at 0.25 m/s",
    ]
    assert set(lines[3]["runs"]) == {"track-velocity-2d-seed0", "track-velocity-2d-seed1"}
    assert not any(line["passed"] for line in lines)
    assert "| 6DoF go to position, 1 to 5 m, 25 s |" in (tmp_path / "agents.md").read_text("utf-8")


def test_the_row_says_where_episodes_start(tmp_path: Path) -> None:
    trainer = tiny_trainer(
        tmp_path / "run",
        replace(CONFIG, task="go-to-position", settings=GoToPosition(), spacecraft="free-flyer"),
    )
    trainer.save()
    row = next(row for row in ROWS if row.agent == "go-to-position-3d")
    _, (_, task, *_) = conditions_of(row, tmp_path / "run")
    assert task.spawn_distance == (1.0, 5.0)  # type: ignore[attr-defined]


def test_shares_of_episodes_are_percent(tmp_path: Path) -> None:
    """From 2 mm no thruster leaves 5 cm in 0.2 s: all of the episodes hold, 100 %."""
    config = replace(
        CONFIG,
        task="go-to-position",
        settings=GoToPosition(),
        timing=Timing(episode_steps=1),
        episode_steps=8,
    )
    tiny_trainer(tmp_path / "agent-seed0", config).save()
    row = Row(
        "row",
        "agent",
        (Goal(("solved to 5 cm",), "%", (99.5,), at_least=True),),
        distance=(0.001, 0.002),
    )
    (line,) = Agents(tmp_path, episodes=4, starts=1)._lines(row)
    assert (line.worst, line.passed) == ((100.0,), True)


def test_a_run_of_another_task_is_one_sentence(tmp_path: Path) -> None:
    trainer = tiny_trainer(tmp_path / "track-velocity-3d-seed0", CONFIG)
    trainer.save()
    with pytest.raises(
        ConfigError, match="nothing is known of velocity error after 5 s: the run is of ano"
    ):
        Agents(tmp_path, episodes=2, starts=1).measured()


def test_nothing_to_judge_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="holds no run named go-to-pose-2d-shared"):
        Agents(tmp_path).measured()
    with pytest.raises(ConfigError, match="--starts must be from 1 to the 4 episodes, got 5"):
        Agents(tmp_path, episodes=4, starts=5).measured()


def test_settling_times_are_medians_and_all_else_means() -> None:
    values = {"settling time": np.array([1.0, 2.0, np.inf]), "duty": np.array([1.0, 2.0, 6.0])}
    assert means(values, Goal(("settling time", "duty"), "")) == (2.0, 3.0)
    assert means(values, Goal(("duty",), ""), 2) == (1.5,)


def test_a_target_may_be_what_time_optimal_trajectories_reach_less_some_slack(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """90 and 70 % of the optimum's first two starts, less 2: the agent's mean over the same two is judged."""
    row = Row(
        "row",
        "agent",
        (
            Goal(("PT5", "PT2"), "%", at_least=True, slack=2.0),
            Goal(("PT5",), "%", (50.0,), at_least=True),
        ),
    )
    judged = Agents(Path("runs"), episodes=3, starts=2)
    measured = {"PT5": np.array([88.0, 90.0, 2.0]), "PT2": np.array([67.0, 67.0, 99.0])}
    optimum = {"PT5": np.array([85.0, 95.0]), "PT2": np.array([60.0, 80.0])}
    monkeypatch.setattr(Path, "glob", lambda *_: [Path("runs/agent-seed0")])
    monkeypatch.setattr(Agents, "_measured", lambda *_: measured)
    monkeypatch.setattr(Agents, "_optimal", lambda *_: optimum)
    near, whole = judged._lines(row)
    assert near.targets == pytest.approx((88.0, 68.0))
    assert near.worst == pytest.approx((89.0, 67.0))
    assert not near.passed
    assert near.what == "PT5 / 2, first 2 starts; time-optimal: 90 / 70 %"
    assert whole.worst == pytest.approx((60.0,))  # over all three episodes
    assert whole.passed


@pytest.mark.parametrize(
    ("value", "missed", "verdict"), [(95.0, False, "met"), (85.0, True, "missed")]
)
def test_the_command_says_whether_targets_are_met(value: float, missed: bool, verdict: str) -> None:
    """One missed target is enough."""
    lines = line(True, (91.0, 99.0)), line(True, (value, 80.0))
    evidence = {"lines": [asdict(one) | {"passed": one.passed} for one in lines]}
    assert Agents(Path("runs")).failed(evidence) is missed
    _, rows = texts(CAMPAIGNS["agents"].tables["agents"], evidence)
    assert f"{value:g} / 80 % (of 1)" in rows[1][4]
    assert rows[1][5] == verdict
