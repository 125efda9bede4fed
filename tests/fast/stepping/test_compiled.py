"""An engine's step as a straight-line program does what its equations do."""

from __future__ import annotations

import copy
from typing import Any

import pytest
import torch

from rans import TASKS, Conditions, Engine, ThrusterConditions, Timing
from rans.fast.stepping.compiled import ArrayStep
from rans.fast.stepping.step import step_arrays
from tests.support.crafts import ANY_CRAFT
from tests.support.engines import FLYER, NEAR, PLATFORM, SHORT, actions
from tests.support.host_kernels import compare


def pair(*given: Any, **kwargs: Any) -> tuple[Engine, Engine]:
    """An engine whose equations run on arrays, and one as they are made, in single precision."""
    plain, straight = (Engine(*given, **kwargs) for _ in range(2))
    plain._step = step_arrays
    return plain, straight


def is_straight(engine: Engine) -> bool:
    return isinstance(engine._step, ArrayStep) and engine._step._generated is not None


@pytest.mark.parametrize(
    ("task", "craft"),
    [(task, (FLYER, PLATFORM)[number % 2]) for number, task in enumerate(ANY_CRAFT)],
    ids=lambda x: getattr(x, "name", str(x)),
)
def test_every_task_steps_and_restarts(task, craft):
    plain, straight = pair(craft, TASKS[task](), 16, Timing(episode_steps=12), seed=2**40 + 5)
    assert compare(plain, straight) > 16
    assert is_straight(straight)


@pytest.mark.parametrize(
    "kwargs",
    [
        {"num_envs": 4099, "seed": 3},
        {"num_envs": 12, "seed": 3, "conditions": "lab"},
    ],
    ids=["blocks", "lab"],
)
def test_blocks_and_conditions(kwargs):
    """4,099 are two blocks, of which the second is small."""
    steps = 8 if kwargs["num_envs"] > 12 else 25
    plain, straight = pair(PLATFORM, NEAR, timing=Timing(episode_steps=6), **kwargs)
    assert compare(plain, straight, steps) > 0
    assert is_straight(straight)


@pytest.mark.slow
def test_what_would_be_too_long_a_program_is_none():
    """At 1 kHz a valve that is 0.2 s late has 200 commands on their way: it took minutes and gigabytes."""
    late = Conditions(thrusters=ThrusterConditions(latency=(0.0, 0.2)))
    engine = Engine(PLATFORM, NEAR, 2, Timing(0.001, substeps=1), conditions=late)
    engine.step(torch.ones(2, 8))
    assert len(engine.episode.memory()) > 1600
    assert not is_straight(engine)


def test_copies_fly_on_by_themselves():
    engine = Engine(PLATFORM, NEAR, 8, SHORT, seed=1)
    first, second = actions(PLATFORM, 8, 2)
    engine.step(first)
    twin = copy.deepcopy(engine)
    ours = engine.step(second)
    assert all(map(torch.equal, twin.step(second), ours))
