"""The generated kernel against NumPy, which runs the equations themselves."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
import torch
from rans_machine_code.cuda import step as step_kernel
from rans_machine_code.cuda.launch import CudaError
from rans_machine_code.cuda.step import Kernel

from rans import (
    TASKS,
    Conditions,
    Engine,
    FaultConditions,
    GoToPose,
    Spacecraft,
    ThrusterConditions,
    Timing,
)
from rans.compile.step_program import trace_step
from rans.fast.distributed import Processes
from rans.fast.learn.curriculum import Curriculum, Ramp
from rans.fast.stepping.compiled import generated_step
from rans.model.actuators import Pulsed, Throttle
from rans.model.body import Body
from rans.model.fields import where
from tests.support.engines import FLYER, NEAR, PLATFORM, SHORT, actions, both_crafts
from tests.support.host_kernels import SEED, TOLERANCE, compare, needs_compiler
from tests.support.switching import SwitchingGoToPose
from tests.support.worlds import EFFECTS, PAIRS

pytestmark = needs_compiler


@pytest.fixture(params=[1, 2])
def together(request, monkeypatch) -> int:
    """Of few spacecraft too, a thread steps so many."""
    monkeypatch.setattr(step_kernel, "MANY", 1 if request.param == 2 else 2**31)
    monkeypatch.setattr(step_kernel, "LONG", 2**31)
    return request.param


def ends(on_host: Any, *made: Any, steps: int = 25, form: Any = torch.uint8, **how: Any) -> int:
    """Episodes that end where the kernel and NumPy fly alike, by default in double precision."""
    given: Any = {"seed": SEED, "dtype": torch.float64} | how
    return compare(Engine(*made, **given), on_host(*made, **given), steps, form)


def two_a_thread(test: Any) -> Any:
    """One a thread is what the tests of conditions and of tasks fly."""
    return pytest.mark.usefixtures("together")(
        pytest.mark.parametrize("together", [2], indirect=True)(test)
    )


@pytest.mark.parametrize(
    ("task", "together", "craft"),
    # The tasks that are least alike; `test_compiled` steps every task's program.
    [("multi-task", 2, FLYER), ("avoid", 1, PLATFORM), ("track-velocity", 1, PLATFORM)],
    indirect=["together"],
    ids=lambda x: getattr(x, "name", str(x)),
)
def test_tasks_step_and_restart_as_on_numpy(on_host, task, craft, together):
    made = (craft, TASKS[task](), 16, Timing(episode_steps=12))
    how = {"seed": SEED, "dtype": torch.float64}
    engine = on_host(*made, **how)
    assert engine._kernel._together == together
    assert compare(Engine(*made, **how), engine) >= 2 * 16


@pytest.mark.parametrize("name", ["sensors", "dropout"])
def test_an_observation_is_that_of_numpy(on_host, name):
    """In what their episodes drew, after a step."""
    given = {"seed": SEED, "dtype": torch.float64, "conditions": EFFECTS[name]}
    ours = Engine(PLATFORM, NEAR, 16, SHORT, **given)
    theirs = on_host(PLATFORM, NEAR, 16, SHORT, **given)
    for engine in (ours, theirs):
        engine.step(torch.ones(16, 8))
    torch.testing.assert_close(
        theirs.observe(), ours.observe(), rtol=0, atol=TOLERANCE[torch.float64]
    )


@pytest.mark.filterwarnings("ignore:spacecraft 'free-flyer'.*cannot push and turn")
@pytest.mark.parametrize(
    ("thrusters", "form", "together"),
    [
        (5, torch.bool, 2),
        (6, torch.float64, 1),
        (12, torch.uint8, 2),
    ],
    indirect=["together"],
)
@pytest.mark.usefixtures("together")
def test_actions_of_any_number_of_thrusters_and_any_dtype(on_host, thrusters, form):
    """Commands are read in pieces of one to sixteen bytes."""
    craft = replace(FLYER, thrusters=FLYER.thrusters[:thrusters], thrust_sharing="split")
    ends(on_host, craft, GoToPose(), 4, Timing(substeps=1), steps=6, form=form)


def test_actions_may_lie_anywhere(on_host):
    made = (PLATFORM, NEAR, 3, SHORT)
    action = actions(PLATFORM, 3, 1)[0].to(torch.uint8)
    shifted = torch.zeros(25, dtype=torch.uint8)[1:].view(3, 8).copy_(action)
    sparse = torch.zeros(3, 16, dtype=torch.uint8)[:, ::2].copy_(action)
    engine = on_host(*made)
    begun = engine.save_state()
    seen = []
    for form in (action, shifted, sparse):
        engine.load_state(begun)
        seen.append(engine.step(form).observation.clone())
    # A GPU reads 16 bytes at once, from where a multiple of them lies.
    assert shifted.data_ptr() % 16 == 1
    assert engine._kernel._readable(shifted).data_ptr() % 16 == 0
    assert torch.equal(seen[0], seen[1])
    assert torch.equal(seen[0], seen[2])


def test_an_odd_number_of_spacecraft_flies_one_by_one(on_host, monkeypatch):
    monkeypatch.setattr(step_kernel, "MANY", 1)
    made = (PLATFORM, NEAR, 15, SHORT)
    engine = on_host(*made)
    assert engine._kernel._together == 1
    assert compare(Engine(*made), engine) > 15


@two_a_thread
def test_each_process_flies_its_own_episodes(on_host):
    whole = Engine(PLATFORM, NEAR, 16, SHORT)
    part = on_host(PLATFORM, NEAR, 8, SHORT, processes=Processes(1, 2))
    over = 0
    for action in actions(PLATFORM, 16, 25):
        expected = whole.step(action)
        found = part.step(action[1::2])
        torch.testing.assert_close(
            found.observation, expected.observation[1::2], rtol=0, atol=TOLERANCE[torch.float32]
        )
        over += int((found.terminated | found.truncated).sum())
    assert over > 8


def test_a_lost_state_earns_nothing(on_host):
    engine = on_host(PLATFORM, NEAR, 4, SHORT)
    engine.state.p.x[1] = torch.nan
    step = engine.step(torch.zeros(4, 8))
    assert step.terminated.tolist() == step.reward.eq(0.0).tolist() == [False, True, False, False]
    assert step.terms[:, 1].eq(0.0).all()


@two_a_thread
def test_a_curriculum_moves_the_settings_of_a_compiled_kernel(on_host):
    ramps = (Ramp("thrust_weight", 0.5, 100), Ramp("spawn_distance", (0.1, 0.2), 100))
    ours, theirs = (Curriculum(NEAR, ramps, dtype) for dtype in (np.float32, torch.float32))
    a = Engine(PLATFORM, ours.task, 16, SHORT)
    b = on_host(PLATFORM, theirs.task, 16, SHORT)
    seen = []
    for steps in (0, 50, 100):
        for curriculum in (ours, theirs):
            curriculum.move_to(steps)
        compare(a, b)
        seen.append([engine.step(torch.ones(16, 8)).terms[-1, 0].item() for engine in (a, b)])
    # Eight thrusters at a price on its way from 0.5 to the task's 0.02.
    np.testing.assert_allclose(seen, [[-4.0] * 2, [-2.08] * 2, [-0.16] * 2], rtol=1e-6)


def test_settings_that_would_be_read_wrongly_are_refused(on_host):
    """The kernel is given where they lie, not what they are."""
    task = Curriculum(NEAR, [Ramp("thrust_weight", 0.5, 100)], torch.float64).task
    with pytest.raises(
        TypeError, match=r"must be torch\.float32 on cpu, got torch\.float64 on cpu"
    ):
        on_host(PLATFORM, task, 4)
    engine = on_host(PLATFORM, NEAR, 4)
    weight: Any = torch.empty((), device="meta")
    elsewhere = replace(NEAR, thrust_weight=weight)
    world = replace(engine._world, setup=engine._world.setup._replace(task=elsewhere))
    with pytest.raises(
        TypeError, match=r"must be torch\.float32 on cpu, got torch\.float32 on meta"
    ):
        Kernel(trace_step(world, engine.episode, engine.dtype), engine._draws)


@pytest.mark.parametrize(
    "error",
    [
        OSError("libnvrtc.so.12: cannot open shared object file"),
        CudaError("no kernel image"),
        AttributeError("'Symbol' object has no attribute 'clamp'"),
    ],
)
def test_without_a_kernel_an_engine_says_why_it_steps_slower(error, monkeypatch):
    def fail(*_):
        raise error

    monkeypatch.setattr(Kernel, "function", fail)
    engine = Engine(PLATFORM, NEAR, 2, compiled=True)
    with pytest.warns(UserWarning, match=f"this engine steps slower, as .*{error}"):
        assert generated_step("cuda", engine._world, engine.episode, engine._draws) is None


def with_actuators(kind: Any) -> Spacecraft:
    return replace(PLATFORM, actuators=kind)


@pytest.mark.parametrize(
    ("kind", "dtype", "together"),
    [
        (Throttle(), torch.float64, 2),
        (Pulsed(5, 2), torch.float32, 1),
    ],
    indirect=["together"],
    ids=str,
)
@pytest.mark.usefixtures("together")
def test_shares_of_thrust(on_host, kind, dtype):
    """Commands anywhere from 0 to 1; the last is remembered in 32 bits, whatever the engine computes in."""
    made = (with_actuators(kind), SwitchingGoToPose(**vars(NEAR)), 16, SHORT)
    ours = Engine(*made, seed=SEED, dtype=dtype)
    theirs = on_host(*made, seed=SEED, dtype=dtype)
    assert {array.dtype for array in theirs.episode.commands[0]} == {torch.float32}
    generator = torch.Generator().manual_seed(7)

    def shares(steps):
        whole = actions(PLATFORM, 16, steps)
        return whole * (0.2 + 0.8 * torch.rand(whole.shape, generator=generator, dtype=dtype))

    assert compare(ours, theirs, form=dtype, given=shares(25)) >= 16


class Unbounded(GoToPose):
    """A reward with numbers that are not finite in its formula."""

    def reward(self, transition: Any) -> dict[str, Any]:
        terms = dict(super().reward(transition))
        distance, _ = self.errors(transition.state, transition.goal).values()
        cheapest = where(distance < 1.0, distance, distance * 0.0 + math.inf)
        terms["near"] = where(cheapest < math.inf, 1.0 - cheapest, distance * 0.0)
        terms["far"] = where(distance * 0.0 - math.inf < -distance, distance * 0.0, distance)
        return terms


def like_near(kind: Any) -> Any:
    return kind(**{field.name: getattr(NEAR, field.name) for field in fields(NEAR)})


@two_a_thread
def test_numbers_that_are_not_finite(on_host):
    assert ends(on_host, PLATFORM, like_near(Unbounded), 16, SHORT) > 16


@both_crafts
def test_a_body_for_every_spacecraft(on_host, craft):
    nominal = Body.of(craft)
    scale = torch.linspace(0.5, 2.0, 16, dtype=torch.float64)
    gain = tuple(torch.roll(scale, k).clamp(max=1.0) for k in range(len(craft.thrusters)))
    body = replace(nominal, mass=nominal.mass * scale, gain=gain)
    assert ends(on_host, craft, NEAR, 16, SHORT, body=body) > 16


IN_ALL = {
    *("all", "body", "thrust", "latency", "rise", "hold", "named", "recoverable", "push", "swing"),
    *("kick", "sensors", "dropout"),
}
"""Effects that are not flown alone: they show in "all", where every effect is."""


@pytest.mark.parametrize(
    ("effect", "remember", "craft"),
    [
        # By turns in the plane and in space.
        *(
            (effect, False, (PLATFORM, FLYER)[number % 2])
            for number, effect in enumerate(one for one in EFFECTS if one not in IN_ALL)
        ),
        ("all", True, PLATFORM),
    ],
    ids=lambda x: getattr(x, "name", str(x)),
)
def test_every_condition_is_drawn_and_flown_as_on_numpy(on_host, effect, remember, craft):
    made = (craft, GoToPose(), 8, Timing(episode_steps=6))
    how = {
        "seed": SEED,
        "dtype": torch.float64,
        "conditions": (EFFECTS | {"pairs": PAIRS})[effect],
    }
    ours = Engine(*made, **how)
    theirs = on_host(*made, **how, remember=remember)
    torch.testing.assert_close(theirs.observe(), ours.observe(), rtol=0, atol=1e-12)
    assert compare(ours, theirs, 13) > 8


@pytest.mark.parametrize(
    "conditions",
    [
        Conditions(thrusters=ThrusterConditions(latency=0.2)),
        Conditions(thrusters=ThrusterConditions(latency=0.33, rise=0.4)),
        Conditions(faults=FaultConditions(count=1.0, time=0.67)),
    ],
    ids=["late", "late and gradual", "fault"],
)
def test_conditions_without_ranges_are_programs_too(on_host, conditions):
    """Where a period is cut is then known before; pieces of it come and go."""
    timing = Timing(episode_steps=12)
    assert ends(on_host, PLATFORM, GoToPose(), 8, timing, conditions=conditions) > 8
