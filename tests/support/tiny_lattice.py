"""Instances so small that every firing sequence can be flown: the oracle of the certificate's tests."""

from __future__ import annotations

import itertools
import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from rans_bounds.goal_set import GoalSet

from rans import Spacecraft, Thruster
from rans.model.body import Body
from rans.model.dynamics import PlanarState, advance, wrench
from rans.model.fields import Heading, Vec2, leaves, unflatten
from rans.model.spacecraft_file import load_spacecraft

PERIOD = 0.2
PLATFORM = load_spacecraft("floating-platform")


def lopsided() -> Spacecraft:
    """Five unequal thrusters with torques of 1, -1, 2, -1 and 0 quanta; no symmetry to hide behind."""

    def thruster(x: float, y: float, degrees: float, force: float) -> Thruster:
        a = math.radians(degrees)
        return Thruster((x, y, 0.0), (math.cos(a), math.sin(a), 0.0), force)

    layout = (
        thruster(0.3, 0.1, 90.0, 1.0),
        thruster(0.0, 0.2, 0.0, 1.5),
        thruster(-0.4, 0.0, 270.0, 1.5),
        thruster(-0.1, -0.3, 180.0, 1.0),
        thruster(0.1, 0.0, 180.0, 0.8),
    )
    sphere = ((0.11, 0.0, 0.0), (0.0, 0.11, 0.0), (0.0, 0.0, 0.11))
    return Spacecraft("lopsided", 2, 4.0, sphere, layout)


def through() -> Spacecraft:
    """Four equal thrusters of 1 and -1 quanta and two through the centre: pulses, but no parity."""
    return _equal("through", 180.0, (0.25, -0.25, 0.0, 0.0))


def doubled() -> Spacecraft:
    """Four equal thrusters with torques of 2, -1, 1 and 0 quanta."""
    return _equal("doubled", 200.0, (0.4, -0.2, 0.2, 0.0))


def centred() -> Spacecraft:
    """Three thrusters that push through the centre of mass: nothing turns the craft."""
    centre = (0.13, 0.07, 0.0)
    nozzles = []
    for degrees in (17.0, 143.0, 261.0):
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        place = (centre[0] - 0.3 * c, centre[1] - 0.3 * s, 0.0)
        nozzles.append(Thruster(place, (c, s, 0.0), 1.0))
    return _craft("centred", nozzles, centre)


def _equal(name: str, last: float, arms: tuple[float, ...]) -> Spacecraft:
    """Thrusters of 1 N by heading (degrees), moved sideways until their arms are exactly the given ones."""
    layout = ((0.3, 0.1, 80.0), (-0.2, 0.3, 190.0), (0.2, 0.0, 0.0), (-0.1, 0.0, last))
    nozzles = []
    for (x, y, degrees), arm in zip(layout, arms, strict=True):
        c = math.cos(math.radians(degrees))
        s = math.sin(math.radians(degrees))
        aside = arm - (x * s - y * c)
        nozzles.append(Thruster((x + aside * s, y - aside * c, 0.0), (c, s, 0.0), 1.0))
    return _craft(name, nozzles, (0.0, 0.0, 0.0))


def _craft(name: str, nozzles: list[Thruster], centre: tuple[float, float, float]) -> Spacecraft:
    sphere = ((0.11, 0.0, 0.0), (0.0, 0.11, 0.0), (0.0, 0.0, 0.11))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that some cannot be steered everywhere does not matter
        return Spacecraft(name, 2, 4.0, sphere, tuple(nozzles), centre_of_mass=centre)


@dataclass(frozen=True)
class Flown:
    """Every firing sequence of a tiny instance."""

    commands: np.ndarray
    """(M, N, thrusters)."""
    fuel: np.ndarray
    """(M,) N s."""
    final: Any
    """Fields (M,)."""

    def errors(self, goal: PlanarState) -> dict[str, np.ndarray]:
        """Of every final state, named as the goal set's tolerances."""
        turn = self.final.attitude.angle - goal.attitude.angle
        return {
            "position": np.hypot(self.final.p.x - goal.p.x, self.final.p.y - goal.p.y),
            "velocity": np.hypot(self.final.v.x - goal.v.x, self.final.v.y - goal.v.y),
            "heading": np.abs(np.angle(np.exp(1j * turn))),
            "spin": np.abs(self.final.w - goal.w),
        }

    def arrived(self, goal: PlanarState, goal_set: GoalSet, names: tuple[str, ...]) -> np.ndarray:
        """(M,) whether all of these errors are within their tolerances (and rounding of the flight)."""
        errors = self.errors(goal)
        return np.all([errors[name] <= getattr(goal_set, name) + 1e-9 for name in names], axis=0)


def fly_everything(craft: Spacecraft, start: Any, steps: int, substeps: int = 1) -> Flown:
    """All 2^(thrusters N) sequences, with the equations of the engines."""
    every = np.array(list(itertools.product((0.0, 1.0), repeat=len(craft.thrusters))))
    choice = np.array(list(itertools.product(range(len(every)), repeat=steps)))
    commands = every[choice]
    state = unflatten(start, [np.full(len(choice), x) for x in leaves(start)])
    for k in range(steps):
        state = advance(
            state, wrench(craft, tuple(commands[:, k].T)), Body.of(craft), PERIOD, substeps
        )
    forces = np.array([thruster.force for thruster in craft.thrusters])
    return Flown(commands, commands.sum(axis=1) @ forces * PERIOD, state)


def instance(craft: Spacecraft, steps: int, seed: int) -> tuple[PlanarState, PlanarState, Flown]:
    """A moving, spinning start, a goal that some random sequence just reaches, and all sequences."""
    random = np.random.default_rng(seed)
    x, y, angle, u, v, w = random.uniform(-0.5, 0.5, 6)
    start = PlanarState(Vec2(x, y), Heading(3.0 * angle), Vec2(u, v), w)
    flown = fly_everything(craft, start, steps)
    pick = random.integers(len(flown.fuel))
    x, y, angle, u, v, w = (float(field[pick]) for field in leaves(flown.final))
    # off by something, and by a turn, so that tolerances and wrapping matter
    turned = Heading(angle + 0.02 - math.tau)
    goal = PlanarState(Vec2(x + 0.004, y - 0.003), turned, Vec2(u, v + 0.006), w)
    return start, goal, flown


CRAFTS = {
    "floating-platform": (PLATFORM, 2),
    "lopsided": (lopsided(), 3),
    "through": (through(), 3),
    "doubled": (doubled(), 3),
    "centred": (centred(), 3),
}
SNUG = GoalSet(0.01, 0.01, 0.03)
