"""What commands print, by value: every figure stands in what was measured, with its unit."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import rans
import validation.study.study
from rans.cli import main
from rans.cli import train as training
from rans.cli.details import _agent_details
from rans.cli.sweep import _table
from rans.evaluation.measure.agreement import EngineComparison
from rans.fast.learn.config import TrainConfig
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.optimal.trajectory.objectives import objective_of
from rans.randomization.conditions import Conditions, ThrusterConditions
from rans.show.progress import describe, describe_terms
from rans.table import Table
from rans.tasks import GoToPose
from validation.study.checks import Check, Skipped, Study


def test_progress_of_a_training() -> None:
    row = {
        "steps": 1_500_000,
        "success": 0.256,
        "steps_per_s": 250_000.0,
        "return/position": 12.4,
        "return/attitude": 3.6,
    }
    assert (
        describe(row, 4_000_000) == "1.50 M steps, solved 25.6%, return 16, 0.25 M/s, 0:00:10 left"
    )
    assert describe(row, 1_000_000).endswith("0:00:00 left")
    # The report of an imitation, whose speed is not that of the training.
    imitated = {"steps": 98_304, "steps_per_s": 157, "success": 1.0}
    assert describe(imitated, 4_000_000) == "0.10 M steps, solved 100.0%, 157 steps/s"
    assert describe_terms(row) == "return of 1.50 M steps: position 12 attitude 4"


@pytest.mark.parametrize(
    ("stopped", "solved", "share", "ending"),
    [
        (True, False, 0.99, "Stopped"),
        (True, True, 0.99, "Solved"),
        (False, True, 0.99, "Solved"),
        (False, False, None, "Done"),
        (False, False, 0.99, "Out of steps, not solved"),
    ],
)
def test_the_end_of_a_training(
    stopped: bool, solved: bool, share: float | None, ending: str
) -> None:
    trainer: Any = SimpleNamespace(
        run=SimpleNamespace(path=Path("runs/a b")),
        solved=solved,
        imitates="",
        ended=solved or not stopped,
        warm_up=2.5,
        seconds=4.0,
        rate=123_456.0,
        learner=SimpleNamespace(description=""),
        config=TrainConfig("go-to-pose", GoToPose(), "floating-platform", solved_share=share),
        engine=SimpleNamespace(craft=load_spacecraft("floating-platform")),
        steps=500_000,
        rows=[{"success": 0.86}],
    )
    text = training._summary(trainer, 1000, stopped, 9.0)
    assert text.startswith(
        f"{ending} after 500,000 steps: 4.0 s of training (123,456 steps/s) after 2.5 s "
        "of warm-up, 9.0 s in all. The agent is runs/a b."
    )
    assert text.endswith("Continue with: rans train --resume 'runs/a b'") is (ending == "Stopped")
    assert ("86% of its last episodes are solved" in text) is (ending == "Out of steps, not solved")
    assert ("--resume 'runs/a b' --total-timesteps 1000000; or another --seed" in text) is (
        ending == "Out of steps, not solved"
    )


def test_the_suggested_training_keeps_settings_of_the_task() -> None:
    """Also by their short names; others, such as a number of steps, may contradict the quality."""
    command = training.Train("go-to-pose", set=("thrust_weight=0.1", "n_steps=8"))
    trainer: Any = SimpleNamespace(
        run=SimpleNamespace(path=Path("runs/a")),
        config=command.resolved(),
        engine=SimpleNamespace(craft=load_spacecraft("floating-platform")),
    )
    better = command._next(trainer)[-1].partition("   #")[0]
    assert better == "rans train go-to-pose --set thrust_weight=0.1 --quality good"


@pytest.mark.parametrize("quick", [0.0, 1.0])
def test_an_agent_that_fails_as_designed_is_named(
    quick: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Solved in training; with everything as designed by all of its flights or by none."""
    import rans.evaluation.measure.metrics as metrics

    monkeypatch.setattr(metrics, "solved", lambda flight: flight.verdict.held * 0.0 + quick)
    trained = Conditions(thrusters=ThrusterConditions(latency=0.03))
    run = rans.load_agent("go-to-pose-2d").run._replace(timing=Timing(episode_steps=5))
    monkeypatch.setattr("rans.evaluation.fly.agent.load_policy", lambda _: run)
    trainer: Any = SimpleNamespace(
        run=SimpleNamespace(path=Path("runs/mine")),
        config=SimpleNamespace(conditions=trained, guard=False),
        rows=[{"success": 1.0}],
    )
    text = training._nominal_hole(trainer)
    assert ("solves 0.0%" in text) is (quick == 0.0)
    assert bool(text) is (quick == 0.0)
    trainer.config.conditions = Conditions()
    assert not training._nominal_hole(trainer)


def swept() -> Any:
    """Two members: one solved, one diverged; 5 cm and 0.1 rad."""
    rows = [
        {
            "steps": 2_000_000,
            "seconds": 3.0,
            "success": 0.5,
            "duty": 0.25,
            "steps_per_s": 4e5,
            "error/position": 0.05,
            "error/attitude": 0.1,
        }
    ]
    members = [SimpleNamespace(rows=rows, solved=k == 0) for k in range(3)]
    members[1].rows = [rows[0] | {"steps": 1_000_000, "success": 0.75}]
    members[2].rows = [rows[0] | {"success": 1.0}]
    results = [
        {
            "member": k,
            "seed": 10 + k,
            "ppo.gamma": 0.9,
            "solved": m.solved,
            "diverged": k == 1,
            **m.rows[-1],
        }
        for k, m in enumerate(members)
    ]
    return SimpleNamespace(
        members=members, varied=["ppo.gamma"], results=lambda: results, best=lambda: members[0]
    )


def test_the_table_of_a_sweep() -> None:
    table = _table(swept())
    columns = [[str(cell) for cell in column] for column in zip(*table.rows, strict=True)]
    assert [column[0] for column in columns] == [
        "10",
        "0.9",
        "yes",
        "2.00",
        "3.00",
        "50.00",
        "25.00",
        "5.00",
        "5.73",
    ]
    assert [column[1] for column in columns][2:6] == ["diverged", "1.00", "3.00", "75.00"]
    assert table.marked == [0]


def test_an_agent_in_detail(monkeypatch: pytest.MonkeyPatch) -> None:
    card = {
        "task": "go-to-pose",
        "spacecraft": "x",
        "episodes": 1024,
        "evaluation_seed": 7,
        "training": {"seed": 3, "steps": 2_000_000, "seconds": 4.25, "device": "cuda"},
        "evaluation": {
            "own": {"": {"settling time": [None, 2.5, "inf", "s"], "duty": [7.25, 7.0, 7.5, "%"]}}
        },
    }
    monkeypatch.setattr("rans.cli.details.pretrained_card", lambda _: card)
    title, made, *_, table = _agent_details("go-to-pose-2d")
    assert str(title).startswith("go-to-pose-2d: go-to-pose with x, in ")
    assert made == (
        "Trained with seed 3 for 2,000,000 steps in 4.2 s on cuda; judged on 1,024 episodes of "
        "seed 7."
    )
    assert isinstance(table, Table)
    assert [list(row) for row in (table.columns, *table.rows)] == [
        ["metric", "value", "95 % interval"],
        ["settling time", "never", "2.5 to never"],
        ["duty", "7.25 %", "7 to 7.5"],
    ]


def study_of(*checks: Check, skipped: tuple[Skipped, ...] = ()) -> Study:
    return Study("x", checks, {"seconds": 1.5}, skipped)


def test_validate_says_what_failed_and_where(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    good = Check("mass", 0.0, 1e-9, "kg", "Rounding.", "state 2")
    bad = Check("way", 1.0, 1e-9, "m", "Truncation.", "flight 7")
    found = study_of(good, bad, skipped=(Skipped("kernel", "No compiler."),))
    monkeypatch.setattr(validation.study.study, "study", lambda *_: found)
    monkeypatch.setenv("COLUMNS", "120")
    assert main(["validate"]) == 1
    printed = capsys.readouterr().out
    assert "FAIL way (flight 7). Its tolerance: Truncation." in printed
    assert "not run kernel: No compiler." in printed
    assert "1 of 2 checks passed in 1.5 s." in printed
    monkeypatch.setattr(validation.study.study, "study", lambda *_: study_of(good))
    assert main(["validate"]) == 0
    assert "1 of 1 checks passed in 1.5 s." in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.usefixtures("here", "undrawn")
def test_engines_that_disagree_end_with_code_1(monkeypatch: pytest.MonkeyPatch) -> None:
    table = EngineComparison("title", (), 1.0).table
    disagree = SimpleNamespace(passed=False, table=table, to_json=dict)
    monkeypatch.setattr("rans.evaluation.measure.agreement.compare_engines", lambda *_: disagree)
    arguments = ["evaluate", "lqr:go-to-pose-2d", "--episodes", "1", "--engine", "both"]
    assert main(arguments) == 1
    monkeypatch.setattr(
        "rans.evaluation.measure.agreement.compare_engines",
        lambda *_: EngineComparison("title", (), 1.0),
    )
    assert main(arguments) == 0


@pytest.mark.filterwarnings("always:LQR's solver stopped")
@pytest.mark.usefixtures("here", "undrawn")
def test_a_solver_that_stopped_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from rans.evaluation.fly import episodes

    true = episodes.fly_episodes
    monkeypatch.setattr(
        episodes, "fly_episodes", lambda *a, **k: replace(true(*a, **k), stopped=42)
    )
    assert main(["evaluate", "lqr:go-to-pose-2d", "--episodes", "1"]) == 0
    assert "rans: warning: LQR's solver stopped 42 times; the previous plan was continued." in (
        capsys.readouterr().err
    )


def test_horizons_of_optimal_trajectories() -> None:
    """25 s for the reward, whose episodes are so long, and 20 s for everything else."""
    assert [objective_of(name).intervals for name in ("reward", "fuel", "tracking")] == [
        125,
        100,
        100,
    ]


def test_notes_of_a_comparison_are_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also beside names that are no mark-up, and all files are written before."""

    def fill(comparison: Any, *_: object, **__: object) -> None:
        comparison.notes.append("No certificate [/red].")
        comparison.failures.append("LQR [bold]failed.")

    monkeypatch.setattr("rans.evaluation.compare.run.Comparison.fly", fill)
    assert main(f"compare lqr:go-to-pose-2d --with lqr --output {tmp_path}".split()) == 1
    assert capsys.readouterr().out.splitlines()[:2] == [
        "No certificate [/red].",
        "LQR [bold]failed.",
    ]
    assert "No certificate [/red]." in (tmp_path / "compare.html").read_text()


@pytest.mark.parametrize(
    "command",
    [
        "evaluate lqr:go-to-pose-2d --episodes",
        "view lqr:go-to-pose-2d --episodes",
        "compare lqr:go-to-pose-2d --episodes",
        "optimal go-to-pose --episodes",
        "follow lqr:track-velocity-2d --episodes",
        "export runs/x --output y --episodes",
    ],
)
@pytest.mark.parametrize("count", ["0", "-1", "2147483648", "99999999999999999999"])
def test_counts_beyond_31_bits_are_a_sentence(
    command: str, count: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*command.split(), count]) == 2
    assert capsys.readouterr().err == (
        f"rans: {command.split()[-1]} must be >= 1 and < 2^31, got {count}.\n"
    )


STYLES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
COLUMNS = 80
AGENT = "pretrained:go-to-pose-2d"
COMMANDS = {
    "list": [],
    "list lab": [],
    "list orbit": [],
    "list TASKS": [],
    "list SPACECRAFT": [],
    "list AGENTS": [],
    "list CONTROLLERS": [],
    "list CONDITIONS": [],
    "list free-flyer": ["-0.219 -0.219 0"],
    f"list {AGENT}": [],
    "faults floating-platform --picture picture.svg": [],
    f"assure {AGENT} --episodes 300": ["flights", "any failure", "not finite", "0.0152"],
    f"assure {AGENT} --failure-below 1e-4 --episodes 0": [],
    f"evaluate {AGENT} --episodes 4": [],
    "sweep go-to-pose --seeds 1 --set total_timesteps=8192 --output a/folder/whose/name/is/rather/long/for": [],
    "validate --quick --layer thrusters --output shown": [],
}
"""Each with cells or words that must be whole."""


@pytest.mark.usefixtures("here", "undrawn")
@pytest.mark.parametrize(
    "command",
    COMMANDS,
)
def test_it_fits(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", str(COLUMNS))
    monkeypatch.setenv("FORCE_COLOR", "1")  # what Rich takes for a terminal
    assert main(command.split()) == 0
    lines = [STYLES.sub("", line).split("\r")[-1] for line in capsys.readouterr().out.splitlines()]
    assert max(map(len, lines)) <= COLUMNS
    for whole in COMMANDS[command]:
        assert any(whole in line for line in lines), whole
