from __future__ import annotations

import gc
import weakref
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from stable_baselines3.common.logger import Logger
from torch import Tensor

from rans.errors import ConfigError
from rans.fast.engine import Engine
from rans.fast.learn import batched
from rans.fast.learn.batched import BatchedPPO, Start
from rans.fast.learn.batched_trainer import BatchedTrainer, Member
from rans.fast.learn.curriculum import Ramp
from rans.fast.learn.members import MembersEngine
from rans.fast.learn.sweep import Sweep
from rans.fast.learn.trainer import make_ppo
from rans.tasks import GoToPose, MultiTask, TrackTwist
from tests.fast.engines import NEAR, PLATFORM, SHORT, actions, both_crafts
from tests.fast.training import CONFIG, TINY, ignore, tiny_trainer

CHOICES: list[dict[str, Any]] = [
    {"learning_rate": 2.0**-10},  # exact in float32, in which PPO keeps it
    {"learning_rate": 2.0**-9, "gamma": 0.9, "ent_coef": 0.01, "clip_range": 0.1, "reward_scale": 0.3,
     "max_learning_rate": 2.0**-9, "anneal": 0.8},
    {"learning_rate": 2.0**-8, "desired_kl": None, "max_grad_norm": 0.05, "vf_coef": 1.0, "gae_lambda": 0.8},
]
TASKS = [NEAR, replace(NEAR, position_scale=0.1, thrust_weight=0.5, switching_weight=0.1),
         replace(NEAR, spawn_distance=(0.2, 0.3), fail_distance=0.4)]


def starts(craft: Any = PLATFORM, dtype: torch.dtype = torch.float64) -> list[Start]:
    """Three trainings that differ in everything in which members may."""
    result = []
    for seed, (choice, task) in enumerate(zip(CHOICES, TASKS, strict=True)):
        settings = replace(TINY, **choice)
        model = make_ppo(Engine(craft, task, 16, SHORT, seed=seed, dtype=dtype), settings, seed)
        model.set_logger(Logger(None, []))
        model.start()
        result.append(Start(model, torch.get_rng_state()))
    return result


def trained(ppo: BatchedPPO, iterations: int) -> BatchedPPO:
    for _ in range(iterations):
        ppo.slow_down(0.4)
        ppo.collect()
        ppo.update()
    return ppo


@both_crafts
def test_a_member_learns_what_it_would_alone(craft: Any) -> None:
    """Rollout, advantages, losses, clipping, Adam, step size and statistics, for two whole iterations."""
    begun = starts(craft)
    together = trained(BatchedPPO(begun, torch.device("cpu")), 2)
    for number, (model, random) in enumerate(begun):
        torch.set_rng_state(random)
        model._current_progress_remaining = 1.0
        before = {name: p.clone() for name, p in model.policy.named_parameters()}
        for _ in range(2):
            model.slow_down(0.4)
            model.collect()
            model.train()
        weights = together.network.member(number)
        for name, alone in (*model.policy.named_parameters(), *model.policy.named_buffers()):
            # PPO rounds a step size divided by 1.5 to float32: 6e-8 of the 1e-2 that weights moved.
            torch.testing.assert_close(weights[name], alone, rtol=0, atol=1e-8, msg=name)
            if name in before:
                assert (alone - before[name]).abs().max() > 1e-3, name


def test_starts_are_not_shared() -> None:
    """Glued together, each member flies the episodes of its own seed."""
    begun = starts()
    observation = BatchedPPO(begun, torch.device("cpu")).engine.observe()
    alone = [start.model.env.engine.observe() for start in begun]  # type: ignore[union-attr]
    assert torch.equal(observation, torch.cat(alone))
    assert not torch.equal(alone[0], alone[1])


def test_an_engine_of_members_is_their_engines(backend: Callable[..., Engine]) -> None:
    """Through many restarts, with settings that are fields: numbers, ranges, and one that adds a term."""
    engines = [backend(PLATFORM, task, 16, SHORT, seed=seed) for seed, task in enumerate(TASKS)]
    compiled = None if backend is Engine else True
    together = MembersEngine(PLATFORM, TASKS, 16, SHORT, compiled=compiled)
    together.adopt(engines)
    ends = 0
    for command in actions(PLATFORM, 48, 50):
        alone = [engine.step(part) for engine, part in zip(engines, command.chunk(3), strict=True)]
        step = together.step(command)
        ends += int((step.terminated | step.truncated).sum())
        for name in ("observation", "reward", "terminated", "truncated", "final_observation", "reached"):
            # A float32 field divides where a Python number was divided in float64 and then rounded.
            torch.testing.assert_close(getattr(step, name), torch.cat([getattr(s, name) for s in alone]),
                                       rtol=1e-5, atol=1e-6, msg=name)
    assert ends > 150


def test_nested_settings_and_every_error() -> None:
    """Members of a multi-task may differ in the settings of its parts."""
    tasks = [MultiTask(tasks=("go-to-pose", "track-twist"), track_twist=TrackTwist(velocity_scale=scale))
             for scale in (0.1, 0.9)]
    configs = [replace(CONFIG, task="multi-task", settings=task, total_timesteps=128) for task in tasks]
    sweep = Sweep(configs)
    assert sweep.varied == ["settings.track_twist.velocity_scale"]
    sweep.train(ignore)
    assert {"error/go-to-pose/attitude", "error/track-twist/spin"} <= set(sweep.results()[0])


def test_the_update_is_one_graph(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a GPU compiles can be compiled without a break, and computes the same."""
    begun = starts(dtype=torch.float32)
    plain = trained(BatchedPPO(begun, torch.device("cpu")), 2)
    monkeypatch.setattr(batched, "fused", lambda function, _: torch.compile(
        function, fullgraph=True, dynamic=False, backend="eager"))
    captured = trained(BatchedPPO(begun, torch.device("cpu")), 2)
    for name, tensor in plain.network.tensors.items():
        assert torch.equal(tensor, captured.network.tensors[name]), name


EASY = GoToPose(evaluation_distance=(0.1, 0.2), position_tolerance=7.9, attitude_tolerance=4.0)
"""Solved by whoever stays within 7.9 m."""


def test_a_sweep_ends_as_trainings_do(tmp_path: Path) -> None:
    """The second report in a row that finds it solved ends a member, and its weights are of then."""
    config = replace(CONFIG, settings=EASY, seed=5, solved_share=0.01, report_interval=3,
                     total_timesteps=10**9)
    alone = tiny_trainer(tmp_path, config)
    alone.train(ignore)
    sweep = Sweep([config, replace(config, settings=replace(EASY, position_tolerance=1e-4))])
    sweep.train(ignore, lambda: len(sweep.members[1].rows) == 4)
    member, rows = sweep.members[0], alone.run.metrics()
    assert [row["steps"] for row in member.rows] == [row["steps"] for row in rows] == [384, 768]
    assert [row["steps"] for row in sweep.members[1].rows] == [384, 768, 1152, 1536, 1664]
    assert (member.solved, sweep.members[1].solved) == (True, False)
    for name, weight in alone.model.policy.named_parameters():
        # Adam's steps of 1e-3 differ by the rounding of float32 sums taken in another order.
        torch.testing.assert_close(member.weights[name], weight.detach(), rtol=0, atol=1e-4, msg=name)
    for ours, theirs in zip(member.rows, rows, strict=True):
        assert ours["success"] == pytest.approx(theirs["success"], abs=3 / 1024)
        assert ours["error/position"] == pytest.approx(theirs["error/position"], rel=1e-2)
        assert 0.0 < ours["duty"] < 1.0


def test_one_that_diverges_disturbs_nobody() -> None:
    healthy = replace(CONFIG, seed=1, total_timesteps=512)
    broken = replace(healthy, ppo=replace(TINY, reward_scale=1e38))
    both, one = Sweep([broken, healthy]), Sweep([healthy])
    both.train(ignore)
    one.train(ignore)
    assert [row["diverged"] for row in both.results()] == [True, False]
    for name, weight in one.members[0].weights.items():
        torch.testing.assert_close(both.members[1].weights[name], weight, rtol=0, atol=1e-4)
    assert both.best() is both.members[1]


def test_what_cannot_train_together_trains_in_turn() -> None:
    settings = [replace(TINY, layers=layers, learning_rate=rate)
                for layers in ((16, 16), (8,)) for rate in (1e-3, 3e-4)]
    short = replace(CONFIG, total_timesteps=128)
    configs = [replace(short, seed=seed, ppo=ppo) for ppo in settings for seed in (0, 1)]
    sweep, seen = Sweep(configs[::-1]), []
    sweep.train(lambda batch: seen.append([configs.index(member.config) for member in batch]))
    assert seen == [[7, 6, 5, 4], [3, 2, 1, 0]]
    assert sweep.varied == ["ppo.learning_rate", "ppo.layers"]
    assert [len(group) for group in sweep.configs()] == [2, 2, 2, 2]
    assert sweep.members[7].weights["action_net.weight"].shape == (16, 16)
    assert sweep.members[0].weights["action_net.weight"].shape == (16, 8)


def test_a_batch_frees_what_the_one_before_held(monkeypatch: pytest.MonkeyPatch) -> None:
    batches: list[weakref.ref[BatchedTrainer]] = []

    def begun(members: Any) -> BatchedTrainer:
        trainer = BatchedTrainer(members)
        cycle: list[Any] = [trainer]  # as on a GPU, where its functions know it
        cycle.append(cycle)
        assert all(batch() is None for batch in batches)
        batches.append(weakref.ref(trainer))
        return trainer

    monkeypatch.setattr("rans.fast.learn.sweep.BatchedTrainer", begun)
    short = replace(CONFIG, total_timesteps=128)
    gc.disable()
    try:
        Sweep([replace(short, ppo=replace(TINY, layers=layers)) for layers in ((16, 16), (8,))]).train(ignore)
    finally:
        gc.enable()
    assert len(batches) == 2


def test_a_stop_keeps_what_there_is() -> None:
    """The batch in training reports once more; those behind it never begin."""
    sweep, asked = Sweep([CONFIG, replace(CONFIG, ppo=replace(TINY, layers=(8,)))]), iter(range(9))
    sweep.train(ignore, lambda: next(asked) >= 3)
    assert [[row["steps"] for row in member.rows] for member in sweep.members] == [[384], []]
    assert len(sweep.results()) == 1
    assert sweep.best() is sweep.members[0]


def test_a_warm_up_that_takes_all_steps_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where few steps are wanted of a GPU, which compiles and records in the first iterations."""
    monkeypatch.setattr(BatchedTrainer, "_warm_up", lambda trainer: [trainer._iterate() for _ in range(3)])
    sweep = Sweep([replace(CONFIG, total_timesteps=384)])
    sweep.train(ignore)
    assert [row["steps"] for row in sweep.best().rows] == [384]
    assert not sweep.best().diverged


def ended(seed: int, rate: float, steps: int, success: float) -> Member:
    member = Member(replace(CONFIG, seed=seed, solved_share=0.9, ppo=replace(TINY, learning_rate=rate)))
    for _ in range(2):
        member.note({"steps": steps, "success": success})
    return member


@pytest.mark.parametrize(("outcomes", "best"), [
    ([(1, 100, 1.0), (1, 900, 1.0), (2, 300, 1.0), (2, 310, 1.0)], 2),  # the luckiest seed is of the worse
    ([(1, 100, 1.0), (1, 900, 0.8), (2, 700, 1.0), (2, 600, 1.0)], 3),  # one never solved it
    ([(1, 900, 0.5), (1, 900, 0.5), (2, 900, 0.7), (2, 900, 0.4)], 2),  # nobody did
])
def test_the_best_seed_of_the_best_config(outcomes: list[tuple[float, int, float]], best: int) -> None:
    sweep = Sweep([CONFIG])
    sweep.members = [ended(seed, *outcome) for seed, outcome in enumerate(outcomes)]
    assert sweep.members.index(sweep.best()) == best


def test_configs_that_cannot_work() -> None:
    with pytest.raises(ConfigError, match="batch_size must be a multiple of n_steps"):
        Sweep([CONFIG, replace(CONFIG, ppo=replace(TINY, batch_size=60))])
    with pytest.raises(ConfigError, match="a sweep cannot train with a curriculum"):
        Sweep([replace(CONFIG, curriculum=(Ramp("thrust_weight", 0.0, 100),))])


def test_weights_come_back_from_a_run_folder(tmp_path: Path) -> None:
    """What is saved flies as the member did."""
    from rans.evaluation.fly.agent import load_agent

    sweep = Sweep([replace(CONFIG, total_timesteps=256, seed=seed) for seed in (0, 1)])
    sweep.train(ignore)
    assert sweep.timed_steps == 2 * 256
    member = sweep.members[1]
    member.save(tmp_path / "best", "rans sweep")
    loaded = load_agent(tmp_path / "best")
    policy: Any = loaded.controller._policy  # type: ignore[attr-defined]
    tensors: dict[str, Tensor] = dict((*policy.named_parameters(), *policy.named_buffers()))
    assert {name for name in tensors} == set(member.weights)
    assert all(torch.equal(tensors[name], weight) for name, weight in member.weights.items())
