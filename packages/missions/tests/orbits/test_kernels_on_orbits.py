"""Kernels of tasks on orbits along which motion changes against NumPy: each craft has its own angle."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import pytest
import torch
from rans_missions.orbits.elliptic import EllipticOrbit
from rans_missions.orbits.perturbed import PerturbedOrbit

from rans import ConfigError, Engine, GoToPosition, Timing
from rans.model.spacecraft_file import load_spacecraft
from tests.support.engines import FLYER, PLATFORM
from tests.support.host_kernels import (
    SEED,
    compare,
    engine_on_host,  # noqa: F401  (a fixture)
    needs_compiler,
)

pytestmark = needs_compiler


@dataclass(frozen=True)
class Angle:
    """What a goal of `OnAnEllipse` notes."""

    angle: Any
    """Of the target on its orbit, rad."""


@dataclass(frozen=True)
class OnAnEllipse(GoToPosition):
    """Its goal has the target's mean anomaly as a note. An orbit lasts a minute, so that seconds matter."""

    goal_notes = Angle

    @property
    def drift(self) -> Any:
        return EllipticOrbit(0.1, 0.5, 0.0)

    def drift_at(self, goal: Any) -> Any:
        return replace(self.drift, angle=goal.notes.angle)

    def sample(self, random: Any) -> tuple[Any, Any]:
        start, goal = super().sample(random)
        return start, replace(goal, notes=Angle(random.uniform(0.0, math.tau)))

    def later(self, goal: Any, time: Any) -> Any:
        return replace(goal, notes=Angle(goal.notes.angle + 0.1 * time))


@dataclass(frozen=True)
class AroundAnOblatePlanet(OnAnEllipse):
    """The goal's note is an argument of latitude. The planet is ten times as flat as the Earth; there is drag."""

    @property
    def drift(self) -> Any:
        return PerturbedOrbit(0.1, 0.02, 0.9, 1e-3, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("craft", "task"),
    [
        (PLATFORM, OnAnEllipse()),
        (PLATFORM, AroundAnOblatePlanet()),
        # W turns the attitude of one that has thrusters for it, and not of a point.
        (FLYER, AroundAnOblatePlanet()),
        (load_spacecraft("afrl-deputy"), OnAnEllipse()),
    ],
    ids=["ellipse", "oblate", "oblate in space", "point"],
)
def test_an_orbit_steps_and_restarts_as_on_numpy(on_host, craft, task):
    made = (craft, task, 8, Timing(episode_steps=4))
    how = {"seed": SEED, "dtype": torch.float64}
    ours = Engine(*made, **how)
    # Anomalies are those of eight places, and move on.
    anomalies = ours.episode.goal.notes.angle.copy()
    assert len(set(anomalies.tolist())) == 8
    assert compare(ours, on_host(*made, **how), 6) == 8
    assert (ours.episode.goal.notes.angle != anomalies).all()


@dataclass(frozen=True)
class BegunAnew(OnAnEllipse):
    """Has an orbit that changes with time, and does not say where on it the target is."""

    drift_at = GoToPosition.drift_at


def test_an_orbit_that_would_begin_anew_in_every_period_is_refused():
    with pytest.raises(ConfigError, match="must have a method drift_at"):
        Engine(PLATFORM, BegunAnew(), num_envs=2, compiled=False).step(torch.zeros(2, 8))
