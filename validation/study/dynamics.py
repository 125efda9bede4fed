"""Do the equations every engine shares describe the spacecraft? Drake's answer, one moment at a time.

A layer's failure says where to look: one thruster, their sum, accelerations (mass properties,
gyroscopic term), one control period (integration). `validation.study.flights` follows with whole flights.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from rans.effectors.motion import held
from rans.model.body import Body
from rans.model.dynamics import Wrench, wrench
from rans.model.fields import Vec2, Vec3, map_leaves
from rans.model.random import generator
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.reference.flight import rows_from_states, states_from_rows
from rans.reference.plant import Plant
from validation.study.checks import Check
from validation.study.sampling import FASTEST, gap_checks, gentle_commands, random_states, stocked

VALIDATION_SUBSTEPS = {2: 1, 3: 32}
"""Physics substeps at which the equations, not the step size, are compared with Drake: the plane's step
is exact, in space the sixth-order error of 32 is below rounding."""
_WITH_MASSES_THAT_MOVE = 128
"""Physics substeps of a craft that is not rigid, whose steps are of order four: errors are some
1e-11 in a period."""
_MOMENT = Timing(control_period=1e-6, substeps=1)
"""So short that no effector runs out of momentum or charge, as Drake's at one moment."""
_STILL = FASTEST**2
"""Acceleration to compare with where nothing pushes, m/s^2: that of a point of the craft at 1 m from the centre of
mass, which Drake's equations of the craft's frame contain."""


def thruster_checks(craft: Spacecraft) -> list[Check]:
    """Force and torque about the centre of mass of every thruster alone."""
    ours = _wrenches(craft, np.eye(len(craft.thrusters)))
    return _wrench_checks(
        "every thruster", "thruster", craft, ours - Plant(craft).thruster_wrenches()
    )


def wrench_checks(craft: Spacecraft, seed: int, count: int) -> list[Check]:
    """Total force and torque of random commands of thrusters, half of them on/off and half relaxed."""
    commands = _commands(craft, seed, count)
    ours = _wrenches(craft, commands)
    return _wrench_checks(
        "random commands", "command", craft, ours - Plant(craft, count).wrenches(commands)
    )


def mass_checks(craft: Spacecraft) -> list[Check]:
    """Mass and inertia about the centre of mass, however far it is from the spacecraft's frame."""
    body = Body.of(craft)
    size = craft.dimension
    ours = np.zeros((craft.degrees_of_freedom,) * 2)
    ours[:size, :size] = body.mass * np.eye(size)
    ours[size:, size:] = tensor(body)
    drake = Plant(craft).mass_matrix()
    difference = np.abs(ours - drake)
    difference[:size, :size] /= body.mass
    difference[size:, size:] /= np.max(np.abs(drake[size:, size:]))
    # Mass times way couples the two where B is not at the centre of mass.
    difference[:size, size:] /= body.mass
    difference[size:, :size] /= body.mass
    return [
        Check(
            "mass matrix",
            float(np.max(difference)),
            1e-12,
            "relative",
            "Rounding of the shift from the spacecraft's frame to its centre of mass.",
        )
    ]


def acceleration_checks(craft: Spacecraft, seed: int, count: int) -> list[Check]:
    """Accelerations in random states under random commands, of all effectors.

    Ours are the derivative of the motion over a control period by its length, at a length of 0. Differentiation by
    torch is exact to rounding, and goes through the code that flies.
    """
    states = random_states(craft.dimension, seed, count)
    others = craft.commands[craft.thruster_count :]
    lows, highs = ([getattr(command, end) for command in others] for end in ("low", "high"))
    further = generator(seed).uniform(lows, highs, (count, len(others)))
    commands = np.hstack([_commands(craft, seed, count), further])
    columns = tuple(torch.from_numpy(commands).unbind(1))
    start = map_leaves(
        lambda x: torch.as_tensor(x, dtype=torch.float64).expand(count), stocked(craft, states)
    )

    # One length for each state, so that the derivative of a sum over states is that of each of them.
    duration = torch.zeros(count, dtype=torch.float64, requires_grad=True)
    pieces = [(duration, wrench(craft, columns), None, _MOMENT.control_period)]
    moved = held(start, craft, Body.of(craft), columns, _MOMENT, pieces=pieces)
    rates = [
        torch.autograd.grad(velocity.sum(), duration, retain_graph=True)[0]
        for velocity in (*moved.v.columns(), *moved.spin())
    ]
    rate = torch.stack(rates, dim=1).numpy()
    drake = Plant(craft, count).accelerations(rows_from_states(states), commands)
    linear, angular = _parts(craft)
    return [
        _acceleration_check(
            "linear",
            rate[:, linear],
            drake[:, linear],
            0.0 if craft.thrusters else _STILL,
            "Rounding, relative to the largest in the sample"
            + ("." if craft.thrusters else f", or to {_STILL:g} m/s^2 without thrusters."),
        ),
        _acceleration_check(
            "angular",
            rate[:, angular],
            drake[:, angular],
            FASTEST**2,
            "Rounding, relative to the largest in the sample, or to w^2 where the "
            "terms of w x I w cancel and nothing turns the spacecraft.",
        ),
    ]


def period_checks(craft: Spacecraft, seed: int, count: int) -> list[Check]:
    """One control period from random states, commands as the actuators take them, validation substeps."""
    states = stocked(craft, random_states(craft.dimension, seed, count))
    commands = gentle_commands(craft, seed, count)
    timing = _fine(craft)
    ours = held(states, craft, Body.of(craft), tuple(commands.T), timing)
    rows = Plant(craft, count).advance(rows_from_states(states), commands, timing.control_period)
    reason = "Truncation of both integrators over one period; a wrong term shows at 1e-6 or more."
    tolerance = _period_tolerance(craft)
    return gap_checks("one control period", ours, states_from_rows(rows, states), tolerance, reason)


def _fine(craft: Spacecraft) -> Timing:
    """The usual control period in validation substeps."""
    substeps = VALIDATION_SUBSTEPS[craft.dimension]
    return Timing(substeps=substeps if craft.is_rigid else _WITH_MASSES_THAT_MOVE)


def _period_tolerance(craft: Spacecraft) -> float:
    """Tolerance of one control period, SI units; as mass falls, the engine's parts leave up to 1.1e-8."""
    return 1e-9 if craft.propellant is None else 3e-8


def disturbance_checks(craft: Spacecraft, seed: int, count: int) -> list[Check]:
    """One control period as above, pushed and turned by forces that stay put in the world.

    Up to 0.5 N and 0.1 N m per axis: the original system's largest uneven floor and torque.
    """
    states = stocked(craft, random_states(craft.dimension, seed, count))
    commands = gentle_commands(craft, seed, count)
    split = 2 if craft.dimension == 2 else 3
    scale = np.array([0.5] * split + [0.1] * (craft.degrees_of_freedom - split))
    pushes = scale * generator(seed).uniform(-1, 1, (count, craft.degrees_of_freedom))
    force = pushes[:, :split].T
    torque = pushes[:, split:].T
    acting = Wrench(Vec2(*force), torque[0]) if split == 2 else Wrench(Vec3(*force), Vec3(*torque))
    timing = _fine(craft)
    ours = held(states, craft, Body.of(craft), tuple(commands.T), timing, disturbance=acting)
    rows = Plant(craft, count).advance(
        rows_from_states(states), commands, timing.control_period, pushes
    )
    reason = "As one control period; a force or torque in the wrong frame shows at 1e-4 or more."
    tolerance = _period_tolerance(craft)
    return gap_checks("disturbed period", ours, states_from_rows(rows, states), tolerance, reason)


def _wrench_checks(layer: str, row: str, craft: Spacecraft, difference: np.ndarray) -> list[Check]:
    """Forces and torques beyond 1 N and 1 N m loosen the bound with their rounding."""
    centre = np.linalg.norm(craft.centre_of_mass)
    forces = [t.force for t in craft.thrusters]
    arms = [np.linalg.norm(t.position) + centre for t in craft.thrusters]
    torques = [float(force * arm) for force, arm in zip(forces, arms, strict=True)]
    reason = "Rounding of a few products, 1e-12 of the largest thruster's where that is above 1."
    checks = []
    for name, unit, sizes, part in zip(
        ("force", "torque"), ("N", "N m"), (forces, torques), _parts(craft), strict=True
    ):
        rows = np.max(np.abs(difference[:, part]), axis=1)
        checks.append(
            Check(
                f"{layer}: {name}",
                float(rows.max()),
                1e-12 * max(1.0, *sizes),
                unit,
                reason,
                f"{row} {rows.argmax()}",
            )
        )
    return checks


def tensor(body: Body) -> np.ndarray:
    """The inertia as a matrix, 1x1 in the plane."""
    if len(body.inertia) == 1:
        return np.array([body.inertia])
    xx, xy, xz, yy, yz, zz = body.inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _parts(craft: Spacecraft) -> tuple[slice, slice]:
    """Columns of translation and rotation in a wrench or an acceleration."""
    return slice(0, craft.dimension), slice(craft.dimension, None)


def _acceleration_check(
    name: str, ours: np.ndarray, drake: np.ndarray, least: float, reason: str
) -> Check:
    """Largest row difference over the largest row, or over the least size to compare with."""
    difference = np.linalg.norm(ours - drake, axis=1)
    value = difference.max() / max(least, np.max(np.linalg.norm(drake, axis=1)))
    return Check(
        f"accelerations: {name}",
        float(value),
        1e-12,
        "relative",
        reason,
        f"state {difference.argmax()}",
    )


def _wrenches(craft: Spacecraft, commands: np.ndarray) -> np.ndarray:
    """Our total wrenches, (N, 3 or 6)."""
    total: Any = wrench(craft, tuple(commands.T))
    torque = (total.torque,) if craft.dimension == 2 else total.torque.columns()
    return np.stack([*total.force.columns(), *torque], axis=1)


def _commands(craft: Spacecraft, seed: int, count: int) -> np.ndarray:
    """Random commands (N, thrusters): on/off in the even rows, anywhere between in the odd ones."""
    commands = generator(seed).random((count, len(craft.thrusters)))
    commands[::2] = commands[::2] > 0.5
    return commands
