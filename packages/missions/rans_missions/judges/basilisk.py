"""Basilisk: craft with thrusters, wheels, a tank, liquid and the gradient of gravity, under commands of chance.

It is the simulator of the University of Colorado (AVSLab/basilisk, `bsk` of the package index). Its states are
those of basilisk.json; docs/provenance.md names the commit whose script flew them, in steps of 2 ms of order four.
Its tank, of constant volume, loses what thrusters take, without forces of the propellant that flows to them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rans import TASKS, load_spacecraft
from rans.extend import (
    Quat,
    Scenario,
    Spacecraft,
    SpatialState,
    Timing,
    Vec3,
    fly,
    map_leaves,
    reading,
)
from rans_missions.script import Script
from rans_missions.slosh.liquid import Slosh
from validation.judges.judge import Judge, Largest, Row
from validation.study.checks import Check

BASILISK_STATES = Path(__file__).with_suffix(".json")
"""File of its states after every tenth period, by case."""
_OPEN = 0.06
"""Part of the thrusters that fire in a period: with more the craft would spin beyond what tasks have."""

BASILISK = Judge(
    "Basilisk 2.12.1",
    "AVSLab/basilisk, bsk of the package index",
    "2.12.1",
    "Other people wrote it, in C++ and by another method: masses that move are back-substituted into the equations "
    "of the hub, attitudes are modified Rodrigues parameters, and the axes do not turn.",
)
_RIGID = "Rounding and Basilisk's own steps."
_SWINGS = "Our steps are of order four where a mass swings."


@dataclass(frozen=True)
class Case:
    """A flight."""

    about: str
    craft: Spacecraft
    period: float
    """Control period, s."""
    steps: int = 50
    """Control periods."""
    mean_motion: float = 0.0
    """Mean motion of its orbit, rad/s, on which the gradient of gravity turns the craft; 0: there is no gravity."""

    @property
    def bound(self) -> float:
        """Largest difference that is accepted, m, rad and rad/s."""
        return 1e-5 if self.craft.further_effectors else 1e-8

    def start(self) -> SpatialState:
        """A craft that turns about all axes, on an orbit where the target is."""
        spin = Vec3(0.11, -0.07, 0.05)
        still = Vec3(0.0, 0.0, 0.0)
        return SpatialState(still, Quat(0.5, -0.1, 0.7, 0.5).normalised(), still, spin)

    def commands(self) -> np.ndarray:
        """Commands (T, commands): few thrusters at a time, and wheels up to half of their torque."""
        random = np.random.default_rng(2026)
        size = (self.steps, len(self.craft.thrusters))
        widths = 1.0
        if self.craft.actuators.is_continuous:
            widths = random.integers(1, 5, size) / 4.0
        thrust = (random.random(size) < _OPEN) * widths
        torque = random.uniform(-0.5, 0.5, (self.steps, len(self.craft.wheels)))
        return np.hstack([thrust, torque])


def cases() -> dict[str, Case]:
    """All cases by their names."""
    flyer = load_spacecraft("free-flyer")
    cube = load_spacecraft("cubesat-3u")
    # A sixth of the mass swings; the inertia is one of an uneven craft.
    liquid = Slosh(0.8, 0.05, (0.03, -0.02, 0.04), (-0.48, 0.6, 0.64), 0.004)
    uneven = ((0.15, 0.01, -0.005), (0.01, 0.12, 0.015), (-0.005, 0.015, 0.2))
    wet = replace(flyer, name="wet", inertia=uneven, further_effectors=(liquid,))
    wheels = tuple(replace(wheel, max_torque=0.01) for wheel in cube.wheels)
    tank: Any = load_spacecraft("mars-lander-steered").propellant
    tank = replace(tank, mass=1.6, specific_impulse=1.2, position=(0.1, 0.06, -0.03), radius=0.05)
    burning = replace(flyer, name="burning", inertia=uneven, wheels=wheels, propellant=tank)
    return {
        "thrusters": Case("free flyer, 16 valves", flyer, 0.2),
        "wheels": Case("CubeSat, pulses of 10 ms and three wheels", cube, 0.5),
        "gradient": Case("the same, turned by gravity at 0.03 rad/s", cube, 0.5, 40, 0.03),
        "tank": Case(
            "a tank 12 cm off the centre that loses an eighth of the mass, and wheels", burning, 0.2
        ),
        "slosh": Case("liquid that swings, 15 % of the mass", wet, 0.2),
        "slosh, wheels": Case("the same with wheels", replace(wet, wheels=wheels), 0.2),
    }


def ours(case: Case) -> np.ndarray:
    """Our states after each period (T, 13): p, v in axes that do not turn, spin in B, quaternion (x, y, z, w)."""
    task = TASKS["go-to-pose"](fail_distance=1e6, fail_spin=1e6)
    if case.mean_motion:
        task = TASKS["go-to-attitude"](mean_motion=case.mean_motion, fail_spin=1e6)
    start = map_leaves(lambda x: np.array([x]), case.start())
    # The equations are judged, not the default steps, which are for agents (docs/dynamics.md): 5e-8 rad here.
    timing = Timing(control_period=case.period, episode_steps=case.steps, substeps=8)
    commands = Script(case.commands()[:, None])
    states = fly(case.craft, task, commands, Scenario(start, start), timing).states
    times = case.period * np.arange(1, case.steps + 1)
    turned = Rotation.from_rotvec(np.outer(times, [0.0, 0.0, case.mean_motion]))
    p, v, w = (np.stack(x.columns(), axis=-1)[1:, 0] for x in (states.p, states.v, states.w))
    q = states.attitude
    attitude = Rotation.from_quat(np.stack([q.x, q.y, q.z, q.w], axis=-1)[1:, 0])
    rate = np.array([0.0, 0.0, case.mean_motion])
    spin = w + attitude.inv().apply(rate)
    speed = turned.apply(v + np.cross(rate, p))
    return np.hstack([turned.apply(p), speed, spin, (turned * attitude).as_quat()])


def rows(named: dict[str, Case] | None = None) -> Iterator[Row]:
    """A row for each case, by its name; None: all of `cases`."""
    with reading(BASILISK_STATES) as table:
        figures = {name: np.array(states) for name, states in table.items()}
    for name, case in (named or cases()).items():
        own = ours(case)[9::10]
        other = figures[name][: len(own)]
        largest = Largest()
        for quantity, columns in (("position", slice(0, 3)), ("spin", slice(6, 9))):
            largest.add(quantity, float(np.abs(own - other)[:, columns].max()))
        turned = Rotation.from_quat(own[:, 9:]).inv() * Rotation.from_quat(other[:, 9:])
        largest.add("attitude", float(turned.magnitude().max()))
        if case.mean_motion:
            del largest.values["position"]  # the Hill frame's equations are of the first order
        units = {"position": "m", "spin": "rad/s", "attitude": "rad"}
        reason = _SWINGS if case.craft.further_effectors else _RIGID
        checks = tuple(
            Check(quantity, value, case.bound, units[quantity], reason)
            for quantity, value in largest.values.items()
        )
        file = BASILISK_STATES.name
        yield Row(BASILISK, f"Basilisk {name}", case.about, file, checks, "1e-12 m by its step")
