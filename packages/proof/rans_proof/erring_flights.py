"""Flights with the errors that a certificate of poses allows: craft, readings, and valves that are late one by one.

Half of all errors are at an end of what is allowed, the others anywhere between.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rans.extend import Body, Heading, LoadedRun, PlanarState, Spacecraft, Vec2, advance
from rans.extend import observation as observed
from rans.model.dynamics import wrench

_NODES = 2
"""Nodes of the quadrature over the delay of a valve, in which a craft hardly turns."""


def between(random: np.random.Generator, largest: float, shape: Any, least: float = 0.0) -> Any:
    """Random numbers from ``least`` to ``largest``, half of which are ends."""
    part = np.clip(random.uniform(-0.5, 1.5, shape), 0.0, 1.0)
    return least + part * (largest - least)


def erring_body(craft: Spacecraft, off: Mapping[str, float], random: Any, count: int) -> Body:
    """Bodies of a number of flights: mass and inertia off by one factor, and all thrusts by another one."""
    body = Body.of(craft)
    mass, thrust = (1.0 + between(random, off[x], count, -off[x]) for x in ("mass", "thrust"))
    inertia = tuple(moment * mass for moment in body.inertia)
    return replace(body, mass=body.mass * mass, inertia=inertia, gain=(thrust,) * len(body.gain))


class Misread:
    """An agent that reads states with errors, at each decision anew.

    Args:
        run: the agent and its task.
        off: largest error of ``position`` (m) and ``velocity`` (m/s) in any direction, ``heading`` (rad) and
            ``spin`` (rad/s).
        random: source of the errors.
    """

    observes = False

    def __init__(
        self, run: LoadedRun, off: Mapping[str, float], random: np.random.Generator
    ) -> None:
        self.name = run.controller.name
        self._run = run
        self._off = off
        self._random = random

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._run.controller.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) to a reading that is off by errors drawn anew; the observation is made of it.

        The random numbers of a decision come in the order position, velocity, heading, spin.
        """
        count = len(state.w)

        def error(name: str) -> np.ndarray:
            return between(self._random, self._off[name], count, -self._off[name])

        def aside(name: str) -> Vec2:
            angle = self._random.uniform(0.0, 2.0 * np.pi, count)
            size = between(self._random, self._off[name], count)
            return Vec2(size * np.cos(angle), size * np.sin(angle))

        read = replace(
            state,
            p=state.p + aside("position"),
            v=state.v + aside("velocity"),
            attitude=Heading(state.attitude.angle + error("heading")),
            w=state.w + error("spin"),
        )
        columns = observed(self._run.task, read, goal)
        table = np.stack(np.broadcast_arrays(*columns), axis=1).astype(np.float32)
        return self._run.controller.act(read, goal, table)


class LateValves:
    """Mover whose valves open and shut late, each by itself and each time anew, by the engine's equations.

    Args:
        craft: craft of on/off thrusters in the plane.
        period: control period, s.
        opening: largest delay to open, s.
        shutting: largest delay to shut, s.
        random: source of the delays.
    """

    engine = "late valves"

    def __init__(
        self,
        craft: Spacecraft,
        period: float,
        opening: float,
        shutting: float,
        random: np.random.Generator,
    ) -> None:
        self._craft, self._period = craft, period
        self._opening, self._shutting = opening, shutting
        self._random = random
        self._before: np.ndarray | None = None
        self.coasting: list[PlanarState] = []
        """At each decision the states from which the craft would coast as it does once valves before have shut."""

    def __call__(self, state: Any, step_inputs: Any) -> tuple[Any, ...]:
        """State after a period in which every valve is late by itself; remembers commands, and appends what coasts.

        See `rans.episode.Mover`.
        """
        now = np.stack(np.broadcast_arrays(*step_inputs.commands[0]), axis=0) > 0.5
        before = np.zeros_like(now) if self._before is None else self._before
        self._before = now
        # One instant a valve: it opens there, or shuts there, or does not move.
        late = np.where(now, self._opening, self._shutting)
        instants = np.where(now == before, 0.0, between(self._random, 1.0, now.shape) * late)
        order = np.sort(np.vstack((np.zeros_like(instants[:1]), instants)), axis=0)
        body = step_inputs.body
        # What valves before let through without those of now: from where it leaves the craft, it coasts back.
        tail = self._through(state, before & ~now, np.zeros_like(now), instants, order, body)
        self.coasting.append(
            replace(
                tail,
                p=tail.p + tail.v.scale(-order[-1]),
                attitude=Heading(tail.attitude.angle - order[-1] * tail.w),
            )
        )
        state = self._through(state, before, now, instants, order, body)
        opened = wrench(self._craft, tuple(now.astype(float)), body)
        return (advance(state, opened, body, self._period - order[-1]).normalised(),)

    def _through(
        self, state: Any, before: Any, now: Any, instants: Any, order: Any, body: Body
    ) -> Any:
        """State when the last valve has moved, from valves ``before`` to valves ``now``, each at its instant.

        Instants (N, thrusters) are s after the decision; ``order`` has 0 and then these, sorted.
        """
        for first, last in itertools.pairwise(order):
            if (last > first).any():
                opened = np.where(instants > first, before, now).astype(float)
                push = wrench(self._craft, tuple(opened), body)
                state = advance(state, push, body, last - first, nodes=_NODES)
        return state
