"""The generated kernel on a GPU does what uncompiled torch does, step by step, through many restarts."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from rans_machine_code.cuda import step as step_kernel
from torch import Tensor

from rans import TASKS, ConfigError, Engine, Timing
from rans.episode.flight_statistics import QUANTITIES
from rans.evaluation.fly.agent import Agent
from rans.evaluation.fly.contestants import contestant
from rans.fast.envs.actions import Actions
from rans.fast.flights import Flights
from rans.fast.stepping.step import Step
from rans.model.body import Body
from rans.model.spacecraft_file import load_spacecraft
from tests.support.crafts import ANY_CRAFT
from tests.support.switching import SwitchingGoToPose

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device"),
]
COUNTS = {1: 4099, 2: 4098}
STEPS = 200
"""Environments by how many a thread steps, not multiples of a warp; and steps, six episodes long."""
MADE = {name: TASKS[name]() for name in ANY_CRAFT} | {"switching": SwitchingGoToPose()}
"""The last one remembers commands."""
TOLERANCE = {torch.float64: 1e-12, torch.float32: 2e-5}
"""Rounding of one step, to a value of one: hundreds of operations; float32 has fast divisions and roots."""


def engine(
    craft: str, task: str, count: int, dtype: torch.dtype, generated: bool, body: Body | None = None
) -> Engine:
    return Engine(
        load_spacecraft(craft),
        MADE[task],
        count,
        Timing(episode_steps=30),
        seed=2**40 + 3,
        device="cuda",
        dtype=dtype,
        compiled=generated,
        generated=generated,
        body=body,
    )


def difference(ours: Tensor, theirs: Tensor) -> float:
    """The largest, relative to values above one."""
    return float(((ours - theirs).abs() / (1 + theirs.abs())).max()) if ours.numel() else 0.0


def flags(step: Step) -> Tensor:
    return torch.stack((step.terminated, step.truncated, step.reached))


def compare(plain: Engine, kernel: Engine) -> None:
    """Results and memory of every step are the same, up to `TOLERANCE`."""
    dtype = plain.dtype
    count = plain.num_envs
    assert isinstance(kernel._kernel, step_kernel.Kernel)
    assert COUNTS[kernel._kernel._together] == count
    generator = torch.Generator("cuda").manual_seed(0)
    ends = flips = 0
    for _ in range(STEPS):
        shape = count, len(plain.craft.thrusters)
        action = torch.rand(shape, device="cuda", generator=generator) < 0.3
        expected = plain.step(action.to(torch.uint8))
        found = kernel.step(action.to(torch.uint8))
        same = (flags(expected) == flags(found)).all(dim=0)
        ended = same & (expected.terminated | expected.truncated)
        ends = ends + int(ended.sum())
        flips = flips + int((~same).sum())
        for rows, name in ((same, "observation"), (same, "reward"), (ended, "final_observation")):
            worst = difference(getattr(found, name)[rows], getattr(expected, name)[rows])
            assert worst < TOLERANCE[dtype], name
        assert difference(found.terms.T[same], expected.terms.T[same]) < TOLERANCE[dtype]
        for left, right in zip(
            plain.save_state()["buffers"], kernel.save_state()["buffers"], strict=True
        ):
            assert difference(right[same].double(), left[same].double()) < TOLERANCE[dtype]
        kernel.load_state(plain.save_state())  # so that what is compared is always one step
    assert ends > count
    # A value within rounding of a bound may fall on either side of it.
    assert flips <= 1e-5 * count * STEPS


@pytest.fixture(params=COUNTS)
def count(request, monkeypatch) -> int:
    """So many environments that a thread steps as many as the key of `COUNTS`, fetching ahead."""
    monkeypatch.setattr(step_kernel, "MANY", 1)
    monkeypatch.setattr(step_kernel, "LONG", 2**31)
    monkeypatch.setattr(
        step_kernel.Kernel, "_blocks_ahead", lambda _: 3
    )  # or so few blocks fetch nothing
    return COUNTS[request.param]


@pytest.mark.parametrize("dtype", TOLERANCE, ids=["float64", "float32"])
@pytest.mark.parametrize("craft", ["floating-platform", "floating-platform-shared", "free-flyer"])
@pytest.mark.parametrize("task", MADE)
def test_the_kernel_does_what_torch_does(task, craft, dtype, count):
    compare(*(engine(craft, task, count, dtype, generated) for generated in (False, True)))


@pytest.mark.parametrize("craft", ["floating-platform", "free-flyer"])
def test_the_kernel_reads_bodies_that_differ(craft, count):
    nominal = Body.of(load_spacecraft(craft))
    scale = torch.linspace(0.5, 4.0, count, device="cuda")
    body = Body(nominal.mass * scale, tuple(entry * scale for entry in nominal.inertia))
    compare(
        *(
            engine(craft, "go-to-pose", count, torch.float64, generated, body)
            for generated in (False, True)
        )
    )


def told(checked: Callable[[Tensor], Tensor], right: Tensor) -> None:
    """Three calls, of which the second at the latest sends the check on and the third finds it done."""
    for _ in range(3):
        checked(right)
        torch.cuda.synchronize()


def test_a_wrong_action_is_told_though_many_right_ones_follow_it():
    """Queued behind a slow product, so that its check is still in flight when the next ones come."""
    checked = Actions(
        engine("floating-platform", "go-to-pose", 64, torch.float32, generated=True)
    ).checked
    right = torch.zeros(64, 8, device="cuda")
    wrong = torch.full((64, 8), 0.5, device="cuda")
    slow = torch.rand(8192, 8192, device="cuda")
    checked(right)
    slow = slow @ slow @ slow
    checked(right)
    checked(wrong)
    with pytest.raises(ConfigError, match="an earlier action"):
        told(checked, right)
    checked(right)  # and is not told twice
    torch.cuda.synchronize()
    checked(right)


COUNT = 16384


@pytest.mark.parametrize(("products", "alike"), [("bf16", 0.1), ("bf16x3", 0.9), ("bf16x6", 0.9)])
@pytest.mark.parametrize(
    "name",
    [
        "go-to-pose-2d",
        "go-to-pose-3d",
        "multi-task-2d",
        "go-to-pose-2d-robust",
        "go-to-pose-3d-robust",
    ],
)
def test_the_kernel_flies_as_a_cpu_does(name, products, alike):
    run = contestant(f"pretrained:{name}")
    assert isinstance(run.controller, Agent)
    count = COUNT // 8 if run.conditions else COUNT
    kernel = Flights(run.network, run.judged, "cuda", products=products).fly(5, count, 7)
    exact = Flights(run.network, run.judged).fly(5, count, 7)
    assert kernel.ways == {f"flight kernel, {products}"}
    # Of bfloat16 one command in a thousand is another, and with it the rest of its flight; else one in 1e5.
    same = set(kernel.numbers) & set(exact.numbers)
    share = 0.03 if products == "bf16" else 5e-3
    if name.endswith("robust"):  # whether a reading is repeated exactly depends on its last bit
        share = 4.0 * share
    assert len(same) >= alike * max(kernel.unsolved, exact.unsolved) - 2
    # Those that go another way are others of the same kind, whose number at a moment spreads like its root,
    # and whose mean like its standard error.
    assert np.abs(kernel.settled_at - exact.settled_at).sum() <= share * math.sqrt(count * COUNT)
    for quantity in QUANTITIES:
        found = kernel.sums[quantity]
        expected = exact.sums[quantity]
        assert abs(found.mean - expected.mean) <= 3.0 * expected.error


@pytest.mark.parametrize("generated", [True, False])
def test_parts_add_up(generated):
    run = contestant("pretrained:go-to-pose-2d")
    assert isinstance(run.controller, Agent)
    flights = Flights(run.network, run.judged, "cuda", generated=generated)
    whole = flights.fly(0, 3001, 1)
    parts = flights.fly(0, 1000, 1) + flights.fly(1000, 2001, 1)
    assert whole.failures == parts.failures
    np.testing.assert_array_equal(whole.numbers, parts.numbers)
    np.testing.assert_array_equal(whole.settled_at, parts.settled_at)
