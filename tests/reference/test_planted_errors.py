"""Errors, planted in our side: the effects in which each must show, and no others."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rans.episode
import rans.model.dynamics
import rans.randomization.parameters
import rans.randomization.valves
from rans.flight import Flight
from rans.model.dynamics import Wrench
from rans.model.fields import Heading
from rans.randomization.valves import Lag
from rans.reference.flight import fly_in_drake
from tests.support.random_flights import PLANE, Random, flown, in_engine
from tests.support.worlds import EFFECTS
from validation.study.sampling import gap

PLANTED_STEPS = 11


def disturbance_in_body(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would turn with the craft."""
    true = rans.model.dynamics._advance_planar

    def turned(state: Any, load: Any, *rest: Any) -> Any:
        if load.disturbance is None:
            return true(state, load, *rest)
        added = Wrench(
            load.thrust.force + load.disturbance.force, load.thrust.torque + load.disturbance.torque
        )
        return true(state, replace(load, thrust=added, disturbance=None), *rest)

    monkeypatch.setattr(rans.model.dynamics, "_advance_planar", turned)


def change_lag(change: Callable[[Lag], Lag]) -> Callable[[pytest.MonkeyPatch], None]:
    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        true = rans.randomization.parameters.pieces
        monkeypatch.setattr(
            rans.randomization.parameters,
            "pieces",
            lambda craft, body, commands, lag, period: true(
                craft, body, commands, change(lag), period
            ),
        )

    return patch


early = change_lag(lambda lag: replace(lag, latency=-lag.latency))
early.__name__ = "valves_move_before_they_are_told"
swapped = change_lag(
    lambda lag: lag if lag.fall is None else replace(lag, rise=lag.fall, fall=lag.rise)
)
swapped.__name__ = "rise_and_fall_exchanged"


def earlier_commands_in_the_wrong_order(monkeypatch: pytest.MonkeyPatch) -> None:
    true = rans.randomization.parameters.pieces
    monkeypatch.setattr(
        rans.randomization.parameters,
        "pieces",
        lambda craft, body, commands, *rest: true(
            craft, body, (commands[0], *reversed(commands[1:])), *rest
        ),
    )


def change_thrust(monkeypatch: pytest.MonkeyPatch, name: str, change: Callable[[Any], Any]) -> None:
    """A function of thrusters and a body, wherever it is called, for a body that is changed."""
    true = getattr(rans.model.dynamics, name)
    for module in (rans.model.dynamics, rans.randomization.valves):
        monkeypatch.setattr(module, name, lambda craft, told, body: true(craft, told, change(body)))


def fault_on_the_next_nozzle(monkeypatch: pytest.MonkeyPatch) -> None:
    change_thrust(
        monkeypatch,
        "thrust",
        lambda body: replace(
            body, gain=(*body.gain[1:], body.gain[0]), leak=(*body.leak[1:], body.leak[0])
        ),
    )


def faults_begin_with_the_next_period(monkeypatch: pytest.MonkeyPatch) -> None:
    true = rans.randomization.parameters.failing
    period = 0.2
    monkeypatch.setattr(
        rans.randomization.parameters,
        "failing",
        lambda sound, failed, instant: true(sound, failed, np.ceil(instant / period) * period),
    )


def supply_never_gives_way(monkeypatch: pytest.MonkeyPatch) -> None:
    change_thrust(monkeypatch, "thrust", lambda body: replace(body, droop=0.0))


def centre_to_the_other_side(monkeypatch: pytest.MonkeyPatch) -> None:
    change_thrust(
        monkeypatch, "wrench_of", lambda body: replace(body, centre=tuple(-x for x in body.centre))
    )


def thrusters_misaligned_to_the_other_side(monkeypatch: pytest.MonkeyPatch) -> None:
    def moved(body: Any) -> Any:
        mountings = tuple(
            replace(one, offset=tuple(-x for x in one.offset)) for one in body.mountings
        )
        return replace(body, mountings=mountings)

    change_thrust(monkeypatch, "wrench_of", moved)


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
    (drakes, judge) = judged(effect)
    (ours, pilot) = flown(PLANE, EFFECTS[effect], PLANTED_STEPS)
    engine = in_engine("numpy", PLANE, EFFECTS[effect], drakes.timing)
    rewards = np.array([engine.step(told) for told in judge.told])
    layers = {
        "motion": max(gap(drakes.states, ours.states).values()),
        "reward": np.abs(rewards - np.sum(list(drakes.rewards().values()), axis=0)).max(),
        "sight": np.abs(np.array(pilot.seen) - judge.seen).max(),
    }
    return {name for name, difference in layers.items() if difference > 1e-6}


ALL_EFFECTS = set(EFFECTS)
SOME = "body", "latency", "sensors", "range", "all"
"""Of errors that show in all effects: in motion, in valves, in readings, and all together."""


@pytest.mark.parametrize(
    ("plant", "shows", "layer"),
    [
        (disturbance_in_body, {"push", "swing", "kicks", "all"}, "motion"),
        (early, {"latency", "rise", "all"}, "motion"),
        pytest.param(swapped, {"fall", "all"}, "motion", marks=pytest.mark.slow),
        (earlier_commands_in_the_wrong_order, {"latency", "all"}, "motion"),
        (
            fault_on_the_next_nozzle,
            {"thrust", "faults", "named", "recoverable", "mountings", "all"},
            "motion",
        ),
        (thrusters_misaligned_to_the_other_side, {"mountings", "all"}, "motion"),
        (faults_begin_with_the_next_period, {"faults", "named", "recoverable", "all"}, "motion"),
        pytest.param(supply_never_gives_way, {"thrust", "all"}, "motion", marks=pytest.mark.slow),
        pytest.param(centre_to_the_other_side, {"body", "all"}, "motion", marks=pytest.mark.slow),
        (noise_in_the_reward, ALL_EFFECTS, "reward"),
        (heading_read_backwards, ALL_EFFECTS, "sight"),
    ],
    ids=lambda x: getattr(x, "__name__", None),
)
def test_planted_errors_are_found_where_they_lie(
    plant: Any, shows: set[str], layer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Two in which it must show beside all together, and two in which it must not.
    others = [effect for effect in EFFECTS if effect not in shows][::6][:2]
    asked = ["all", *sorted(shows - {"all"})[:2], *others] if others else SOME
    for effect in asked:
        judged(effect)  # before anything is planted
    plant(monkeypatch)
    for effect in asked:
        layers = found(effect)
        assert (layer in layers) == (effect in shows), f"{effect}: {layers}"
        assert layer == "motion" or layers <= {layer}


def test_nothing_planted_nothing_found() -> None:
    for effect in SOME:
        assert found(effect) == set()
