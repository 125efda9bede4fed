"""`rans.PPO`: what Python users have of the trainer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_baselines3
import torch

import rans
from rans.errors import ConfigError
from rans.fast.engine import Engine
from rans.fast.envs.sb3 import SB3VecEnv
from rans.fast.learn.config import MemorySettings
from tests.support.engines import FLYER, NEAR, PLATFORM, SHORT
from tests.support.processes import printed
from tests.support.training import scatter, seen, weights

SMALL: dict[str, Any] = {"n_steps": 8, "layers": (16, 16)}


def made(craft: Any = PLATFORM, **settings: Any) -> rans.PPO:
    return rans.PPO(Engine(craft, NEAR, 16, SHORT), **SMALL | settings)


def test_it_learns_so_many_steps_more_and_says_how_it_went() -> None:
    heard: list[int] = []
    model = made().learn(300, lambda model: heard.append(model.num_timesteps))
    assert heard == [128, 256, 384]
    assert model.learn(1).num_timesteps == 512
    assert {"train/loss", "rollout/success_rate", "return/position"} <= set(model.log)


def test_learning_in_pieces_changes_nothing() -> None:
    whole = made().learn(1024)
    parts = made()
    for piece in (128, 256, 640):
        parts.learn(piece)
    assert torch.equal(weights(whole.network), weights(parts.network))


def test_an_engine_or_sb3s_environment_around_it() -> None:
    bare = made()
    around = rans.PPO(SB3VecEnv(Engine(PLATFORM, NEAR, 16, SHORT)), **SMALL)
    assert torch.equal(weights(bare.learn(256).network), weights(around.learn(256).network))


KINDS = [
    {},
    {"memory": MemorySettings(4)},
    {"privileged_critic": True},
]


@pytest.mark.parametrize(
    ("craft", "kind"),
    [*zip((PLATFORM, FLYER, FLYER), KINDS, strict=True)],
    ids=["plain", "history", "privileged"],
)
def test_saved_agents_open_in_sb3(craft: Any, kind: dict[str, Any], tmp_path: Path) -> None:
    """And remember there what they remember here."""
    model = made(craft, symmetric=not kind, **kind).learn(512)
    model.save(tmp_path / "policy.zip")
    loaded = stable_baselines3.PPO.load(tmp_path / "policy.zip", device="cpu")
    assert loaded.num_timesteps == 512
    here: Any = None
    there: Any = None
    alone: Any = None
    said = []
    first = []
    for step in range(4):
        observations = seen(craft, 50, seed=step).numpy()
        begins = np.arange(50) % 7 == 3 * step
        ours, here = model.predict(observations, here, begins)
        theirs, there = loaded.predict(observations, there, begins, deterministic=True)
        np.testing.assert_array_equal(theirs, ours)
        one, alone = loaded.predict(observations[0], alone, deterministic=True)
        assert one.shape == (len(craft.thrusters),)
        said.append(ours)
        first.append(model.predict(observations)[0])
    assert 0.05 < np.mean(said) < 0.95
    forgets = "memory" not in kind
    assert (np.array(said) == np.array(first)).all() == forgets
    assert (here is None) == forgets


def test_where_an_episode_begins_nothing_is_remembered() -> None:
    """And elsewhere what was: row by row as if each spacecraft had flown alone."""
    model = made(symmetric=False, memory=MemorySettings(4))
    begins = np.arange(60) % 3 == 0
    scatter(model.network)
    before, now = (seen(PLATFORM, 60, seed).numpy() for seed in (1, 2))
    _, state = model.predict(before)
    said, after = model.predict(now, state, begins)
    blank = model.predict(now)
    old = model.predict(now, state)
    assert state is not None
    assert after is not None
    assert (blank[0] != old[0]).any(axis=1).sum() > 20
    for rows, (command, memory) in ((begins, blank), (~begins, old)):
        assert memory is not None
        np.testing.assert_array_equal(said[rows], command[rows])
        np.testing.assert_array_equal(after[0][rows], memory[0][rows])


@pytest.mark.parametrize("kind", KINDS[:2], ids=["plain", "history"])
def test_a_loaded_agent_learns_on(tmp_path: Path, kind: dict[str, Any]) -> None:
    """With its weights, its settings and Adam's memory."""
    model = made(learning_rate=2e-3, gamma=0.9, symmetric=not kind, **kind).learn(1024)
    model.save(tmp_path / "policy.zip")
    again = rans.PPO.load(tmp_path / "policy.zip", Engine(PLATFORM, NEAR, 16, SHORT))
    assert (again.settings, again.num_timesteps) == (model.settings, 1024)
    assert torch.equal(weights(again.network), weights(model.network))
    for name, moments in model.learner.adam.state().items():
        torch.testing.assert_close(again.learner.adam.state()[name], moments, msg=name)
    assert (weights(again.learn(128).network) != weights(model.network)).any()
    with pytest.raises(ConfigError, match="is not an agent for free-flyer"):
        rans.PPO.load(tmp_path / "policy.zip", Engine(FLYER, NEAR, 16, SHORT))


@pytest.mark.parametrize("backbone", ["dense", "allocated"])
def test_sb3_itself_learns_on_from_it(backbone: str, tmp_path: Path) -> None:
    made(backbone=backbone).learn(1024).save(tmp_path / "policy.zip")
    env = SB3VecEnv(Engine(PLATFORM, NEAR, 16, SHORT))
    model = stable_baselines3.PPO.load(tmp_path / "policy.zip", env=env, device="cpu")
    before = weights(model.policy)
    # Of the type of the space, as of its other heads.
    assert model.policy(seen(PLATFORM, 5))[0].dtype == torch.int64
    model.learn(256, reset_num_timesteps=False)
    assert model.num_timesteps == 1280
    assert (weights(model.policy) != before).any()


@pytest.mark.slow
def test_prediction_needs_no_environment_and_no_compiler(tmp_path: Path) -> None:
    model = made().learn(256)
    model.save(tmp_path / "policy.zip")
    observation = seen(PLATFORM, 1).numpy()
    np.save(tmp_path / "observation.npy", observation)
    script = (
        "import numpy, stable_baselines3, sys; "
        "model = stable_baselines3.PPO.load('policy.zip', device='cpu'); "
        "print(*model.predict(numpy.load('observation.npy'), deterministic=True)[0][0])"
    )
    said = printed("-c", script, cwd=tmp_path, PATH="")
    assert said.split() == [str(int(x)) for x in model.predict(observation)[0][0]]


def test_defaults_fit_the_engine() -> None:
    assert made().settings.batch_size == 32  # a quarter of 16 x 8
    assert rans.PPO(Engine(PLATFORM, NEAR, 3, SHORT), **SMALL).settings.batch_size == 24


def test_one_thread_unless_told_otherwise() -> None:
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        made(threads=None)
        assert torch.get_num_threads() == 2
        made()
        assert torch.get_num_threads() == 1
    finally:
        torch.set_num_threads(before)
