"""An effector without a mass whose load depends on the craft's motion: it moves the craft itself."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import rans
from rans.effectors.effector import Begun, Effector, JointMotion
from rans.errors import ConfigError
from rans.flight import fly
from rans.model.body import Body
from rans.model.fields import Vec2
from rans.model.spacecraft import CommandRange, Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.optimal.trajectory.allocation import check_relaxation
from rans.reference.flight import DrakeMover
from rans.reference.further import DrakeMass, register
from rans.scenario import scenarios
from tests.support.played import Played

RATE = 1.0
"""Drag for each m/s, N s/m."""


@dataclass(frozen=True)
class Dragged(Effector):
    """Viscous drag on a craft that coasts; with a command it could be switched."""

    is_switched: bool = False

    @property
    def commands(self) -> tuple[CommandRange, ...]:
        return (CommandRange("drag", "torque", 0.0, 1.0),) * self.is_switched

    @property
    def moves_mass(self) -> bool:
        return True

    def begin(self, begun: Begun) -> JointMotion:
        return _Slowing()


class _Slowing(JointMotion):
    def steps(self, longest: float) -> int:
        return 1

    def advance(self, state: Any, applied: Any, body: Body, duration: Any, *_: Any) -> Any:
        rate = RATE / body.mass
        left = math.exp(-rate * duration)
        return replace(state, p=state.p + state.v.scale((1.0 - left) / rate), v=state.v.scale(left))


class DraggedInDrake(DrakeMass):
    """The damping of the craft's own joint, as the docstring of `DrakeMass.add` says."""

    def __init__(self, _: Any) -> None: ...

    def at_rest(self, craft: Spacecraft, body: Body, index: int) -> tuple[float, np.ndarray]:
        return 0.0, np.zeros(3)

    def add(self, plant: Any, craft: Spacecraft, body: Body, bodies: Any) -> None:
        self._count = len(bodies)
        for rigid in bodies:
            joint = plant.GetJointByName(f"B of {rigid.name()}")
            joint.set_default_damping_vector(np.array([RATE, RATE, 0.0]))

    def friction(self) -> None: ...

    def set(self, context: Any, q: np.ndarray, v: np.ndarray, stores: np.ndarray) -> None: ...

    def get(self, context: Any) -> np.ndarray:
        return np.zeros((self._count, 0))


register("Dragged", DraggedInDrake)
PLATFORM = load_spacecraft("floating-platform")
CRAFT = replace(PLATFORM, name="dragged", further_effectors=(Dragged(),))
TASK = rans.GoToPose()


COASTING = Played(lambda _, count: np.zeros((count, CRAFT.command_count)))


@pytest.mark.parametrize("in_drake", [False, True], ids=["engine", "drake"])
def test_drag_slows_a_coasting_craft_by_its_closed_form(in_drake: bool) -> None:
    """In Drake it is a `DrakeMass` of mass 0. Its integrator is accurate to 1e-6 or better."""
    timing = Timing(episode_steps=10)
    starts = scenarios(TASK, CRAFT, 0, 2)
    v = Vec2(np.array([0.3, -0.1]), np.array([0.1, 0.2]))
    starts = replace(starts, start=replace(starts.start, v=v))
    flight = fly(
        CRAFT, TASK, COASTING, starts, timing, DrakeMover(CRAFT, timing) if in_drake else None
    )
    left = np.exp(-RATE / CRAFT.mass * flight.times)[:, None]
    np.testing.assert_allclose(flight.states.v.x, left * v.x, rtol=1e-6)
    np.testing.assert_allclose(flight.states.v.y, left * v.y, rtol=1e-6)


def test_bounds_name_it_and_controllers_fly_it_unless_it_takes_commands() -> None:
    with pytest.raises(ConfigError, match="'dragged' has Dragged"):
        check_relaxation(CRAFT)
    rans.LQR(CRAFT, TASK)
    switched = replace(CRAFT, further_effectors=(Dragged(is_switched=True),))
    with pytest.raises(ConfigError, match="effectors of other kinds"):
        rans.LQR(switched, TASK)
