"""States of a user's own: as numbers in Python, and as words, with zones, for every command that takes them.

A pose is "X Y HEADING" in the plane and "X Y Z", or "X Y Z ROLL PITCH YAW", in space: positions in m, angles in
degrees or with a unit, as in "3 1 40deg" or "3 1 0.7rad". Velocities may follow by their names, such as "v.x=0.1"
(m/s) and "w=0.2" (rad/s; in space w.x, w.y and w.z).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from rans.base.errors import ConfigError, brief, is_finite
from rans.episode.scenario import LARGEST, Endpoints, Scenario, each
from rans.model.dynamics import PlanarState, SpatialState, State
from rans.model.fields import Heading, Quat, Vec2, Vec3, unflatten

_UNITS = {"deg": 1.0, "rad": math.degrees(1.0)}
_RATES = {2: ("v.x", "v.y", "w"), 3: ("v.x", "v.y", "v.z", "w.x", "w.y", "w.z")}
"""Names of velocities and angular velocities, by dimension, in the order of a state's values."""


def state(
    position: Sequence[float],
    attitude: float | Sequence[float] | None = None,
    velocity: Sequence[float] | None = None,
    spin: float | Sequence[float] | None = None,
) -> State:
    """Make a state to start from or to arrive at, in the plane or in space.

    >>> rans.state((3.0, -1.0), attitude=0.5).v
    Vec2(x=0.0, y=0.0)
    >>> rans.state((3.0, -1.0, 0.0)).attitude
    Quat(w=1.0, x=0.0, y=0.0, z=0.0)

    Args:
        position: p_WB, the position in the world frame W: two or three numbers, m.
        attitude: R_WB, of the body frame B in W: in the plane the heading, rad; in space a quaternion
            (w, x, y, z), which is normalized, or a Rotation of SciPy.
            None: aligned with the world.
        velocity: v_WB in W, m/s; None: at rest.
        spin: in the plane w_WB, rad/s; in space w_WB_B, three numbers. None: none.

    Raises:
        ConfigError: these are not so many finite numbers, or the quaternion is zero.
    """
    target = _numbers("position", position)
    if len(target) not in (2, 3):
        raise ConfigError(f"the position has 2 or 3 numbers, got {len(target)}.")
    size = len(target)
    moving = _numbers("velocity", [0.0] * size if velocity is None else velocity, size)
    if size == 2:
        heading = _numbers("attitude", [0.0 if attitude is None else attitude], 1)
        turning = _numbers("spin", [0.0 if spin is None else spin], 1)
        return PlanarState(Vec2(*target), Heading(heading[0]), Vec2(*moving), turning[0])
    if hasattr(attitude, "as_quat"):  # a Rotation of SciPy, whose real part comes last
        attitude = np.roll(attitude.as_quat(), 1)
    if is_finite(attitude):
        raise ConfigError(
            "a position with three numbers is in space, where the attitude is a quaternion (w, x, y, z), got "
            f"{brief(attitude)}."
        )
    quaternion = _numbers("attitude", (1.0, 0.0, 0.0, 0.0) if attitude is None else attitude, 4)
    length = float(np.linalg.norm(quaternion))
    if not length > 1e-6:
        raise ConfigError(f"the attitude is a quaternion (w, x, y, z), got {brief(attitude)}.")
    turning = _numbers("spin", [0.0] * 3 if spin is None else spin, 3)
    unit = Quat(*(x / length for x in quaternion))
    return SpatialState(Vec3(*target), unit, Vec3(*moving), Vec3(*turning))


def _numbers(what: str, values: Any, count: int | None = None) -> list[float]:
    """Finite numbers, ``count`` of them unless it is None; else a `ConfigError` that names what they are."""
    try:
        results = [float(x) for x in values]
    except (TypeError, ValueError) as error:
        raise ConfigError(f"the {what} must be numbers, got {brief(values)}.") from error
    if not np.isfinite(results).all() or (count is not None and len(results) != count):
        form = "finite numbers" if count is None else f"{count} finite numbers"
        raise ConfigError(f"the {what} must be {form}, got {brief(values)}.")
    return results


class WrittenState(NamedTuple):
    """A pose and velocities as a user writes them."""

    pose: tuple[float, ...]
    """x, y (m) and heading (degrees); in space x, y, z and roll, pitch, yaw. Empty: none is written."""
    velocities: dict[str, float]
    """Velocities (m/s) and angular velocities (rad/s) by their names; those that are not written are absent."""


def read_state(words: Sequence[str], dimension: int, option: str) -> WrittenState:
    """Pose and velocities of the words after an option.

    Args:
        words: words such as "3", "1", "40deg" and "v.x=0.1".
        dimension: 2 in the plane, 3 in space.
        option: name of the option, for messages.

    Raises:
        ConfigError: there are too many or too few words, one is no finite number, or an angle is where a length
            must be.
    """
    # A pose in quotation marks or with commas is one word of several numbers.
    words = [piece for word in words for piece in word.replace(",", " ").split()]
    numbers = [word for word in words if "=" not in word]
    counts = (0, 3) if dimension == 2 else (0, 3, 6)
    if len(numbers) not in counts:
        form = "x, y and heading" if dimension == 2 else "x, y, z and perhaps roll, pitch, yaw"
        raise ConfigError(
            f"{option} takes {form}, such as 3 1 {'40deg' if dimension == 2 else '0 0 0 40deg'}, got "
            f"{brief(' '.join(words))}."
        )
    pose = [_number(word, option, index >= dimension) for index, word in enumerate(numbers)]
    if dimension == 3 and len(pose) == 3:
        pose += [0.0, 0.0, 0.0]
    names = _RATES[dimension]
    velocities: dict[str, float] = {}
    for word in words:
        name, equals, text = word.partition("=")
        if not equals:
            continue
        if name not in names or name in velocities:
            raise ConfigError(
                f"{option} takes each of {', '.join(names)} once after the pose, got {brief(word)}."
            )
        velocities[name] = _number(text, option, False)
    return WrittenState(tuple(pose), velocities)


def read_zones(words: Sequence[str], dimension: int) -> list[tuple[float, ...]]:
    """Keep-out zones of words such as "1.5,0.2,0.4": the centre's coordinates and the radius of each, m.

    Raises:
        ConfigError: a word has another number of numbers, or one is not finite.
    """
    words = [word for word in words if word]
    zones = [tuple(_number(text, "--zones", False) for text in word.split(",")) for word in words]
    for word, zone in zip(words, zones, strict=True):
        if len(zone) != dimension + 1:
            form = "x,y,r" if dimension == 2 else "x,y,z,r"
            example = "1.5,0.2,0.4" if dimension == 2 else "1.5,0.2,0,0.4"
            raise ConfigError(
                f"--zones takes {form} of each zone, m, such as {example}, got {brief(word)}."
            )
    return zones


class WrittenEndpoints(Endpoints):
    """Start and goal as a user writes them: words, each in place of a state.

    With a start alone the goal is the origin, at rest; with a goal alone the starts are sampled.
    """

    def applied(self, sampled: Scenario) -> Scenario:
        """Words become states of the sampled ones' kind, whose other values stay; see `Endpoints.applied`.

        Raises:
            ConfigError: see `read_state`.
        """
        example = next(each(sampled))
        start: Any = self.start
        goal: Any = self.goal
        # What is no word is a state already.
        if is_written(start):
            start = _stated(start, example.start, "--start")
            goal = () if goal is None else goal
        if goal == () or is_written(goal):
            goal = _stated(goal, example.goal, "--goal")
        return Endpoints(start, goal).applied(sampled)


def is_written(value: object) -> bool:
    """Whether a value is a list of words, of which there is at least one."""
    return (
        isinstance(value, list | tuple) and bool(value) and all(isinstance(x, str) for x in value)
    )


def _stated(words: Sequence[str], like: State, option: str) -> State:
    """The state of the words after an option; what they leave out is zero, the rest is as in ``like``.

    Raises:
        ConfigError: see `read_state`.
    """
    dimension = len(like.p.columns())
    pose, velocities = read_state(words, dimension, option)
    pose = pose or (0.0,) * (3 if dimension == 2 else 6)
    if dimension == 2:
        attitude = [math.radians(pose[2])]
    else:
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_euler("xyz", pose[3:], degrees=True)
        attitude = turn.as_quat(scalar_first=True).tolist()
    rates = [velocities.get(name, 0.0) for name in _RATES[dimension]]
    motion = unflatten(replace(like, notes=None, stores=()), [*pose[:dimension], *attitude, *rates])
    return replace(motion, notes=like.notes, stores=like.stores)


def _number(word: str, option: str, is_angle: bool) -> float:
    """A length in m, or an angle in degrees unless it ends in "rad"; other units are refused (`ConfigError`)."""
    unit = next((unit for unit in _UNITS if word.endswith(unit)), "")
    try:
        value = float(word.removesuffix(unit)) * _UNITS.get(unit, 1.0)
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST:
        units = ": lengths in m without a unit" + ", angles with deg or rad" * is_angle
        raise ConfigError(
            f"{option} takes finite numbers of at most {LARGEST:g}{units}, got {brief(word)}."
        )
    if unit and not is_angle:
        raise ConfigError(f"{option}: {brief(word)} is an angle where a length must be.")
    return value
