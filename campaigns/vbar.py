"""Scenarios and suites of V-BAR, scored by V-BAR: ``python -m campaigns V-BAR``.

Transfers and flights along axes are RANS's guidance; far transfers, ellipse and departure are laws of this script.
The network of `campaigns.vbar_agent` flies the scenarios that lead to a point or a port.

V-BAR (J. Hammoudeh, "Verified Benchmark for Autonomous Rendezvous", 2026) needs Python 3.12 or later, and is no
dependency of RANS::

    make setup PYTHON=python3.12
    .venv/bin/pip install vbar==0.3.1
    .venv/bin/python -m campaigns V-BAR --docs docs

V-BAR flies: its environments, starts, sensors and constraints, and its composite score. Guidance receives what
V-BAR's interface gives to every agent: the public description of the scenario, and readings.
"""

from __future__ import annotations

import importlib
import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from itertools import groupby, product
from typing import Any, Literal

import numpy as np
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.control.navigation_filter import NavigationFilter
from rans_missions.guidance.along_axis import AlongAxis
from rans_missions.orbits.reach import velocity_to_reach
from rans_missions.tasks.dock import Dock
from rans_missions.tasks.hold import Hold
from rans_missions.tasks.orbital import OrbitalMission

from campaigns.parts import in_parts
from rans.model.drift import ClohessyWiltshire
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec2, Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.shapes import Shape, SpeedLimit

NAV1 = (1.0, 1e-3)
"""Standard deviations of the readings of V-BAR's track nav1, m and m/s."""
_FAR = 1000.0
"""Distance from a hold point from which coasts of most of an orbit are compared, m."""
_PART_OF_TIME = 0.75
"""Part of an episode in which these coasts must end."""
AVERAGED = 5200.0
"""Time of an episode until which readings with noise are averaged before a port, s: at the contact 500 s later the
best estimate is off by more than the port's 0.1 m in one of 2,000 episodes, which last 6,000 s."""
_DURATIONS = (2200.0, 1800.0, 1400.0, 1000.0)
"""Durations of transfers to a port, s, the cheapest first."""
_JOB = 4
"""Number of episodes that a process flies together."""
Array = np.ndarray
Route = Iterator[Any]
"""Legs, of which the next begins when one is over."""


@dataclass(frozen=True)
class Scored:
    """Fly V-BAR's episodes, and keep what V-BAR says of them."""

    split: Literal["validation", "train"] = "validation"
    """Which of V-BAR's public lists of episodes."""
    episodes: int = 50
    """Number of episodes of each scenario, the first ones of the list. V-BAR's suites have 50."""
    contestants: tuple[str, ...] = ("rans", "network", "pd")
    """Guidance, the network of `campaigns.vbar_agent`, and V-BAR's own controller."""
    workers: int | None = None
    """Number of processes; None: one per processor."""
    only: tuple[str, ...] = ()
    """Scenarios to fly, such as docking:nav1; the others keep their figures. By default all."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """A row of each scenario."""
        suites: Any = importlib.import_module("vbar.scenarios.suites")
        entries = {
            entry.scenario: suite.id for suite in suites.SUITES.values() for entry in suite.entries
        }
        entries["docking-afrl"] = "in no suite"
        names = [name for name in entries if not self.only or name in self.only]
        together = dict.fromkeys(product(names, self.contestants), _JOB)
        parts = in_parts(scored, together, self.episodes, self.workers, self.split)
        for name, flown in groupby(parts, key=lambda one: one[0][0]):
            # None: it flies no such scenario.
            found = {
                who: None if None in own else _together([one for part in own for one in part or ()])
                for (_, who), own in flown
            }
            about = {"scenario": name, "suite": entries[name], "vbar": version("vbar")}
            yield {**about, "episodes": self.episodes, **found}


def scored(
    _: None, row: tuple[str, str], first: int, number: int, split: str
) -> list[dict[str, Any]] | None:
    """What V-BAR says of so many episodes of a scenario by a contestant, from the first one on; a job of a worker.

    Returns:
        One of each episode; None: the network or V-BAR's controller does not fly this scenario.
    """
    name, who = row
    metrics: Any = importlib.import_module("vbar.metrics")
    composite: Any = importlib.import_module("vbar.metrics.composite")
    scenarios: Any = importlib.import_module("vbar.scenarios")
    seeds: Any = importlib.import_module("vbar.scenarios.seeds")
    agents: Any = importlib.import_module("vbar.agents")
    ours: Any = importlib.import_module("campaigns.vbar_agent")
    _search_less()
    agent = {"rans": Guidance, "network": ours.Agent, "pd": agents.PDAgent}[who]()
    environment = scenarios.make(name)
    episodes = []
    for seed, own in seeds.SeedSplit(name, split, first + number).pairs()[first:]:
        try:
            episode = metrics.record_episode(environment, agent, seed, own)
        except ValueError:
            if who != "rans":
                return None
            raise
        inner = environment.unwrapped
        least = inner.min_margins
        mission = metrics.mission.mission_metrics(episode)
        # V-BAR judges coverage and departure in the environment, and not in this metric.
        mission["success"] = bool(inner._success())
        scores = composite.composite_metrics(episode, mission=mission)
        episodes.append(
            {
                "succeeded": mission["success"],
                "broken": sorted(one for one in episode.hard if least[one] < 0.0),
                "soft": sorted(one for one in set(least) - episode.hard if least[one] < 0.0),
                "composite": float(scores["composite_score"]),
                "spent": float(inner.dv_l2),
                "time": float(inner.t),
            }
        )
    return episodes


def _together(episodes: list[dict[str, Any]]) -> dict[str, Any]:
    """Scores of an agent over the episodes of a scenario."""
    soft = Counter(one for episode in episodes for one in episode["soft"])
    spent = [episode["spent"] for episode in episodes]
    return {
        "episodes": len(episodes),
        "succeeded": sum(episode["succeeded"] for episode in episodes),
        "broken": sum(bool(episode["broken"]) for episode in episodes),
        "limits": sorted({one for episode in episodes for one in episode["broken"]}),
        "soft": dict(sorted(soft.items())),
        "composite": float(np.mean([episode["composite"] for episode in episodes])),
        "spent": float(np.mean(spent)),
        "worst": float(np.max(spent)),
        "time": float(np.mean([episode["time"] for episode in episodes])),
    }


@cache
def _search_less() -> None:
    """Leave out V-BAR's search for the least margin over a segment where V-BAR's own bound is above zero already.

    The search takes nine tenths of the time. Whether a limit is broken is the same.
    """
    base: Any = importlib.import_module("vbar.scenarios.base")
    whole = base.segment_minimum

    class Coarse:
        """A constraint whose bound is never refined."""

        resolution = math.inf

        def __init__(self, constraint: Any) -> None:
            self._constraint = constraint

        def __getattr__(self, name: str) -> Any:
            return getattr(self._constraint, name)

    def least(constraint: Any, *segment: Any) -> Any:
        result = whole(Coarse(constraint), *segment)
        return result if result.lower_bound > 0.0 else whole(constraint, *segment)

    base.segment_minimum = least


def cells(evidence: Any) -> Iterator[dict[str, Any]]:
    """Rows of the table."""
    for row in evidence["rows"]:
        own = row["rans"]
        soft = ", ".join(f"{one.replace('_', ' ')} {count}" for one, count in own["soft"].items())
        yield {
            **row,
            "soft": soft or "-",
            "peer": _told(row.get("pd"), ""),
            "agent": _told(row["network"], ", {spent:.2f} of {episodes}"),
        }


def _told(scores: dict[str, Any] | None, more: str) -> str:
    """Cell of the scores of a contestant."""
    text = "{succeeded}, {broken}, {composite:.2f}" + more
    return "-" if scores is None else text.format(**scores)


class Guidance:
    """An agent of V-BAR that flies every task by the legs that `route` names, from an estimate of the state."""

    name = "rans"

    def reset(self, view: Any, rng: np.random.Generator | None = None) -> None:
        """Begin an episode."""
        self._view = view
        self._legs: Route | None = None
        self._filter: NavigationFilter | None = None
        if ":nav1" in view.scenario_id:
            drift = ClohessyWiltshire(view.n)
            self._filter = NavigationFilter(drift, 3, view.dt, *NAV1, 0.0)

    def act(self, obs: Array, info: Any) -> Array:
        """Three numbers from -1 to 1 for the relative state that V-BAR observes, m and m/s."""
        state = np.array(obs[:6], float)
        if self._filter is not None:
            state = self._filter.read(state[None])[0][0]
        time = float(info["time_s"])
        if self._legs is None:
            self._legs = self.route(self._view, state)
            self._leg = next(self._legs)
        while self._leg.over(state, time):
            self._leg = next(self._legs)
        change = self._leg.change(state, time)
        command = np.clip(change / (self._view.max_accel * self._view.dt), -1.0, 1.0)
        # Windows in which V-BAR shuts every thruster, s.
        shut = self._view.goal.get("thrust_inhibit", ())
        if any(start - 1e-6 <= time < end - 1e-6 for start, end in shut):
            command = np.zeros(3)
        if self._filter is not None:
            self._filter.burn(command[None] * self._view.max_accel * self._view.dt)
        return command

    def route(self, view: Any, start: Array) -> Route:
        """The legs of a scenario, from what V-BAR says of it publicly and the state at the start."""
        limits = {one["type"]: one for one in view.constraints}
        routes = {
            "hold": _to_hold,
            "dock": _to_port,
            "berth": _to_box,
            "inspect": _around,
            "depart": _away,
        }
        return routes[view.goal["task"]](view, limits, start)


class Leg(ABC):
    """Part of a route: what velocity to change by in the next period, and whether it is over."""

    def over(self, state: Array, time: float) -> bool:
        """Whether the next leg begins."""
        return False

    @abstractmethod
    def change(self, state: Array, time: float) -> Array:
        """Change of velocity in the Hill frame in the next control period, m/s."""


@dataclass
class Coast(Leg):
    """Coast until a time, s."""

    until: float

    def over(self, state: Array, time: float) -> bool:
        """See `Leg`."""
        return time > self.until - 1e-6

    def change(self, state: Array, time: float) -> Array:
        """See `Leg`."""
        return np.zeros(3)


class Transfer(Leg):
    """Mission guidance (`rans.MissionGuidance`) to a point at rest; over within the tolerances or at its deadline.

    Args:
        view: what V-BAR says of the scenario.
        mission: the mission, with its tolerances and limits.
        point: where to, m.
        seconds: by when it plans to arrive after the leg begins, s.
    """

    def __init__(self, view: Any, mission: OrbitalMission, point: Array, seconds: float) -> None:
        timing = replace(Hold.timing, control_period=view.dt)
        self._guidance = MissionGuidance(load_spacecraft("vbar-chaser"), mission, timing)
        self._mission = mission
        self._goal_state = _state(np.concatenate([point, np.zeros(3)]))
        self._point = np.asarray(point, float)
        self._seconds = seconds
        self._per_command = view.max_accel * view.dt
        self._dt = view.dt
        self._goal: Any = None

    def over(self, state: Array, time: float) -> bool:
        """See `Leg`."""
        away = np.linalg.norm(state[:3] - self._point)
        fast = np.linalg.norm(state[3:])
        near = away < self._mission.position_tolerance and fast < self._mission.velocity_tolerance
        return bool(
            near or (self._goal is not None and self._goal.notes.deadline[0] < -0.5 * self._dt)
        )

    def change(self, state: Array, time: float) -> Array:
        """See `Leg`."""
        own = _state(state)
        if self._goal is None:
            self._guidance.reset(1)
            self._goal = self._mission.plan(own, self._goal_state, np.full(1, self._seconds))
        commands = self._guidance.act(own, self._goal, np.zeros((1, 0)))[0]
        self._goal = self._mission.later(self._goal, self._dt)
        # Thrusters are along x, -x, y, -y, z, -z.
        return (commands[0::2] - commands[1::2]) * self._per_command


@dataclass(frozen=True)
class Standoff(Hold):
    """The mission `hold` below a speed limit that increases with the distance from the target."""

    speed_base: float = 1.0
    """Speed limit at the target, m/s."""
    speed_slope: float = 1.0
    """Increase of the speed limit per metre, 1/s."""

    def limits(self, goal: Any) -> dict[str, Shape]:
        """The keep-out ball, and the speed limit."""
        speed = SpeedLimit(goal.p.scale(0.0), self.speed_base, self.speed_slope)
        return {**super().limits(goal), "speed": speed}


def _hold(view: Any, keep_out: float, tolerance: tuple[float, float]) -> Hold:
    """The mission `hold` with a ball in m, tolerances in m and m/s, and a scenario's speed limit if it has one."""
    limit = next((one for one in view.constraints if one["type"] == "speed_limit"), None)
    # A little below it: readings have errors, and burns last for a period.
    extra = {}
    if limit is not None:
        extra = {"speed_base": limit["v0"] - 0.02, "speed_slope": 0.95 * limit["v1"]}
    return (Hold if limit is None else Standoff)(
        mean_motion=view.n,
        deadline=(600.0, 2200.0),
        keep_out=keep_out,
        position_tolerance=tolerance[0],
        velocity_tolerance=tolerance[1],
        shortest_aim=view.dt,
        braking_time=view.dt,
        fail_distance=1e6,
        **extra,
    )


@dataclass
class Arrive(Leg):
    """Two impulses to a state by the time with the least of both, replanned every period, then coast."""

    view: Any
    """What V-BAR says of the scenario."""
    goals: Callable[[float, float], Array]
    """State (6,) to arrive in, at a time and after a duration, s."""
    durations: Array
    """Durations that are compared, s."""
    keep_out: float
    """Least distance of the coast from the target, m."""
    dead: float = 0.0
    """Correction below which it coasts on, m/s."""

    def __post_init__(self) -> None:
        self._drift = ClohessyWiltshire(self.view.n)
        self._end: float | None = None
        self._arrived = False

    def over(self, state: Array, time: float) -> bool:
        """See `Leg`."""
        return self._arrived

    def change(self, state: Array, time: float) -> Array:
        """See `Leg`."""
        if self._end is None:
            prices = [self._price(state, time, float(d)) for d in self.durations]
            self._end = time + float(self.durations[int(np.argmin(prices))])
            self._goal = self.goals(time, self._end - time)
        left = self._end - time
        if left < 0.5 * self.view.dt:
            # The burn at the end goes on in the next periods if one is too short for it.
            _, goal = self._drift.carry(Vec3(*self._goal[:3]), Vec3(*self._goal[3:]), -left)
            gain = np.array(goal.columns(), float) - state[3:]
            self._arrived = bool(np.abs(gain).max() <= self.view.max_accel * self.view.dt)
            return gain
        gain = self._velocity(state, self._goal, left) - state[3:]
        # Corrections wait while they are small against the time that is left.
        if np.linalg.norm(gain) < self.dead and left > 10 * self.view.dt:
            return np.zeros(3)
        return gain

    def _velocity(self, state: Array, goal: Array, left: float) -> Array:
        """Velocity with which a coast reaches the goal, m/s; across the orbit in its last half only."""
        n = self.view.n
        in_plane = velocity_to_reach(self._drift, Vec2(*state[:2]), Vec2(*goal[:2]), left)
        across = state[5]
        if n * left < 0.45 * 2.0 * math.pi:
            across = (goal[2] - state[2] * math.cos(n * left)) * n / math.sin(n * left)
        return np.array([in_plane.x, in_plane.y, across])

    def _price(self, state: Array, time: float, duration: float) -> float:
        """Both changes of velocity, m/s; infinite through the keep-out ball."""
        goal = self.goals(time, duration)
        velocity = self._velocity(state, goal, duration)
        times = np.linspace(0.0, duration, 200)
        p, _ = self._drift.carry(Vec3(*state[:3]), Vec3(*velocity), times)
        least = np.sqrt(sum(np.asarray(x) ** 2 for x in p.columns())).min()
        if least < self.keep_out:
            return math.inf
        _, arriving = self._drift.carry(Vec3(*state[:3]), Vec3(*velocity), duration)
        last = np.array(arriving.columns(), float)
        return float(np.abs(velocity - state[3:]).sum() + np.abs(goal[3:] - last).sum())


@dataclass
class Track(Leg):
    """`AlongAxis` for one craft: toward the origin or away from it, at a speed for each distance."""

    view: Any
    """What V-BAR says of the scenario."""
    origin: Callable[[float], Array]
    """Origin of the axis at a time, m."""
    axis: Callable[[float], Array]
    """Unit axis at a time."""
    speed: Callable[[float], float]
    """Closing speed for a distance in m, m/s."""
    end: float = -math.inf
    """Distance at which it stops, m; -inf: it goes on through the origin."""
    waits: float = -math.inf
    """Distance at which it waits while `free` says no, m."""
    free: Callable[[float], bool] = lambda time: True
    """Whether it may go on at a time."""
    leaves: float = math.inf
    """Distance from which the leg is over, m."""
    distance: float | None = None
    """Where on the axis it begins, m; None: where the craft is."""
    until: float = math.inf
    """The leg is over at this time, s."""

    def __post_init__(self) -> None:
        self._law = AlongAxis(self.view.n, self.view.dt)
        self._law.reset(self.distance)

    def over(self, state: Array, time: float) -> bool:
        """See `Leg`."""
        along = (state[:3] - self.origin(time)) @ self.axis(time)
        return bool(along > self.leaves) or time > self.until - 1e-6

    def change(self, state: Array, time: float) -> Array:
        """See `Leg`."""
        distance = self._law.distance
        if distance is None:
            distance = np.array([(state[:3] - self.origin(time)) @ self.axis(time)])
        held = distance[0] >= self.waits and not self.free(time)
        return self._law.change(
            state[None],
            lambda later: (self.origin(time + later)[None], self.axis(time + later)[None]),
            lambda far: np.array([self.speed(float(far[0]))]),
            self.waits if held else self.end,
        )[0]


def _to_hold(view: Any, limits: Any, start: Array) -> Route:
    """To a hold point, and stay."""
    goal = view.goal
    point = np.array(goal["hold_point"], float)
    ball = limits.get("keep_out", {}).get("radius", 0.0)
    if "zone_entry" in limits:
        yield Coast(limits["zone_entry"]["go_time"])
    away = float(np.linalg.norm(start[:3] - point))
    if "approach_cone" in limits:
        yield _into_cone(view, limits, point)
    elif not ball:
        # The mission of V-BAR's source and of `dock`: the same speed limit.
        limit = limits["speed_limit"]
        dock = Dock(mean_motion=view.n, deadline=(600.0, 2500.0), fail_distance=1e6)
        assert math.isclose(limit["v0"], dock.velocity_tolerance)
        yield Transfer(view, dock, point, 2000.0)
    elif away > _FAR:
        # Coasts of most of an orbit are cheaper than those of mission guidance, which end before half of one.
        period = 2.0 * math.pi / view.n
        latest = min(0.9 * period, _PART_OF_TIME * view.max_steps * view.dt)
        goals = np.concatenate([point, np.zeros(3)])
        yield Arrive(view, lambda t, d: goals, np.arange(1000.0, latest, 100.0), 1.2 * ball)
    elif away > 2.0 * goal["capture_radius"]:
        tolerance = (goal["capture_radius"], goal["capture_speed"])
        beside = min(1.4 * ball, float(np.linalg.norm(point)) - 3.0 * tolerance[0])
        yield Transfer(view, _hold(view, beside, tolerance), point, 1900.0)
    yield _rest(view, point)


def _rest(view: Any, point: Array, until: float = math.inf) -> Leg:
    """Stay at a point until a time, s."""
    axis = np.array([1.0, 0.0, 0.0])
    return Track(
        view, lambda time: point, lambda time: axis, lambda s: 0.0, distance=0.0, until=until
    )


def _into_cone(view: Any, limits: Any, point: Array) -> Leg:
    """To a hold point that is inside a turning cone for a part of each turn.

    It waits outside the range in which the cone counts, goes in as soon as the leading edge allows, and follows
    this edge to the hold point, where it can stay for the rest of the time in which the cone passes.
    """
    goal, cone, target = view.goal, limits["approach_cone"], view.goal["target"]
    gates = limits["gate_table"]["gates"]
    end = float(np.linalg.norm(point))
    outside = cone["active_range"] + 1.3
    half_angle = math.degrees(cone["half_angle"])
    lead = half_angle - 1.5
    # From where it waits to the tolerance at 2 cm/s, braking, and the time to hold, before the cone has passed.
    needed = (outside - end - goal["capture_radius"]) / 0.02 + 40.0 + goal["hold_time"]
    last = math.degrees(abs(target["rate"])) * needed - half_angle

    def turn(time: float) -> float:
        """Angle from the hold point to the cone's axis, degrees from -180 to 180."""
        angle = math.degrees(target["phase"] + target["rate"] * time)
        return (angle + 180.0) % 360.0 - 180.0

    def axis(time: float) -> Array:
        # Along the edge that comes first, from beside the hold point, where it waits for the cone.
        edge = [0.0, lead, lead + 11.5, lead + 40.0, lead + 80.0]
        ahead = float(np.interp(turn(time), edge, [0, 0, 11.5, 11.5, 0]))
        return turned(point / end, math.radians(ahead))

    return Track(
        view,
        lambda time: np.zeros(3),
        axis,
        lambda s: min(gate(gates, s), 0.02 if s < outside + 1.0 else 1.0, 0.02 * (s - end)),
        end=end,
        waits=outside,
        free=lambda time: last < turn(time) < lead + 11.5,
    )


def gate(gates: Any, distance: float) -> float:
    """Closing speed that is a little below the one that a table of gates allows, m/s."""
    ranges, speeds = np.array(sorted(gates)).T
    return 0.9 * float(np.interp(distance, ranges, speeds))


def _to_port(view: Any, limits: Any, start: Array) -> Route:
    """To a point on the axis of a port outside its corridor, and along the axis into the port."""
    port = Port(view, limits)
    if np.linalg.norm(start[:3] - port.origin(0.0)) >= port.corridor:
        arrival = AVERAGED if ":nav1" in view.scenario_id else 2500.0
        reach = port.arm + port.corridor + 1.0
        point = port.origin(arrival) + port.axis(arrival) * (reach + 8.0)
        seconds = in_time(port.free, view.max_steps * view.dt)
        yield Transfer(view, _hold(view, reach, (2.0, 0.04)), point, seconds)
        # It waits for a port that turns, and for readings to average; the light may pass meanwhile.
        if arrival > 2500.0 or port.rate:
            yield _rest(view, point, arrival)
    yield Track(view, port.origin, port.axis, port.speed, waits=port.waits, free=port.free)


class Port:
    """A port of a scenario, which turns with an inertially pointing target.

    Args:
        view: what V-BAR says of the scenario.
        limits: its limits by their types.
    """

    def __init__(self, view: Any, limits: Any) -> None:
        goal = view.goal
        self._place, self._outwards = (
            np.array(goal[name], float) for name in ("port", "port_axis")
        )
        self.rate = goal["target"].get("rate", 0.0)
        """Rate of the turn about z, rad/s."""
        self.arm = float(np.linalg.norm(self._place))
        """Distance from the target's centre, m."""
        self.corridor = limits["approach_cone"]["active_range"]
        """Length of the corridor, m."""
        self.waits, self.free = _light(limits)
        self._window = goal.get("axial_speed_window", (0.0, 0.0))
        self._gates = limits.get("gate_table")

    def origin(self, time: float) -> Array:
        """Position of the port at a time, m."""
        return turned(self._place, self.rate * time)

    def axis(self, time: float) -> Array:
        """Unit vector out of the port at a time."""
        return turned(self._outwards, self.rate * time)

    def speed(self, distance: float) -> float:
        """Closing speed at a distance from the port, m/s."""
        low, high = self._window
        fastest = min(0.5 * (low + high) + 0.0025 * max(distance, 0.0), 0.2)
        if self._gates is None:
            return fastest
        allowed = gate(self._gates["gates"], distance + self.arm)
        # The mechanism asks for more than the last gate allows.
        return max(min(fastest, allowed), low + 0.15 * (high - low))


def _light(limits: Any) -> tuple[float, Callable[[float], bool]]:
    """Distance at which a craft waits for the light, m, and whether it may go on at a time."""
    if "lighting_window" not in limits:
        return -math.inf, lambda time: True
    targets: Any = importlib.import_module("vbar.scenarios.targets")
    light = {k: v for k, v in limits["lighting_window"].items() if k != "type"}
    window = targets.LightingWindow(**light)
    # The way from where it waits to the contact takes less than all these times.
    ahead = np.arange(0.0, 260.0, 5.0)

    def free(time: float) -> bool:
        return bool(np.min(window.window_margin(time + ahead)) > 0.02)

    return light["active_range"] + 1.5, free


def in_time(free: Callable[[float], bool], end: float) -> float:
    """Duration of a transfer, s: so slow that it is cheap, and so fast that the light comes after it, if it can.

    Args:
        free: whether the craft may go on at a time from where it waits, which is 350 s behind the transfer.
        end: time at which an episode ends, s.
    """
    last = max((t for t in np.arange(0.0, end - 300.0, 10.0) if free(t)), default=end)
    return next((x for x in _DURATIONS if x + 350.0 < last), _DURATIONS[0])


def _to_box(view: Any, limits: Any, start: Array) -> Route:
    """Along the axis of the corridor into the box."""
    box = np.array(view.goal["hold_point"], float)
    out = box / np.linalg.norm(box)
    # Slower than the box asks for from its edge on, so that the thrusters shut on a craft at rest.
    yield Track(
        view, lambda time: box, lambda time: out, lambda s: min(0.01 * max(s, 0.0), 0.06), 0.0
    )


def _around(view: Any, limits: Any, start: Array) -> Route:
    """Onto an ellipse that goes around the target as the Sun does, on the Sun's side, and coast."""
    n = view.n
    sun = view.goal["sun_direction"]
    first = math.atan2(sun[1], sun[0])
    radius = 0.45 * view.goal["max_range"]

    def ellipse(time: float, duration: float) -> Array:
        angle = first - n * (time + duration)
        c, s = math.cos(angle), math.sin(angle)
        return np.array([radius * c, 2 * radius * s, 0.0, n * radius * s, -2 * n * radius * c, 0.0])

    ball = limits["keep_out"]["radius"]
    yield Arrive(view, ellipse, np.arange(300.0, 2500.0, 50.0), 2.0 * ball)
    yield Coast(math.inf)


def _away(view: Any, limits: Any, start: Array) -> Route:
    """Out of the corridor along its axis, and onto an orbit below the target's, which leads away for ever."""
    port = Port(view, limits)
    yield Track(
        view,
        port.origin,
        port.axis,
        lambda s: -min(0.06 + 0.002 * s, 0.25),
        leaves=port.corridor + 3.0,
    )
    below = 100.0
    clear = math.hypot(below, 1.05 * view.goal["clear_range"])
    there = np.array([-below, clear, 0.0, 0.0, 1.5 * view.n * below, 0.0])
    yield Arrive(view, lambda t, d: there, np.arange(600.0, 2500.0, 50.0), 60.0)
    yield Coast(math.inf)


def turned(vector: Array, angle: float) -> Array:
    """A vector turned about z by an angle, rad."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]])


def _state(row: Array) -> SpatialState:
    """One craft at a position and velocity, (6,), without rotation."""
    zero = np.zeros(1)
    still = Vec3(zero, zero, zero)
    place, speed = (Vec3(*(zero + float(x) for x in half)) for half in (row[:3], row[3:]))
    return SpatialState(place, Quat(zero + 1.0, zero, zero, zero), speed, still)
