"""Sweeps: members are trainings like others, wherever they run and however often they are stopped."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rans.errors import ConfigError
from rans.executors import run_on
from rans.fast.agent_files.agent import read_policy
from rans.fast.learn.curriculum import Ramp
from rans.fast.learn.sweep import Member, Sweep, read_configs
from rans.tasks import GoToPose, MultiTask, TrackTwist
from tests.support.training import CONFIG, TINY, ignore, tiny_trainer

RAMPED = replace(CONFIG, report_interval=4, curriculum=(Ramp("thrust_weight", 0.5, 1500),))
CONFIGS = [
    RAMPED,
    replace(RAMPED, seed=1, settings=GoToPose(thrust_weight=0.2)),
    replace(RAMPED, seed=2, ppo=replace(TINY, layers=(8,))),
]


@pytest.fixture(autouse=True)
def _in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rans.processes.processors", lambda: 1)


def trained(folder: Path) -> dict[str, list[float]]:
    """All weights and statistics of the agent of a run folder."""
    tensors = read_policy(folder / "agent.safetensors").network.tensors
    return {name: tensor.tolist() for name, tensor in tensors.items()}


def test_members_are_trainings_wherever_they_run(tmp_path: Path) -> None:
    """Bit by bit those of a training alone: on an executor, and of a sweep that was stopped and resumed."""
    for number, config in enumerate(CONFIGS):
        tiny_trainer(tmp_path / "alone" / str(number), config).train()
    with ThreadPoolExecutor(1) as pool, run_on(pool):
        Sweep(CONFIGS, tmp_path / "pool").train()
    cut = Sweep(CONFIGS, tmp_path / "cut", "rans sweep of mine")

    def stop(_: Member) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cut.train(stop)
    assert [row["member"] for row in cut.results()] == [0]
    assert cut.best() is cut.members[0]
    read, command = read_configs(tmp_path / "cut")
    assert (read, command) == (CONFIGS, "rans sweep of mine")
    again = Sweep(read, tmp_path / "cut", command)
    again.train(ignore)
    assert again.timed_steps == 2 * 2048
    for number in range(3):
        weights = trained(tmp_path / "alone" / str(number))
        for name in ("pool", "cut"):
            assert trained(tmp_path / name / "members" / str(number)) == weights
        assert [row["steps"] for row in again.members[number].rows] == [512, 1024, 1536, 2048]


def test_what_members_differ_in() -> None:
    tasks = [
        MultiTask(tasks=("go-to-pose", "track-twist"), track_twist=TrackTwist(velocity_scale=scale))
        for scale in (0.1, 0.9)
    ]
    configs = [replace(CONFIG, task="multi-task", settings=task) for task in tasks]
    assert Sweep(configs, Path("nowhere")).varied == ["settings.track_twist.velocity_scale"]


def test_one_that_diverges_disturbs_nobody(tmp_path: Path) -> None:
    healthy = replace(CONFIG, seed=1, total_timesteps=512, report_interval=1)
    broken = replace(healthy, ppo=replace(TINY, learning_rate=1e38))
    both = Sweep([broken, healthy], tmp_path)
    both.train()
    assert [member.diverged for member in both.members] == [True, False]
    assert both.best() is both.members[1]
    assert trained(both.save_best()) == trained(tmp_path / "members/1")
    assert [(row["member"], row["steps"]) for row in both.results()] == [(0, 0), (1, 512)]
    # A config of which a seed diverged is worse than one of which none did; what diverged has ended.
    again = Sweep([broken, healthy], tmp_path)
    again.train()
    assert again.timed_steps == 0


def ended(seed: int, rate: float, steps: int, success: float) -> Member:
    config = replace(
        CONFIG,
        seed=seed,
        solved_share=0.9,
        report_interval=1,
        ppo=replace(TINY, learning_rate=rate),
    )
    row: dict[str, Any] = {"steps": 128 * steps, "success": success, "train/learning_rate": rate}
    return Member(config, [row, row], has_agent=True)


@pytest.mark.parametrize(
    ("outcomes", "best"),
    [
        (
            [(1, 100, 1.0), (1, 900, 1.0), (2, 300, 1.0), (2, 310, 1.0)],
            2,
        ),  # the luckiest seed is of the worse
        ([(1, 100, 1.0), (1, 900, 0.8), (2, 700, 1.0), (2, 600, 1.0)], 3),  # one never solved it
        ([(1, 900, 0.5), (1, 900, 0.5), (2, 900, 0.7), (2, 900, 0.4)], 2),  # nobody did
    ],
)
def test_the_best_seed_of_the_best_config(
    outcomes: list[tuple[float, int, float]], best: int
) -> None:
    sweep = Sweep([CONFIG], Path("nowhere"))
    sweep.members = [ended(seed, *outcome) for seed, outcome in enumerate(outcomes)]
    assert sweep.members.index(sweep.best()) == best


def test_folders_that_are_refused(tmp_path: Path) -> None:
    """A config that cannot work, a folder of another sweep or of none; what was there before stays."""
    short = replace(CONFIG, total_timesteps=128)
    with pytest.raises(ConfigError, match="batch_size must be a multiple of n_steps"):
        Sweep([short, replace(short, ppo=replace(TINY, batch_size=60))], tmp_path / "sweep")
    assert not (tmp_path / "sweep").exists()
    Sweep([short], tmp_path / "sweep").train()
    with pytest.raises(ConfigError, match="holds another sweep already"):
        Sweep([replace(short, seed=7)], tmp_path / "sweep").train()
    assert [config.seed for config in read_configs(tmp_path / "sweep")[0]] == [0]
    with pytest.raises(ConfigError, match=r"is not a sweep's folder: it has no configs\.json"):
        read_configs(tmp_path)
