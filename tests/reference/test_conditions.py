"""Conditions: every effect alone, and all together, are the same in Drake as with our equations."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

import rans.episode
import rans.model.dynamics
import rans.model.valves
from rans.fast import Engine
from rans.flight import Flight, fly
from rans.model.actuators import Pulsed, Throttle
from rans.model.conditions import Conditions, ThrusterConditions
from rans.model.dynamics import Wrench
from rans.model.fields import Heading, leaves
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.model.valves import Lag
from rans.reference.flight import fly_in_drake
from rans.scenario import draws, scenarios
from rans.tasks import GoToPose
from tests.crafts import nasty_planar, nasty_spatial
from tests.worlds import EFFECTS, PAIRS
from validation.conditions import Watching
from validation.sampling import gap

TASK = GoToPose(fail_distance=1e3, fail_spin=1e3)
"""Which never ends before its time."""
PLANE, SPACE = nasty_planar(), nasty_spatial()
CRAFTS = {2: PLANE, 3: SPACE}
TOLERANCE = 1e-9
"""Of issue 16, m, rad, m/s and rad/s after 25 s. In the plane some 1e-11 are seen."""
TIMING = {2: Timing(), 3: Timing(substeps=8)}
"""In space the step is a series of order six: after 25 s of a steady torque, at 1.4 rad/s, six substeps a
period leave 1e-9, eight 2e-10 and twelve 5e-11, whatever Drake's step is."""
DRAKE_STEP = {2: 0.01, 3: 0.005}
"""s; in space 0.01 s leaves some 1e-9 of its own."""
LAGS = ("latency", "rise", "fall", "all")


every_effect = pytest.mark.parametrize("effect", EFFECTS)


@every_effect
def test_every_effect_is_the_same_in_drake(effect: str) -> None:
    """Closed loop: one observation that differs would lead to other commands."""
    fly_alike(PLANE, EFFECTS[effect])


@pytest.mark.parametrize(("effect", "steps"), [(effect, 30 if effect == "all" else 10) for effect in EFFECTS])
def test_and_in_space(effect: str, steps: int) -> None:
    """Where every period, and every piece of it, takes substeps; alone each flies 25 s in `rans validate`."""
    fly_alike(SPACE, EFFECTS[effect], steps=steps)


@pytest.mark.parametrize("effect", LAGS)
@pytest.mark.parametrize("kind", [Pulsed(4), Throttle()], ids=str)
def test_slow_valves_of_every_kind(kind: Any, effect: str) -> None:
    fly_alike(replace(PLANE, actuators=kind), without_least_times(EFFECTS[effect]), steps=15)


@pytest.mark.parametrize("effect", LAGS)
def test_pulses_that_end_at_any_time(effect: str) -> None:
    fly_alike(replace(PLANE, actuators=Pulsed(10_000, 40)), without_least_times(EFFECTS[effect]), steps=15)


def without_least_times(conditions: Conditions) -> Conditions:
    """For valves that are not just open or shut."""
    thrusters = replace(conditions.thrusters, least_on=0.0, least_off=0.0)
    return replace(conditions, thrusters=thrusters)


@pytest.mark.parametrize("thrusters", [
    ThrusterConditions(rise=0.05, fall=0.0), ThrusterConditions(fall=(0.0, 0.1)),
    ThrusterConditions(latency=0.2), ThrusterConditions(latency=0.05, rise=0.15),
    ThrusterConditions(latency=0.33, rise=0.4, fall=0.1),
], ids=str)
@pytest.mark.parametrize("sharing", ["none", "split"])
def test_at_once_exactly_one_period_and_longer_than_one(thrusters: Any, sharing: Any) -> None:
    """Where kinks meet, or fall on the beginning of a period; the last has ramps that overlap."""
    fly_alike(replace(PLANE, thrust_sharing=sharing), Conditions(thrusters=thrusters), steps=20)


def fly_alike(craft: Spacecraft, conditions: Conditions, count: int = 2, steps: int = 125) -> None:
    starts, dimension = scenarios(TASK, craft, 5, count), craft.dimension
    timing = replace(TIMING[dimension], episode_steps=steps)
    pilot, judged, usual = Watching(craft, 1), Watching(craft, 1), Watching(craft, 1)
    ours = fly(craft, TASK, pilot, starts, timing, conditions=conditions, draws=draws(5, count))
    drakes = fly_in_drake(craft, TASK, judged, starts, timing, conditions=conditions,
                          draws=draws(5, count), max_step=DRAKE_STEP[dimension])
    assert np.array_equal(drakes.commands, ours.commands)
    assert max(gap(drakes.states, ours.states).values()) < TOLERANCE
    np.testing.assert_allclose(judged.states, pilot.states, rtol=0, atol=TOLERANCE)
    # Rounded to float32: half a last place of ways up to 8 m.
    np.testing.assert_allclose(judged.seen, pilot.seen, rtol=0, atol=1e-6)
    perfect = fly(craft, TASK, usual, starts, timing)
    felt = max(*gap(perfect.states, ours.states).values(), np.abs(np.array(usual.seen) - pilot.seen).max())
    assert felt > 1e-3


@pytest.mark.parametrize("name", ["floating-platform", "free-flyer"])
def test_pairs_of_thrusters_that_can_be_done_without(name: str) -> None:
    fly_alike(load_spacecraft(name), PAIRS, count=3, steps=15)


class Random:
    """Opens thrusters at random, the same in every flight; keeps what it told and was shown."""

    name = "random"

    def __init__(self, craft: Spacecraft) -> None:
        self._thrusters = len(craft.thrusters)

    def reset(self, count: int) -> None:
        self._rng, self._count = np.random.default_rng(3), count
        self.told, self.seen = [], []

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        self.seen.append(observation)
        self.told.append(self._rng.integers(0, 2, (self._count, self._thrusters)).astype(float))
        return self.told[-1]


def flown(craft: Spacecraft, conditions: Conditions, steps: int,
          move: Any = fly) -> tuple[Flight, Random]:
    # For a second or two, four substeps a period are as exact in space.
    pilot, timing = Random(craft), Timing(substeps=1 if craft.dimension == 2 else 4, episode_steps=steps)
    return move(craft, TASK, pilot, scenarios(TASK, craft, 9, 2), timing, conditions=conditions,
                draws=draws(9, 2)), pilot


@functools.cache
def once(dimension: int) -> tuple[Flight, Random]:
    return flown(CRAFTS[dimension], EFFECTS["all"], 8)


@pytest.mark.parametrize("name", ["numpy", "torch", "float32", "fast", "drake"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_scenario_is_the_same_wherever_it_flies(dimension: int, name: str) -> None:
    """All effects at once for eight periods: states, observations and rewards."""
    craft, conditions = CRAFTS[dimension], EFFECTS["all"]
    flight, pilot = once(dimension)
    rewards = np.sum(list(flight.rewards().values()), axis=0)
    made = in_environment if name in ("fast", "drake") else in_engine
    tolerance = {"float32": 2e-5, "drake": 1e-9}.get(name, 1e-11)
    with torch.compiler.set_stance("force_eager"):
        other: Any = made(name, craft, conditions, flight.timing)
        for k, told in enumerate(pilot.told):
            np.testing.assert_allclose(other.observe(), pilot.seen[k][:other.count], rtol=0, atol=2e-5)
            reward = other.step(told)
            # At most 20 for every metre.
            np.testing.assert_allclose(reward, rewards[k][:other.count], rtol=0, atol=20 * tolerance)
            if k == 7 and other.count == 2:
                break  # an engine has begun the next episode
            now = np.array([np.asarray(x)[k + 1][:other.count] for x in leaves(flight.states)])
            np.testing.assert_allclose(other.state(), now, rtol=0, atol=tolerance)


class InEngine:
    """Two spacecraft of an engine."""

    count = 2

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def observe(self) -> np.ndarray:
        return self._engine.observe().numpy()

    def step(self, told: np.ndarray) -> np.ndarray:
        return self._engine.step(torch.from_numpy(told)).reward.numpy()

    def state(self) -> np.ndarray:
        return np.array([np.asarray(x) for x in leaves(self._engine.state)])


class InEnvironment:
    """The first of them, in a Gymnasium environment."""

    count = 1

    def __init__(self, env: Any) -> None:
        self._env = env
        self._seen, _ = env.reset(seed=9)

    def observe(self) -> np.ndarray:
        return self._seen[None]

    def step(self, told: np.ndarray) -> np.ndarray:
        self._seen, reward, *_ = self._env.step(told[0])
        return np.array([reward])

    def state(self) -> np.ndarray:
        return np.array([[x] for x in leaves(self._env.state)])


def in_engine(name: str, craft: Spacecraft, conditions: Conditions, timing: Timing) -> InEngine:
    dtype = torch.float32 if name == "float32" else torch.float64
    return InEngine(Engine(craft, TASK, 2, timing, seed=9, dtype=dtype, compiled=name != "numpy",
                           conditions=conditions))


def in_environment(name: str, craft: Spacecraft, conditions: Conditions, timing: Timing) -> InEnvironment:
    made = f"rans/GoToPose{craft.dimension}D-{'Drake-' if name == 'drake' else ''}v0"
    return InEnvironment(gymnasium.make(made, spacecraft=craft, task=TASK, timing=timing,
                                        conditions=conditions).unwrapped)


def test_every_episode_of_drakes_environment_has_its_own_body() -> None:
    """The third episode's factors on the mass are its own: the same push of one nozzle shows them."""
    gained = []
    for name in ("rans/GoToPose2D-Drake-v0", "rans/GoToPose2D-v0"):
        env: Any = gymnasium.make(name, spacecraft=PLANE, conditions=EFFECTS["body"]).unwrapped
        for seed in (4, None, None):
            before = env.reset(seed=seed) and env.state
            env.step(np.array([1, 0, 0, 0, 0]))
            gained.append((env.state.v - before.v).norm())
    np.testing.assert_allclose(gained[:3], gained[3:], rtol=1e-9)
    assert np.unique(np.round(gained[:3], 6)).size == 3


# Errors, planted in our side: the effects in which each must show, and no others.

PLANTED_STEPS = 15


def disturbance_in_body(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would turn with the craft."""
    true = rans.model.dynamics._advance_planar

    def turned(state: Any, load: Any, *rest: Any) -> Any:
        if load.disturbance is None:
            return true(state, load, *rest)
        added = Wrench(load.thrust.force + load.disturbance.force,
                       load.thrust.torque + load.disturbance.torque)
        return true(state, replace(load, thrust=added, disturbance=None), *rest)

    monkeypatch.setattr(rans.model.dynamics, "_advance_planar", turned)


def change_lag(change: Callable[[Lag], Lag]) -> Callable[[pytest.MonkeyPatch], None]:
    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        true = rans.episode.pieces
        monkeypatch.setattr(rans.episode, "pieces", lambda craft, body, commands, lag, period: true(
            craft, body, commands, change(lag), period))

    return patch


early = change_lag(lambda lag: replace(lag, latency=-lag.latency))
early.__name__ = "valves_move_before_they_are_told"
swapped = change_lag(lambda lag: lag if lag.fall is None else replace(lag, rise=lag.fall, fall=lag.rise))
swapped.__name__ = "rise_and_fall_exchanged"


def earlier_commands_in_the_wrong_order(monkeypatch: pytest.MonkeyPatch) -> None:
    true = rans.episode.pieces
    monkeypatch.setattr(rans.episode, "pieces", lambda craft, body, commands, *rest: true(
        craft, body, (commands[0], *reversed(commands[1:])), *rest))


def change_thrust(monkeypatch: pytest.MonkeyPatch, name: str, change: Callable[[Any], Any]) -> None:
    """A function of thrusters and a body, wherever it is called, for a body that is changed."""
    true = getattr(rans.model.dynamics, name)
    for module in (rans.model.dynamics, rans.model.valves):
        monkeypatch.setattr(module, name, lambda craft, told, body: true(craft, told, change(body)))


def fault_on_the_next_nozzle(monkeypatch: pytest.MonkeyPatch) -> None:
    change_thrust(monkeypatch, "thrust", lambda body: replace(
        body, gain=(*body.gain[1:], body.gain[0]), leak=(*body.leak[1:], body.leak[0])))


def supply_never_gives_way(monkeypatch: pytest.MonkeyPatch) -> None:
    change_thrust(monkeypatch, "thrust", lambda body: replace(body, droop=0.0))


def centre_to_the_other_side(monkeypatch: pytest.MonkeyPatch) -> None:
    change_thrust(monkeypatch, "wrench_of", lambda body: replace(body, centre=tuple(-x for x in body.centre)))


def noise_in_the_reward(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the reward looked at what sensors tell, 1 cm beside the truth."""
    true = rans.episode.Transition

    def seen(state: Any, *rest: Any) -> Any:
        return true(replace(state, p=replace(state.p, x=state.p.x + 0.01)), *rest)

    monkeypatch.setattr(rans.episode, "Transition", seen)


def heading_read_backwards(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what policies are shown."""
    true = rans.episode.World.sensed

    def sensed(*arguments: Any) -> Any:
        state = true(*arguments)
        return replace(state, attitude=Heading(-state.attitude.angle))

    monkeypatch.setattr(rans.episode.World, "sensed", sensed)


@functools.cache
def judged(effect: str) -> tuple[Flight, Random]:
    return flown(PLANE, EFFECTS[effect], PLANTED_STEPS, fly_in_drake)


def found(effect: str) -> set[str]:
    """In which layer our flight is not Drake's: in its motion, its rewards or what was shown."""
    (drakes, judge), (ours, pilot) = judged(effect), flown(PLANE, EFFECTS[effect], PLANTED_STEPS)
    engine = in_engine("numpy", PLANE, EFFECTS[effect], drakes.timing)
    rewards = np.array([engine.step(told) for told in judge.told])
    layers = {"motion": max(gap(drakes.states, ours.states).values()),
              "reward": np.abs(rewards - np.sum(list(drakes.rewards().values()), axis=0)).max(),
              "sight": np.abs(np.array(pilot.seen) - judge.seen).max()}
    return {name for name, difference in layers.items() if difference > 1e-6}


ALL_EFFECTS = set(EFFECTS)
LATE = {"latency", "rise", "fall", "all"}


@pytest.mark.parametrize(("plant", "shows", "layer"), [
    (disturbance_in_body, {"push", "swing", "kicks", "all"}, "motion"),
    (early, {"latency", "rise", "all"}, "motion"),
    (swapped, {"fall", "all"}, "motion"),
    (earlier_commands_in_the_wrong_order, {"latency", "all"}, "motion"),
    (fault_on_the_next_nozzle, {"thrust", "faults", "recoverable", "all"}, "motion"),
    (supply_never_gives_way, {"thrust", "all"}, "motion"),
    (centre_to_the_other_side, {"body", "all"}, "motion"),
    (noise_in_the_reward, ALL_EFFECTS, "reward"),
    (heading_read_backwards, ALL_EFFECTS, "sight"),
], ids=lambda x: getattr(x, "__name__", None))
def test_planted_errors_are_found_where_they_lie(plant: Any, shows: set[str], layer: str,
                                                 monkeypatch: pytest.MonkeyPatch) -> None:
    for effect in EFFECTS:
        judged(effect)  # before anything is planted
    plant(monkeypatch)
    for effect in EFFECTS:
        layers = found(effect)
        assert (layer in layers) == (effect in shows), f"{effect}: {layers}"
        assert layer == "motion" or layers <= {layer}


def test_nothing_planted_nothing_found() -> None:
    for effect in EFFECTS:
        assert found(effect) == set()
