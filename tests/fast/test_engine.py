from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from rans import ConfigError, Engine, Spacecraft, Timing
from rans.episode.scenario import scenario
from rans.model.body import Body
from rans.model.fields import Vec2
from rans.tasks import GoToPose, observation
from rans.tasks.observation_terms import VectorInW
from tests.support.engines import (
    FLYER,
    NEAR,
    PLATFORM,
    SHORT,
    actions,
    by_turns,
    run,
)


def first_observation(craft: Spacecraft, seed: int, episode: int) -> np.ndarray:
    chosen = scenario(NEAR, craft.dimension, seed, episode)
    return np.array(observation(NEAR, chosen.start, chosen.goal))


class ToALine(GoToPose):
    """Shown the way to the line y = 0 alone: a column is a number."""

    def observation_terms(self, state: Any, goal: Any) -> Any:
        """See the base."""
        _, turn = super().observation_terms(state, goal)
        return VectorInW("d", "m", Vec2(0.0, goal.p.y - state.p.y)), turn


@by_turns
def test_a_number_is_a_column(backend, craft):
    if craft.dimension == 2:
        engine = backend(craft, ToALine(), 4, SHORT, seed=3)
        assert torch.equal(engine.reset(seed=1)[:, 6], torch.zeros(4))
        assert engine.step(actions(craft, 4, 1)[0]).observation[:, 7].ne(0.0).all()


@by_turns
def test_a_lost_state_earns_nothing_and_fails(backend, craft):
    """The others' rewards stay as they are, to the last bit."""
    engine, whole = (backend(craft, NEAR, 4, SHORT, seed=3, dtype=torch.float64) for _ in range(2))
    engine.state.p.x[1] = torch.nan
    action = actions(craft, 4, 1)[0]
    lost = engine.step(action)
    fine = whole.step(action)
    assert lost.terminated.tolist() == [False, True, False, False]
    assert lost.reward[1] == 0.0
    assert lost.terms[:, 1].eq(0.0).all()
    assert torch.equal(lost.reward[[0, 2, 3]], fine.reward[[0, 2, 3]])
    assert torch.equal(lost.terms[:, [0, 2, 3]], fine.terms[:, [0, 2, 3]])


@by_turns
@pytest.mark.parametrize("mass", [math.nan, 1e-9])
def test_the_last_observation_of_a_lost_state_is_finite(backend, craft, mass):
    """A mass that is no number, or that flies away at 1e8 m/s within a period, in every program."""
    body = replace(Body.of(craft), mass=np.full(4, craft.mass))
    far = replace(NEAR, fail_distance=1e20)
    engine = backend(craft, far, 4, SHORT, seed=3, body=body)
    before = engine.observe().clone()
    engine.body.mass[1] = mass
    all_open = torch.zeros_like(actions(craft, 4, 1)[0])
    all_open[:, 0] = 1
    step = engine.step(all_open)
    assert step.terminated.tolist() == [False, True, False, False]
    assert step.final_observation[1].isfinite().all()
    torch.testing.assert_close(step.final_observation[1], before[1], rtol=0, atol=1e-6)
    assert step.reward.isfinite().all()


@by_turns
def test_reset_goes_on_counting_and_a_seed_starts_over(backend, craft):
    engine = backend(craft, NEAR, 3, SHORT, seed=5)
    first = engine.observe()
    second = engine.reset()
    assert (first != second).any(dim=1).all()
    np.testing.assert_allclose(second[0], first_observation(craft, 5, 3), atol=1e-6)  # float32
    torch.testing.assert_close(engine.reset(5), first, rtol=0, atol=0)
    assert (engine.reset(6) != first).any(dim=1).all()
    np.testing.assert_allclose(
        engine.reset(2**64 - 1)[0], first_observation(craft, 2**64 - 1, 0), atol=1e-6
    )


def test_reset_forgets_the_steps(backend):
    engine = backend(PLATFORM, GoToPose(), 2, Timing(episode_steps=5))
    still = torch.zeros(2, 8)
    for _ in range(3):
        engine.step(still)
    engine.reset()
    assert [bool(engine.step(still).truncated.all()) for _ in range(5)] == [False] * 4 + [True]


def test_stagger_spreads_the_ends(backend):
    engine = backend(PLATFORM, GoToPose(), 2000, Timing(episode_steps=10))
    engine.stagger(torch.Generator().manual_seed(1))
    truncated = torch.stack([engine.step(torch.zeros(2000, 8)).truncated for _ in range(30)])
    first = truncated.int().argmax(dim=0)
    # 200 of 2,000 expected in each of ten steps; 5 standard deviations of 13.
    assert (torch.bincount(first, minlength=10) - 200).abs().max() < 65
    for shift in (10, 20):
        assert truncated.gather(0, (first + shift).clamp(max=29)[None]).all()
    assert (truncated.sum(dim=0) == 3).all()


def test_stagger_forgets_the_steps_and_keeps_the_episodes(backend):
    """Of an engine that has flown before, as a second training on it begins."""
    fresh, used = (backend(PLATFORM, NEAR, 16, SHORT) for _ in range(2))
    run(used, 27)
    before = torch.as_tensor(used.episode.clock).clone() // 32
    for engine in (fresh, used):
        engine.stagger(torch.Generator().manual_seed(1))
    clock = torch.as_tensor(used.episode.clock)
    assert before.min() > 0
    assert torch.equal(clock // 32, before)
    assert torch.equal(clock % 32, torch.as_tensor(fresh.episode.clock))


def test_a_foreign_state_is_refused(backend):
    saved = backend(PLATFORM, NEAR, 1, SHORT).save_state()
    with pytest.raises(ConfigError, match="4 environments of 'floating-platform'"):
        backend(PLATFORM, NEAR, 4, SHORT).load_state(saved)
    with pytest.raises(ConfigError, match="1 environments of 'free-flyer'"):
        backend(FLYER, NEAR, 1, SHORT).load_state(saved)
    with pytest.raises(
        ConfigError, match=r"episodes of 20 steps, not 21: its clocks would be misread\."
    ):
        backend(PLATFORM, NEAR, 1, Timing(episode_steps=21)).load_state(saved)


@by_turns
def test_results_are_never_written_again(backend, craft):
    engine = backend(craft, NEAR, 16, SHORT, seed=9)
    observed = engine.observe()
    kept = [observed.clone()]
    step = engine.step(actions(craft, 16, 1)[0])
    kept += [x.clone() for x in step]
    run(engine, 25, seed=3)
    engine.reset()
    for before, now in zip(kept, (observed, *step), strict=True):
        assert torch.equal(before, now)


def test_actions_of_any_dtype_and_layout_mean_the_same(backend):
    action = actions(PLATFORM, 16, 1)[0]
    forms = [action, action.bool(), action.float(), action.to(torch.int8), action.T.contiguous().T]
    seen = [backend(PLATFORM, NEAR, 16, SHORT).step(form).final_observation for form in forms]
    for other in seen[1:]:
        assert torch.equal(other, seen[0])


SHUT = torch.zeros(2, 8)


@pytest.mark.parametrize(
    ("actions", "said"),
    [
        (SHUT.to(torch.complex64), "dtype complex64"),
        (SHUT.to_sparse(), "layout sparse_coo"),
        (SHUT.to("meta"), "device meta"),
        (SHUT.clone().requires_grad_(), "must not require gradients"),
    ],
)
def test_odd_actions(actions, said):
    for engine in (Engine(PLATFORM, GoToPose(), 2), Engine(PLATFORM, GoToPose(), 2, plain=True)):
        with pytest.raises(ConfigError, match=said):
            engine.step(actions)
    engine.step(SHUT)
    with torch.no_grad():
        engine.step(SHUT.clone().requires_grad_())
