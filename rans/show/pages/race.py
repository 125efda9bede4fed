"""A replay inside a page: contestants fly from the same start, above their thrusters, at the same time."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rans.episode.flight import Flight
from rans.episode.outline import outline_values
from rans.evaluation.measure.metrics import arrival_times
from rans.model.dynamics import State
from rans.model.fields import Vec2, Vec3, leaves, map_leaves
from rans.model.spacecraft import Spacecraft
from rans.show.palette import series_style
from rans.tasks.shapes import Ball, Cone, GlideSlope

FRAMES = 300
"""Most instants of a flight in a page; longer flights skip some."""


class Track(NamedTuple):
    """One contestant's flight."""

    name: str
    flight: Flight
    episode: int
    """Number of the episode within the flight."""
    arrival: float
    """First time in the goal set, s; infinite if never."""
    colour: str = ""
    """"" for that of its place among the contestants."""


@dataclass(frozen=True)
class Race:
    """Flights that the page's script replays, see `race`."""

    data: Mapping[str, Any]
    caption: str


def race(
    craft: Spacecraft,
    starts: Iterable[tuple[str, Sequence[Track]]],
    caption: str = "",
    plays: bool = False,
) -> Race:
    """Flights by start, as plain values for a page.

    Args:
        craft: what flies; its thrusters are drawn.
        starts: of each a label, and the flights that begin there.
        caption: what readers see, before how a replay is read.
        plays: whether it plays by itself, again and again.

    Returns:
        Positions in W (m), two axes of B in W, and commands as digits from 0 (shut) to 9 (open); for tasks that are
        nowhere also velocities (m/s). Numbers have three decimals.
    """
    results = [_start(label, tracks, craft) for label, tracks in starts]
    strips = (
        "Strips have a row a thruster, filled while it is open; thruster-seconds are their sum."
    )
    turns = "Drag to turn the view." if craft.dimension == 3 else ""
    said = " ".join(filter(None, (caption, strips, turns)))
    return Race(outline_values(craft, 3) | {"starts": results, "plays": plays}, said)


def has_place(flight: Flight) -> bool:
    """Whether the task of a flight is somewhere: it has a position to go to, or points to see."""
    return "position" in flight.errors() or bool(flight.task.markers(flight.goals))


def median_and_slowest(flight: Flight, name: str) -> Race | None:
    """The median episode of a flight and its slowest ones; None for tasks that are nowhere."""
    if not has_place(flight):
        return None
    times = arrival_times(flight)
    if flight.done is not None and flight.lengths is not None:
        # Missions that are won between two commands are never there at one.
        ends = np.asarray(flight.lengths) * flight.timing.control_period
        times = np.where(np.asarray(flight.done) & np.isinf(times), ends, times)

    def track(k: int) -> list[Track]:
        return [Track(name, flight, k, float(times[k]))]

    return gallery(flight.craft, f"episode of {name}", times, track, range(len(times)), 3)


def gallery(
    craft: Spacecraft,
    what: str,
    times: np.ndarray,
    tracks: Callable[[int], Sequence[Track]],
    typical: Collection[int],
    slow: int,
    caption: str = "",
) -> Race:
    """The median of some starts, then the slowest of all.

    Args:
        craft: what flies.
        what: what a start is, and of whom the times are, as in "episode of LQR".
        times: when its flights are there, (N,) s; infinite: never.
        tracks: what flies from a start.
        typical: numbers of the starts whose median is chosen.
        slow: number of slow starts.
        caption: what readers see besides.
    """
    ranking = [int(k) for k in np.argsort(times, kind="stable")]
    middle = [k for k in ranking if k in typical]
    chosen = dict.fromkeys([middle[(len(middle) - 1) // 2], *ranking[: -slow - 1 : -1]])
    starts = []
    for k in chosen:
        when = f"{times[k]:.1f} s" if np.isfinite(times[k]) else "never within all tolerances"
        starts.append((f"{what.split()[0]} {k}: {when}", tracks(k)))
    first = f"The median {what}, then its slowest." if len(starts) > 1 else ""
    return race(craft, starts, " ".join(filter(None, (first, caption))))


def _start(label: str, tracks: Sequence[Track], craft: Spacecraft) -> dict[str, Any]:
    """Data of one start for race.js: goal, scenery, and motion (W, SI) and valves of every contestant."""
    first = tracks[0]
    period = first.flight.timing.control_period
    steps = max(len(track.flight.commands) for track in tracks)
    stride = math.ceil(steps / FRAMES)
    follows = not has_place(first.flight)
    goals = _motion(first, first.flight.goals, stride, follows)
    if all(row == rows[0] for rows in goals.values() for row in rows):
        goals = {name: rows[:1] for name, rows in goals.items()}
    aims = first.flight.task.errors(first.flight.states, first.flight.goals)
    return {
        "label": label,
        "period": stride * period,
        "goal": goals,
        "turned": "attitude" in aims,
        "follows": follows,
        **_scenery(first, stride),
        "tracks": [
            {
                "name": track.name,
                "colour": track.colour or series_style(k)[0],
                "arrival": track.arrival if math.isfinite(track.arrival) else None,
                "u": _levels(track, stride, craft.thruster_count),
                **_motion(track, track.flight.states, stride, follows),
            }
            for k, track in enumerate(tracks)
        ],
    }


def _kept(track: Track, field: Any, stride: int) -> np.ndarray:
    """A field of states or goals at every kept instant: (T, N), or the same at all instants, (N,) or a number."""
    values = np.asarray(field)
    if values.ndim == 2:
        return values[::stride, track.episode]
    instants = len(track.flight.commands) // stride + 1
    return np.full(instants, values[track.episode] if values.ndim else values)


def _motion(track: Track, states: State, stride: int, moves: bool) -> dict[str, list[list[float]]]:
    """Positions (W, m), the first two axes of B, and velocities where asked for, at every ``stride``-th instant."""

    def of_episode(field: Any) -> np.ndarray:
        return _kept(track, field, stride)

    attitude: Any = states.attitude
    planar = isinstance(states.p, Vec2)
    axes = (
        (Vec2(1.0, 0.0), Vec2(0.0, 1.0)) if planar else (Vec3(1.0, 0.0, 0.0), Vec3(0.0, 1.0, 0.0))
    )
    position = np.stack([of_episode(x) for x in states.p.columns()], axis=1)
    rotated = [
        np.stack([of_episode(x) for x in attitude.rotate(axis).columns()], 1) for axis in axes
    ]
    result = {
        "p": [_rounded(row) for row in position],
        "e": [_rounded(row) for row in np.concatenate(rotated, axis=1)],
    }
    if moves:
        velocity = np.stack([of_episode(x) for x in states.v.columns()], axis=1)
        result["v"] = [_rounded(row) for row in velocity]
    return result


def _scenery(track: Track, stride: int) -> dict[str, Any]:
    """Zones, cones and slopes of a flight's task at every kept instant, or once if they stand still; its markers.

    Of a shape its class, and its numbers in the order of its fields. Of a marker its place, m, and the number of
    the first kept instant at which the mission has dealt with it, -1: never.

    The script of race.html.j2 draws it by these keys.
    """
    flight = track.flight
    goals = map_leaves(lambda field: _kept(track, field, stride), flight.goals)
    count = len(next(iter(leaves(goals))))
    shapes = []
    for shape in flight.task.scenery(goals):
        if isinstance(shape, Ball | Cone | GlideSlope):
            columns = [np.broadcast_to(np.asarray(x, dtype=float), count) for x in leaves(shape)]
            rows = [_rounded(row) for row in np.stack(columns, axis=1)]
            still = all(row == rows[0] for row in rows)
            shapes.append({"kind": type(shape).__name__, "rows": rows[:1] if still else rows})
    markers = []
    for position, is_done in flight.task.markers(goals):
        done = np.broadcast_to(np.asarray(is_done, dtype=bool), count)
        corner = [np.broadcast_to(np.asarray(x, dtype=float), count)[0] for x in position.columns()]
        markers.append([*_rounded(corner), int(np.argmax(done)) if done.any() else -1])
    return {"shapes": shapes, "markers": markers}


def _levels(track: Track, stride: int, thrusters: int) -> list[str]:
    """A text a kept control period: a digit a thruster, its mean command in ninths."""
    commands = np.asarray(track.flight.commands)[:, track.episode, :thrusters]
    parts = (commands[k : k + stride].mean(axis=0) for k in range(0, len(commands), stride))
    return ["".join(str(round(9.0 * min(max(x, 0.0), 1.0))) for x in part) for part in parts]


def _rounded(numbers: Iterable[float]) -> list[float]:
    return [round(float(x), 3) + 0.0 for x in numbers]
