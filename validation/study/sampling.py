"""States and commands to try the dynamics on, and how far two motions differ."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from rans.effectors.commands import of_outputs
from rans.effectors.motion import held
from rans.model.body import Body
from rans.model.dynamics import AnyState, PlanarState, SpatialState
from rans.model.fields import Heading, Quat, leaves, unflatten, wrap
from rans.model.random import Random, generator, seed_words
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks import GoToPose
from rans.tasks.quantities import QUANTITIES
from validation.study.checks import Check, Curve

ENDLESS = GoToPose(fail_distance=1e6, fail_spin=1e6)
"""No flight ends, wherever it goes."""
FASTEST = 1.0
"""Largest sampled speed (m/s) and spin (rad/s): twice what the paper's tasks ask for."""


_GENTLE = 10.0
"""rad/s^2: turns a spacecraft by 0.2 rad in a control period; 8 is what the free flyer can do."""


@contextmanager
def any_spin() -> Iterator[None]:
    """Flights without the warning of spins beyond the accuracy, where the study measures it or compares engines."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*its motion is accurate up to")
        yield


def random_states(dimension: Literal[2, 3], seed: int, count: int) -> Any:
    """States of float64 arrays (N,): within 5 m of the origin, any attitude, up to `FASTEST`."""
    random = Random(dimension, *seed_words(seed), np.arange(count, dtype=np.int32), np.float64)
    p: Any = random.direction().scale(random.uniform(0.0, 5.0))
    attitude: Any = random.attitude()
    v: Any = random.direction().scale(random.uniform(0.0, FASTEST))
    if dimension == 2:
        return PlanarState(p, attitude, v, random.uniform(-FASTEST, FASTEST))
    w: Any = random.direction().scale(random.uniform(0.0, FASTEST))
    return SpatialState(p, attitude, v, w)


def stocked(craft: Spacecraft, states: Any) -> Any:
    """States with full tanks and wheels at rest, of a craft that has them."""
    like = states.p.x * 0.0
    return replace(states, stores=tuple(like + store.initial for store in craft.stores))


def moments(craft: Spacecraft) -> np.ndarray:
    """Moments of inertia about the axes in which a craft can turn, (1, 1) or (3, 3) kg m^2."""
    first = 2 if craft.dimension == 2 else 0
    return np.array(craft.inertia)[first:, first:]


def gentle_commands(craft: Spacecraft, seed: int, count: int) -> np.ndarray:
    """Random commands (N, commands): on/off in the even rows, anywhere between in the odd ones.

    Those of other ranges are scaled to them.

    All are scaled down for a spacecraft that would spin up faster than `_GENTLE`: the equations are
    linear in the torque, and step sizes are for spacecraft that tasks can be solved with.
    """
    commands = generator(seed).random((count, len(craft.commands)))
    commands[::2] = commands[::2] > 0.5
    size = craft.dimension
    spin_ups = np.linalg.solve(moments(craft), craft.wrenches[:, size:].T)
    most = np.linalg.norm(
        np.maximum(spin_ups.clip(min=0).sum(axis=1), -spin_ups.clip(max=0).sum(axis=1))
    )
    commands *= min(1.0, _GENTLE / max(float(most), _GENTLE))
    return np.stack(of_outputs(craft, tuple(commands.T)), axis=1)


class Restless:
    """Opens the thrusters that push toward the goal, and one decision in twenty the wrong way round.

    Independent random thrust would spin a spacecraft up without bound; a good controller would fall
    silent. This one flies like a mediocre agent: near the goal, in all attitudes, always firing. A
    thruster opens when the acceleration it gives, projected on the acceleration that a critically
    damped spring to the goal asks for (time constants 3 s for position, 1 s for attitude), covers
    more than a share of the strongest thruster's. Where commands may be anything between shut and open, it
    opens by quarters, so that valves that pulse shut at four moments of a period.

    Args:
        craft: what it flies; any set of thrusters.
        seed: of the wrong decisions.
        share: by default a half; at 0 every thruster is always fully open or works the wrong way, which
            is bang-bang control.
    """

    name = "restless"

    def __init__(self, craft: Spacecraft, seed: int, share: float = 0.5) -> None:
        self._random = generator(seed)
        self._share = share
        self._craft = craft
        self._by_quarters = craft.actuators.is_continuous and share > 0.0
        columns = craft.wrenches
        size = craft.dimension
        moments = np.array([[craft.inertia[2][2]]]) if size == 2 else np.array(craft.inertia)
        linear = columns[:, :size] / craft.mass
        angular = np.linalg.solve(moments, columns[:, size:].T).T
        self._projection = np.concatenate([_scaled(linear), _scaled(angular)], axis=1).T

    def reset(self, count: int) -> None:
        """Nothing to forget."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.episode.flight.Controller`."""
        to_body = state.attitude.to(_identity(state))
        linear = to_body.rotate((goal.p - state.p).scale(1 / 9) - state.v.scale(2 / 3))
        turn = _rotation_vector(state.attitude.to(goal.attitude))
        angular = [angle - 2.0 * rate for angle, rate in zip(turn, state.spin(), strict=True)]
        wanted = np.stack([*linear.columns(), *angular], axis=1)
        opened = wanted @ self._projection > self._share
        opened ^= self._random.random(opened.shape) < 0.05
        outputs = (
            opened * self._random.integers(1, 5, opened.shape) / 4 if self._by_quarters else opened
        )
        if self._craft.wheels:
            # A craft that is to turn one way turns its wheels the other way.
            torque = np.stack(angular, axis=1) @ moments(self._craft).T
            strongest = np.array(self._craft.wheel_map)
            share = np.clip(torque @ strongest.T / (strongest**2).sum(axis=1), -1.0, 1.0)
            share *= np.where(self._random.random(share.shape) < 0.05, -1.0, 1.0)
            outputs = np.hstack([outputs, 0.5 + 0.5 * share])
        # Whatever else has commands follows nothing.
        further = len(self._craft.commands) - outputs.shape[1]
        if further:
            outputs = np.hstack([outputs, self._random.random((len(outputs), further))])
        return np.stack(of_outputs(self._craft, tuple(outputs.T)), axis=1)


def rollout(
    craft: Spacecraft, start: AnyState, commands: Any, period: float, substeps: int
) -> AnyState:
    """Our equations under commands given beforehand, as the fast engine applies them.

    Args:
        craft: what flies.
        start: fields (N,), NumPy or torch.
        commands: (T, N, thrusters), 0 to 1, of the same library and dtype.
        period: each command is held, s.
        substeps: a control period.

    Returns:
        The states with fields (T + 1, N), NumPy float64.
    """
    body = Body.of(craft)
    start = start if start.stores else stocked(craft, start)
    states = [start]
    timing = Timing(control_period=period, substeps=substeps)
    for command in commands:
        states.append(held(states[-1], craft, body, tuple(command.T), timing))
    columns = zip(*(leaves(state) for state in states), strict=True)
    return unflatten(
        start, [np.stack([np.asarray(x, dtype=np.float64) for x in c]) for c in columns]
    )


def gaps(a: Any, b: Any) -> dict[str, np.ndarray]:
    """How far two states of arrays differ: position (m), attitude (rad), velocity, spin."""
    spin = [x - y for x, y in zip(a.spin(), b.spin(), strict=True)]
    stores = {}
    if a.stores and b.stores:
        # Propellant and momenta of wheels.
        apart = [x - y for x, y in zip(a.stores, b.stores, strict=True)]
        stores = {"stores": np.linalg.norm(np.array(apart), axis=0)}
    return {
        "position": np.asarray((a.p - b.p).norm()),
        "attitude": np.asarray(a.attitude.to(b.attitude).magnitude()),
        "velocity": np.asarray((a.v - b.v).norm()),
        "spin": np.linalg.norm(np.array(spin), axis=0),
        **stores,
    }


def gap(a: Any, b: Any) -> dict[str, float]:
    """The largest of the `gaps`."""
    return {name: float(np.max(value)) for name, value in gaps(a, b).items()}


def gap_checks(layer: str, ours: Any, drake: Any, tolerance: float, reason: str) -> list[Check]:
    """One check per quantity of the largest of the `gaps`, which may have the shape (N,) or (T + 1, N)."""
    return [
        Check(
            f"{layer}: {name}",
            float(np.max(value)),
            tolerance,
            QUANTITIES[name].unit if name in QUANTITIES else "kg, N m s",
            reason,
            _where(value),
        )
        for name, value in gaps(ours, drake).items()
    ]


def growth(name: str, ours: Any, reference: Any, timing: Timing) -> Iterator[Curve]:
    """The largest position and attitude difference at every instant, of states (T + 1, N)."""
    times = tuple(np.arange(len(leaves(reference)[0])) * timing.control_period)
    for quantity in ("position", "attitude"):
        values = gaps(ours, reference)[quantity].max(axis=1)
        figure = f"{quantity} error, {QUANTITIES[quantity].unit}, over time, s"
        yield Curve(figure, name, times, tuple(values.tolist()))


def reach(states: Any) -> float:
    """How far beyond 10 m a flight went: rounding and truncation grow with the way flown."""
    return max(1.0, float(np.max(states.p.norm())) / 10.0)


def _where(values: np.ndarray) -> str:
    """Which of the states, or which flight and control period, has the largest value."""
    *period, number = np.unravel_index(np.argmax(values), values.shape)
    return f"flight {number}, period {period[0]}" if period else f"state {number}"


def _scaled(accelerations: np.ndarray) -> np.ndarray:
    """Rows over the square of the longest; zero when there is none (no thrusters, or none that turns)."""
    longest = np.linalg.norm(accelerations, axis=1).max(initial=0.0)
    return accelerations / longest**2 if longest > 0 else accelerations


def _identity(state: Any) -> Heading | Quat:
    return Heading(0.0) if isinstance(state, PlanarState) else Quat(1.0, 0.0, 0.0, 0.0)


def _rotation_vector(turn: Any) -> tuple[np.ndarray, ...]:
    """The shortest rotation as a vector in B, rad; in space twice the sine of half the angle."""
    if isinstance(turn, Heading):
        return (wrap(turn.angle),)
    sign = np.where(turn.w < 0, -2.0, 2.0)
    return (sign * turn.x, sign * turn.y, sign * turn.z)
