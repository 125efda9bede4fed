"""Attacks on the safety filter by gradients and by search: ``python -m campaigns.attack``.

- gradient: in every control period the commands of the next periods are optimized by gradients through the engine's
  step, so that the least margin of the constraints becomes as small as possible. The first command is flown.
- cem: the cross-entropy method searches the commands of whole flights behind the filter for the least margin. Every
  flight of the search counts.

Both fly from the same starts without and with the filter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
import tyro
from rans_missions.guard.ahead import Ahead
from rans_missions.guard.expected import Expected

from campaigns.command import ended
from campaigns.guard import MISSIONS, begun, noise_and_delay, setup_of
from rans.episode import Setup, World, step
from rans.errors import one_of
from rans.fast.stepping.step import Backend
from rans.files import number, read_json, write_json
from rans.model.fields import map_leaves, where
from rans.processes import Workers
from rans.randomization.conditions import (
    Conditions,
)
from rans.terminal import Terminal

_HORIZON = 10
"""Number of control periods whose commands are optimized by gradients: as many as a platform needs to stop."""
_ITERATIONS = 6
"""Number of steps of the gradient; they move commands by at most their whole range."""
_STEP = 0.35
"""Change of a command, from 0 to 1, in a step of the gradient."""
_POPULATION = 64
"""Number of flights that the cross-entropy method compares from each start."""
_ELITE = 8
"""Number of the best flights of a generation, from which the next one is drawn."""
_KNOTS = 16
"""Parts of a flight in which a command is constant, at most."""
_LEAST_CHANCE = 0.05
"""Bounds of the chance that a thruster is open, so that every generation tries something."""
Commands = Callable[[int, Any, Any], tuple[Any, ...]]
"""Commands in a control period, by its number, the state and the goal."""


class Counts(NamedTuple):
    """Flights of an attack from safe starts, and how many of them violated a constraint."""

    flights: int
    """Number of flights behind the filter."""
    unfiltered: int | None
    """Violations without the filter; None: none were flown."""
    filtered: int
    """Violations behind the filter."""
    least: float
    """Least margin behind the filter, m or m/s; infinite if no start was safe, a text in a record."""
    expected: int
    """Number of flights whose readings were never off by more than the reserve."""
    filtered_expected: int
    """Violations among these."""

    @classmethod
    def of(cls, unfiltered: Flights | None, filtered: Flights) -> Counts:
        """Counts of flights without the filter, if there are any, and behind it."""
        least = filtered.least[filtered.safe]
        expected = filtered.beyond[filtered.safe] <= 0.0
        return cls(
            len(least),
            None if unfiltered is None else int((unfiltered.least[unfiltered.safe] < 0.0).sum()),
            int((least < 0.0).sum()),
            float(least.min(initial=np.inf)),
            int(expected.sum()),
            int((least[expected] < 0.0).sum()),
        )

    @classmethod
    def together(cls, parts: list[Counts]) -> Counts:
        """Counts of several jobs."""
        flights, unfiltered, filtered, least, expected, filtered_expected = zip(*parts, strict=True)
        return cls(
            sum(flights),
            None if None in unfiltered else sum(unfiltered),
            sum(filtered),
            min(map(number, least)),
            sum(expected),
            sum(filtered_expected),
        )


class Flights(NamedTuple):
    """What became of N flights, arrays (N,)."""

    safe: np.ndarray
    """Whether the filter holds from the start."""
    least: np.ndarray
    """Least margin of all constraints until the end, m or m/s."""
    beyond: np.ndarray
    """Largest margin by which readings were too optimistic, less the filter's reserve, m or m/s; without conditions
    none is expected."""


@torch.no_grad()
def flown(
    setup: Setup, plan: Plan, numbers: np.ndarray, filtered: bool, commands: Commands
) -> Flights:
    """Fly the starts of these numbers, (N,), in single precision, with commands (thrusters of (N,))."""
    backend, world, draws, now, safe = begun(setup, filtered, numbers, plan.device, False)
    expected = Expected.of(setup)
    zero = now.state.p.columns()[0] * 0.0
    optimistic = zero - np.float32(1e30)
    finished = zero > 1.0
    least = zero + np.float32(1e30)
    for k in range(plan.steps(setup)):
        if setup.conditions is not None:
            beyond = expected.beyond(world, now.state, world.sensed(now, draws), now.goal)
            optimistic = where(~finished & (beyond > optimistic), beyond, optimistic)
        wanted = tuple(backend.put(x, torch.float32) for x in commands(k, now.state, now.goal))
        outcome = step(world, now, wanted, draws)
        now = outcome.episode
        for margin in outcome.margins.values():
            least = where(~finished & (margin < least), margin, least)
        finished = finished | outcome.terminated
        if bool(finished.all()):
            break
    return Flights(*(torch.as_tensor(x).cpu().numpy() for x in (safe, least, optimistic)))


class Plan(NamedTuple):
    """How flights are attacked."""

    device: str = "cpu"
    """Torch device of the flights."""
    periods: int | None = None
    """Number of control periods of a flight; None: the whole episode."""
    generations: int = 6
    """Number of generations of the cross-entropy method."""
    unfiltered: bool = True
    """Whether the attack is flown without the filter too."""

    @property
    def ways(self) -> tuple[bool, ...]:
        """Whether flights are filtered: first those that are not."""
        return (False, True) if self.unfiltered else (True,)

    def steps(self, setup: Setup) -> int:
        """Number of control periods of a flight."""
        return min(self.periods or setup.timing.episode_steps, setup.timing.episode_steps)


class GradientAttack:
    """Commands that reduce the least margin of the next control periods, by projected gradients.

    Args:
        setup: craft, task and timing; the attack knows the true state.
    """

    def __init__(self, setup: Setup) -> None:
        backend = Backend.of("cpu", torch.float32, None, plain=True)
        self._ahead = Ahead(World(Setup(*setup[:3]), backend.nodes))
        self._levels: torch.Tensor | None = None
        """(periods, thrusters, N)"""
        self._steady = setup.craft.is_continuous

    def __call__(self, k: int, state: Any, goal: Any) -> tuple[Any, ...]:
        """See `Commands`."""
        size = len(state.p.columns()[0])
        state, goal = map_leaves(lambda x: _tensor(x, size), (state, goal))
        count = len(self._ahead.world.craft.commands)
        if self._levels is None:
            generator = torch.Generator().manual_seed(0)
            self._levels = torch.rand((_HORIZON, count, size), generator=generator)
        else:
            # The plan goes on, with its last command once more.
            self._levels = torch.cat([self._levels[1:], self._levels[-1:]])
        levels = self._levels
        for _ in range(_ITERATIONS):
            levels = levels.detach().requires_grad_()
            with torch.enable_grad():
                self._least(state, goal, levels).sum().backward()
            assert levels.grad is not None
            levels = (levels - _STEP * levels.grad.sign()).clamp(0.0, 1.0)
        self._levels = levels.detach()
        first = self._levels[0].numpy()
        return tuple(first if self._steady else np.round(first))

    def _least(self, state: Any, goal: Any, levels: torch.Tensor) -> torch.Tensor:
        """Least margin (N,) while these commands are flown."""
        result: Any = None
        for command in levels.unbind():
            predicted = self._ahead.fly(state, goal, command.unbind())
            state, goal = predicted.state, predicted.goal
            result = predicted.least if result is None else torch.minimum(result, predicted.least)
        return result


def _tensor(x: Any, size: int) -> torch.Tensor:
    values = np.broadcast_to(np.asarray(x, np.float32), size)
    return torch.from_numpy(np.array(values))


def by_gradients(
    mission: str, conditions: Conditions | None, plan: Plan, first: int, count: int
) -> tuple[Flights, ...]:
    """Flights from so many starts, without the filter if the plan says so, and with it."""
    torch.set_num_threads(1)
    setup = setup_of(mission, conditions)
    numbers = np.arange(first, first + count)
    return tuple(
        flown(setup, plan, numbers, filtered, GradientAttack(setup)) for filtered in plan.ways
    )


def by_search(
    mission: str, conditions: Conditions | None, plan: Plan, first: int, count: int
) -> tuple[Flights, ...]:
    """Flights of all generations from so many starts, without the filter if the plan says so, and with it."""
    setup = setup_of(mission, conditions)
    period = -(-plan.steps(setup) // _KNOTS)
    numbers = np.repeat(np.arange(first, first + count), _POPULATION)
    thrusters = len(setup.craft.commands)
    result = []
    for filtered in plan.ways:
        random = np.random.default_rng(first)
        chances = np.full((_KNOTS, thrusters, count), 0.5)
        flights = []
        for _ in range(plan.generations):
            opened = random.random((_KNOTS, thrusters, count, _POPULATION)) < chances[..., None]
            levels = opened.reshape(_KNOTS, thrusters, -1).astype(np.float32)

            def commands(k: int, state: Any, goal: Any, levels: Any = levels) -> tuple[Any, ...]:
                return tuple(levels[k // period])

            flight = flown(setup, plan, numbers, filtered, commands)
            flights.append(flight)
            order = np.argsort(flight.least.reshape(count, _POPULATION), axis=1)[:, :_ELITE]
            elite = np.take_along_axis(opened, order[None, None], axis=3).mean(axis=3)
            chances = np.clip(elite, _LEAST_CHANCE, 1.0 - _LEAST_CHANCE)
            Terminal().say(
                f"  {mission}: {'filtered' if filtered else 'unfiltered'}, generation {len(flights)}: "
                f"{int((flight.least[flight.safe] < 0.0).sum())} of {int(flight.safe.sum())} violated, "
                f"least margin {flight.least[flight.safe].min():.5f}"
            )
        result.append(Flights(*(np.concatenate(x) for x in zip(*flights, strict=True))))
    return tuple(result)


ATTACKS = {"gradient": by_gradients, "cem": by_search}


def counted(_: int, attack: str, *job: Any) -> Counts:
    """Counts of an attack with these arguments; a job of a worker."""
    *unfiltered, filtered = ATTACKS[attack](*job)
    return Counts.of(unfiltered[0] if unfiltered else None, filtered)


@dataclass(frozen=True)
class Attack:
    """Attack the filter of missions, and print a row of each."""

    missions: tuple[str, ...] = ("avoid-2d", "dock-port-2d-atmos", "dock", "hold")
    """Names of the missions that are attacked, keys of `campaigns.guard.MISSIONS`."""
    attacks: tuple[str, ...] = tuple(ATTACKS)
    """gradient and cem."""
    starts: int = 256
    """Number of starts."""
    noise: tuple[float, float] = (0.0, 0.0)
    """Standard deviations of measured positions, m, and velocities, m/s, which the filter knows."""
    delay: float = 0.0
    """Time from a decision until the command arrives, in control periods, which the filter knows."""
    periods: int | None = None
    """Control periods of a flight; None: the whole episode."""
    generations: int = 6
    """Number of generations of the cross-entropy method."""
    device: str = "cpu"
    """Torch device: cpu or cuda."""
    job: int = 16
    """Starts that a process attacks together; on a GPU all of them."""
    workers: int | None = None
    """Number of processes; None: one per processor."""
    unfiltered: bool = True
    """Whether the attacks are flown without the filter too."""
    record: Path | None = None
    """JSON file to which the counts of each finished job are written, and from which they are read: an attack that
    was interrupted goes on with the next job. By default there is none."""

    def run(self) -> int:
        """Attack and print."""
        for mission in self.missions:
            one_of("a mission", mission, MISSIONS)
        for attack in self.attacks:
            one_of("an attack", attack, ATTACKS)
        plan = Plan(self.device, self.periods, self.generations, self.unfiltered)
        known: dict[str, Any] = {}
        if self.record is not None and self.record.exists():
            known = read_json(self.record)
        for mission in self.missions:
            conditions = noise_and_delay(mission, self.noise, self.delay)
            for attack in self.attacks:
                jobs = [
                    (attack, mission, conditions, plan, first, min(self.job, self.starts - first))
                    for first in range(0, self.starts, self.job)
                ]
                left = [job for job in jobs if self._name(*job) not in known]
                workers = Workers(int, (), self.workers, "flew attacks")
                for job, counts in zip(left, workers.ordered(counted, left), strict=True):
                    known[self._name(*job)] = counts._asdict()
                    if self.record is not None:
                        write_json(self.record, known)
                counts = Counts.together([Counts(**known[self._name(*job)]) for job in jobs])
                Terminal().say(_line(mission, attack, counts))
        return 0

    def _name(self, attack: str, mission: str, _: Any, plan: Plan, first: int, count: int) -> str:
        """Name of a job in the record: all that its counts depend on but the device."""
        return (
            f"{mission}, {attack}, noise {self.noise}, delay {self.delay}, periods {plan.periods}, generations "
            f"{plan.generations}, unfiltered {plan.unfiltered}, starts {first} to {first + count - 1}"
        )


def _line(mission: str, attack: str, counts: Counts) -> str:
    """Counts of all jobs, of the starts from which the filter holds."""
    free = "" if counts.unfiltered is None else f"{counts.unfiltered:,} unfiltered, "
    return (
        f"{mission:13} {attack:9} {counts.flights:,} flights from safe starts: violated {free}"
        f"{counts.filtered:,} filtered (least margin {counts.least:.4f}); of {counts.expected:,} whose readings "
        f"were never off by more than the reserve {counts.filtered_expected:,}"
    )


if __name__ == "__main__":
    # Jobs of other processes are in the module of its own name.
    from campaigns import attack

    raise SystemExit(ended("attack", lambda: tyro.cli(attack.Attack).run()))
