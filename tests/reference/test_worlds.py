"""Every drift with every kind of actuator and every body: torch, NumPy, CasADi and Drake fly alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
import torch

from rans import Spacecraft, Timing
from rans.effectors.motion import held
from rans.model.actuators import Actuators, OnOff, Pulsed, Throttle
from rans.model.body import Body
from rans.model.drift import ClohessyWiltshire, Drift, FreeFlight, UniformGravity
from rans.model.fields import leaves, map_leaves, unflatten
from rans.reference.flight import rows_from_states, states_from_rows
from rans.reference.plant import Plant
from tests.support.crafts import nasty_planar, nasty_spatial, random_states
from validation.study.sampling import Restless, gaps

COUNT = 2
STEPS = {2: 12, 3: 5}
"""Spacecraft side by side; control periods of 0.2 s, fewer in space, where each takes substeps. Errors show after
a few."""

DRIFTS = {
    "free": lambda _: FreeFlight(),
    "gravity": lambda dimension: UniformGravity((0.02, -0.03, 0.01)[:dimension]),
    # A hundred times a low orbit's rate, so that its forces are felt within 5 s.
    "orbit": lambda _: ClohessyWiltshire(0.11),
}
ACTUATORS = {
    "on-off": OnOff(),
    "pulsed": Pulsed(10_000, 40),
    "few counts": Pulsed(4),
    "throttle": Throttle(),
}
TOLERANCE = 1e-9
"""m, rad, m/s, rad/s. Drake's step leaves some 1e-10 after 25 s in space, and less in the plane."""


@dataclass(frozen=True)
class World:
    craft: Spacecraft
    drift: Drift
    body: Body
    timing: Timing

    def held(self, state: Any, command: Any, body: Body) -> Any:
        return held(state, self.craft, body, command, self.timing, self.drift)


def world(dimension: int, drift: str, actuators: Actuators) -> World:
    craft = replace(nasty_planar() if dimension == 2 else nasty_spatial(), actuators=actuators)
    substeps = (
        1 if dimension == 2 else 3 if isinstance(actuators, Pulsed) else 6
    )  # pulses cut a period too
    return World(craft, DRIFTS[drift](dimension), faulty(craft), Timing(substeps=substeps))


def faulty(craft: Spacecraft) -> Body:
    """Two spacecraft of other masses, with weak, dead, leaking thrusters and shifted centres of mass."""
    usual = Body.of(craft)
    n = len(craft.thrusters)
    gain = np.ones((n, COUNT))
    leak = np.zeros((n, COUNT))
    gain[0] = (0.6, 0.9)
    gain[1, 0] = 0.0
    leak[2, 1] = 0.02
    leak[3] = (0.0, 0.01)
    scale = np.array([0.9, 1.3])
    return Body(
        usual.mass * scale,
        tuple(x * scale for x in usual.inertia),
        tuple(np.array([0.02, -0.01]) * k for k in range(1, craft.dimension + 1)),
        tuple(gain),
        tuple(leak),
    )


def flown(world: World, steps: int) -> tuple[Any, np.ndarray]:
    """States, fields (T + 1, N), and commands (T, N, thrusters) of our equations on NumPy."""
    state: Any = random_states(world.craft.dimension, COUNT, 3, speed=0.1, spin=0.1)
    goal = map_leaves(lambda x: x * 0.0, state)
    if world.craft.dimension == 3:
        goal = replace(goal, attitude=replace(goal.attitude, w=np.ones(COUNT)))
    pilot = Restless(world.craft, 1)
    shares = np.random.default_rng(2)
    states = [state]
    commands = []
    for _ in range(steps):
        command = pilot.act(states[-1], goal, np.zeros(0)).astype(float)
        if world.craft.actuators.is_continuous:
            command *= shares.random(command.shape)
        states.append(world.held(states[-1], tuple(command.T), world.body))
        commands.append(command)
    return stacked(states), np.array(commands)


def stacked(states: list[Any]) -> Any:
    columns = zip(*(leaves(state) for state in states), strict=True)
    return unflatten(
        states[0], [np.stack([np.asarray(x, dtype=float) for x in c]) for c in columns]
    )


def in_torch(world: World, start: Any, commands: np.ndarray) -> Any:
    body = placed(world.body, torch.as_tensor)
    states = [map_leaves(torch.as_tensor, start)]
    for command in commands:
        states.append(world.held(states[-1], tuple(torch.as_tensor(command.T)), body))
    return stacked(states)


def in_casadi(world: World, start: Any, commands: np.ndarray) -> Any:
    """One function of state, command and body."""

    def symbol(_: Any) -> Any:
        return ca.SX.sym("x")  # type: ignore[call-arg]

    state: Any = map_leaves(symbol, start)
    told = [symbol(None) for _ in world.craft.thrusters]
    body = placed(world.body, symbol)
    columns = [
        ca.vertcat(*x)
        for x in (leaves(state), told, leaves(body), leaves(world.held(state, told, body)))
    ]
    step = ca.Function("step", columns[:3], columns[3:])
    tracks = []
    for k in range(COUNT):
        begun, own = ([float(x[k]) for x in leaves(tree)] for tree in (start, world.body))
        track = [np.array(begun)]
        for command in commands[:, k]:
            track.append(np.array(step(track[-1], command, own)).ravel())
        tracks.append(track)
    return unflatten(start, np.moveaxis(np.array(tracks), (0, 1, 2), (2, 1, 0)))


def in_drake(world: World, start: Any, commands: np.ndarray) -> Any:
    step = 0.01 if world.craft.dimension == 2 else 0.005
    plant = Plant(world.craft, COUNT, max_step=step, body=world.body, drift=world.drift)
    rows = plant.rollout(rows_from_states(start), commands, world.timing.control_period)
    return states_from_rows(rows, start).normalised()


def placed(body: Body, place: Callable[[Any], Any]) -> Body:
    return Body(
        place(body.mass),
        *(tuple(map(place, getattr(body, name))) for name in ("inertia", "centre", "gain", "leak")),
    )


def gap(a: Any, b: Any) -> float:
    return max(float(difference.max()) for difference in gaps(a, b).values())


@pytest.mark.parametrize(
    "world",
    [
        pytest.param((dimension, drift, kind), id=f"{dimension}d-{drift}-{kind}")
        # Each drift and each kind of actuator in both dimensions; which kind meets which drift plays no part.
        for dimension, drift, kind in (
            (2, "free", "few counts"),
            (2, "gravity", "pulsed"),
            (2, "orbit", "throttle"),
            (2, "orbit", "on-off"),
            (3, "free", "throttle"),
            (3, "gravity", "on-off"),
            (3, "orbit", "few counts"),
        )
    ],
)
def test_all_libraries_and_drake_fly_alike(world):
    built = globals()["world"](world[0], world[1], ACTUATORS[world[2]])
    # Drake takes a step for every edge of a pulse, and space is slower than the plane.
    steps = STEPS[world[0]]
    states, commands = flown(built, steps // 3 if world[2] == "pulsed" else steps)
    start = map_leaves(lambda x: x[0], states)
    # The same arithmetic: roundings of numbers up to some tens, over the first periods.
    few = 10 if world[0] == 2 else 3
    for fly in (in_torch, in_casadi):
        early = map_leaves(lambda x: x[: few + 1], states)
        assert gap(fly(built, start, commands[:few]), early) < 1e-12, fly.__name__
    assert gap(in_drake(built, start, commands), states) < TOLERANCE
