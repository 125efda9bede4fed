from __future__ import annotations

import dataclasses
import gc
import math
import shutil
import tracemalloc
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from rans.errors import ConfigError
from rans.fast.engine import Engine, Step
from rans.fields import leaves
from rans.scenario import scenario
from rans.spacecraft import Spacecraft
from rans.spacecraft_file import load_spacecraft
from rans.tasks import GoToPose, observation
from rans.timing import Timing

PLATFORM, FLYER = load_spacecraft("floating-platform"), load_spacecraft("free-flyer")
SHORT = Timing(episode_steps=20)
NEAR = GoToPose(spawn_distance=(0.5, 1.0), fail_distance=1.05)
"""With it about half of the episodes of `SHORT` fail under random thrust."""

both_crafts = pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=lambda craft: craft.name)


@pytest.fixture(params=["numpy", "torch"])
def backend(request: pytest.FixtureRequest) -> Any:
    """Makes engines that step on NumPy, or on torch as on a GPU but without compiling."""
    if request.param == "numpy":
        yield lambda *args, **kwargs: Engine(*args, compiled=False, **kwargs)
        return
    with torch.compiler.set_stance("force_eager"):
        yield lambda *args, **kwargs: Engine(*args, compiled=True, **kwargs)


def actions(craft: Spacecraft, count: int, steps: int, seed: int = 1, held: int = 5) -> Tensor:
    """Random commands (steps, count, thrusters), each held for some steps so that craft get somewhere."""
    generator = torch.Generator().manual_seed(seed)
    shape = (math.ceil(steps / held), count, len(craft.thrusters))
    return torch.randint(0, 2, shape, generator=generator).repeat_interleave(held, dim=0)[:steps]


def run(engine: Engine, steps: int = 45, seed: int = 1) -> list[Step]:
    return [engine.step(a) for a in actions(engine.craft, engine.num_envs, steps, seed)]


def way_to_go(craft: Spacecraft, seen: Tensor) -> Tensor:
    """Distance from the goal, (N,), in the observation's task data."""
    first = 6 if craft.dimension == 2 else 13
    return seen[:, first:first + craft.dimension].norm(dim=1)


def spin(craft: Spacecraft, seen: Tensor) -> Tensor:
    return seen[:, 4:5].norm(dim=1) if craft.dimension == 2 else seen[:, 9:12].norm(dim=1)


def first_observation(craft: Spacecraft, seed: int, episode: int) -> np.ndarray:
    chosen = scenario(NEAR, craft.dimension, seed, episode)
    return np.array(observation(NEAR, chosen.start, chosen.goal))


@both_crafts
def test_episode_k_is_the_same_however_many_fly(backend: Any, craft: Spacecraft) -> None:
    """Environment i of N flies episodes i, i + N, i + 2 N, ... as `scenario` gives them."""
    for count in (1, 3, 7):
        engine = backend(craft, NEAR, count, SHORT, seed=11, dtype=torch.float64)
        number, begun, seen = np.arange(count), np.full(count, True), engine.observe()
        for action in actions(craft, count, 45):
            for i in np.flatnonzero(begun):
                expected = first_observation(craft, 11, int(number[i]))
                # Both take the same draws; sine and cosine may differ in the last place.
                np.testing.assert_allclose(seen[i].numpy(), expected, rtol=0, atol=1e-14)
            step = engine.step(action)
            begun, seen = (step.terminated | step.truncated).numpy(), step.observation
            number = number + count * begun
        assert number.min() >= 2 * count


@both_crafts
def test_ends(backend: Any, craft: Spacecraft) -> None:
    """Failure ends an episode at once, time ends it after so many steps, and never both."""
    engine = backend(craft, NEAR, 32, SHORT, seed=1)
    age, ends = np.zeros(32, dtype=int), np.zeros(2, dtype=int)
    for step in run(engine):
        age += 1
        terminated, truncated = step.terminated.numpy(), step.truncated.numpy()
        far = way_to_go(craft, step.final_observation).numpy() > NEAR.fail_distance
        fast = (craft.dimension == 3) & (spin(craft, step.final_observation).numpy() > NEAR.fail_spin)
        np.testing.assert_array_equal(terminated, far | fast)
        np.testing.assert_array_equal(truncated, (age == SHORT.episode_steps) & ~terminated)
        ends += terminated.sum(), truncated.sum()
        age[terminated | truncated] = 0
    assert ends.min() > 5  # the test saw both kinds


@both_crafts
def test_observation_is_final_observation_until_the_end(backend: Any, craft: Spacecraft) -> None:
    engine = backend(craft, NEAR, 32, SHORT, seed=1)
    for step in run(engine):
        same = (step.observation == step.final_observation).all(dim=1)
        # A new episode is at rest, the old one was not.
        torch.testing.assert_close(same, ~(step.terminated | step.truncated))
        torch.testing.assert_close(step.observation, engine.observe(), rtol=0, atol=0)


def test_spinning_too_fast_fails_in_space(backend: Any) -> None:
    engine = backend(FLYER, GoToPose(fail_distance=1e6), 4, seed=1)
    torque = max(range(16), key=lambda i: np.linalg.norm(FLYER.wrench_map[i][3:]))
    action = torch.zeros(4, 16)
    action[:, torque] = 1.0
    step = next(step for step in (engine.step(action) for _ in range(125)) if step.terminated.any())
    assert (spin(FLYER, step.final_observation) > GoToPose.fail_spin).all()
    assert (spin(FLYER, step.observation) == 0).all()


@both_crafts
def test_reward_is_the_sum_of_its_terms(backend: Any, craft: Spacecraft) -> None:
    engine = backend(craft, NEAR, 16, SHORT, seed=1)
    for step in run(engine, 25):
        # Four float32 numbers below 1 added in another order.
        torch.testing.assert_close(step.reward, step.terms.sum(dim=0), rtol=0, atol=5e-7)


@both_crafts
def test_price_of_thrust_is_counted_after_sharing(backend: Any, craft: Spacecraft) -> None:
    """With every thruster open, the shares add up to all of them, or to one if they share."""
    price = {"none": len(craft.thrusters), "split": 1}
    for sharing in ("none", "split"):
        shared = dataclasses.replace(craft, thrust_sharing=sharing)
        engine = backend(shared, GoToPose(thrust_weight=0.5), 2, seed=1)
        step = engine.step(torch.ones(2, len(craft.thrusters), dtype=torch.int64))
        paid = step.terms[engine.term_names.index("thrust")]
        torch.testing.assert_close(paid, torch.full((2,), -0.5 * price[sharing]))


def test_one_thruster_for_one_period(backend: Any) -> None:
    """From rest at heading h, v = F h_t / m turned by h plus half the turn, to first order in it."""
    craft = dataclasses.replace(PLATFORM, inertia=((1e6, 0.0, 0.0), (0.0, 1e6, 0.0), (0.0, 0.0, 1e6)))
    engine = backend(craft, GoToPose(), 8, seed=4, dtype=torch.float64)
    before = engine.observe()
    after = engine.step(torch.eye(8)).final_observation
    for i, thruster in enumerate(craft.thrusters):
        c, s = before[i, :2].tolist()
        x, y, _ = thruster.direction
        push = np.array([c * x - s * y, s * x + c * y]) * thruster.force / craft.mass
        # The huge inertia leaves a turn below 1e-8 rad, so that the push is straight.
        np.testing.assert_allclose(after[i, 2:4], push * 0.2, atol=1e-8)
        np.testing.assert_allclose(before[i, 6:8] - after[i, 6:8], push * 0.5 * 0.2**2, atol=1e-8)


@both_crafts
def test_a_batch_is_its_members(backend: Any, craft: Spacecraft) -> None:
    """Environment 2 of 5 flies as one that starts alone in episode 2, until that ends."""
    batch, alone = (backend(craft, NEAR, n, SHORT, seed=3, dtype=torch.float64) for n in (5, 1))
    for _ in range(2):
        alone.reset()
    for action in actions(craft, 5, 20):
        many, one = batch.step(action), alone.step(action[2:3])
        # The same operations on arrays of another length may round differently in the last place.
        torch.testing.assert_close(many.final_observation[2:3], one.final_observation, rtol=0, atol=1e-13)
        torch.testing.assert_close(many.reward[2:3], one.reward, rtol=0, atol=1e-13)
        if one.terminated | one.truncated:
            return
    pytest.fail("the episode did not end")


def compare(craft: Spacecraft, dtype: torch.dtype, tolerance: float, other: Any) -> None:
    """Fly the same commands on NumPy and with another engine."""
    ours, theirs = (
        make(craft, NEAR, 64, SHORT, seed=2, dtype=dtype) for make in (Engine, other))
    for action in actions(craft, 64, 45):
        a, b = ours.step(action), theirs.step(action)
        for name, x, y in zip(Step._fields, a, b, strict=True):
            assert (x.shape, x.dtype) == (y.shape, y.dtype), name
            torch.testing.assert_close(x, y, rtol=0, atol=tolerance, msg=lambda m, n=name: f"{n}: {m}")


def torch_engine(*args: Any, **kwargs: Any) -> Engine:
    return Engine(*args, compiled=True, **kwargs)


@both_crafts
@pytest.mark.parametrize(("dtype", "tolerance"), [
    # 20 steps multiply a last place of values up to 4 by a few hundred at most.
    (torch.float64, 1e-12), (torch.float32, 1e-4),
])
def test_numpy_and_torch_agree(craft: Spacecraft, dtype: torch.dtype, tolerance: float) -> None:
    with torch.compiler.set_stance("force_eager"):
        compare(craft, dtype, tolerance, torch_engine)


_COMPILER = pytest.mark.skipif(not any(map(shutil.which, ("c++", "g++", "clang++"))),
                               reason="torch.compile needs a C++ compiler")


@_COMPILER
# torch.compile itself uses a part of torch that torch has deprecated.
@pytest.mark.filterwarnings("ignore:.*torch.jit.script_method:DeprecationWarning")
@pytest.mark.parametrize("craft", [
    PLATFORM, pytest.param(FLYER, marks=pytest.mark.slow),
], ids=lambda craft: craft.name)
def test_numpy_and_compiled_agree(craft: Spacecraft) -> None:
    compare(craft, torch.float64, 1e-12, torch_engine)  # as above


@both_crafts
def test_float32_flies_where_float64_does(craft: Spacecraft) -> None:
    """Over 25 s of commands held for a second; the target of the project is 1e-3 m and rad."""
    task = GoToPose(fail_distance=1e3, fail_spin=1e3)
    timing = Timing(episode_steps=126)
    short, long = (Engine(craft, task, 64, timing, dtype=d) for d in (torch.float32, torch.float64))
    for action in actions(craft, 64, 125, held=5):
        a, b = short.step(action).final_observation, long.step(action).final_observation
    first = 6 if craft.dimension == 2 else 13
    # Relative to the distance flown, tens of metres here where an episode allows 8.
    scale = way_to_go(craft, b)[:, None].clamp(min=8.0) / 8.0
    worst = ((a - b).abs() / scale)[:, first:].max()
    assert worst < 1e-3


@both_crafts
def test_reset_goes_on_counting_and_a_seed_starts_over(backend: Any, craft: Spacecraft) -> None:
    engine = backend(craft, NEAR, 3, SHORT, seed=5)
    first = engine.observe()
    second = engine.reset()
    assert (first != second).any(dim=1).all()
    np.testing.assert_allclose(second[0], first_observation(craft, 5, 3), atol=1e-6)  # float32
    torch.testing.assert_close(engine.reset(5), first, rtol=0, atol=0)
    assert (engine.reset(6) != first).any(dim=1).all()
    np.testing.assert_allclose(engine.reset(2**64 - 1)[0], first_observation(craft, -1, 0), atol=1e-6)


def test_reset_forgets_the_steps(backend: Any) -> None:
    engine = backend(PLATFORM, GoToPose(), 2, Timing(episode_steps=5))
    still = torch.zeros(2, 8)
    for _ in range(3):
        engine.step(still)
    engine.reset()
    assert [bool(engine.step(still).truncated.all()) for _ in range(5)] == [False] * 4 + [True]


def test_stagger_spreads_the_ends(backend: Any) -> None:
    engine = backend(PLATFORM, GoToPose(), 2000, Timing(episode_steps=10))
    engine.stagger(torch.Generator().manual_seed(1))
    truncated = torch.stack([engine.step(torch.zeros(2000, 8)).truncated for _ in range(30)])
    first = truncated.int().argmax(dim=0)
    # 200 of 2,000 expected in each of ten steps; 5 standard deviations of 13.
    assert (torch.bincount(first, minlength=10) - 200).abs().max() < 65
    for shift in (10, 20):
        assert truncated.gather(0, (first + shift).clamp(max=29)[None]).all()
    assert (truncated.sum(dim=0) == 3).all()


@both_crafts
def test_a_loaded_state_goes_on_bit_for_bit(backend: Any, craft: Spacecraft) -> None:
    engine = backend(craft, NEAR, 16, SHORT, seed=9)
    run(engine, 7)
    saved = engine.save_state()
    expected = run(engine, 45, seed=2)
    other = backend(craft, NEAR, 16, SHORT, seed=123)
    places = [x.data_ptr() for x in leaves(other.state)] if torch.is_tensor(other.state.p.x) else []
    other.load_state(saved)
    for a, b in zip(expected, run(other, 45, seed=2), strict=True):
        for x, y in zip(a, b, strict=True):
            assert torch.equal(x, y)
    # A CUDA graph reads and writes these very places.
    assert places == ([x.data_ptr() for x in leaves(other.state)] if places else [])


def test_a_state_moves_between_backends() -> None:
    """A training saved on a GPU can be looked at on a machine without one, and the reverse."""
    numpy_engine = Engine(PLATFORM, NEAR, 8, SHORT, seed=9)
    run(numpy_engine, 7)
    torch_one = torch_engine(PLATFORM, NEAR, 8, SHORT)
    torch_one.load_state(numpy_engine.save_state())
    again = Engine(PLATFORM, NEAR, 8, SHORT)
    again.load_state(torch_one.save_state())
    expected = numpy_engine.observe()
    assert torch.equal(again.observe(), expected)
    for x, y in zip(run(again), run(numpy_engine), strict=True):
        assert torch.equal(x.observation, y.observation)


def test_a_foreign_state_is_refused(backend: Any) -> None:
    saved = backend(PLATFORM, NEAR, 1, SHORT).save_state()
    with pytest.raises(ConfigError, match="4 environments of 'floating-platform'"):
        backend(PLATFORM, NEAR, 4, SHORT).load_state(saved)
    with pytest.raises(ConfigError, match="1 environments of 'free-flyer'"):
        backend(FLYER, NEAR, 1, SHORT).load_state(saved)


@both_crafts
def test_results_are_never_written_again(backend: Any, craft: Spacecraft) -> None:
    engine = backend(craft, NEAR, 16, SHORT, seed=9)
    observed = engine.observe()
    kept = [observed.clone()]
    step = engine.step(actions(craft, 16, 1)[0])
    kept += [x.clone() for x in step]
    run(engine, 25, seed=3)
    engine.reset()
    for before, now in zip(kept, (observed, *step), strict=True):
        assert torch.equal(before, now)


def test_actions_of_any_dtype_and_layout_mean_the_same(backend: Any) -> None:
    action = actions(PLATFORM, 16, 1)[0]
    forms = [action, action.bool(), action.float(), action.to(torch.int8), action.T.contiguous().T]
    seen = [backend(PLATFORM, NEAR, 16, SHORT).step(form).final_observation for form in forms]
    for other in seen[1:]:
        assert torch.equal(other, seen[0])


def test_errors_are_those_of_the_current_state(backend: Any) -> None:
    engine = backend(PLATFORM, GoToPose(), 16, seed=1)
    run(engine, 3)
    seen, errors = engine.observe(), engine.errors()
    torch.testing.assert_close(errors["position"], way_to_go(PLATFORM, seen))
    torch.testing.assert_close(errors["attitude"], torch.atan2(seen[:, 9], seen[:, 8]).abs())


def test_memory_does_not_grow() -> None:
    engine = Engine(PLATFORM, NEAR, 4096, SHORT)
    action = actions(PLATFORM, 4096, 1)[0]
    engine.step(action)
    tracemalloc.start()
    try:
        engine.step(action)
        gc.collect()
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(100):
            engine.step(action)
        gc.collect()
        # One array of one step kept each time would be 100 x 16 kB.
        assert tracemalloc.get_traced_memory()[0] - before < 100_000
    finally:
        tracemalloc.stop()


def stronger(craft: Spacecraft, factor: float) -> Spacecraft:
    thrusters = tuple(dataclasses.replace(t, force=factor * t.force) for t in craft.thrusters)
    return dataclasses.replace(craft, thrusters=thrusters)


@pytest.mark.parametrize("factor", [1.0, 1e3])
@pytest.mark.parametrize("name", ["floating-platform", "free-flyer", "nasty planar", "nasty spatial"])
def test_a_million_steps_without_nan(name: str, factor: float, planar_craft: Spacecraft,
                                     spatial_craft: Spacecraft) -> None:
    """Random, held, one-sided and full thrust; also a thousand times too much of it."""
    own = {"nasty planar": planar_craft, "nasty spatial": spatial_craft}
    craft = stronger(own.get(name) or load_spacecraft(name), factor)
    count, n = 8192, len(craft.thrusters)
    engine = Engine(craft, GoToPose(), count)
    random, held = actions(craft, count, 125, held=1), actions(craft, count, 125, held=25)
    one = torch.eye(n).repeat(count // n + 1, 1)[:count]
    for k in range(125):
        kinds = (random[k], held[k], one, torch.ones(count, n))
        step = engine.step(kinds[0] if k < 32 else kinds[k // 32])
        assert all(torch.isfinite(x).all() for x in (step.observation, step.final_observation, step.terms))


@pytest.mark.parametrize("count", [0, -1, 2.5, True, "4"])
def test_wrong_number_of_environments(count: Any) -> None:
    with pytest.raises(ConfigError, match="whole number >= 1, got"):
        Engine(PLATFORM, NEAR, count)


def test_wrong_dtype_and_seed() -> None:
    with pytest.raises(ConfigError, match=r"float32 or torch\.float64, got torch\.float16"):
        Engine(PLATFORM, NEAR, 1, dtype=torch.float16)
    with pytest.raises(ConfigError, match="64 bits"):
        Engine(PLATFORM, NEAR, 1, seed=2**64)
