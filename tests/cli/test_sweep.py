from __future__ import annotations

import json
import re
import signal
from pathlib import Path
from typing import Any

import pytest

from rans.cli import main
from rans.cli.sweep import Sweep
from rans.cli.train import Train
from rans.evaluation.fly.agent import load_policy
from rans.fast.learn.run_folder import RunFolder
from rans.randomization.conditions_file import load_conditions
from tests.support.training import as_sb3

TINY = {
    "ppo.n_envs": "16",
    "ppo.n_steps": "8",
    "ppo.batch_size": "64",
    "timing.episode_steps": "20",
    "solved_share": "null",
}


def tiny(**changes: str) -> list[str]:
    """Arguments for a sweep whose iterations take milliseconds."""
    settings = (
        {"ppo.layers": "[16, 16]"} | TINY | {k.replace("__", "."): v for k, v in changes.items()}
    )
    given = [part for key, value in settings.items() for part in ("--set", f"{key}={value}")]
    return ["sweep", "go-to-pose", *given]


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs go to a folder of the test's own, and what the command sets ends with it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TORCHINDUCTOR_COMPILE_THREADS", "1")
    monkeypatch.setattr("rans.processes.processors", lambda: 1)


def test_a_sweep_leaves_table_figure_and_best_agent(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*tiny(ppo__gamma="0.9,0.98"), "--seeds", "2", "--set", "total_timesteps=256"]) == 0
    folder = Path("runs/sweep-go-to-pose-floating-platform")
    captured = capsys.readouterr()
    assert "Done: 0 of 4 members solved, " in captured.out
    said = re.search(r"solved, (.*) s of training \((.*) steps/s of all together\)", captured.out)
    assert said is not None
    assert int(said[2].replace(",", "")) > 0
    assert f"The best agent is {folder}/best." in captured.out
    assert captured.out.count(" no ") == 4
    for head in ("seed", "gamma", "steps", "success", "duty", "cm", "deg"):
        assert head in captured.out
    assert {file.name for file in folder.iterdir()} == {
        "sweep.json",
        "metrics.jsonl",
        "best",
        "configs.json",
        "members",
    }
    told = json.loads((folder / "sweep.json").read_text())
    assert [(row["seed"], row["ppo.gamma"]) for row in told["members"]] == [
        (0, 0.9),
        (1, 0.9),
        (0, 0.98),
        (1, 0.98),
    ]
    rows = [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]
    assert [row["member"] for row in rows] == [0, 1, 2, 3]
    check_best(folder, told)


def check_best(folder: Path, told: dict[str, Any]) -> None:
    """It is a run folder of the member that was chosen, which others can read."""
    run = RunFolder(folder / "best")
    chosen = told["members"][told["best"]]
    config = run.config()
    assert (config.seed, config.ppo.gamma) == (chosen["seed"], chosen["ppo.gamma"])
    assert run.metrics()[-1]["steps"] == 256
    assert as_sb3(run.path).num_timesteps == 256
    assert load_policy(run.path).craft.name == "floating-platform"


def test_values_of_every_kind() -> None:
    sweep = Sweep(
        "go-to-pose",
        seeds=1,
        set=(
            "device=cpu",
            "ppo.layers=[64,64],[32]",
            "spacecraft=floating-platform,floating-platform-air-tank",
            "seed=7",
        ),
    )
    found = [(config.ppo.layers, config.spacecraft, config.seed) for config in sweep._configs()]
    assert found == [
        (layers, craft, 7)
        for layers in ((64, 64), (32,))
        for craft in ("floating-platform", "floating-platform-air-tank")
    ]


def test_an_interrupt_keeps_what_there_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    signals = iter([signal.SIGINT])
    monkeypatch.setattr(
        "rans.show.progress.NowAndThen.say", lambda *_: [*map(signal.raise_signal, signals)]
    )
    small = tiny(total_timesteps="128", report_interval="1")
    assert main([*small, "--seeds", "2", "--output", "sweep"]) == 130
    assert "Stopped: 0 of 2 members solved" in capsys.readouterr().out
    assert [row["steps"] for row in RunFolder(Path("sweep/best")).metrics()] == [128]


def test_spacecraft_and_conditions_are_entries_like_others() -> None:
    """Names as in rans train: a craft in space begins with the recipe of space, and each value of a list trains."""
    flyer, lab, nominal = (
        "spacecraft=free-flyer",
        "conditions=lab,harsh",
        'conditions={"description": "still air"}',
    )
    one, other = Sweep("go-to-pose", seeds=1, set=(flyer, lab))._configs()
    assert (one.spacecraft, one.ppo) == (
        "free-flyer",
        Train("go-to-pose", "free-flyer").resolved().ppo,
    )
    assert (one.conditions, other.conditions) == (load_conditions("lab"), load_conditions("harsh"))
    [table] = Sweep("go-to-pose", seeds=1, set=(nominal,))._configs()
    assert table.conditions == Train("go-to-pose", set=(nominal,)).resolved().conditions


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
def test_a_sweep_that_goes_on_replaces_its_best_agent() -> None:
    """Nothing of what was the best before is left among it."""
    assert main([*tiny(), "--seeds", "1", "--set", "total_timesteps=128", "--output", "sweep"]) == 0
    Path("sweep/best/of-before").write_text("")
    assert main(["sweep", "--resume", "sweep"]) == 0
    assert (
        Path("sweep/best/agent.safetensors").exists(),
        Path("sweep/best/of-before").exists(),
    ) == (
        True,
        False,
    )
