"""Do the equations every engine shares describe the spacecraft? Drake's answer, layer by layer.

A layer's failure says where to look: one thruster, their sum, accelerations (mass properties,
gyroscopic term), one control period (integration), a whole flight (accumulation).
"""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np

from rans.dynamics import MassProperties, advance, wrench
from rans.fields import map_leaves
from rans.flight import Flight, fly, scenarios
from rans.reference.flight import rows_from_states, states_from_rows
from rans.reference.plant import Plant
from rans.spacecraft import Spacecraft
from rans.tasks import GoToPose
from rans.timing import Timing
from validation.checks import Check, Report
from validation.invariants import invariant_checks
from validation.sampling import FASTEST, Restless, gap, random_states, rollout

VALIDATION_SUBSTEPS = {2: 1, 3: 32}
"""Physics substeps at which the equations, not the step size, are compared with Drake: the plane's step
is exact, in space the fourth-order error of 32 is 65,536 times below that of 2."""

_UNITS = {"position": "m", "attitude": "rad", "velocity": "m/s", "spin": "rad/s"}


def study(craft: Spacecraft, seed: int = 0, quick: bool = False) -> Report:
    """Compare the dynamics of a spacecraft with Drake and with the laws of mechanics.

    Args:
        craft: planar or spatial.
        seed: of every random state and command.
        quick: fewer states and flights.

    Raises:
        ConfigError: Drake refuses the spacecraft's mass properties.
    """
    started = time.perf_counter()
    states, flights = (64, 16) if quick else (512, 128)
    checks = [
        *thruster_checks(craft),
        *wrench_checks(craft, seed, states),
        *acceleration_checks(craft, seed, states),
        *period_checks(craft, seed, states),
        *flight_checks(craft, seed, flights),
        *invariant_checks(craft, seed, states, VALIDATION_SUBSTEPS[craft.dimension]),
    ]
    settings = {"spacecraft": craft.name, "seed": seed, "states": states, "flights": flights,
                "seconds": round(time.perf_counter() - started, 2)}
    return Report(f"Dynamics of {craft.name} ({craft.degrees_of_freedom}DoF) against Drake",
                  tuple(checks), settings)


def thruster_checks(craft: Spacecraft) -> list[Check]:
    """Force and torque about the centre of mass of every thruster alone."""
    ours = _wrenches(craft, np.eye(len(craft.thrusters)))
    return _wrench_checks("every thruster", craft, ours - Plant(craft).thruster_wrenches())


def wrench_checks(craft: Spacecraft, seed: int, count: int) -> list[Check]:
    """Total force and torque of random commands, half of them on/off and half relaxed."""
    commands = _commands(craft, seed, count)
    ours = _wrenches(craft, commands)
    return _wrench_checks("random commands", craft, ours - Plant(craft, count).wrenches(commands))


def acceleration_checks(craft: Spacecraft, seed: int, count: int) -> list[Check]:
    """Accelerations in random states under random commands.

    Ours are the derivative of `rans.dynamics.advance` at the start of a step, taken with a complex
    step (Squire and Trapp, SIAM Review 40(1), 1998): exact to rounding, and of the code that flies.
    """
    states, commands = random_states(craft.dimension, seed, count), _commands(craft, seed, count)
    step = 1e-30
    moved = advance(states, wrench(craft, tuple(commands.T)), MassProperties.of(craft), step * 1j)
    rate = np.stack([np.imag(x) / step for x in (*moved.v.columns(), *moved.spin())], axis=1)
    drake = Plant(craft, count).accelerations(rows_from_states(states), commands)
    linear, angular = _parts(craft)
    check = partial(Check, tolerance=1e-12, unit="relative")
    return [
        check("accelerations: linear", _relative(rate[:, linear], drake[:, linear], 0.0),
              reason="Rounding, relative to the largest in the sample."),
        check("accelerations: angular", _relative(rate[:, angular], drake[:, angular], FASTEST**2),
              reason="Rounding, relative to the largest in the sample, or to w^2 where the terms of "
                     "w x I w cancel and nothing turns the spacecraft."),
    ]


def period_checks(craft: Spacecraft, seed: int, count: int) -> list[Check]:
    """One control period from random states, held commands, at the validation substeps."""
    states, commands = random_states(craft.dimension, seed, count), _commands(craft, seed, count)
    period = Timing().control_period
    ours = advance(states, wrench(craft, tuple(commands.T)), MassProperties.of(craft), period,
                   VALIDATION_SUBSTEPS[craft.dimension])
    rows = Plant(craft, count).advance(rows_from_states(states), commands, period)
    reason = "Truncation of both integrators over one period; a wrong term shows at 1e-6 or more."
    return _gap_checks("one control period", ours, states_from_rows(rows, states), 1e-9, reason)


def flight_checks(craft: Spacecraft, seed: int, count: int) -> list[Check]:
    """25 s under the commands of a restless controller, replayed by Drake and in float32."""
    timing, task = Timing(), GoToPose()
    starts = scenarios(task, craft, seed, count)
    flight = fly(craft, task, Restless(craft, seed), starts, timing)
    coarse, fine = (_drake_states(flight, starts.start, step) for step in (0.01, 0.005))
    reason = "Its fixed step halved: the judge must be a decade better than what it judges."
    return [
        *_gap_checks("Drake's own error", coarse, fine, 0.1 * _agreement(flight), reason)[:2],
        *_accuracy_checks(flight, starts.start, fine),
        *_float32_checks(flight, starts.start),
    ]


def _accuracy_checks(flight: Flight, start: Any, drake: Any) -> list[Check]:
    """Default substeps (a bound on accuracy), and in space validation substeps (the equations)."""
    if flight.craft.dimension == 2:
        reason = "The plane's step is exact: rounding, and Drake's own error, over 125 periods."
        return _gap_checks("25 s", flight.states, drake, _agreement(flight), reason)
    substeps = VALIDATION_SUBSTEPS[3]
    ours = rollout(flight.craft, start, flight.commands, flight.timing.control_period, substeps)
    reason = "A hundredth of what a task notices (1 cm, 1 mrad); more substeps lower the error."
    gaps = gap(flight.states, drake)
    return [
        Check("25 s, default substeps: position", gaps["position"], 1e-4, "m", reason),
        Check("25 s, default substeps: attitude", gaps["attitude"], 1e-5, "rad", reason),
        *_gap_checks(f"25 s, {substeps} substeps", ours, drake, _agreement(flight),
                     "Fourth-order truncation; a wrong term of the equations would not shrink with it."),
    ]


def _float32_checks(flight: Flight, start: Any) -> list[Check]:
    """The precision agents train in, on the library they train with."""
    import torch

    single = map_leaves(lambda x: torch.tensor(x, dtype=torch.float32), start)
    commands = torch.tensor(flight.commands, dtype=torch.float32)
    substeps = flight.timing.substeps_in(flight.craft.dimension)
    ours = rollout(flight.craft, single, commands, flight.timing.control_period, substeps)
    reason = "125 periods of float32 rounding (1e-7), most of it heading error times way flown."
    return _gap_checks("25 s, float32", ours, flight.states, 1e-3 * _reach(flight), reason)[:2]


def _drake_states(flight: Flight, start: Any, max_step: float) -> Any:
    """The flight's commands replayed by Drake at an integration step."""
    plant = Plant(flight.craft, flight.commands.shape[1], max_step)
    rows = plant.rollout(rows_from_states(start), flight.commands, flight.timing.control_period)
    return states_from_rows(rows, start)


def _agreement(flight: Flight) -> float:
    """How closely a flight of 25 s must agree with Drake where the step size plays no part."""
    return (1e-9 if flight.craft.dimension == 2 else 1e-6) * _reach(flight)


def _reach(flight: Flight) -> float:
    """How far beyond 10 m a flight went: rounding and truncation grow with the way flown."""
    return max(1.0, float(np.max(flight.states.p.norm())) / 10.0)


def _gap_checks(layer: str, ours: Any, drake: Any, tolerance: float, reason: str) -> list[Check]:
    return [Check(f"{layer}: {name}", value, tolerance, _UNITS[name], reason)
            for name, value in gap(ours, drake).items()]


def _wrench_checks(layer: str, craft: Spacecraft, difference: np.ndarray) -> list[Check]:
    """Forces and torques beyond 1 N and 1 N m loosen the bound with their rounding."""
    centre = np.linalg.norm(craft.centre_of_mass)
    forces = [t.force for t in craft.thrusters]
    arms = [np.linalg.norm(t.position) + centre for t in craft.thrusters]
    torques = [float(force * arm) for force, arm in zip(forces, arms, strict=True)]
    reason = "Rounding of a few products, 1e-12 of the largest thruster's where that is above 1."
    return [
        Check(f"{layer}: {name}", float(np.max(np.abs(difference[:, part]))),
              1e-12 * max(1.0, *sizes), unit, reason)
        for name, unit, sizes, part in zip(("force", "torque"), ("N", "N m"), (forces, torques),
                                           _parts(craft), strict=True)
    ]


def _parts(craft: Spacecraft) -> tuple[slice, slice]:
    """Columns of translation and rotation in a wrench or an acceleration."""
    return slice(0, craft.dimension), slice(craft.dimension, None)


def _relative(ours: np.ndarray, reference: np.ndarray, least: float) -> float:
    """Largest row difference over the largest row, or over the least size to compare with."""
    difference = np.max(np.linalg.norm(ours - reference, axis=1))
    return float(difference / max(least, np.max(np.linalg.norm(reference, axis=1))))


def _wrenches(craft: Spacecraft, commands: np.ndarray) -> np.ndarray:
    """Our total wrenches, (N, 3 or 6)."""
    total: Any = wrench(craft, tuple(commands.T))
    torque = (total.torque,) if craft.dimension == 2 else total.torque.columns()
    return np.stack([*total.force.columns(), *torque], axis=1)


def _commands(craft: Spacecraft, seed: int, count: int) -> np.ndarray:
    """Random commands (N, thrusters): on/off in the even rows, anywhere between in the odd ones."""
    commands = np.random.default_rng(seed).random((count, len(craft.thrusters)))
    commands[::2] = commands[::2] > 0.5
    return commands
