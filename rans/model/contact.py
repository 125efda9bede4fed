"""Two spacecraft that become one at an instant, or one that becomes two: motion after docking and undocking.

Nothing else acts at that instant, so momentum and angular momentum stay. Energy does not: a latch takes what is
left of the relative motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rans.errors import ConfigError
from rans.model.drift import FREE, Drift
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Quat, Vec2, Vec3
from rans.model.joined import Effectors, joined
from rans.model.spacecraft import Spacecraft


@dataclass(frozen=True)
class _Moving:
    """A craft in motion, in W: arrays (3,) and (3, 3)."""

    p: np.ndarray
    v: np.ndarray
    w: np.ndarray
    """Angular velocity in W, rad/s."""
    turn: Rotation
    """Rotation from B to W."""
    inertia: np.ndarray
    """About the centre of mass, in W, without the wheels about their axes."""


def join_at_contact(
    first: Spacecraft,
    second: Spacecraft,
    state: Any,
    other: Any,
    effectors: Effectors = "both",
    name: str | None = None,
    drift: Drift = FREE,
) -> tuple[Spacecraft, Any]:
    """Two craft that latch rigidly where they are now, as one craft with its motion after it.

    Wheels keep their momentum: a latch has no torque about their axes. With the effectors of the first alone the
    wheels of the second are locked, and their momentum becomes that of the joined craft.

    Args:
        first: craft whose axes and frame G the joined craft has.
        second: craft of the same dimension.
        state: of the first.
        other: of the second, in the same W.
        effectors: which thrusters and wheels the joined craft has, see `rans.model.joined.joined`.
        name: of the joined craft; None: FIRST-SECOND.
        drift: of W: where it turns, spins are relative to it.

    Raises:
        ConfigError: see `rans.model.joined.joined`; or a state has not the dimension or the stores of its craft.
    """
    one, two = _moving(first, state, "first"), _moving(second, other, "second")
    origins = [
        moving.p - moving.turn.apply(craft.centre_of_mass)
        for craft, moving in ((first, one), (second, two))
    ]
    offset = one.turn.inv().apply(origins[1] - origins[0])
    between = one.turn.inv() * two.turn
    flat = first.dimension == 2
    position = offset[:2] if flat else offset
    attitude: Any = between.as_quat(scalar_first=True).tolist()
    if flat:
        attitude = float(between.as_rotvec()[2])
    craft = joined(first, second, position.tolist(), attitude, effectors, name)

    # Momentum gives the velocity, angular momentum about the common centre of mass the spin.
    masses = np.array([first.mass, second.mass]) / craft.mass
    p = masses[0] * one.p + masses[1] * two.p
    v = masses[0] * one.v + masses[1] * two.v
    momentum = np.zeros(3)
    for mass, moving in ((first.mass, one), (second.mass, two)):
        momentum += moving.inertia @ moving.w + mass * np.cross(moving.p - p, moving.v - v)
    stores = state.stores
    if effectors == "both":
        stores = (*stores, *other.stores)
    else:
        # Momenta of wheels are absolute, and those of locked wheels that turn with W are not in its spin.
        frame = two.turn.inv().apply(_rate(drift))
        wheels = zip(second.wheels, _wheel_momenta(second, other), strict=True)
        for wheel, stored in wheels:
            axis = np.array(wheel.axis)
            momentum += two.turn.apply(axis * (stored - wheel.inertia * (axis @ frame)))
    inertia = _in_world(np.array(craft.inertia), one.turn)
    spin = np.linalg.solve(inertia, momentum)
    return craft, _state(state, p, v, spin, one.turn, stores)


def part(
    first: Spacecraft,
    second: Spacecraft,
    position: Sequence[float],
    attitude: float | Sequence[float],
    state: Any,
    drift: Drift = FREE,
) -> tuple[Any, Any]:
    """States of two joined craft that part without an impulse: each moves on as the part that it was.

    Wheels of both, if the joined craft has them, keep their momentum; those of a second craft whose effectors the
    joined one has not are at rest relative to it.

    Args:
        first: craft whose axes the joined craft has.
        second: the other.
        position: origin of the second's frame G in that of the first, m.
        attitude: of the second's G in that of the first, as for `rans.model.joined.joined`.
        state: of the joined craft.
        drift: of W: where it turns, spins are relative to it.

    Raises:
        ConfigError: see `rans.model.joined.joined`.
    """
    whole = joined(first, second, position, attitude, "first")
    turn = _attitude(state)
    spin = _spin(state, turn)
    offset = np.zeros(3)
    offset[: first.dimension] = position
    if isinstance(attitude, int | float):
        between = Rotation.from_rotvec([0.0, 0.0, float(attitude)])
    else:
        between = Rotation.from_quat(np.array(attitude, float), scalar_first=True)
    centre = _three(state.p.columns())
    speed = _three(state.v.columns())
    # Each part's centre of mass moves with the joined craft's spin.
    results = []
    count = len(first.stores)
    own = (state.stores[:count], state.stores[count:])
    for craft, place, relative, stores in (
        (first, np.array(first.centre_of_mass), Rotation.identity(), own[0]),
        (second, offset + between.apply(second.centre_of_mass), between, own[1]),
    ):
        arm = turn.apply(place - np.array(whole.centre_of_mass))
        if len(stores) != len(craft.stores):
            # Momenta of wheels are absolute: at rest in the craft they turn with W too.
            body_spin = (turn * relative).inv().apply(spin + _rate(drift))
            stores = tuple(
                float(wheel.inertia * (np.array(wheel.axis) @ body_spin)) for wheel in craft.wheels
            )
        velocity = speed + np.cross(spin, arm)
        results.append(_state(state, centre + arm, velocity, spin, turn * relative, stores))
    return results[0], results[1]


def _moving(craft: Spacecraft, state: Any, which: str) -> _Moving:
    """Motion of a craft in W, in arrays (3,); `ConfigError` if the state is of another craft, or it has a tank."""
    if len(state.p.columns()) != craft.dimension or len(state.stores) != len(craft.stores):
        raise ConfigError(
            f"the state of the {which} craft has {len(state.p.columns())} components of position and "
            f"{len(state.stores)} stores; {craft.name!r} has {craft.dimension} and {len(craft.stores)}."
        )
    if craft.propellant is not None or craft.further_effectors:
        raise ConfigError(
            f"{craft.name!r} has a tank or further effectors, whose mass moves: describe the craft as it is "
            "at contact, without them."
        )
    turn = _attitude(state)
    return _Moving(
        _three(state.p.columns()),
        _three(state.v.columns()),
        _spin(state, turn),
        turn,
        _in_world(np.array(craft.inertia), turn),
    )


def _rate(drift: Drift) -> np.ndarray:
    """Angular velocity of W, (3,) rad/s."""
    rate = drift.rate()
    return np.zeros(3) if rate is None else np.array(rate.columns(), dtype=float)


def _wheel_momenta(craft: Spacecraft, state: Any) -> tuple[float, ...]:
    """Momentum of each wheel among the stores, N m s."""
    return tuple(map(float, state.stores[: craft.wheel_count]))


def _attitude(state: Any) -> Rotation:
    if isinstance(state, PlanarState):
        return Rotation.from_rotvec([0.0, 0.0, float(state.attitude.angle)])
    q = state.attitude
    return Rotation.from_quat([float(q.x), float(q.y), float(q.z), float(q.w)])


def _spin(state: Any, turn: Rotation) -> np.ndarray:
    """Angular velocity in W, rad/s."""
    if isinstance(state, PlanarState):
        return np.array([0.0, 0.0, float(state.w)])
    return turn.apply([float(x) for x in state.w.columns()])


def _in_world(inertia: np.ndarray, turn: Rotation) -> np.ndarray:
    matrix = turn.as_matrix()
    return matrix @ inertia @ matrix.T


def _three(columns: Sequence[float]) -> np.ndarray:
    result = np.zeros(3)
    result[: len(columns)] = [float(x) for x in columns]
    return result


def _state(
    like: Any,
    p: np.ndarray,
    v: np.ndarray,
    spin: np.ndarray,
    turn: Rotation,
    stores: tuple[float, ...],
) -> Any:
    """A state of the same kind as another, from position, velocity and spin (3,) in W; its own spin is in B.

    Its turn is from B to W.
    """
    x, y, z = map(float, p)
    u = tuple(map(float, v))
    if isinstance(like, PlanarState):
        heading = Heading(float(turn.as_rotvec()[2]))
        return replace(
            like, p=Vec2(x, y), attitude=heading, v=Vec2(*u[:2]), w=float(spin[2]), stores=stores
        )
    q = turn.as_quat(scalar_first=True)
    own = turn.inv().apply(spin)
    return replace(
        like,
        p=Vec3(x, y, z),
        attitude=Quat(*map(float, q)),
        v=Vec3(*u),
        w=Vec3(*map(float, own)),
        stores=stores,
    )
