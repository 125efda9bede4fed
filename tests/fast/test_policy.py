from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium import spaces
from scipy.spatial.transform import Rotation
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor

from rans.errors import ConfigError
from rans.fast.engine import Engine
from rans.fast.learn.config import PPOSettings, Precision
from rans.fast.learn.trainer import make_ppo
from rans.fast.policy import NormalisedMlp, OnOff, evaluate, expect_duty, paper_layout, set_precision
from rans.model.dynamics import PlanarState, SpatialState
from rans.model.fields import Heading, Quat, Vec2, Vec3
from rans.spaces import action_space, observation_space
from rans.tasks import GoToPose, observation
from tests.crafts import random_states
from tests.fast.engines import PLATFORM, both_crafts
from tests.fast.training import scatter


def make_policy(craft: Any, net_arch: Any = ()) -> ActorCriticPolicy:
    """A float64 policy with large random weights and statistics."""
    policy = ActorCriticPolicy(
        observation_space(GoToPose(), craft.dimension), action_space(craft), lambda _: 1e-3,
        net_arch=net_arch or [],
        features_extractor_class=NormalisedMlp, features_extractor_kwargs={"layers": (16,)})
    policy.double()
    scatter(policy)
    extractor: Any = policy.features_extractor
    extractor.update_statistics(extractor.seen(seen(craft, 500))[0])
    return policy


def seen(craft: Any, count: int, seed: int = 1) -> Tensor:
    """Observations that float32 holds exactly: SB3 casts what it is given to float32."""
    state, goal = (random_states(craft.dimension, count, s) for s in (seed, seed + 1))
    return torch.from_numpy(np.stack(observation(GoToPose(), state, goal), axis=1).astype(np.float32))


@pytest.mark.parametrize("net_arch", [[], {"pi": [8], "vf": [4]}], ids=["shared", "separate"])
@both_crafts
def test_it_says_what_sb3_says(craft: Any, net_arch: Any) -> None:
    policy, observations = make_policy(craft, net_arch), seen(craft, 64)
    actions = torch.randint(0, 2, (64, len(craft.thrusters)), generator=torch.Generator().manual_seed(1))
    output = evaluate(policy, observations)
    value, log_prob, entropy = policy.evaluate_actions(observations, actions)
    # Sums of tens of float64 numbers of order one in another order.
    close = {"rtol": 0, "atol": 1e-12}
    torch.testing.assert_close(output.value, value.squeeze(1), **close)
    torch.testing.assert_close(output.log_prob(actions), log_prob, **close)
    torch.testing.assert_close(output.entropy(), entropy, **close)
    mode = policy.get_distribution(observations).mode()
    np.testing.assert_array_equal(output.mode().numpy(), mode.numpy())
    predicted, _ = policy.predict(observations.numpy(), deterministic=True)
    np.testing.assert_array_equal(output.mode().numpy(), predicted)
    assert 0.2 < mode.double().mean() < 0.8  # both choices are there


def test_probabilities_of_all_actions_add_up_to_one() -> None:
    output = OnOff(torch.tensor([[-3.0, 0.2, 1.5, 7.0]], dtype=torch.float64), torch.zeros(1))
    every = torch.tensor(list(itertools.product((0.0, 1.0), repeat=4)), dtype=torch.float64)
    probability = OnOff(output.logit.expand(16, 4), torch.zeros(16)).log_prob(every).exp()
    assert float(probability.sum()) == pytest.approx(1.0, abs=1e-15)
    entropy = -(probability * probability.log()).sum()
    assert float(output.entropy()) == pytest.approx(float(entropy), abs=1e-14)
    assert every[probability.argmax()].tolist() == output.mode()[0].tolist() == [0, 1, 1, 1]


def test_certain_thrusters_give_finite_numbers() -> None:
    """A probability that rounds to 0 or 1 must not become infinity minus infinity."""
    output = OnOff(torch.tensor([[-500.0, 500.0]]), torch.zeros(1))
    assert output.log_prob(torch.tensor([[0.0, 1.0]])).item() == 0.0
    assert output.log_prob(torch.tensor([[1.0, 1.0]])).item() == -500.0
    assert output.entropy().item() == 0.0


def test_samples_have_their_probabilities() -> None:
    torch.manual_seed(1)
    probability = torch.tensor([0.01, 0.3, 0.5, 0.95])
    samples = OnOff(probability.logit().expand(20_000, 4), torch.zeros(20_000)).sample()
    assert samples.unique().tolist() == [0.0, 1.0]
    # Five standard deviations of a mean over 20,000 throws.
    bound = 5 * (probability * (1 - probability) / 20_000).sqrt()
    assert ((samples.mean(dim=0) - probability).abs() < bound).all()
    assert (samples.T.corrcoef() - torch.eye(4)).abs().max() < 5 / math.sqrt(20_000)


def test_body_frame_in_the_plane() -> None:
    """Facing world y, what moves along world x moves to the body's right, its negative y."""
    row = [0.0, 1.0, 3.0, 0.0, 0.7, 1.0, 0.0, 2.0, 0.6, 0.8]
    expected = [0.0, -3.0, 0.7, 1.0, 2.0, 0.0, 0.6, 0.8]
    torch.testing.assert_close(torch.tensor(paper_layout(10).in_body(row)), torch.tensor(expected))


def test_body_frame_in_space() -> None:
    """Turned by 90 degrees about world z: body x is world y, body y is minus world x."""
    # R_WB = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]: its first two rows are observed.
    rest = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    row = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 3.0, 4.0, 5.0, 7.0, 8.0, 9.0, 1.0, 10.0, 11.0, 12.0, *rest]
    expected = [4.0, -3.0, 5.0, 7.0, 8.0, 9.0, 1.0, 11.0, -10.0, 12.0, *rest]
    torch.testing.assert_close(torch.tensor(paper_layout(22).in_body(row)), torch.tensor(expected))


def turned(state: Any, angle: float, axis: np.ndarray) -> Any:
    """A state seen from a world turned about its origin; computed by SciPy."""
    if isinstance(state, PlanarState):
        turn = Rotation.from_euler("z", angle)
        p, v = (turn.apply(np.stack([*u.columns(), 0 * u.x], axis=1))[:, :2].T for u in (state.p, state.v))
        return PlanarState(Vec2(*p), Heading(state.attitude.angle + angle), Vec2(*v), state.w)
    turn = Rotation.from_rotvec(angle * axis)
    p, v = (turn.apply(np.stack(u.columns(), axis=1)).T for u in (state.p, state.v))
    q = state.attitude
    x, y, z, w = (turn * Rotation.from_quat(np.stack([q.x, q.y, q.z, q.w], axis=1))).as_quat().T
    return SpatialState(Vec3(*p), Quat(w, x, y, z), Vec3(*v), state.w)


@pytest.mark.parametrize("angle", [0.3, 2.0, -1.2, math.pi])
@both_crafts
def test_turning_the_world_changes_nothing(craft: Any, angle: float) -> None:
    policy, axis = make_policy(craft), np.array([2.0, -1.0, 2.0]) / 3
    state, goal = (random_states(craft.dimension, 100, seed) for seed in (5, 6))

    def outputs(*states: Any) -> OnOff:
        return evaluate(policy, torch.from_numpy(np.stack(observation(GoToPose(), *states), axis=1)))

    here, there = outputs(state, goal), outputs(turned(state, angle, axis), turned(goal, angle, axis))
    # Rounding of float64 through two rotations and weights of order one.
    torch.testing.assert_close(there.logit, here.logit, rtol=0, atol=1e-11)
    torch.testing.assert_close(there.value, here.value, rtol=0, atol=1e-11)
    assert outputs(turned(state, angle, axis), goal).logit.sub(here.logit).abs().max() > 0.1


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_statistics_are_those_of_all_observations(dtype: torch.dtype) -> None:
    extractor = NormalisedMlp(spaces.Box(-9, 9, (10,))).to(dtype)
    generator = torch.Generator().manual_seed(2)
    scale, shift = torch.rand(2, 10, generator=generator) * 5
    parts = [torch.randn(count, 10, generator=generator) * scale + shift * part
             for part, count in enumerate((3, 500, 1, 64))]
    for part in parts:
        extractor.update_statistics(extractor.seen(part)[0])
    everything = np.stack(extractor.layout.in_body(torch.cat(parts).double().unbind(1)), axis=1)
    # Rounding of the dtype, and in float32 of the observations turned into the body frame.
    relative = 1e-12 if dtype == torch.float64 else 2e-5
    np.testing.assert_allclose(extractor.mean, everything.mean(axis=0), rtol=relative, atol=relative)
    np.testing.assert_allclose(extractor.variance, everything.var(axis=0), rtol=relative)
    assert extractor.count == 568


def test_normalised_observations() -> None:
    extractor = NormalisedMlp(observation_space(GoToPose(), 2)).double()  # type: ignore[arg-type]
    observations = seen(PLATFORM, 1000)
    extractor.update_statistics(extractor.seen(observations)[0])
    result = looks(extractor, observations).numpy()
    np.testing.assert_allclose(result.mean(axis=0), 0, atol=1e-12)
    flag = 3
    # The variance is 1e-6 short of its true inverse; the task flag never varies and stays zero.
    np.testing.assert_allclose(np.delete(result, flag, axis=1).std(axis=0), 1, atol=1e-4)
    assert (result[:, flag] == 0).all()
    far = observations.clone()
    far[:, 4] = 1e6
    assert looks(extractor, far)[:, 2].eq(10.0).all()


def test_second_look_is_steep_at_zero_and_flat_far_away() -> None:
    space = observation_space(GoToPose(), 2)
    plain = NormalisedMlp(space).double()  # type: ignore[arg-type]
    zoomed = NormalisedMlp(space, zoom=20.0).double()  # type: ignore[arg-type]
    width = plain.layout.body.width
    assert zoomed.trunk[0].in_features == 2 * width
    plain.mean[2] = zoomed.mean[2] = 0.5
    observations = torch.zeros(3, 10, dtype=torch.float64)
    observations[:, 0] = 1.0  # cos heading
    observations[1, 4], observations[2, 4] = 0.001, 3.0  # spin, whose variance is 1
    first, second = looks(zoomed, observations).split(width, dim=1)
    assert torch.equal(first, looks(plain, observations))
    # 0.02 less its cube's third, which is 2.7e-6; 20 times 3 is as far as tanh goes.
    torch.testing.assert_close(second[:, 2], torch.tensor([0.0, 0.02, 1.0], dtype=torch.float64),
                               rtol=0, atol=3e-6)


def outputs_of(matmul: Precision, device: str) -> Tensor:
    """Values of a trainer's network with the same weights and observations."""
    settings = PPOSettings(n_envs=64, batch_size=2048, layers=(32, 32), matmul=matmul)
    policy: Any = make_ppo(Engine(PLATFORM, GoToPose(), 64, device=device), settings, seed=0).policy
    assert policy.features_extractor.bf16 == (matmul == "bf16")
    with torch.no_grad():
        return evaluate(policy, seen(PLATFORM, 64).float().to(device)).value


def test_a_cpu_knows_no_bf16() -> None:
    assert torch.equal(outputs_of("bf16", "cpu"), outputs_of("tf32", "cpu"))


def test_only_known_precisions() -> None:
    with pytest.raises(ConfigError, match="matmul must be one of float32, tf32, bf16, got 'fp8'"):
        set_precision("fp8", torch.device("cpu"))


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_bf16_rounds_the_hidden_layers() -> None:
    """To 8 significant bits, of numbers of order one."""
    difference = (outputs_of("bf16", "cuda") - outputs_of("tf32", "cuda")).abs().max()
    assert 1e-5 < difference < 2e-2


def test_untrained_policies_open_thrusters_as_often_as_asked() -> None:
    policy = make_policy(PLATFORM)
    expect_duty(policy, 0.1)
    blind = torch.zeros(1, 16, dtype=torch.float64)  # features of nothing seen
    head = policy.action_net(blind).reshape(-1, 2).softmax(dim=1)  # type: ignore[operator]
    torch.testing.assert_close(head[:, 1], torch.full((8,), 0.1, dtype=torch.float64), rtol=1e-12, atol=0)


def looks(extractor: NormalisedMlp, observations: Tensor) -> Tensor:
    columns = torch.stack(extractor.layout.in_body(observations.to(extractor.mean.dtype).unbind(1)), dim=1)
    return extractor.looks(columns, extractor.mean, extractor.variance)
