from __future__ import annotations

import gc
import weakref
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from rans.errors import ConfigError
from rans.evaluation.fly.agent import Agent, load_policy
from rans.fast.engine import Engine
from rans.fast.learn import adam, ppo
from rans.fast.learn.config import MemorySettings, ScheduleSettings
from rans.fast.learn.curriculum import Curriculum, Ramp
from rans.fast.learn.member import Member, begin
from rans.fast.learn.ppo import PPOLearner
from rans.fast.learn.sweep import Sweep, read_configs
from rans.fast.learn.trainer import Trainer
from rans.fast.stepping.step import field_dtype
from rans.tasks import GoToPose, MultiTask, TrackTwist
from tests.support.engines import FLYER, NEAR, PLATFORM, SHORT
from tests.support.training import CONFIG, TINY, after, ignore, tiny_trainer

CHOICES: list[dict[str, Any]] = [
    {"learning_rate": 2.0**-10},  # exact in float32, in which PPO keeps it
    {
        "learning_rate": 2.0**-9,
        "gamma": 0.9,
        "reward_scale": 0.3,
        "schedule": ScheduleSettings(max_learning_rate=2.0**-9, anneal=0.8),
    },
    {
        "learning_rate": 2.0**-8,
        "schedule": ScheduleSettings(anneal=0.3),
        "gae_lambda": 0.8,
    },
]
TASKS = [
    NEAR,
    replace(NEAR, approach_weight=0.1, thrust_weight=0.5, spin_weight=0.1),
    replace(NEAR, spawn_distance=(0.2, 0.3), fail_distance=0.4),
]


def together(
    craft: Any = PLATFORM,
    dtype: torch.dtype = torch.float64,
    only: int | None = None,
    **settings: Any,
) -> PPOLearner:
    """Three trainings that differ in everything in which members may, or only one of them."""
    numbers = range(3) if only is None else [only]
    tasks = [TASKS[n] for n in numbers]
    fields = field_dtype(torch.device("cpu"), dtype)
    engine = Engine(
        craft,
        Curriculum(tasks, (), fields, each=16).task,
        16 * len(tasks),
        SHORT,
        seed=numbers,
        dtype=dtype,
    )
    return begin(engine, [replace(TINY, **CHOICES[n], **settings) for n in numbers], numbers)


def trained(learner: PPOLearner, iterations: int) -> PPOLearner:
    for _ in range(iterations):
        learner.slow_down(0.4)
        learner.collect()
        learner.update()
    return learner


@pytest.mark.parametrize(
    ("craft", "kind"),
    [
        (PLATFORM, {}),
        (
            FLYER,
            {"memory": MemorySettings("history"), "privileged_critic": True},
        ),
    ],
    ids=["plain", "history"],
)
def test_a_member_learns_what_it_would_alone(craft: Any, kind: dict[str, Any]) -> None:
    """Rollout, advantages, losses, clipping, Adam, step size and statistics, for two whole iterations."""
    begun = together(craft, **kind)
    before = [begun.network.member(number) for number in range(3)]
    trained(begun, 2)
    for number in range(3):
        alone = trained(together(craft, only=number, **kind), 2).network
        ours = begun.network.member(number)
        for name, weight in alone.tensors.items():
            # Sums of float64 in another order, divided by gradients as small as 1e-5.
            torch.testing.assert_close(ours[name], weight.detach(), rtol=0, atol=1e-8, msg=name)
            assert (ours[name] - before[number][name]).abs().max() > 1e-3, name


def test_nested_settings_and_every_error(tmp_path: Path) -> None:
    """Members of a multi-task may differ in the settings of its parts."""
    tasks = [
        MultiTask(tasks=("go-to-pose", "track-twist"), track_twist=TrackTwist(velocity_scale=scale))
        for scale in (0.1, 0.9)
    ]
    configs = [
        replace(CONFIG, task="multi-task", settings=task, total_timesteps=128) for task in tasks
    ]
    sweep = Sweep(configs, tmp_path)
    assert sweep.varied == ["settings.track_twist.velocity_scale"]
    sweep.train(ignore)
    assert {"error/go-to-pose/attitude", "error/track-twist/spin"} <= set(sweep.results()[0])


@pytest.mark.slow
def test_the_update_is_one_graph(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a GPU compiles can be compiled without a break, and computes the same."""
    plain = trained(together(dtype=torch.float32), 2)
    for module in (ppo, adam):
        monkeypatch.setattr(
            module,
            "fused",
            lambda function, *_: torch.compile(
                function, fullgraph=True, dynamic=False, backend="eager"
            ),
        )
    captured = trained(together(dtype=torch.float32), 2)
    for name, tensor in plain.network.tensors.items():
        # The compiler takes Adam's norms and powers apart: the last bit of float32 differs.
        torch.testing.assert_close(
            captured.network.tensors[name], tensor, rtol=0, atol=2e-6, msg=name
        )


EASY = GoToPose(evaluation_distance=(0.1, 0.2), position_tolerance=7.9, attitude_tolerance=4.0)
"""Solved by whoever stays within 7.9 m."""


@pytest.mark.slow
def test_a_sweep_ends_as_trainings_do(tmp_path: Path) -> None:
    """The second report in a row that finds it solved ends a member, and its weights are of then."""
    config = replace(
        CONFIG, settings=EASY, seed=5, solved_share=0.01, report_interval=3, total_timesteps=10**9
    )
    alone = tiny_trainer(tmp_path / "alone", config)
    alone.train(ignore)
    sweep = Sweep(
        [config, replace(config, settings=replace(EASY, position_tolerance=1e-4))], tmp_path
    )
    sweep.train(ignore, lambda: len(sweep.members[1].rows) == 4)
    member = sweep.members[0]
    rows = alone.run.metrics()
    assert [row["steps"] for row in member.rows] == [row["steps"] for row in rows] == [384, 768]
    assert [row["steps"] for row in sweep.members[1].rows] == [384, 768, 1152, 1536, 1664]
    assert (member.solved, sweep.members[1].solved) == (True, False)
    for name, weight in alone.learner.network.tensors.items():
        # Adam's steps of 1e-3 differ by the rounding of float32 sums taken in another order.
        torch.testing.assert_close(
            member.weights[name], weight.detach(), rtol=0, atol=1e-4, msg=name
        )
    for ours, theirs in zip(member.rows, rows, strict=True):
        assert ours["success"] == pytest.approx(theirs["success"], abs=3 / 1024)
        assert ours["error/position"] == pytest.approx(theirs["error/position"], rel=1e-2)
        assert 0.0 < ours["duty"] < 1.0


def test_one_that_diverges_disturbs_nobody(tmp_path: Path) -> None:
    healthy = replace(CONFIG, seed=1, total_timesteps=512)
    broken = replace(healthy, ppo=replace(TINY, reward_scale=1e38))
    both = Sweep([broken, healthy], tmp_path / "both")
    one = Sweep([healthy], tmp_path / "one")
    both.train(ignore)
    one.train(ignore)
    assert [row["diverged"] for row in both.results()] == [True, False]
    for name, weight in one.members[0].weights.items():
        torch.testing.assert_close(both.members[1].weights[name], weight, rtol=0, atol=1e-4)
    assert both.best() is both.members[1]


def test_what_cannot_train_together_trains_in_turn(tmp_path: Path) -> None:
    settings = [
        replace(TINY, layers=layers, learning_rate=rate)
        for layers in ((16, 16), (8,))
        for rate in (1e-3, 3e-4)
    ]
    short = replace(CONFIG, total_timesteps=128)
    configs = [replace(short, seed=seed, ppo=ppo) for ppo in settings for seed in (0, 1)]
    sweep = Sweep(configs[::-1], tmp_path)
    seen = []
    sweep.train(lambda batch: seen.append([configs.index(member.config) for member in batch]))
    assert seen == [[7, 6, 5, 4], [3, 2, 1, 0]]
    assert sweep.varied == ["ppo.learning_rate", "ppo.layers"]
    assert [len(group) for group in sweep.configs()] == [2, 2, 2, 2]
    assert sweep.members[7].weights["action_net.weight"].shape == (16, 16)
    assert sweep.members[0].weights["action_net.weight"].shape == (16, 8)


def test_a_batch_frees_what_the_one_before_held(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    batches: list[weakref.ref[Trainer]] = []

    def begun(*arguments: Any, **settings: Any) -> Trainer:
        trainer = Trainer(*arguments, **settings)
        cycle: list[Any] = [trainer]  # as on a GPU, where its functions know it
        cycle.append(cycle)
        assert all(batch() is None for batch in batches)
        batches.append(weakref.ref(trainer))
        return trainer

    monkeypatch.setattr("rans.fast.learn.sweep.Trainer", begun)
    short = replace(CONFIG, total_timesteps=128)
    gc.disable()
    try:
        Sweep(
            [replace(short, ppo=replace(TINY, layers=layers)) for layers in ((16, 16), (8,))],
            tmp_path,
        ).train(ignore)
    finally:
        gc.enable()
    assert len(batches) == 2


def test_a_stop_keeps_what_there_is(tmp_path: Path) -> None:
    """The batch in training reports once more; those behind it never begin."""
    sweep = Sweep([CONFIG, replace(CONFIG, ppo=replace(TINY, layers=(8,)))], tmp_path)
    asked = iter(range(9))
    sweep.train(ignore, lambda: next(asked) >= 3)
    assert [[row["steps"] for row in member.rows] for member in sweep.members] == [[384], []]
    assert len(sweep.results()) == 1
    assert sweep.best() is sweep.members[0]


def test_a_warm_up_that_takes_all_steps_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where few steps are wanted of a GPU, which compiles and records in the first iterations."""
    monkeypatch.setattr(Trainer, "_warm_up", lambda trainer: [trainer._iterate() for _ in range(3)])
    sweep = Sweep([replace(CONFIG, total_timesteps=384)], tmp_path)
    sweep.train(ignore)
    assert [row["steps"] for row in sweep.best().rows] == [384]
    assert not sweep.best().diverged


def ended(seed: int, rate: float, steps: int, success: float) -> Member:
    member = Member(
        replace(CONFIG, seed=seed, solved_share=0.9, ppo=replace(TINY, learning_rate=rate))
    )
    for _ in range(2):
        member.note({"steps": steps, "success": success}, member.finds_solved(success))
    return member


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


def test_configs_that_cannot_work(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="batch_size must be a multiple of n_steps"):
        Sweep([CONFIG, replace(CONFIG, ppo=replace(TINY, batch_size=60))], tmp_path / "sweep")
    assert not (tmp_path / "sweep").exists()


RAMPED = [
    replace(
        CONFIG,
        seed=seed,
        report_interval=4,
        curriculum=(Ramp("thrust_weight", 0.5, 1500),),
        settings=replace(GoToPose(), thrust_weight=weight),
        ppo=replace(TINY, gamma=gamma),
    )
    for seed, weight, gamma in ((0, 0.1, 0.98), (1, 0.2, 0.9))
]


@pytest.mark.slow
def test_a_sweep_follows_the_members_own_curricula(tmp_path: Path) -> None:
    """Each as it would alone."""
    sweep = Sweep(RAMPED, tmp_path / "sweep")
    sweep.train(ignore)
    for number, config in enumerate(RAMPED):
        alone = tiny_trainer(tmp_path / str(number), config)
        alone.train(ignore)
        for name, weight in alone.learner.network.tensors.items():
            # Sixteen iterations of float32 sums in another order.
            ours = sweep.members[number].weights[name]
            torch.testing.assert_close(ours, weight.detach(), rtol=1e-3, atol=2e-3, msg=name)
        assert (tmp_path / "sweep/batches/0/tensorboard" / str(number)).is_dir()


@pytest.mark.slow
def test_a_resumed_sweep_ends_as_if_never_stopped(tmp_path: Path) -> None:
    """Bit by bit, with the same reports but for the one at the stop; solved members stay as they were."""
    configs = [*RAMPED, replace(RAMPED[0], seed=2, ppo=replace(TINY, layers=(8,)))]
    whole = Sweep(configs, tmp_path / "whole")
    whole.train(ignore)
    Sweep(configs, tmp_path / "cut", "rans sweep of mine").train(ignore, after(6))
    read, command, parts = read_configs(tmp_path / "cut")
    assert (read, command, parts) == (configs, "rans sweep of mine", 1)
    again = Sweep(read, tmp_path / "cut", command)
    again.train(ignore)
    for ours, theirs in zip(again.members, whole.members, strict=True):
        assert [row["steps"] for row in theirs.rows] == [512, 1024, 1536, 2048]
        assert {row["steps"] for row in ours.rows} - {640} == {row["steps"] for row in theirs.rows}
        assert ours.rows[-1]["train/loss"] == theirs.rows[-1]["train/loss"]
        for name, weight in theirs.weights.items():
            assert torch.equal(ours.weights[name], weight), name


def test_two_sweeps_in_one_folder(tmp_path: Path) -> None:
    """The second is refused, and the first's configs stay: while it trains, and after that."""

    def sweep(seed: int) -> Sweep:
        return Sweep([replace(CONFIG, seed=seed, total_timesteps=128)], tmp_path)

    refused: list[str] = []

    def meanwhile(_: Any) -> None:
        with pytest.raises(ConfigError) as caught:
            sweep(7).train(ignore)
        refused.append(str(caught.value))

    sweep(0).train(meanwhile)
    assert refused
    assert all("is being trained by another sweep" in sentence for sentence in refused)
    with pytest.raises(ConfigError, match="holds another sweep already"):
        sweep(7).train(ignore)
    assert [config.seed for config in read_configs(tmp_path)[0]] == [0]


def test_a_folder_without_a_sweep(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"is not a sweep's folder: it has no configs\.json"):
        read_configs(tmp_path)


def test_weights_come_back_from_a_run_folder(tmp_path: Path) -> None:
    """What is saved flies as the member did."""
    sweep = Sweep(
        [replace(CONFIG, total_timesteps=256, seed=seed) for seed in (0, 1)], tmp_path / "sweep"
    )
    sweep.train(ignore)
    assert sweep.timed_steps == 2 * 256
    member = sweep.members[1]
    sweep.save(member, tmp_path / "best")
    loaded = load_policy(tmp_path / "best")
    assert isinstance(loaded.controller, Agent)
    tensors = loaded.controller.network.tensors
    assert set(tensors) == set(member.weights)
    assert all(torch.equal(tensors[name], weight) for name, weight in member.weights.items())
