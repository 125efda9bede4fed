"""What a time step costs in accuracy: ours, and the one of the original system.

The original (and PhysX below it) takes semi-implicit Euler steps at 50 or 100 Hz under commands at 5 or
10 Hz. Here the same commands are flown with that scheme and with ours at several step sizes, and Drake
says how far off each is after 25 s.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.model.accuracy import chosen
from rans.model.body import Body
from rans.model.dynamics import PlanarState, advance, wrench
from rans.model.fields import Heading, Quat, Vec3, cos, map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks import GoToPose
from rans.tasks.quantities import QUANTITIES
from validation.study.checks import Check, Curve
from validation.study.dynamics import tensor
from validation.study.flights import drake_states
from validation.study.sampling import Restless, gaps, gentle_commands, random_states

Method = Callable[[Any, Any, Body, float, int], Any]
"""(state, wrench, body, duration, steps) to the state after."""

_CONTROL_RATES = (5, 10)
_EULER_RATES = (50, 100, 200, 400, 800)
"""Steps per second; the first two are the original's."""
_OUR_STEPS = (1, 2, 3, 4, 8, 16)
"""A control period, in space."""
_OUR_NODES = (1, 2, 3, 4, 5, 6)
"""Of one quadrature a control period, in the plane."""
_ORDER_STEPS = (1, 2, 4, 8, 16, 32)
"""A control period."""
_EVALUATIONS = {2: 1, 3: 3}
"""Of the force for each of these: a node, or a step of three nodes."""


def discretisation_checks(craft: Spacecraft, seed: int, count: int) -> list[Check | Curve]:
    """Errors after 25 s by force evaluations per second, and that the default beats the original's.

    A semi-implicit Euler step evaluates the force once, so that its steps per second are the same thing.
    """
    results: list[Check | Curve] = []
    for rate in _CONTROL_RATES:
        timing = Timing(control_period=1.0 / rate, episode_steps=25 * rate)
        starts = scenarios(GoToPose(), craft, seed, count)
        # Open for the whole period or not at all: then a step's length is its share of the period.
        commands = np.ceil(fly(craft, GoToPose(), Restless(craft, seed), starts, timing).commands)
        # Wheels rest: a full one gives no torque, which `wrench` does not know.
        commands[..., len(craft.thrusters) :] = 0.0
        drake = drake_states(craft, starts.start, commands, timing, 0.01)
        end = map_leaves(lambda x: x[-1], drake)

        def error(
            method: Method,
            steps: int,
            start: Any = starts.start,
            inputs: Any = commands,
            period: float = timing.control_period,
            reference: Any = end,
        ) -> dict[str, float]:
            flown = _flown(craft, start, inputs, period, method, steps)
            return {name: float(np.median(value)) for name, value in gaps(flown, reference).items()}

        euler = {
            per_second: error(semi_implicit_euler, per_second // rate)
            for per_second in _EULER_RATES
        }
        ours = dict(_ours(craft, rate, error))
        results += [
            *_curves(f"semi-implicit Euler, control at {rate} Hz", euler),
            *_curves(f"ours, control at {rate} Hz", ours),
        ]
        default = rate * _EVALUATIONS[craft.dimension] * _default(craft, rate)
        results.append(
            Check(
                f"control at {rate} Hz: default over 50 Hz Euler",
                ours[default]["position"] / euler[50]["position"],
                0.1,
                "ratio",
                "Median position error after 25 s over the median of the original's step: the default must "
                "gain a decade.",
            )
        )
    return results


def order_curves(craft: Spacecraft, seed: int, count: int) -> list[Curve]:
    """Error of one control period by step size; its slope is the order of convergence.

    `validation.study.invariants` checks the slope of ours.
    """
    states = random_states(craft.dimension, seed, count)
    body = Body.of(craft)
    period = Timing().control_period
    applied = wrench(craft, tuple(gentle_commands(craft, seed, count).T))
    finest = advance(states, applied, body, period, 256)
    curves = []
    methods = dict[str, Method]({"semi-implicit Euler": semi_implicit_euler, "ours": advance})
    for name, method in methods.items():
        errors = [
            gaps(method(states, applied, body, period, steps), finest) for steps in _ORDER_STEPS
        ]
        sizes = tuple(float(np.sqrt(np.mean(error["position"] ** 2))) for error in errors)
        curves.append(
            Curve(
                "position error (RMS), m, over step, s",
                name,
                tuple(period / steps for steps in _ORDER_STEPS),
                sizes,
            )
        )
    return curves


def semi_implicit_euler(state: Any, applied: Any, body: Body, duration: float, steps: int) -> Any:
    """Velocity first, then position with the new velocity; the attitude turns by exactly w h.

    The gyroscopic torque is taken at the old spin.
    """
    h = duration / steps
    for _ in range(steps):
        v = state.v + state.attitude.rotate(applied.force).scale(h / body.mass)
        if isinstance(state, PlanarState):
            w = state.w + h * applied.torque / body.inertia[0]
            state = PlanarState(state.p + v.scale(h), Heading(state.attitude.angle + h * w), v, w)
        else:
            w = state.w + _spin_up(state.w, applied.torque, body).scale(h)
            state = type(state)(state.p + v.scale(h), state.attitude.times(_turn(w.scale(h))), v, w)
    return state


def _spin_up(w: Vec3, torque: Vec3, body: Body) -> Vec3:
    inertia = tensor(body)
    momentum = Vec3(*(inertia @ np.array(w.columns())))
    return Vec3(*np.linalg.solve(inertia, np.array((torque - w.cross(momentum)).columns())))


def _turn(vector: Vec3) -> Quat:
    """The rotation by a rotation vector, rad."""
    half = vector.norm() * 0.5
    scale = 0.5 * np.sinc(half / np.pi)  # sin(half) / (2 half), also where nothing turns
    return Quat(cos(half), vector.x * scale, vector.y * scale, vector.z * scale)


def _default(craft: Spacecraft, rate: int) -> int:
    """Nodes or steps a control period."""
    return (
        _OUR_NODES[-1] if craft.dimension == 2 else chosen(craft, Timing(1.0 / rate)).substeps or 1
    )


def _ours(
    craft: Spacecraft,
    rate: int,
    error: Callable[..., dict[str, float]],
) -> Iterator[tuple[int, dict[str, float]]]:
    """Force evaluations per second and errors."""
    if craft.dimension == 3:
        for steps in sorted({*_OUR_STEPS, _default(craft, rate)}):
            yield rate * _EVALUATIONS[3] * steps, error(advance, steps)
        return
    for nodes in _OUR_NODES:

        def one_step(
            state: Any, applied: Any, body: Body, duration: float, steps: int, nodes: int = nodes
        ) -> Any:
            return advance(state, applied, body, duration, steps, nodes)

        yield rate * nodes, error(one_step, 1)


def _flown(
    craft: Spacecraft, state: Any, commands: np.ndarray, period: float, method: Method, steps: int
) -> Any:
    body = Body.of(craft)
    for command in commands:
        state = method(state, wrench(craft, tuple(command.T)), body, period, steps).normalised()
    return state


def _curves(name: str, errors: dict[int, dict[str, float]]) -> Iterator[Curve]:
    for quantity in ("position", "attitude"):
        yield Curve(
            f"median {quantity} error after 25 s, {QUANTITIES[quantity].unit}, "
            "over force evaluations per second",
            name,
            tuple(errors),
            tuple(error[quantity] for error in errors.values()),
        )
