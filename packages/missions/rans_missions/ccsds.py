"""Flights near a target on an orbit as messages of the Consultative Committee for Space Data Systems (CCSDS).

An Orbit Ephemeris Message (OEM) has positions and velocities, and an Orbit Parameter Message (OPM) one state. They
are in the keyword notation (KVN), in km and km/s in an inertial frame; missions fly in the target's Hill frame.

Source: CCSDS 502.0-B-3, "Orbit Data Messages", 2023.
"""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from rans import RansWarning
from rans.base.errors import finite, one_line
from rans.extend import (
    ClohessyWiltshire,
    ConfigError,
    Flight,
    brief,
    checked,
    counted,
    read_text,
    ready_folder,
    whole,
    write_text,
)
from rans_missions.orbits.earth import EARTH

FRAME = "EME2000"
"""Inertial frame of messages: x towards the vernal equinox, z along the Earth's axis, at J2000."""
_ECCENTRICITY = 0.01
"""Eccentricity above which an orbit does not count as circular: Clohessy-Wiltshire's equations are then as wrong as
at a distance of a hundredth of the radius."""
_STATE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")
_LEAPS = (
    "1972-07 1973-01 1974-01 1975-01 1976-01 1977-01 1978-01 1979-01 1980-01 1981-07 1982-07 1983-07 1985-07 "
    "1988-01 1990-01 1991-01 1992-07 1993-07 1994-07 1996-01 1997-07 1999-01 2006-01 2009-01 2012-07 2015-07 "
    "2017-01"
)
"""Months before whose first day UTC had a leap second, up to 2026 (IERS, Bulletin C)."""


@dataclass(frozen=True)
class OrbitState:
    """State of an OPM, or the first one of an OEM."""

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


def write_ccsds(
    flight: Flight,
    folder: str | Path,
    episode: int = 0,
    epoch: str | datetime = "2026-01-01T00:00:00",
    inclination: float = 0.0,
    node: float = 0.0,
    latitude: float = 0.0,
) -> tuple[Path, Path]:
    """Write one episode as CCSDS messages: OEM of the craft and of its target.

    The missions have a circular orbit with a radius, but no orientation and no epoch, so these are arguments.

    >>> import tempfile
    >>> starts = rans.scenarios(rans.Hold(), rans.load_spacecraft("vbar-chaser"), 7, 1)
    >>> timing = rans.Timing(control_period=10.0, episode_steps=5)
    >>> controller = rans.MissionGuidance("vbar-chaser", "hold")
    >>> flight = rans.fly("vbar-chaser", "hold", controller, starts, timing)
    >>> [file.name for file in rans.write_ccsds(flight, tempfile.mkdtemp(), inclination=51.6)]
    ['episode-0.oem', 'episode-0-target.oem']

    Args:
        flight: flights of a mission on an orbit, in space.
        folder: folder of the files.
        episode: number of the episode.
        epoch: instant of the start, UTC, as ISO 8601 writes it, or a `datetime`, of UTC without a time zone.
        inclination: of the orbit, degrees.
        node: right ascension of its ascending node, degrees.
        latitude: argument of latitude of the target at the start, degrees.

    Raises:
        ConfigError: the flight is of another kind or has a leap second, there is no such episode, the epoch is
            none, an angle is no finite number, or the files cannot be written.
    """
    checked("flight", flight, Flight)
    drift = flight.task.drift
    if not isinstance(drift, ClohessyWiltshire) or flight.craft.dimension != 3:
        raise ConfigError(
            f"CCSDS messages are of missions in space on a circular orbit, such as hold, and "
            f"{type(flight.task).__name__} is not one."
        )
    count = flight.commands.shape[1]
    orientation = [
        finite(f"{name}, degrees,", angle)
        for name, angle in (("node", node), ("inclination", inclination), ("latitude", latitude))
    ]
    if (episode := whole("episode", episode, 0)) >= count:
        raise ConfigError(f"the flight has episodes 0 to {count - 1}, got {episode}.")
    # States up to the end of the episode, in the Hill frame.
    start = _instant(epoch, "epoch")
    steps = len(flight.commands) if flight.lengths is None else int(flight.lengths[episode])
    times = flight.times[: steps + 1]
    try:
        instants = [start + timedelta(seconds=float(t)) for t in times]
    except OverflowError:
        raise ConfigError(
            f"the flight begins at the epoch {start:%Y-%m-%d} and ends after the year 9999, the last one."
        ) from None
    for month in _LEAPS.split():
        if instants[0] < _instant(f"{month}-01T00:00", "") <= instants[-1]:
            raise ConfigError(
                f"UTC has a leap second before {month}-01, which instants of CCSDS count and this flight does not: "
                "choose another epoch."
            )
    columns = [*flight.states.p.columns(), *flight.states.v.columns()]
    states = np.stack([x[: steps + 1, episode] for x in columns], axis=1)
    if not np.isfinite(states).all():
        raise ConfigError(
            f"episode {episode} has a state that is not finite: it was lost in flight."
        )
    target = np.zeros((len(times), 3))
    # Axes of the Hill frame in the inertial one, its rate and its centre.
    n = drift.mean_motion
    angles = np.broadcast_to(np.radians(orientation), (len(times), 3)).copy()
    angles[:, 2] += n * times
    axes = Rotation.from_euler("ZXZ", angles)
    rate = np.array([0.0, 0.0, n])
    centre = np.array([np.cbrt(EARTH / n**2), 0.0, 0.0])
    # Ephemerides of craft and target in the inertial frame, km and km/s.
    folder = ready_folder(folder)
    of_craft, of_target = (folder / f"episode-{episode}{end}" for end in (".oem", "-target.oem"))
    for file, name, motion in (
        (of_craft, flight.craft.name, (states[:, :3], states[:, 3:])),
        (of_target, f"target of {flight.craft.name}", (target, target)),
    ):
        p = axes.apply(motion[0] + centre)
        v = axes.apply(motion[1] + np.cross(rate, motion[0] + centre))
        rows = [
            f"{_text(instant)} {' '.join(f'{x:.9f}' for x in 1e-3 * a)} {' '.join(f'{x:.12f}' for x in 1e-3 * b)}"
            for instant, a, b in zip(instants, p, v, strict=True)
        ]
        lines = [  # of printable ASCII (CCSDS 502.0-B-3, section 7.4)
            "CCSDS_OEM_VERS = 3.0",
            f"CREATION_DATE = {_text(datetime.now(UTC))}",
            "ORIGINATOR = RANS",
            "",
            "META_START",
            f"OBJECT_NAME = {re.sub(r'[^ -~]', '_', name)}",
            "OBJECT_ID = UNKNOWN",
            "CENTER_NAME = EARTH",
            f"REF_FRAME = {FRAME}",
            "TIME_SYSTEM = UTC",
            f"START_TIME = {_text(instants[0])}",
            f"STOP_TIME = {_text(instants[-1])}",
            "META_STOP",
            "",
            *rows,
        ]
        write_text(file, "\n".join(lines) + "\n")
    return of_craft, of_target


def read_opm(file: str | Path) -> OrbitState:
    """Read the state of an Orbit Parameter Message in the keyword notation, around the Earth, in UTC.

    Of an Orbit Ephemeris Message (OEM) it is the first state, whose numbers are km and km/s.

    Units in brackets are converted, and are km and km/s without one. Covariances, Keplerian elements and properties
    of the spacecraft are not read.

    >>> message = "CCSDS_OPM_VERS = 3.0, OBJECT_NAME = iss, CENTER_NAME = EARTH, REF_FRAME = EME2000"
    >>> message += ", TIME_SYSTEM = UTC, EPOCH = 2026-01-01T00:00:00, X = 6800.0, Y = 0.0, Z = 0.0"
    >>> message += ", X_DOT = 0.0, Y_DOT = 4.7, Z_DOT = 6.0"
    >>> file = tempfile.mkdtemp() + "/iss.opm"
    >>> with open(file, "w") as lines:
    ...     _ = lines.write(message.replace(", ", chr(10)))
    >>> rans.read_opm(file).v.tolist()
    [0.0, 4700.0, 6000.0]

    Raises:
        ConfigError: the file is no such message, its frame is not inertial, or a number of its state is missing or
            in another unit.
    """
    file = Path(file)
    text = read_text(file, _LARGEST, "the message ")
    fields = _keywords(text, file)
    for key, expected in (("CENTER_NAME", "EARTH"), ("TIME_SYSTEM", "UTC")):
        if fields.get(key, "").upper() != expected:
            raise ConfigError(
                f"{key} of {file} must be {expected}, got {brief(fields.get(key, ''))}."
            )
    frame = fields.get("REF_FRAME", "")
    _check_frame(frame, f"REF_FRAME of {file}")
    if "REF_FRAME_EPOCH" in fields:
        frame = f"{frame} at {fields['REF_FRAME_EPOCH']}"
    state = np.array([_quantity(fields, key, file) for key in _STATE])
    p, v = state[:3], state[3:]
    radius = float(np.linalg.norm(p))
    if not _NEAREST <= radius <= _FARTHEST:
        raise ConfigError(
            f"the position of {file} must be {_NEAREST / 1e3:,.0f} to {_FARTHEST / 1e3:,.0f} km from the Earth's "
            f"centre, got {radius / 1e3:,.6g} km: the usual cause are other units, which stand in brackets after a "
            "number, as [m]."
        )
    speed = float(np.linalg.norm(v))
    if not speed <= _FASTEST:
        raise ConfigError(
            f"the speed of {file} must be at most {_FASTEST / 1e3:g} km/s, as of every orbit around the Earth, got "
            f"{speed / 1e3:,.6g} km/s: the usual cause are numbers in m/s, which take [m/s] behind them."
        )
    if burns := len(re.findall(r"^\s*MAN_EPOCH_IGNITION", text, re.MULTILINE)):
        warnings.warn(
            f"{file} has {counted(burns, 'manoeuvre')}, which RANS does not read: the state is that before them.",
            RansWarning,
            stacklevel=2,
        )
    epoch = _instant(fields.get("EPOCH", ""), f"EPOCH of {file}")
    name = fields.get("OBJECT_NAME", "")
    if name:
        one_line(f"OBJECT_NAME of {file}", name)
    return OrbitState(name, frame, epoch, p, v)


_LARGEST = 2**20
"""Bytes of a message: an ephemeris of a fortnight, a state every four minutes, has 600,000."""
_NEAREST = 6.35e6
"""Least distance of a state from the Earth's centre, m: its radius at the poles is 6,357 km."""
_FARTHEST = 1.5e9
"""Greatest distance, m: that at which the Sun's attraction takes over (Hill's sphere)."""
_FASTEST = 12e3
"""Greatest speed, m/s: from the Earth's surface 11.2 km/s lead away from it for good."""
_INERTIAL = re.compile(
    r"EME2000|J2000|[GI]CRF[123]?|TEME(OFDATE|OFEPOCH)?|(TOD|MOD|TOE|MOE)(_EARTH)?", re.ASCII
)
"""Frames that do not turn with the Earth or an orbit: annex B of CCSDS 502.0-B-3, and SANA's registry of celestial
body reference frames. Those of date turn by precession, 8e-12 rad/s, which is below what orbits are read for."""
_UNITS = {
    False: {"km": 1e3, "m": 1.0},
    True: {"km/s": 1e3, "m/s": 1.0},
}
"""Units of positions (False) and velocities (True) in m and m/s."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([EeDd][+-]?\d{1,3})?", re.ASCII)
"""A number as KVN and Fortran write it."""


def _keywords(text: str, file: Path) -> dict[str, str]:
    """Values of an OPM, or of the first segment of an OEM and its first state, by the keywords of an OPM.

    Raises:
        ConfigError: a line has no keyword with a value and no state, a keyword stands twice, the version differs,
            or the message is of several objects.
    """
    fields: dict[str, str] = {}
    lines = list(enumerate((line.strip() for line in text.splitlines()), 1))
    lines = [(k, line) for k, line in lines if line and not re.match(r"COMMENT\b", line)]
    found = re.match("CCSDS_(OPM|OEM)_VERS", lines[0][1]) if lines else None
    if not found:
        raise ConfigError(
            f"{file} is no Orbit Parameter Message in the keyword notation: it does not begin with "
            "CCSDS_OPM_VERS = ..., and other notations, such as XML, are not read."
        )
    kind = found[1]
    names = {line.partition("=")[2].strip() for _, line in lines if line.startswith("OBJECT_NAME")}
    if len(names) > 1:
        raise ConfigError(
            f"{file} is of {counted(len(names), 'object')}, {', '.join(map(brief, sorted(names)))}: divide it, "
            "since one start has one."
        )
    for number, line in lines:
        key, equals, value = (part.strip() for part in line.partition("="))
        if kind == "OEM" and not equals:
            if line in ("META_START", "META_STOP"):
                continue
            # The first state of an ephemeris: nothing behind it is read.
            parts = line.split()
            if len(parts) not in (7, 10):
                raise ConfigError(
                    f"line {number} of {file} must be an epoch and six numbers, perhaps with three accelerations, "
                    f"got {brief(line)}."
                )
            fields.update(zip(("EPOCH", *_STATE), parts, strict=False))
            break
        if not equals:
            raise ConfigError(
                f"line {number} of {file} is no keyword of an {kind} with a value, got {brief(line)}."
            )
        if key in fields and not key.startswith("MAN_"):
            raise ConfigError(f"{key} stands twice in {file}, again in line {number}.")
        fields[key] = value
    version = fields.get(f"CCSDS_{kind}_VERS", "")
    if version not in ("1.0", "2.0", "3.0"):
        raise ConfigError(
            f"CCSDS_{kind}_VERS of {file} must be 1.0, 2.0 or 3.0, got {brief(version)}."
        )
    if kind == "OEM" and "EPOCH" not in fields:
        raise ConfigError(f"{file} is an OEM without a state.")
    return fields


def _quantity(fields: dict[str, str], key: str, file: Path) -> float:
    """Number of a keyword of the state in m or m/s; without a unit it is in km or km/s."""
    if key not in fields:
        raise ConfigError(f"{file} must have numbers for {', '.join(_STATE)}, got none for {key}.")
    known = _UNITS["DOT" in key]
    text, bracket, rest = fields[key].partition("[")
    unit = rest.removesuffix("]").strip() if bracket else next(iter(known))
    if unit not in known or (bracket and not rest.endswith("]")):
        raise ConfigError(
            f"{key} of {file} is in {brief(bracket + rest)}, and {' and '.join(known)} are read."
        )
    number = text.strip()
    value = float(re.sub("[Dd]", "e", number)) if _NUMBER.fullmatch(number) else math.nan
    if not math.isfinite(value):
        raise ConfigError(f"{key} of {file} must be a finite number, got {brief(number)}.")
    return known[unit] * value


def _check_frame(frame: str, what: str) -> None:
    """Refuse (`ConfigError`) a frame that is not known to be inertial."""
    if _INERTIAL.fullmatch(frame.upper().partition(" AT ")[0]):
        return
    raise ConfigError(
        f"{what} must be an inertial frame, such as EME2000, GCRF, ICRF, TEME or TOD, got {brief(frame)}: in "
        "one that turns with the Earth or the orbit a velocity is not that of the orbit."
    )


def relative_state(target: OrbitState, craft: OrbitState) -> tuple[float, np.ndarray, np.ndarray]:
    """State of a craft in the Hill frame of a target, as missions on an orbit start from it.

    >>> from dataclasses import replace
    >>> from datetime import datetime
    >>> import numpy as np
    >>> from rans_missions.ccsds import OrbitState
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
        ConfigError: both have different instants or frames, a frame is not known to be inertial, the orbit's
            eccentricity exceeds 0.01, or the craft is farther away than 0.01 of its radius.
    """
    for name, state in (("target", target), ("craft", craft)):
        checked(name, state, OrbitState)
        _check_frame(state.frame, f"the frame of the {name}")
    if target.epoch != craft.epoch or target.frame.upper() != craft.frame.upper():
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
    if not (distance := float(np.linalg.norm(offset))) <= _ECCENTRICITY * radius:
        raise ConfigError(
            f"the craft must be within {1e-3 * _ECCENTRICITY * radius:.4g} km of its target, a hundredth of the "
            f"radius, got {1e-3 * distance:.6g} km: missions fly by equations that are linear about the target."
        )
    semi_major = 1.0 / (2.0 / radius - v @ v / EARTH)
    n = math.sqrt(EARTH / semi_major**3)
    return n, axes @ offset, axes @ (craft.v - v - np.cross(rate, offset))


def _instant(given: object, what: str) -> datetime:
    """An instant of UTC to the microsecond, with the month and day or the day of the year.

    A `datetime` without a time zone is of UTC. Leap seconds, which it has not, are refused. Source: CCSDS
    301.0-B-4, codes A and B.
    """
    if isinstance(given, datetime):
        return given.astimezone(UTC) if given.tzinfo else given.replace(tzinfo=UTC)
    text = given if isinstance(given, str) else ""
    whole, _, decimals = text.strip().removesuffix("Z").partition(".")
    for date in ("%Y-%m-%d", "%Y-%j"):
        for time in ("T%H:%M:%S", "T%H:%M"):
            try:
                instant = datetime.strptime(whole, date + time).replace(tzinfo=UTC)
            except ValueError:
                continue
            if whole.startswith(str(instant.year)) and re.fullmatch("[0-9]*", decimals):
                return instant.replace(microsecond=int(f"{decimals:0<6}"[:6]))
    raise ConfigError(f"{what} must be an instant such as 2026-01-01T00:00:00, got {brief(given)}.")


def _text(instant: datetime) -> str:
    return instant.strftime("%Y-%m-%dT%H:%M:%S.%f")
