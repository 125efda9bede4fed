"""The batched environment as other libraries want it: seeds, actions, ends, wrappers."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import vector as wrappers

import rans
from rans import SpacecraftVectorEnv
from tests.support.engines import NEAR, SHORT

PLANE = "rans/GoToPose2D-v0"
COUNT = 6
STEPS = 50


def make(**kwargs: Any) -> SpacecraftVectorEnv:
    made: Any = gymnasium.make_vec(PLANE, num_envs=COUNT, task=NEAR, timing=SHORT, **kwargs)
    return made


def actions(steps: int = STEPS) -> torch.Tensor:
    return torch.randint(2, (steps, COUNT, 8), generator=torch.Generator().manual_seed(1))


def sync(mode: AutoresetMode, conditions: str | None) -> SyncVectorEnv:
    """Gymnasium's own loop over single environments, each with every `COUNT`th episode of one seed."""
    made = [partial(Numbered, place, conditions) for place in range(COUNT)]
    return SyncVectorEnv(made, autoreset_mode=mode)


class Numbered(gymnasium.Wrapper):
    """A single environment in this place of a batch."""

    def __init__(self, place: int, conditions: str | None) -> None:
        super().__init__(gymnasium.make(PLANE, task=NEAR, timing=SHORT, conditions=conditions))
        self._next = place

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        if seed is not None:
            super().reset(seed=SEED)
        inner: Any = self.unwrapped
        inner._episode = self._next - 1
        self._next += COUNT
        return super().reset(options=options)


SEED = 2**63 + 5


@pytest.mark.parametrize(
    ("mode", "conditions"), [(AutoresetMode.SAME_STEP, None), (AutoresetMode.NEXT_STEP, "lab")]
)
def test_every_mode_is_gymnasiums_own(mode, conditions):
    """Observation, reward and ends of 50 steps."""
    ours = make(autoreset_mode=mode, dtype=torch.float64, conditions=conditions)
    theirs = sync(mode, conditions)
    assert ours.autoreset_mode == ours.metadata["autoreset_mode"] == mode
    one, _ = ours.reset(seed=SEED)
    other, _ = theirs.reset(seed=1)
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-6)  # float32 there
    ends = won = 0
    for action in actions():
        mine = ours.step(action)
        yours = theirs.step(action.numpy())
        np.testing.assert_allclose(mine[0], yours[0], rtol=0, atol=2e-6)
        np.testing.assert_allclose(mine[1], yours[1], rtol=0, atol=1e-6)
        for flags, expected in zip(mine[2:4], yours[2:4], strict=True):
            np.testing.assert_array_equal(flags, expected)
        over = (mine[2] | mine[3]).numpy()
        ends += over.sum()
        if mode == AutoresetMode.SAME_STEP:
            for name, paid in yours[4]["reward_terms"].items():
                if not name.startswith("_"):
                    found = mine[4][f"reward/{name}"]
                    np.testing.assert_allclose(found[~over], paid[~over], rtol=0, atol=1e-6)
            if over.any():
                ours_end, theirs_end = (step[4]["final_info"]["at_goal"] for step in (mine, yours))
                np.testing.assert_array_equal(ours_end[over], theirs_end[over])
                won += int(ours_end[over].sum())
    assert ends > COUNT
    assert won or mode != AutoresetMode.SAME_STEP


def test_resets_count_on_and_observations_are_contiguous_without_gradients():
    env = make()
    first = env.reset(seed=3)[0].clone()
    again = env.reset()[0]
    assert (again != first).any(dim=1).all()  # episodes are counted on
    assert again.is_contiguous()
    seen = env.step(actions()[0].float().requires_grad_())[0]
    assert seen.is_contiguous()
    assert not seen.requires_grad
    assert env.spec is not None
    assert env.spec.max_episode_steps == SHORT.episode_steps


def _mean_return(action: Callable[[np.ndarray], np.ndarray]) -> tuple[float, float]:
    """Mean return of 64 episodes of go-to-pose in the plane, and the threshold of the environment."""
    env = gymnasium.make_vec("rans/GoToPose2D-v0", num_envs=64)
    assert env.spec is not None
    assert env.spec.max_episode_steps is not None
    assert env.spec.reward_threshold is not None
    observation, _ = env.reset(seed=7)
    total = 0.0
    for _ in range(env.spec.max_episode_steps):
        observation, reward, *_ = env.step(action(np.asarray(observation)))
        total += float(np.asarray(reward).mean())
    return total, env.spec.reward_threshold


def test_the_reward_threshold_tells_good_agents_from_idle_ones():
    agent = rans.load_agent("go-to-pose-2d")
    good, threshold = _mean_return(lambda observation: agent.predict(observation)[0])
    idle, _ = _mean_return(lambda observation: np.zeros((len(observation), 8), np.int8))
    assert idle < 0.5 * threshold < threshold < good


@pytest.mark.filterwarnings("ignore:.*precision lowered")  # Gymnasium's own, where it rescales
def test_gymnasiums_wrappers_of_actions():
    """Behind the one that makes arrays of tensors: -1 shuts and 1 opens where actions are rescaled."""
    make_one = lambda: gymnasium.make_vec(PLANE, num_envs=COUNT, spacecraft="atmos")  # noqa: E731
    env = wrappers.RescaleAction(wrappers.ArrayConversion(make_one(), torch, np), -1.0, 1.0)
    plain = make_one()
    env.reset(seed=1)
    plain.reset(seed=1)
    asked = np.array([[-1.0, 1.0] * 4] * COUNT, np.float32)
    seen = env.step(asked)[0]
    expected = plain.step(torch.from_numpy(asked.clip(0.0, 1.0)))[0]
    np.testing.assert_array_equal(seen, expected)
