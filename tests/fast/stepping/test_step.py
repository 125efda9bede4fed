from __future__ import annotations

import dataclasses
import gc
import shutil
import tracemalloc
from functools import partial
from typing import Any

import pytest
import torch

from rans import Engine, GoToPose, Spacecraft, Timing
from rans.model.spacecraft_file import load_spacecraft
from tests.support import engines
from tests.support.engines import (
    FLYER,
    NEAR,
    PLATFORM,
    SHORT,
    actions,
    both_crafts,
    run,
    torch_engine,
)
from tests.support.host_kernels import compare


def alike(craft: Spacecraft, dtype: torch.dtype = torch.float64, **how: Any) -> None:
    """NumPy and compiled torch step alike by the same commands, through ends of many episodes."""
    ours, theirs = (
        make(craft, NEAR, 64, SHORT, seed=2, dtype=dtype, **how) for make in (Engine, torch_engine)
    )
    assert compare(ours, theirs, 45 if dtype == torch.float64 else 25) > 64


@pytest.mark.parametrize(
    ("craft", "dtype"),
    [(FLYER, torch.float64), (PLATFORM, torch.float64), (PLATFORM, torch.float32)],
)
def test_numpy_and_torch_agree(craft, dtype):
    with torch.compiler.set_stance("force_eager"):
        alike(craft, dtype)


@pytest.mark.skipif(
    not any(map(shutil.which, ("c++", "g++", "clang++"))),
    reason="torch.compile needs a C++ compiler",
)
# torch.compile itself uses a part of torch that torch has deprecated.
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*torch.jit.script_method:DeprecationWarning")
def test_numpy_and_compiled_agree(monkeypatch):
    # Processes that compile beside this one would each import torch.
    monkeypatch.setattr("torch._inductor.config.compile_threads", 1)
    alike(PLATFORM)


@pytest.mark.slow
def test_a_step_in_space_is_one_graph(monkeypatch):
    """What torch's compiler is given, without the 20 s it would then take for the machine's code."""
    monkeypatch.setattr(torch, "compile", partial(torch.compile, backend="eager"))
    alike(FLYER)


@dataclasses.dataclass(frozen=True)
class Untraceable(GoToPose):
    """A task whose reward torch's compiler does not follow."""

    def reward(self, transition: Any) -> dict[str, Any]:
        terms = dict(super().reward(transition))
        name = type(self.fail_spin).__module__.partition(".")[0]  # which the compiler does not know
        return terms if name else {}


@pytest.mark.slow
def test_what_torch_cannot_compile_runs_eagerly(monkeypatch):
    monkeypatch.setattr(torch, "compile", partial(torch.compile, backend="eager"))
    ours = Engine(PLATFORM, Untraceable(), 4, SHORT, seed=2)
    theirs = torch_engine(PLATFORM, Untraceable(), 4, SHORT, seed=2)
    first, second = actions(PLATFORM, 4, 2)
    with pytest.warns(UserWarning, match="torch cannot compile what its task does"):
        got = theirs.step(first)
    # Single precision, in another order.
    torch.testing.assert_close(got.reward, ours.step(first).reward, rtol=0, atol=1e-5)
    torch.testing.assert_close(
        theirs.step(second).reward, ours.step(second).reward, rtol=0, atol=1e-5
    )


@both_crafts
def test_float32_flies_where_float64_does(craft):
    """Over 25 s of commands held for a second; the target of the project is 1e-3 m and rad."""
    task = GoToPose(fail_distance=1e3, fail_spin=1e3)
    timing = Timing(episode_steps=126)
    short, long = (Engine(craft, task, 64, timing, dtype=d) for d in (torch.float32, torch.float64))
    for action in actions(craft, 64, 125):
        short.step(action)
        long.step(action)
    a = short.observe()
    b = long.observe()
    first = 6 if craft.dimension == 2 else 13
    # Relative to the distance flown, tens of metres here where an episode allows 8.
    scale = engines.way_to_go(craft, b)[:, None].clamp(min=8.0) / 8.0
    worst = ((a - b).abs() / scale)[:, first:].max()
    assert worst < 1e-3


def test_a_state_moves_between_backends():
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


@pytest.mark.slow
def test_memory_does_not_grow():
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


@pytest.mark.filterwarnings("ignore:spacecraft .* one command turns it")  # a hundred times too much
@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("floating-platform", 1.0),
        pytest.param("nasty spatial", 1.0, marks=pytest.mark.slow),
        ("nasty planar", 100.0),
        ("nasty spatial", 100.0),
    ],
)
def test_a_hundred_thousand_steps_without_nan(name, factor, planar_craft, spatial_craft):
    """Random, held, one-sided and full thrust; also a hundred times too much of it."""
    own = {"nasty planar": planar_craft, "nasty spatial": spatial_craft}
    craft = stronger(own.get(name) or load_spacecraft(name), factor)
    quick = factor == 1.0 or craft.dimension == 2  # else 64 substeps are chosen in space
    count = 1024 if quick else 256
    n = len(craft.thrusters)
    engine = Engine(craft, GoToPose(), count, Timing(substeps=None if quick else 8))
    random = actions(craft, count, 125, held=1)
    held = actions(craft, count, 125, held=25)
    one = torch.eye(n).repeat(count // n + 1, 1)[:count]
    for k in range(0, 125, 1 if quick else 5):
        kinds = (random[k], held[k], one, torch.ones(count, n))
        step = engine.step(kinds[0] if k < 32 else kinds[k // 32])
        for values in (step.observation, step.final_observation, step.terms):
            assert torch.isfinite(values).all()
