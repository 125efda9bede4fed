"""Fitted value iteration: its model is the engine's, costs are symmetric, and training makes flights cheaper."""

from __future__ import annotations

import math
import shutil
from copy import deepcopy
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import pytest
import torch
from rans_value.belief import Belief
from rans_value.common import CommonProblem, CommonValue
from rans_value.controller import SHIPPED, CommonController, GreedyController, Newest
from rans_value.goal_frame import equivalent
from rans_value.greedy import Greedy
from rans_value.learner import Value, ValueLearner, ValueSettings
from rans_value.problem import PoseProblem, parted
from rans_value.varied import VariedProblem, drawn_parameters
from torch import Tensor

from rans import (
    TASKS,
    Conditions,
    ConfigError,
    Engine,
    FaultConditions,
    GoToPose,
    GoToPosePriced,
    RansWarning,
    ThrusterConditions,
    Timing,
)
from rans.api.training import config_of
from rans.episode.flight import fly
from rans.episode.scenario import draws, scenarios
from rans.episode.step import Setup
from rans.evaluation.compare.entrants import contest_of, enlist
from rans.evaluation.fly.episodes import fly_episodes
from rans.fast.learn.beginning import begin
from rans.fast.learn.config import TrainConfig, training, training_of_quality
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer
from rans.model.fields import wrap
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions_file import load_conditions
from tests.support.damage import check
from tests.support.draws import PLATFORM
from tests.support.training import TINY, ignore

TASK = GoToPosePriced(spawn_distance=(0.3, 0.6), evaluation_distance=(0.3, 0.6))
SMALL = ValueSettings(units=32, states=256, rounds=1, updates=12, batch=512)
PPO = replace(TINY, n_envs=64, n_steps=4, batch_size=64, layers=(16,))


def learner(craft: Any = PLATFORM, task: Any = TASK, units: int = 32) -> ValueLearner:
    engine = Engine(craft, task, PPO.n_envs)
    made = begin(engine, PPO, 0, True, partial(ValueLearner, own=replace(SMALL, units=units)))
    assert isinstance(made, ValueLearner)
    engine.reset()
    return made


def commands(count: int = 8) -> Tensor:
    return (torch.rand(64, count, generator=torch.Generator().manual_seed(1)) < 0.5).float()


WHEELED = "roboran-platform"
"""Planar craft whose thrusters share a supply, with a reaction wheel."""

# Near the port, whose cone looks the same in a mirror alone, and of which each turns at its own rate.
PORT = TASKS["dock-port"](
    spawn_distance=(0.66, 0.9),
    port_rate=(0.1, 0.5),
    cone_half_angle=1.2,
    position_tolerance=0.5,
    attitude_tolerance=1.5,
    velocity_tolerance=0.4,
    spin_tolerance=1.0,
)


@pytest.mark.parametrize(
    ("spacecraft", "task", "sides"),
    [
        ("floating-platform", TASK, 8),
        ("free-flyer", TASK, 16),
        ("floating-platform", PORT, 2),
        (WHEELED, TASK, 8),
        (WHEELED, PORT, 2),
    ],
)
def test_the_model_is_that_of_the_engine_and_looks_the_same_from_all_sides(spacecraft, task, sides):
    made = learner(load_spacecraft(spacecraft), task)
    problem = made.problem
    assert len(problem.turn) == sides
    command = commands(made.engine.craft.command_count)
    ended = torch.zeros(2)
    for _ in range(3):  # a craft that turns and moves
        before = made.states()
        step = made.engine.step(command)
        after, won, lost = problem.frame.step(before, command.unbind(dim=1))
        assert torch.equal(won | lost, step.terminated)
        goes_on = ~step.terminated
        assert not problem.frame.is_over(after[:, goes_on]).any()
        assert difference(made.states()[:, goes_on], after[:, goes_on]) < 1e-5
        _, cost, discount = problem.step(before, command)
        assert (discount[won | lost] == 0).all()
        assert ((cost > 25.0) == lost).all()
        ended += torch.stack((won, lost)).sum(dim=1)
    assert (ended > 0).all() == (task is PORT)
    for turn, hand, place in zip(problem.turn, problem.hand, problem.place, strict=True):
        placed = torch.zeros_like(command).scatter(1, place.expand(64, -1), command)
        placed[:, made.engine.craft.wheel_commands] *= hand
        seen, _, _ = problem.step(equivalent(before, turn, hand), placed)
        assert difference(seen, equivalent(after, turn, hand)) < 1e-4  # rounding


def difference(one: Tensor, other: Tensor) -> float:
    """Largest difference of states; of quaternions those of equal sign."""
    if len(one) == 14:
        sign = (one[3:7] * other[3:7]).sum(dim=0).sign()
        other = torch.cat((other[:3], sign * other[3:7], other[7:]))
    return float((one - other).abs().max())


@pytest.mark.parametrize("folder", ["floating-platform", "dock-port-2d", "free-flyer"])
def test_a_fit_begins_with_the_values_most_alike(folder, monkeypatch):
    monkeypatch.setattr("rans_value.learner._BEGUN", 0)
    fitted: Any = GreedyController(SHIPPED / folder)
    own = fitted.greedy.value
    craft, task, _ = fitted._setup
    made = learner(craft, task, units=512)
    made._begin()
    # Where pulses lead from rest, the heading or height being that of the goal.
    state = made.states()
    state[2] = 0.0
    reached, _, _ = made.problem.step(state, commands(craft.thruster_count))
    torch.testing.assert_close(made.average(reached), own(reached), rtol=0.01, atol=0.01)
    # Headings at rest that are close together have no phase.
    inertia = tuple(tuple(4.0 * x for x in row) for row in craft.inertia)
    learner(replace(craft, inertia=inertia), task, units=512).value.begin_as(own)


def test_most_spins_near_the_goal_are_those_that_pulses_bring_to_rest():
    problem = learner(load_spacecraft("free-flyer")).problem
    near = problem.near(torch.rand(problem.numbers, 512), torch.zeros(problem.rows, 512))
    x, y, z = parted(near)[3] / torch.tensor(problem.spin_steps)[:, None]
    # Nozzles across turn it about x and y at once.
    pulses = torch.stack(((x + y) / 2, (x - y) / 2, z))
    assert ((pulses - pulses.round()).abs() < 1e-3).all(dim=0).float().mean() > 0.85


@pytest.mark.parametrize("times", [1.0, 4.0, 8.0])
def test_the_thriftiest_transfer_arrives_within_the_flight(times):
    problem = PoseProblem(replace(PLATFORM, mass=times * PLATFORM.mass), GoToPosePriced(), Timing())
    price = float(problem.price(torch.ones(1, 1)))
    assert (price == 4.0) is (times < 4.0)
    # The least cost of a double integrator that burns, coasts and brakes over its range by two thrusters, tried.
    burnt = torch.linspace(0.1, 1.0, 10_000) * problem.scale
    time = problem.scale**2 / burnt + burnt
    least = (time + 4.0 * price * burnt).argmin()
    assert 5.0 < float(time[least]) < 18.0


def test_commands_cost_at_most_what_they_promise():
    made = learner()
    greedy = made.greedy
    state = made._ends[:, :64]
    command = greedy.best(state, 1)[0]
    single = greedy.outcomes(state, torch.eye(8)[:, None])[0].amin(dim=0)
    assert (greedy.outcomes(state, command[None])[0, 0] <= single + 1e-5).all()  # rounding

    def of_two(first):
        after, cost, discount = made.problem.step(state, first)
        return cost + discount * greedy.outcomes(after, greedy.best(after, 1)[0][None])[0, 0]

    # Ahead of two periods, the command of one is among those that are tried.
    ahead, _ = greedy.best(state, 2)
    assert (of_two(ahead) <= of_two(command) + 1e-5).all()


@pytest.mark.parametrize("spacecraft", ["atmos", WHEELED])
def test_pulsed_thrusters_are_opened_in_part_and_wheels_turned_where_that_costs_less(spacecraft):
    greedy = learner(load_spacecraft(spacecraft)).greedy
    state = torch.rand(greedy.problem.rows, 64, generator=torch.Generator().manual_seed(1))
    patterns, (costs, *_) = greedy.best(state, 1)
    whole = greedy.outcomes(state, greedy.problem.patterns[:, None])[0].amin(dim=0)
    # The patterns that are tried are the best, also of valves that share a supply.
    assert (costs <= whole + 0.02).all()
    partly = ((patterns != 0.0) & (patterns != 1.0)).any(dim=1)
    assert (costs[partly] < whole[partly]).any()


def test_a_full_wheel_only_slows_down_and_values_can_tell():
    problem = PoseProblem(load_spacecraft(WHEELED), TASK, Timing())
    state = torch.zeros(8, 2)
    state[6, 1] = 0.7
    after = problem.step(state, torch.eye(9)[[8, 8]])[0]
    assert after[6].tolist() == pytest.approx([0.02, 0.7])
    assert problem.features(state).diff(dim=0).any()


def test_a_policy_imitates_valves_and_torques():
    made = learner(load_spacecraft(WHEELED))
    made._fly()
    columns, patterns, regret = (x[: made.n_steps].flatten(0, 1) for x in made._labels)
    # Always the same command costs least.
    patterns[:, 0] = torch.tensor([1.0, 0, 0, 1, 0, 0, 0, 0, -0.5])
    regret[:, 0] = -30.0
    made._batch = [columns, patterns, regret]
    made.adam.rate.fill_(1e-2)
    for _ in range(200):
        made._descend()
    command = made.engine.commands(made.network.evaluate_seen(columns).policy.mode())
    torch.testing.assert_close(command, patterns[:, 0], rtol=0.0, atol=0.1)


def test_labels_are_costs_above_the_best_of_two_periods():
    made = learner()
    state = made._ends[:, :64]
    patterns, regret = made.greedy.label(state)
    best, _ = made.greedy.best(state, 2)
    assert (regret.min(dim=0).values == 0).all()
    # Few patterns are better than all that the search tries first.
    cost = regret.where((patterns == best).all(dim=2), 0.0).sum(dim=0)
    assert (cost == 0).float().mean() > 0.75
    assert (regret > 0.01).float().mean() > 0.5


def test_labels_of_new_periods_replace_the_oldest(monkeypatch):
    monkeypatch.setattr("rans_value.learner._LABELLED", 2)
    made = learner()
    columns = []
    for _ in range(3):
        made._fly()
        columns.append(made._labels[0].clone())
    old, new = [False] * made.n_steps, [True] * made.n_steps
    changed = [(a != b).any(dim=(1, 2)).tolist() for a, b in pairwise(columns)]
    assert changed == [old + new, new + old]


NEAR = GoToPosePriced(evaluation_distance=(0.3, 0.6)).for_evaluation()
BRIEF = Timing(episode_steps=65)
"""From there craft arrive within 8 s; they stay for 5 s."""


@pytest.mark.parametrize(
    ("spin", "conditions"),
    [
        (0.105, None),  # which no whole pulses stop
        (0.0, Conditions(thrusters=ThrusterConditions(thrust=(0.92, 1.08), latency=0.04))),
        (0.0, Conditions(faults=FaultConditions(thrusters=(2,), kinds=("dead",)))),
    ],
)
def test_the_common_values_fly_in_a_world_that_is_not_the_file(spin, conditions):
    """From spins between two pulses, with thrusters 8 % off and late, and with a dead one that nobody tells."""
    task = replace(NEAR, trade_off=(0.5, 0.5))
    timing = Timing(episode_steps=55)
    starts = scenarios(task, PLATFORM, 0, 2)
    starts = replace(starts, start=replace(starts.start, w=starts.start.w + spin))
    controller = Newest(PLATFORM, task, timing).expecting(None)
    drawn = None if conditions is None else draws(0, 2, 0)
    flight = fly(PLATFORM, task, controller, starts, timing, conditions=conditions, draws=drawn)
    assert controller.name == "value of all planar craft"
    assert task.reached(flight.states, flight.goals)[-12:].all()


@pytest.mark.parametrize("left", [6, 8])
def test_failures_are_expected_of_thrusters_that_a_craft_can_do_without(left):
    """A platform with six thrusters can spare none: only the thrust of each may be off."""
    craft = replace(PLATFORM, thrusters=PLATFORM.thrusters[:left])
    controller: Any = Newest(craft, TASK, Timing()).expecting(None)._flown
    spread = controller._belief._spread.diagonal()[6:][:3].sum().sqrt()
    turning = controller._problem.design[:3, 0].norm()
    # Mass and thrust alone are 15 % off, as standard deviation; failures of one in thirty make it 22 %.
    assert (spread / turning > 0.19) == (left == 8)


def test_values_of_one_craft_leave_spins_between_its_pulses_to_those_of_all():
    task = replace(NEAR, trade_off=(0.5, 0.5))
    starts = scenarios(task, PLATFORM, 0, 2)
    starts = replace(starts, start=replace(starts.start, w=starts.start.w + 0.15))
    controller = GreedyController(SHIPPED / "floating-platform")
    flight = fly(PLATFORM, task, controller, starts, BRIEF)
    assert task.reached(flight.states, flight.goals)[-12:].all()
    controller._by_all = None
    with pytest.warns(RansWarning, match="2 of 2 flights begin with a spin"):
        flight = fly(PLATFORM, task, controller, starts, BRIEF)
    assert not task.reached(flight.states, flight.goals)[-12:].any()


def test_a_spin_that_no_pulses_stop_is_told_in_space():
    craft = load_spacecraft("free-flyer")
    task = GoToPosePriced()
    controller = GreedyController(SHIPPED / "free-flyer")
    starts = scenarios(task, craft, 0, 1)
    spun = replace(starts.start, w=replace(starts.start.w, z=starts.start.w.z + 0.152))
    with pytest.warns(RansWarning, match="1 of 1 flights begin with a spin"):
        fly(craft, task, controller, replace(starts, start=spun), Timing(episode_steps=1))


def common(craft: Any, period: float = 0.2, tolerance: float = 0.05) -> Any:
    """Common values of a craft at 64 states, and these."""
    task = GoToPosePriced(position_tolerance=tolerance)
    problem = CommonProblem(craft, task, Timing(control_period=period))
    state = torch.rand(7, 64, generator=torch.Generator().manual_seed(1))
    state[3:6] *= 0.2 / period
    seen = problem.with_parameters(state)
    return CommonValue(problem).of(seen)(seen).detach()


def test_common_values_know_no_order_of_thrusters_and_are_alike_at_other_periods():
    values = common(PLATFORM)
    turned = replace(PLATFORM, thrusters=PLATFORM.thrusters[::-1])
    torch.testing.assert_close(common(turned), values, rtol=1e-4, atol=1e-4)  # rounding
    # Half the period with four times the accelerations: as many periods, the price being that of the flight.
    inertia: Any = tuple(tuple(0.25 * x for x in row) for row in PLATFORM.inertia)
    light = replace(PLATFORM, mass=0.25 * PLATFORM.mass, inertia=inertia)
    torch.testing.assert_close(2.0 * common(light, 0.1), values, rtol=0.02, atol=0.02)
    with pytest.raises(ConfigError, match=r"acceleration of floating-platform is 0\.004"):
        common(replace(PLATFORM, mass=500.0))


def test_the_common_values_hold_a_finer_tolerance():
    task = replace(NEAR, trade_off=(1.0, 1.0), position_tolerance=0.02)
    starts = scenarios(replace(task, evaluation_distance=(0.1, 0.3)), PLATFORM, 0, 4)
    timing = Timing(episode_steps=65)
    flight = fly(PLATFORM, task, Newest(PLATFORM, task, timing), starts, timing)
    assert task.reached(flight.states, flight.goals)[-20:].all()


def test_the_weights_that_ship_dock_at_the_trade_off_of_the_name():
    name = "value:dock-port-2d@floating-platform"
    contest = contest_of(name, 2)
    controller = enlist(f"{name}#0.5", contest).controller
    timing = replace(contest.timing, episode_steps=45)
    flight = fly_episodes(controller, Setup(PLATFORM, contest.task, timing), 0, 2)
    assert flight.verdict.solved.all()
    # 146 openings; at 0.2 a third more.
    assert flight.openings.sum() < 170
    assert enlist(name, contest).name == "installed value of dock-port-2d#0.2"
    with pytest.raises(ConfigError, match="from 0 "):
        enlist(f"{name}#2", contest)


LAB = load_conditions("lab")
FAULTS = load_conditions("faults")
FAILING = replace(FAULTS, faults=replace(FAULTS.faults, time=(2.0, 2.0)))


def test_flights_as_designed_are_a_case_of_those_under_conditions():
    problem = VariedProblem(PLATFORM, TASK, Timing())
    motion = 0.3 * torch.randn(7, 64, generator=torch.Generator().manual_seed(1))
    command = commands()
    designed, _, _ = PoseProblem(PLATFORM, TASK, Timing()).step(motion, command)
    found, _, _ = problem.step(problem.with_parameters(motion), command)
    assert difference(found[:6], designed[:6]) < 1e-3


@pytest.mark.parametrize(("conditions", "part"), [(LAB, 0.6), (FAILING, 0.01)])
def test_flights_tell_what_conditions_drew(conditions, part, monkeypatch):
    """Motion by the engine, and what an episode drew: estimates come near to both, to whole failures exactly."""
    estimates: Any = []
    timing = Timing(episode_steps=50)
    slows = -torch.tensor(PLATFORM.wrench_map)[:, 2].sign()

    def guess(greedy, seen, periods):
        """Random commands that do not let it spin."""
        return [(torch.rand(64, 8) < 0.25 + 0.15 * seen[5, :, None] * slows).float()]

    read = Belief.read

    def noted(belief, reading):
        seen = read(belief, reading)
        estimates.append(torch.cat((belief._estimate[:6], seen[6:-1])))
        return seen

    monkeypatch.setattr(Belief, "read", noted)
    monkeypatch.setattr(Greedy, "best", guess)
    controller: Any = Newest(PLATFORM, TASK, timing).expecting(conditions)._flown
    torch.manual_seed(0)
    controller.slow = False  # all in this process
    flight = fly_episodes(controller, Setup(PLATFORM, TASK, timing, conditions), 0, 64)
    like = torch.zeros(()).double()
    true = controller._problem.frame.relative(flight.states, flight.goals, like)
    found = torch.stack(estimates, dim=1)
    error = found[:6, 30:] - true[:6, 30:-1]
    error[2] = wrap(error[2])
    below = 0.9 * torch.tensor([0.005, 0.005, 0.0087, 0.01, 0.01, 0.0087])
    assert (error.square().mean(dim=(1, 2)).sqrt() < below).all()
    # The parameters of the same episodes, in units of how much they differ.
    ended = drawn_parameters(conditions, PLATFORM, timing)[1]
    rows = [*range(24 + 2), -1]  # disturbances along x and y are in the frame of the goal
    spread = ended[rows].std(dim=1)
    off = (found[6:, -1] - ended[:, :64])[rows].square().mean(dim=1).sqrt()
    assert (off <= part * spread)[spread > 1e-6].all()


def test_the_weights_that_ship_hold_the_pose_under_conditions():
    """A comparison tells it what these are; without estimates it holds none."""
    name = "value:go-to-pose-priced-2d@floating-platform#0.5"
    controller = enlist(name, contest_of(name, 2, conditions=LAB)).controller
    task = replace(NEAR, trade_off=(0.5, 0.5))
    flight = fly_episodes(controller, Setup(PLATFORM, task, BRIEF, LAB), 0, 4)
    assert task.reached(flight.states, flight.goals)[-25:].mean() > 0.95
    # Wrong inputs cost thrust: 10 openings with a disturbance's sign turned round, 7.4 without.
    assert flight.commands.sum(axis=0).mean() < 8.5


@pytest.mark.slow
def test_training_makes_flights_cheaper_and_they_stay_at_the_goal():
    made = learner()
    start = made.states()
    start[6] = 0.3

    @torch.no_grad()
    def flown():
        """Mean cost of flights of 20 s, and the part of the periods of the last fifth within the tolerances."""
        state, total, held = start, torch.zeros(64), torch.zeros(64)
        for period in range(100):
            state, cost, _ = made.problem.step(state, made.greedy.best(state, 1)[0])
            total += cost
            held += 0.05 * made.problem.inside(state)[0] * (period >= 80)
        return float(total.mean()), float(held.mean())

    first, _ = flown()
    made._begin()
    for _ in range(25):
        made._round()
    last, held = flown()
    # With 32 units in seconds; 512 on a GPU stay in all flights (docs/decisions/value.md).
    assert last < 0.5 * first
    assert held > 0.8


def tiny(spacecraft: str) -> TrainConfig:
    return TrainConfig(
        "go-to-pose-priced",
        replace(TASK, trade_off=(0.3, 0.3)),
        spacecraft,
        PPO,
        Timing(episode_steps=8),
        algorithm="value",
        learner={"units": 8, "states": 16, "rounds": 1, "updates": 1, "batch": 16},
        total_timesteps=4 * 64 * 4,
        solved_share=None,
    )


def test_a_training_leaves_its_policy_and_its_value_function(tmp_path, monkeypatch):
    config = tiny("floating-platform")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rans_value.learner._BEGUN", 1)
    Path("runs/other").mkdir(parents=True)
    Path("runs/other/config.json").write_text("[]")
    Path("runs/no-json").mkdir()
    Path("runs/no-json/config.json").write_text("{")
    wheeled = load_spacecraft(WHEELED)
    with pytest.raises(ConfigError, match="has a value function"):
        Newest(wheeled, TASK, config.timing)
    assert Newest(PLATFORM, TASK, config.timing).name == "value of all planar craft"
    run = RunFolder(tmp_path / "runs" / "run")
    run.begin(config, "test")
    trainer = Trainer(config, PLATFORM, run)
    trainer.train(ignore)
    learnt = trainer.learner
    assert isinstance(learnt, ValueLearner)
    controller: Any = Newest(PLATFORM, config.settings, config.timing)
    starts = scenarios(TASK, PLATFORM, 0, 4)
    flight = fly(PLATFORM, TASK, controller, starts, Timing(episode_steps=2))
    # The value function is the learner's, not a new one.
    state = learnt.states()
    torch.testing.assert_close(learnt.average(state), controller._made.greedy.value(state))
    assert set(flight.commands.flat) <= {0.0, 1.0}
    assert controller.name == "value of run"
    # Under conditions the common values fly, for what is estimated.
    assert isinstance(controller.expecting(LAB)._flown, CommonController)
    # The comparison that a training suggests is of several trade-offs, also where the agent has none.
    plain = replace(config, task="go-to-pose", settings=TASKS["go-to-pose"]())
    contest = contest_of("lqr:go-to-pose-2d", episodes=4)
    names = Value.contestants(plain, run.path)
    rivals: list[Any] = [enlist(name, contest) for name in names]
    assert [rival.controller._made._trade_off for rival in rivals] == [0.0, 0.5, 1.0]
    assert {rival.controller.name.partition("#")[0] for rival in rivals} == {"value of run"}
    evil = replace(plain, spacecraft="evil:E")  # as a file may name it
    assert Value.contestants(evil, run.path) == []
    # Of two folders none is taken for its time, and one outside of runs/ can be named.
    for other in ("runs/later", "elsewhere"):
        shutil.copytree(run.path, other)
    with pytest.raises(ConfigError, match=r"runs/later, runs/run have .*#runs/later,0\.2"):
        Newest(PLATFORM, config.settings, config.timing)
    named = Newest(PLATFORM, config.settings, config.timing, "elsewhere,0.5")
    assert named.name == "value of elsewhere"
    with pytest.raises(ConfigError, match="nobody has no value function"):
        Newest(PLATFORM, config.settings, config.timing, "nobody,0.5")
    saved = run.load_checkpoint("cpu")
    for name, wrong in (("last.bias", math.nan), ("spread", 0.0)):
        spoilt = deepcopy(saved)
        spoilt["learner"]["average"][name][:] = wrong
        RunFolder(Path("elsewhere")).save_checkpoint(spoilt)
        with pytest.raises(ConfigError, match="cannot be flown"):
            GreedyController("elsewhere")
    check([run.config_file, run.checkpoint_file], lambda: GreedyController(run.path), 0.5)
    run.checkpoint_file.unlink()
    with pytest.raises(ConfigError, match="has no value function"):
        GreedyController(run.path)


def test_a_training_that_was_stopped_goes_on_bit_by_bit(tmp_path, monkeypatch):
    """In the fit and in the imitation, also where another process has drawn other numbers."""
    monkeypatch.setattr("rans_value.learner._BEGUN", 1)
    config = tiny("floating-platform")
    agents = []
    for until in (99, 1, 3):
        run = RunFolder(tmp_path / f"run{until}")
        run.begin(config, "test")
        calls = iter(range(99))
        Trainer(config, PLATFORM, run).train(ignore, lambda: next(calls) + 1 >= until)  # noqa: B023
        torch.manual_seed(until)
        again = Trainer(config, PLATFORM, run)
        again.resume()
        again.train(ignore)
        agents.append(run.agent_file.read_bytes())
    assert again.steps == config.total_timesteps
    assert agents[1] == agents[0] == agents[2]


def test_a_craft_with_a_wheel_flies_by_its_run(tmp_path, monkeypatch):
    monkeypatch.setattr("rans_value.learner._BEGUN", 1)
    craft = load_spacecraft(WHEELED)
    config = tiny(WHEELED)
    run = RunFolder(tmp_path)
    run.begin(config, "test")
    Trainer(config, craft, run).train(ignore)
    controller = GreedyController(tmp_path)
    flight = fly(craft, TASK, controller, scenarios(TASK, craft, 0, 4), config.timing)
    (momentum,) = flight.states.stores
    assert momentum[-1] == pytest.approx(0.02 * flight.commands[..., 8].sum(axis=0))
    assert momentum.any()
    # It estimates nothing of such craft.
    assert controller.expecting(LAB) is controller


def test_other_craft_and_conditions_are_refused():
    with pytest.raises(ConfigError, match="no such craft"):
        learner(load_spacecraft("cubesat-3u"))
    tank = replace(cast("Any", load_spacecraft("mars-lander-steered").propellant), mass=1.0)
    burning = replace(PLATFORM, propellant=tank)
    with pytest.raises(ConfigError, match="no such craft"):
        Newest(burning, TASK, Timing())
    with pytest.raises(ConfigError, match="note what differs"):
        Newest(PLATFORM, TASKS["avoid"](), Timing())
    with pytest.raises(ConfigError, match="goals move"):
        learner(load_spacecraft("free-flyer"), PORT)
    with pytest.raises(ConfigError, match="for what DockPort asks"):
        Newest(PLATFORM, PORT, PORT.timing)
    noisy = replace(training("go-to-pose", device="cpu"), conditions=LAB)
    with pytest.raises(ConfigError, match="leave out the conditions"):
        Value.making(noisy, PLATFORM, SMALL)


def test_the_best_quality_on_a_gpu_is_this_algorithm_where_it_can_fly(monkeypatch):
    best = partial(training_of_quality, "go-to-pose", quality="best")
    for spacecraft, device, algorithm in (
        ("atmos", "cuda", "value"),
        ("atmos", "cpu", "ppo"),
        (WHEELED, "cuda", "ppo"),
        ("free-flyer", "cuda", "ppo"),  # a pulse turns it too far
    ):
        assert best(spacecraft, device=device).algorithm == algorithm
    # One agent for every trade-off, to the tolerance that is asked for.
    fine = config_of(GoToPose(position_tolerance=0.03), "atmos", "cuda", quality="best")
    assert fine.settings == GoToPosePriced(position_tolerance=0.03)
    monkeypatch.setattr("rans_value.learner._FINE", 0.07)
    assert best("free-flyer", device="cuda").algorithm == "value"
    assert best(None, device="cuda", randomized=True).algorithm == "ppo"
    assert best(None, device="cuda", algorithm="ppo").algorithm == "ppo"
    # Small fits begin from nothing: 272 times 8 periods instead of 96.
    for device, steps in (("cuda", 768), ("cpu", 2176)):
        begun = Value.started(replace(training("dock-port", device=device), algorithm="value"))
        assert begun.total_timesteps / begun.ppo.n_envs == steps
    # So do those of other layers than ship, unless a length is asked for.
    wide = partial(config_of, "go-to-pose", "atmos", "cuda", algorithm="value")
    asked = [
        wide(changes={"units": units}, total_timesteps=total)
        for units, total in ((512, None), (256, None), (256, 12288))
    ]
    assert [config.total_timesteps / 12288 for config in asked] == [768, 2176, 1]
    for file in SHIPPED.glob("*/config.json"):
        assert RunFolder(file.parent).config().learner["units"] == ValueSettings.units


def test_commands_that_cost_less_than_expected_gain(monkeypatch):
    monkeypatch.setattr("rans_value.learner._TRACE", 0.0)
    made = learner()
    state = made.states()
    order = made.network.look(made.network.in_body(made.engine.observe()))[2]
    _, action, _, gain = made._flown_by_policy()
    command = action[:64] if order is None else action[:64].gather(1, order)
    less = made.average(state) - made.greedy.outcomes(state, command[None])[0, 0]
    assert torch.stack((less, gain[:64])).corrcoef()[0, 1] > 0.5  # whatever their prices are
