"""The MPC settles in every task; its plans are those of a solver that knows nothing of its equations."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any, cast

import casadi as ca
import numpy as np
import pytest
from rans_optimal.mpc import MPC, MPCSettings, shortest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from rans import GoToPose, Spacecraft, Timing
from rans.control.regulator import Deadband, Regulator, Weights
from rans.episode.scenario import scenarios
from rans.model.actuators import OnOff, Pulsed, Throttle
from rans.model.body import Body
from rans.model.dynamics import advance, wrench
from rans.model.fields import leaves, map_leaves
from rans.model.spacecraft_file import load_spacecraft

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")

TASK = GoToPose().for_evaluation()
TIMING = Timing()


def first(tree: Any) -> Any:
    return map_leaves(lambda x: float(x[0]), tree)


def cost(
    craft: Spacecraft,
    regulator: Regulator,
    start: Any,
    goal: Any,
    commands: np.ndarray,
    effort: float,
) -> float:
    """What a plan costs, flown in NumPy and measured with SciPy's rotations."""
    turn = turn_to_go(start, goal)
    total = effort * float((commands**2).sum())
    state = start
    for k in range(commands.shape[1]):
        state = advance(
            state, wrench(craft, tuple(commands[:, k])), Body.of(craft), TIMING.control_period
        )
        turn = turn_to_go(state, goal)
        gaps = (
            ((state.p - goal.p).columns(), (state.v - goal.v).columns(), regulator.translation),
            (turn, np.array(state.spin()) - np.array(goal.spin()), regulator.rotation),
        )
        last = k == commands.shape[1] - 1
        for deviation, speed, gains in gaps:
            error = np.array([*deviation, *speed])
            price = np.diag(np.repeat(gains.price, len(error) // 2))
            total += error @ (gains.cost_to_go if last else price) @ error
    return float(total)


def turn_to_go(state: Any, goal: Any) -> np.ndarray:
    turn = goal.attitude.to(state.attitude)
    return (
        np.array([turn.angle])
        if len(leaves(turn)) == 1
        else Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_rotvec()
    )


@pytest.mark.parametrize(("craft", "horizon"), [(PLATFORM, 5), (FLYER, 2)], ids=["plane", "space"])
def test_plan_is_that_of_a_generic_solver(craft, horizon):
    """Repeated until it stays, the program has found what SLSQP finds by finite differences."""
    starts = scenarios(GoToPose(spawn_distance=(0.3, 0.4)), craft, 34, 1)
    goal = starts.goal
    program = MPC(craft, TASK, TIMING, settings=MPCSettings(horizon=horizon))._program
    error = shortest(starts.start, goal)[:, 0]
    goals = np.tile(np.array(leaves(goal)), horizon + 1)
    nothing = np.zeros(len(craft.thrusters))
    plan = np.zeros((len(craft.thrusters), horizon))
    for _ in range(30):
        plan = cast(np.ndarray, program.improved(plan, error, goals, nothing))
    # full thrust along an axis costs 1: in the plane four nozzles give it, in space four along x or y
    effort = 1.0 / 4.0
    regulator = Regulator.of(craft, TASK, TIMING, Weights())
    begin = first(starts.start)
    end = first(goal)

    def objective(flat):
        return cost(craft, regulator, begin, end, flat.reshape(plan.shape), effort)

    best = minimize(
        objective,
        np.full(plan.size, 0.2),
        method="SLSQP",
        bounds=[(0.0, 1.0)] * plan.size,
        options={"ftol": 1e-10, "maxiter": 300},
    )
    ours = objective(plan.ravel())
    assert ours < objective(np.zeros(plan.size))
    assert ours == pytest.approx(best.fun, rel=1e-5)  # finite differences leave SLSQP about 1e-6


def test_a_program_without_a_solution_falls_back_to_the_plan_before():
    starts = scenarios(TASK, PLATFORM, 35, 2)
    controller = MPC(PLATFORM, TASK, TIMING, settings=MPCSettings(horizon=4))
    controller.reset(2)
    seen = np.zeros((2, 10))
    controller.act(starts.start, starts.goal, seen)
    plans = controller._plans.copy()
    program = controller._program
    sparsity = {"h": program._solver.sparsity_in(0), "a": program._solver.sparsity_in(2)}
    program._solver = ca.conic(
        "lame", "piqp", sparsity, {"error_on_fail": False, "piqp": {"max_iter": 1}}
    )
    pulses = controller.act(starts.start, starts.goal, seen)
    assert controller.failures == 2
    assert set(np.unique(pulses)) <= {0.0, 1.0}
    np.testing.assert_array_equal(controller._plans[..., :-1], plans[..., 1:])
    np.testing.assert_array_equal(controller._plans[..., -1], 0.0)


def test_plans_are_the_same_whatever_the_kind_of_thrusters():
    """Plans take any share of full force: below the least level of a throttle its force would have no slope."""
    starts = scenarios(TASK, PLATFORM, 35, 1)
    plans = []
    for kind in (OnOff(), Throttle(), Throttle(least=0.2), Pulsed(counts=10, least=3)):
        controller = MPC(
            replace(PLATFORM, actuators=kind), TASK, TIMING, settings=MPCSettings(horizon=4)
        )
        controller.reset(1)
        assert controller.act(starts.start, starts.goal, np.zeros((1, 10))).any()
        plans.append(controller._plans)
    assert plans[0].max() > 0.1
    for plan in plans[1:]:
        np.testing.assert_array_equal(plan, plans[0])


def test_a_copy_by_way_of_a_file_does_the_same():
    """Processes get it so."""
    starts = scenarios(TASK, PLATFORM, 36, 3)
    seen = np.zeros((3, 10))
    controllers = [MPC(PLATFORM, TASK, TIMING)]
    controllers.append(pickle.loads(pickle.dumps(controllers[0])))
    pulses = []
    for controller in controllers:
        controller.reset(3)
        pulses.append([controller.act(starts.start, starts.goal, seen) for _ in range(2)])
    assert np.any(pulses[0])
    np.testing.assert_array_equal(pulses[0], pulses[1])


def test_a_plan_ends_where_it_rests():
    """Who was at rest plans anew, as one does who has just begun, and not along what was left to fly."""
    starts = scenarios(TASK, PLATFORM, 36, 2)
    plans = []
    for path in ((starts.start,), (starts.start, starts.goal, starts.start)):
        controller = MPC(PLATFORM, TASK, TIMING)
        controller.reset(2)
        for state in path:
            controller.act(state, starts.goal, np.zeros((2, 10)))
        plans.append(controller._plans)
    assert plans[0].max() > 0.1
    np.testing.assert_array_equal(plans[0], plans[1])


def test_nothing_is_planned_at_rest():
    goal = scenarios(TASK, PLATFORM, 36, 3).goal
    controller = MPC(PLATFORM, TASK, TIMING)
    controller.reset(3)
    controller._program = None  # type: ignore[assignment] - asking it fails
    assert not controller.act(goal, goal, np.zeros((3, 10))).any()
    restless = MPC(PLATFORM, TASK, TIMING, deadband=Deadband(share=0.0))
    restless.reset(3)
    restless._program = None  # type: ignore[assignment]
    with pytest.raises(AttributeError):
        restless.act(goal, goal, np.zeros((3, 10)))
