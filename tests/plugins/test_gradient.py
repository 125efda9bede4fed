"""The gradient of the return through the motion: against differences, against one member alone, end to end."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import torch
from rans_gradient.learner import GradientLearner, GradientSettings

from rans.cli import main
from rans.errors import ConfigError
from rans.fast.engine import Engine
from rans.fast.learn.beginning import begin
from rans.fast.learn.config import MemorySettings, TrainConfig, change_entry, from_table, to_table
from rans.model.actuators import Pulsed, Throttle
from rans.model.spacecraft_file import to_toml
from rans.model.timing import Timing
from rans.tasks import GoToPose, Task
from tests.support import plugins
from tests.support.draws import FLYER, PLATFORM
from tests.support.switching import SwitchingGoToPose
from tests.support.training import (
    CONFIG,
    TINY,
    after,
    everything,
    ignore,
    resumed,
    tiny_trainer,
)

plugins.register()

SHORT = Timing(episode_steps=20)
THROTTLED = replace(PLATFORM, actuators=Throttle())
FLYER_THROTTLED = replace(FLYER, actuators=Throttle())
NEAR = GoToPose(spawn_distance=(0.5, 1.0), fail_distance=1.5)
OWN = GradientSettings(noise=0.05, bound=1e6)


def gradient_learner(
    craft: Any = THROTTLED,
    task: Task = NEAR,
    seed: int = 0,
    dtype: torch.dtype = torch.float64,
    conditions: str | None = None,
    timing: Timing = SHORT,
    own: GradientSettings = OWN,
    **settings: Any,
) -> GradientLearner:
    """Small, and exact; some of its episodes fail and others are cut off."""
    sizes: dict[str, Any] = {"n_epochs": 1, "n_steps": 8}
    chosen = replace(TINY, **(sizes | settings))
    engine = Engine(
        craft,
        task,
        chosen.n_envs,
        timing,
        seed=seed,
        dtype=dtype,
        conditions=conditions,
        plain=True,
        remember=chosen.privileged_critic,
    )
    learner = begin(engine, chosen, seed, True, partial(GradientLearner, own=own))
    assert isinstance(learner, GradientLearner)
    return learner


def losses_by(learner: GradientLearner, name: str, place: int, size: float) -> float:
    """The loss of the same rollout with one weight changed; everything is put back."""
    kept = learner.engine.save_state(), learner.state()
    (state,) = kept[1]["generators"]
    memory = None if learner.rollout.memory is None else learner.rollout.memory.clone()
    weight = learner.network.tensors[name].detach().view(-1)
    before = weight[place].item()
    weight[place] += size
    with torch.no_grad():
        found = learner.loss().item()
    weight[place] = before
    learner.engine.load_state(kept[0])
    learner._generator.set_state(state)
    if memory is not None and learner.rollout.memory is not None:
        learner.rollout.memory.copy_(memory)
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("craft", "task", "others"),
    [
        (THROTTLED, NEAR, {}),
        (THROTTLED, NEAR, {"n_steps": 20, "batch_size": 80}),
        (FLYER_THROTTLED, NEAR, {}),
        (THROTTLED, SwitchingGoToPose(**vars(NEAR), switching_weight=0.05), {"symmetric": True}),
        (THROTTLED, NEAR, {"memory": MemorySettings(2)}),
        (THROTTLED, NEAR, {"conditions": "lab", "privileged_critic": True}),
    ],
    ids=["horizon", "episode", "space", "symmetric", "history", "lab"],
)
def test_the_gradient_of_a_return_is_that_of_differences(
    craft: Any, task: Task, others: dict[str, Any]
) -> None:
    """In float64, of a policy whose commands are far from shut and open; of weights of every layer."""
    learner = gradient_learner(craft, task, **others)
    for _ in range(2):
        learner.learn()  # so that the critic says something, and episodes are in their midst
    names = [name for name in learner.network.learnt if not name.startswith("value_net")]
    if others.get("privileged_critic"):
        names = [name for name in names if ".critic." not in name]
    kept = learner.engine.save_state(), learner._generator.get_state()
    memory = None if learner.rollout.memory is None else learner.rollout.memory.clone()
    loss = learner.loss()
    action = learner.rollout.all.action
    assert action.min() > 0.0
    assert action.max() < 1.0
    ended = learner.rollout.all.ended
    assert ended.sum() > 0
    gradients = torch.autograd.grad(loss, [learner.network.tensors[name] for name in names])
    learner.engine.load_state(kept[0])
    learner._generator.set_state(kept[1])
    if memory is not None and learner.rollout.memory is not None:
        learner.rollout.memory.copy_(memory)
    size = 1e-6
    for name, gradient in zip(names, gradients, strict=True):
        place = int(gradient.abs().argmax())
        more, less = (losses_by(learner, name, place, sign * size) for sign in (1, -1))
        difference = (more - less) / (2 * size)
        assert abs(difference) > 1e-9, name
        assert gradient.view(-1)[place].item() == pytest.approx(difference, rel=2e-4, abs=1e-9)


def test_a_root_at_rest_leaves_gradients_finite() -> None:
    """All thrusters are shut and episodes begin at rest, where a speed and a spin have no gradient."""
    task = replace(NEAR, spin_weight=0.1)
    learner = gradient_learner(task=task, own=replace(OWN, noise=1e-6))
    with torch.no_grad():
        learner.network.tensors["action_net.bias"].fill_(-0.1)
    learner.engine.reset(0)
    loss = learner.loss()
    assert (learner.rollout.all.action < 0).all()
    norm = learner.adam.descend(loss, learner.settings.max_grad_norm, learner.processes)
    assert norm.isfinite().all()
    assert all(x.isfinite().all() for x in learner.network.tensors.values())


def test_the_engine_flies_what_the_learner_flew() -> None:
    """The rollout's commands, given to an engine of the same starts, bring the same rewards."""
    learner = gradient_learner()
    other = Engine(THROTTLED, NEAR, 16, SHORT, dtype=torch.float64)
    other.load_state(learner.engine.save_state())
    for _ in range(4):
        learner.loss()
        kept = learner.rollout.all
        for t in range(learner.n_steps):
            torch.testing.assert_close(other.observe(), kept.observation[t], rtol=0, atol=1e-12)
            step = other.step(kept.action[t].clamp(0.0, 1.0))
            torch.testing.assert_close(step.reward, kept.reward[t], rtol=0, atol=1e-12)
            assert torch.equal((step.terminated | step.truncated).double(), kept.ended[t])


def test_what_has_no_gradient_is_refused() -> None:
    for craft in (PLATFORM, replace(PLATFORM, actuators=Pulsed(10))):
        with pytest.raises(ConfigError, match="needs thrusters that are throttled"):
            gradient_learner(craft)
    engine = Engine(THROTTLED, NEAR, 16, SHORT)
    with pytest.raises(ConfigError, match="plain engine"):
        begin(engine, TINY, 0, None, partial(GradientLearner, own=OWN))
    with pytest.raises(ConfigError, match="plain=True"):
        engine.stepped(engine.running(), torch.zeros(16, 8))


# In a training.


def config(folder: Path, **others: Any) -> TrainConfig:
    craft = folder / "craft.toml"
    craft.write_text(to_toml(THROTTLED))
    return replace(CONFIG, spacecraft=str(craft), algorithm="gradient", **others)


@pytest.mark.slow
def test_a_resumed_training_ends_as_if_never_stopped(tmp_path: Path) -> None:
    given = config(tmp_path, total_timesteps=1024, report_interval=4)
    whole = tiny_trainer(tmp_path / "whole", given)
    whole.train(ignore)
    tiny_trainer(tmp_path / "cut", given).train(ignore, after(3))
    trainer = resumed(tmp_path / "cut")
    torch.manual_seed(99)
    trainer.train(ignore)
    assert everything(trainer) == everything(whole)
    for name, tensor in whole.learner.state()["critic"].items():
        assert torch.equal(trainer.learner.state()["critic"][name], tensor)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
def test_the_command_trains_and_evaluates_such_an_agent(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    craft = tmp_path / "craft.toml"
    craft.write_text(to_toml(THROTTLED))
    run = tmp_path / "run"
    small = ["--set", "ppo.n_envs=8", "--set", "ppo.n_steps=16", "--set", "ppo.batch_size=64"]
    where = ["--spacecraft", str(craft), "--device", "cpu", "--output", str(run)]
    given = ["--set", "algorithm=gradient", "--set", "total_timesteps=256"]
    assert main(["train", "go-to-pose", *small, *where, *given]) == 0
    assert "gradients through the motion" in " ".join(capsys.readouterr().out.split())
    assert json.loads((run / "config.json").read_text())["algorithm"] == "gradient"
    assert main(f"evaluate {run} --episodes 8".split()) == 0
    platform = ["--device", "cpu", "--output", str(tmp_path / "other")]
    assert main(["train", "go-to-pose", *platform, "--set", "algorithm=gradient"]) == 2
    assert "needs thrusters that are throttled" in " ".join(capsys.readouterr().err.split())


def test_wrong_settings_are_refused() -> None:
    table = to_table(CONFIG)
    with pytest.raises(ConfigError, match=r"no learner named 'sac'.*examples/plugins"):
        from_table(table | {"algorithm": "sac"})
    with pytest.raises(ConfigError, match="learner: unknown key 'noise'"):
        from_table(table | {"learner": {"noise": 0.1}})
    for name, value in (("target_rate", 0.0), ("noise", math.inf), ("critic_learning_rate", -1.0)):
        with pytest.raises(ConfigError, match=name):
            from_table(table | {"algorithm": "gradient", "learner": {name: value}})


def test_another_learner_has_other_settings() -> None:
    table = to_table(CONFIG)
    change_entry(table, "algorithm", "gradient")
    change_entry(table, "learner.noise", 0.4)
    assert from_table(table).learner == asdict(GradientSettings(noise=0.4))
    change_entry(table, "algorithm", "ppo")
    assert from_table(table) == CONFIG
