"""Flights near a target on an orbit as messages of the Consultative Committee for Space Data Systems (CCSDS).

An Orbit Ephemeris Message (OEM) has positions and velocities, an Attitude Ephemeris Message (AEM) attitudes, and
an Orbit Parameter Message (OPM) one state. They are in the keyword notation (KVN), in km and km/s in an inertial
frame; missions fly in the target's Hill frame.

Sources: CCSDS 502.0-B-3, "Orbit Data Messages", 2023, and CCSDS 504.0-B-1, "Attitude Data Messages", 2008,
whose version 1 of AEM more programs read than version 2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rans.errors import ConfigError, checked
from rans.files import read_text, write_text
from rans.flight import Flight
from rans.model.drift import EARTH, ClohessyWiltshire
from rans.model.fields import Quat, map_leaves
from rans.tasks import Task

FRAME = "EME2000"
"""Inertial frame of messages: x towards the vernal equinox, z along the Earth's axis, at J2000."""
_ECCENTRICITY = 0.01
"""Eccentricity above which an orbit does not count as circular: Clohessy-Wiltshire's equations are then as wrong as
at a distance of a hundredth of the radius."""
_STATE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")


class Orbit(NamedTuple):
    """Circular orbit of a target around the Earth in the frame `FRAME`."""

    mean_motion: float
    """Mean motion n, rad/s."""
    inclination: float = 0.0
    """Inclination, rad."""
    node: float = 0.0
    """Right ascension of the ascending node, rad."""
    latitude: float = 0.0
    """Argument of latitude at the start of the flight, rad."""

    def axes(self, times: np.ndarray) -> np.ndarray:
        """Rotation matrices (T, 3, 3) whose columns are the axes of the Hill frame in the inertial one."""
        angle = self.latitude + self.mean_motion * np.asarray(times, dtype=float)
        c, s = np.cos(self.node), np.sin(self.node)
        node = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        c, s = np.cos(self.inclination), np.sin(self.inclination)
        plane = node @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        axes = np.zeros((len(angle), 3, 3))
        axes[:, 0, 0] = axes[:, 1, 1] = np.cos(angle)
        axes[:, 1, 0] = np.sin(angle)
        axes[:, 0, 1] = -np.sin(angle)
        axes[:, 2, 2] = 1.0
        return plane @ axes

    def attitude(self, times: np.ndarray) -> Quat:
        """Attitude of the Hill frame in the inertial one, of arrays (T,)."""
        zero = np.zeros(len(times))
        angle = 0.5 * (self.latitude + self.mean_motion * np.asarray(times, dtype=float))
        node, inclination = zero + 0.5 * self.node, zero + 0.5 * self.inclination
        about_node = Quat(np.cos(node), zero, zero, np.sin(node))
        about_line = Quat(np.cos(inclination), np.sin(inclination), zero, zero)
        return about_node.times(about_line).times(Quat(np.cos(angle), zero, zero, np.sin(angle)))

    @property
    def radius(self) -> float:
        """Radius, m."""
        return (EARTH / self.mean_motion**2) ** (1.0 / 3.0)

    def inertial(
        self, times: np.ndarray, p: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Inertial positions and velocities (T, 3) of points of the Hill frame, m and m/s.

        Args:
            times: (T,) since the start of the flight, s.
            p: (T, 3) positions in the Hill frame, m.
            v: (T, 3) velocities relative to it, m/s.
        """
        axes = self.axes(times)
        from_centre = p + np.array([self.radius, 0.0, 0.0])
        moving = v + np.cross([0.0, 0.0, self.mean_motion], from_centre)
        return np.einsum("tij,tj->ti", axes, from_centre), np.einsum("tij,tj->ti", axes, moving)


@dataclass(frozen=True)
class OrbitState:
    """State of an OPM."""

    name: str
    """Name of the object."""
    frame: str
    """Reference frame."""
    epoch: datetime
    """Instant, UTC."""
    p: np.ndarray
    """Position, (3,) m."""
    v: np.ndarray
    """Velocity, (3,) m/s."""


def is_on_orbit(task: Task, dimension: int) -> bool:
    """Whether a task is a mission in space near a target on a circular orbit."""
    return isinstance(task.drift, ClohessyWiltshire) and dimension == 3


def orbit_of(
    task: Task, dimension: int, inclination: float = 0.0, node: float = 0.0, latitude: float = 0.0
) -> Orbit:
    """Orbit of the target of a task that is flown in so many dimensions, with angles in degrees.

    Raises:
        ConfigError: the task is not one in space near a target on an orbit.
    """
    drift = task.drift
    if not isinstance(drift, ClohessyWiltshire) or dimension != 3:
        raise ConfigError(
            f"CCSDS messages are of missions in space on a circular orbit, such as hold, and "
            f"{type(task).__name__} is not one."
        )
    return Orbit(drift.mean_motion, *map(math.radians, (inclination, node, latitude)))


def write_ccsds(
    flight: Flight,
    folder: str | Path,
    episode: int = 0,
    epoch: str = "2026-01-01T00:00:00",
    inclination: float = 0.0,
    node: float = 0.0,
    latitude: float = 0.0,
) -> tuple[Path, Path, Path]:
    """Write one episode as CCSDS messages: OEM of the craft and of its target, and AEM of the craft.

    The missions have a circular orbit with a radius, but no orientation and no epoch, so these are arguments.
    Attitudes are those relative to the Hill frame, which turns with the target.

    >>> import tempfile
    >>> starts = rans.scenario.scenarios(rans.Hold(), rans.load_spacecraft("vbar-chaser"), 7, 1)
    >>> timing = rans.Timing(control_period=10.0, episode_steps=5)
    >>> controller = rans.MissionGuidance("vbar-chaser", "hold")
    >>> flight = rans.fly("vbar-chaser", "hold", controller, starts, timing)
    >>> [file.name for file in rans.write_ccsds(flight, tempfile.mkdtemp(), inclination=51.6)]
    ['episode-0.oem', 'episode-0-target.oem', 'episode-0.aem']

    Args:
        flight: flights of a mission on an orbit, in space.
        folder: folder of the files.
        episode: number of the episode.
        epoch: instant of the start, UTC, as ISO 8601 writes it.
        inclination: of the orbit, degrees.
        node: right ascension of its ascending node, degrees.
        latitude: argument of latitude of the target at the start, degrees.

    Raises:
        ConfigError: the flight is of another kind, there is no such episode, the epoch is none, or the files cannot
            be written.
    """
    checked("flight", flight, Flight)
    orbit = orbit_of(flight.task, flight.craft.dimension, inclination, node, latitude)
    count = flight.commands.shape[1]
    if not 0 <= episode < count:
        raise ConfigError(f"the flight has episodes 0 to {count - 1}, got {episode}.")
    # States up to the end of the episode, in the Hill frame.
    start = _instant(epoch, "epoch")
    steps = len(flight.commands) if flight.lengths is None else int(flight.lengths[episode])
    times = flight.times[: steps + 1]
    columns = [*flight.states.p.columns(), *flight.states.v.columns()]
    states = np.stack([x[: steps + 1, episode] for x in columns], axis=1)
    if not np.isfinite(states).all():
        raise ConfigError(
            f"episode {episode} has a state that is not finite: it was lost in flight."
        )
    instants = [_text(start + timedelta(seconds=float(t))) for t in times]
    target = np.zeros((len(times), 3))
    # Ephemerides of craft and target in the inertial frame, km and km/s.
    folder = Path(folder)
    names = (f"episode-{episode}{suffix}" for suffix in (".oem", "-target.oem", ".aem"))
    of_craft, of_target, of_attitude = (folder / name for name in names)
    for file, name, motion in (
        (of_craft, flight.craft.name, (states[:, :3], states[:, 3:])),
        (of_target, f"target of {flight.craft.name}", (target, target)),
    ):
        p, v = orbit.inertial(times, *motion)
        rows = [
            f"{instant} {' '.join(f'{x:.9f}' for x in 1e-3 * a)} {' '.join(f'{x:.12f}' for x in 1e-3 * b)}"
            for instant, a, b in zip(instants, p, v, strict=True)
        ]
        meta = {"CENTER_NAME": "EARTH", "REF_FRAME": FRAME, "TIME_SYSTEM": "UTC"}
        write_text(file, _message("CCSDS_OEM_VERS", "3.0", name, meta, instants, rows))
    # Attitude: that of the Hill frame, then that of the craft in it; the scalar is last.
    attitude = orbit.attitude(times).times(
        map_leaves(lambda x: x[: steps + 1, episode], flight.states.attitude)
    )
    quaternions = np.stack([attitude.x, attitude.y, attitude.z, attitude.w], axis=1)
    rows = [
        f"{instant} {' '.join(f'{x:.12f}' for x in q)}"
        for instant, q in zip(instants, quaternions, strict=True)
    ]
    meta = {
        "CENTER_NAME": "EARTH",
        "REF_FRAME_A": FRAME,
        "REF_FRAME_B": "SC_BODY_1",
        "ATTITUDE_DIR": "A2B",
        "TIME_SYSTEM": "UTC",
    }
    last = {"ATTITUDE_TYPE": "QUATERNION", "QUATERNION_TYPE": "LAST"}
    text = _message("CCSDS_AEM_VERS", "1.0", flight.craft.name, meta, instants, rows, last)
    write_text(of_attitude, text)
    return of_craft, of_target, of_attitude


def read_opm(file: str | Path) -> OrbitState:
    """Read the state of an Orbit Parameter Message in the keyword notation.

    >>> message = "CCSDS_OPM_VERS = 3.0, OBJECT_NAME = iss, CENTER_NAME = EARTH, REF_FRAME = EME2000"
    >>> message += ", TIME_SYSTEM = UTC, EPOCH = 2026-01-01T00:00:00, X = 6800.0, Y = 0.0, Z = 0.0"
    >>> message += ", X_DOT = 0.0, Y_DOT = 4.7, Z_DOT = 6.0"
    >>> file = tempfile.mkdtemp() + "/iss.opm"
    >>> with open(file, "w") as lines:
    ...     _ = lines.write(message.replace(", ", chr(10)))
    >>> rans.read_opm(file).v.tolist()
    [0.0, 4700.0, 6000.0]

    Raises:
        ConfigError: the file is no such message, or a number of its state is missing.
    """
    file = Path(file)
    fields: dict[str, str] = {}
    for line in read_text(file).splitlines():
        key, equals, value = line.partition("=")
        if equals and not key.strip().startswith("COMMENT"):
            fields.setdefault(key.strip(), value.split("[")[0].strip())
    if "CCSDS_OPM_VERS" not in fields:
        raise ConfigError(
            f"{file} is no Orbit Parameter Message in the keyword notation: it has no line CCSDS_OPM_VERS = ..."
        )
    if (centre := fields.get("CENTER_NAME", "")).upper() != "EARTH":
        raise ConfigError(f"CENTER_NAME of {file} must be EARTH, got {centre!r}.")
    if (system := fields.get("TIME_SYSTEM", "")).upper() != "UTC":
        raise ConfigError(f"TIME_SYSTEM of {file} must be UTC, got {system!r}.")
    try:
        numbers = np.array([float(fields[key]) for key in _STATE])
    except (KeyError, ValueError) as error:
        raise ConfigError(f"{file} must have numbers for {', '.join(_STATE)}; {error}.") from None
    if not np.isfinite(numbers).all():
        raise ConfigError(f"the state of {file} must be finite, got {numbers.tolist()}.")
    epoch = _instant(fields.get("EPOCH", ""), f"EPOCH of {file}")
    name, frame = fields.get("OBJECT_NAME", ""), fields.get("REF_FRAME", "")
    return OrbitState(name, frame, epoch, 1e3 * numbers[:3], 1e3 * numbers[3:])


def relative_state(target: OrbitState, craft: OrbitState) -> tuple[float, np.ndarray, np.ndarray]:
    """State of a craft in the Hill frame of a target, as missions on an orbit start from it.

    >>> from dataclasses import replace
    >>> from datetime import datetime
    >>> import numpy as np
    >>> from rans.ccsds import OrbitState
    >>> p, v = np.array([7e6, 0.0, 0.0]), np.array([0.0, 7546.053, 0.0])
    >>> target = OrbitState("target", "EME2000", datetime(2026, 1, 1), p, v)
    >>> n, p, v = rans.relative_state(target, replace(target, p=np.array([7000100.0, 0.0, 0.0])))
    >>> p.tolist(), f"{n:.6f}"
    ([100.0, 0.0, 0.0], '0.001078')

    Args:
        target: target, on an orbit that is nearly circular.
        craft: craft near it, at the same instant and in the same inertial frame.

    Returns:
        Mean motion n of the target, rad/s, and position, m, and velocity, m/s, of the craft in the Hill frame.

    Raises:
        ConfigError: both have different instants or frames, or the orbit's eccentricity exceeds 0.01.
    """
    for name, state in (("target", target), ("craft", craft)):
        checked(name, state, OrbitState)
    if target.epoch != craft.epoch or target.frame != craft.frame:
        raise ConfigError(
            f"target and craft must have one epoch and frame, got {target.epoch} in {target.frame} and "
            f"{craft.epoch} in {craft.frame}."
        )
    r, v = target.p, target.v
    momentum = np.cross(r, v)
    radius = float(np.linalg.norm(r))
    eccentricity = float(np.linalg.norm(np.cross(v, momentum) / EARTH - r / radius))
    if not eccentricity <= _ECCENTRICITY:
        raise ConfigError(
            f"the target's eccentricity must be at most {_ECCENTRICITY:g}, got {eccentricity:.3g}: missions fly "
            "near a circular orbit."
        )
    across = momentum / np.linalg.norm(momentum)
    axes = np.stack([r / radius, np.cross(across, r / radius), across])
    rate = momentum / radius**2
    offset = craft.p - r
    semi_major = 1.0 / (2.0 / radius - v @ v / EARTH)
    n = math.sqrt(EARTH / semi_major**3)
    return n, axes @ offset, axes @ (craft.v - v - np.cross(rate, offset))


def _message(
    key: str,
    version: str,
    name: str,
    meta: dict[str, str],
    instants: list[str],
    rows: list[str],
    last: dict[str, str] | None = None,
) -> str:
    """An ephemeris message with one segment."""
    header = {key: version, "CREATION_DATE": _text(datetime.now(UTC)), "ORIGINATOR": "RANS"}
    segment = {
        "OBJECT_NAME": name,
        "OBJECT_ID": "UNKNOWN",
        **meta,
        "START_TIME": instants[0],
        "STOP_TIME": instants[-1],
        **(last or {}),
    }
    data = ["DATA_START", *rows, "DATA_STOP"] if last else rows
    lines = [f"{k} = {v}" for k, v in header.items()]
    lines += ["", "META_START", *(f"{k} = {v}" for k, v in segment.items()), "META_STOP", "", *data]
    return "\n".join(lines) + "\n"


def _instant(text: str, what: str) -> datetime:
    """An instant from ISO 8601, calendar or day of the year, UTC."""
    value = text.removesuffix("Z")
    for form in (
        "%Y-%m-%dT%H:%M:%S.%f",
        "%Y-%m-%dT%H:%M:%S",
        "%Y-%jT%H:%M:%S.%f",
        "%Y-%jT%H:%M:%S",
    ):
        try:
            return datetime.strptime(value, form).replace(tzinfo=UTC)
        except ValueError:
            continue
    raise ConfigError(f"{what} must be an instant such as 2026-01-01T00:00:00, got {text!r}.")


def _text(instant: datetime) -> str:
    return instant.strftime("%Y-%m-%dT%H:%M:%S.%f")
