"""Impulse below which no flight docks at a port: through the mouth of its cone, by a cone program."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rans.extend import Scenario, Spacecraft, State, Timing
from rans_missions.convex import waypoints
from rans_missions.tasks import DockPort
from rans_missions.vectors import numbers

_SPANS = 20
"""Number of spans of an episode in which a craft may enter the cone of a port, or dock."""
_CAP = 0.5
"""Speed of flights that the spans bound, m/s; faster ones spend at least the mass times it."""


def least_to_dock(craft: Spacecraft, task: DockPort, one: Scenario, timing: Timing) -> float:
    """Impulse below which no flight docks at a port from a start at rest, N s; attitude and ball are left out.

    Before it docks, a flight enters the sphere of the cone's length around its apex through the cone's mouth.
    Spans of time are tried for both, and the least bound counts. A flight whose changes of velocity are less than
    `_CAP` is no faster than that, so that at the first check behind the mouth it is near it; for all others the
    bound is what such a change costs.
    """
    goal: Any = one.goal
    start: Any = one.start
    place = numbers(start.p)
    mouths, ports = port_waypoints(task, goal, timing)
    apex = numbers(goal.p) * (1.0 - task.cone_depth / task.standoff)
    if np.linalg.norm(place - apex) <= task.cone_length:
        ways = [[port] for port in ports]
    else:
        ways = [[mouths[k], port] for j, port in enumerate(ports) for k in range(j + 1)]
    least = min(waypoints.least_impulse_through(craft.mass, place, way) for way in ways)
    return min(least, craft.mass * _CAP)


def port_waypoints(
    task: DockPort, goal: State, timing: Timing
) -> tuple[list[waypoints.Waypoint], list[waypoints.Waypoint]]:
    """Parts of balls that contain the mouth of the cone, and the docked position, in every span of an episode.

    The mouth is as it is at the first check behind it, of a craft that is no faster than `_CAP`.

    Args:
        task: of which the settings count.
        goal: docked state at the start, of floats.
        timing: control period, checks and length of the episode.
    """
    period = timing.control_period
    rate = math.hypot(*(float(x) for x in goal.spin()))
    edges = np.linspace(0.0, period * timing.episode_steps, _SPANS + 1)
    half = 0.5 * (edges[1] - edges[0])
    late = (_CAP + rate * task.standoff) * period / timing.checks
    # The mouth is in a ball about the middle of its rim, and ahead of the rim's plane.
    narrow = task.cone_half_angle
    apex = task.standoff - task.cone_depth
    middle = apex + task.cone_length * math.cos(narrow)
    rim = task.cone_length * math.sin(narrow) + late + rate * middle * half
    turned = min(rate * half, math.pi - narrow)
    plane = apex * math.cos(turned) + task.cone_length * math.cos(narrow + turned) - late
    near = task.tolerances()["position"] + rate * task.standoff * half
    mouths = []
    ports = []
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        then: Any = task.later(goal, 0.5 * (first + last))
        place = numbers(then.p)
        out = place / np.linalg.norm(place)
        mouths.append(waypoints.Waypoint(first, last, middle * out, rim, out, middle - plane))
        ports.append(waypoints.Waypoint(first, last, place, near))
    return mouths, ports
