"""Certified least fuel on short horizons, checked by a mixed-integer linear program.

Run ``python -m campaigns.mixed_integer`` for a table. Nothing of `rans.optimal.certificate.plane` is used
to set the program up: wrenches are computed from thrusters' positions and directions, motions are integrated by
SciPy, and HiGHS (`scipy.optimize.milp`) proves its own optimum.

A planar craft has constant inertia, so its spin and heading after k control periods depend on the sums of its
commands' torques alone. The program is a flow of one unit through a graph of (period, spin, heading). An edge is a
set of open thrusters; it carries the change of velocity and position that it causes. The balls of the goal set are
replaced by regular polygons: one around each ball gives a value that no controller beats, one within gives a value
that some controller reaches, so the least fuel lies between both. The same program takes a minimum on-time.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array

from campaigns.command import ended
from rans.errors import ConfigError
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.certificate.certificate import bounder, certified_least_fuel
from rans.optimal.certificate.flight import state_after
from rans.optimal.certificate.goal_set import GoalSet
from rans.optimal.certificate.problem import Problem, SearchEffort, Unreachable
from rans.terminal import Terminal
from validation.study.checks import Check, Study

_SIDES = 16
"""Of the polygons: the circumscribed one is 2 % wider than its ball."""
_SPIN_DIGITS = 9
"""Decimals, in quanta of spin and heading, to which two ways to the same node agree."""


@dataclass(frozen=True)
class Answer:
    """What the program proved of one start."""

    least: float
    """Fuel (N s) below which nothing arrives, proven with circumscribed polygons; infinite if none does."""
    reached: float
    """Fuel (N s) with which something arrives, found with inscribed polygons; infinite if nothing was found."""
    commands: np.ndarray | None
    """(T, thrusters) zeros and ones that reach it."""
    edges: int
    """Binary variables."""
    seconds: float
    """Wall time of both."""


@dataclass(frozen=True)
class Question:
    """Least impulse with which on/off commands are in the goal set after some control periods."""

    craft: Spacecraft
    """Planar, of on/off thrusters that share no thrust."""
    start: PlanarState
    """State of floats."""
    goal: PlanarState
    """State of floats, at rest."""
    goals: GoalSet
    """Balls around the goal."""
    period: float
    """For which commands are held, s."""
    steps: int
    """Control periods."""
    least_on: int = 1
    """Periods for which a thruster that opens stays open at least."""


@dataclass(frozen=True)
class _Edge:
    """A set of thrusters that is open in a period, from one node to the next."""

    before: tuple[int, float, float]
    """Period, spin (rad/s) and heading (rad) at its begin, the latter two from the start's."""
    after: tuple[int, float, float]
    velocity: complex
    """Change of v in W that it causes, m/s."""
    position: complex
    """Change of p in W at the horizon that it causes, m."""
    fuel: float
    """N s."""
    pattern: tuple[int, ...]
    """Thrusters, zeros and ones."""


def least_fuel_by_mixed_integers(
    question: Question, most_fuel: float, seconds: float = 30.0
) -> Answer:
    """Two programs that enclose the least fuel.

    Args:
        question: what is asked.
        most_fuel: fuel that a controller is known to need at most, N s: sets of thrusters that need more are
            left out. The answer holds below it.
        seconds: for each of both programs; less gives a wider gap between their values, never a wrong one.
    """
    began = time.monotonic()
    edges = list(_graph(question, most_fuel))
    least, _ = _solve(edges, question, True, seconds)
    reached, commands = _solve(edges, question, False, seconds)
    return Answer(least, reached, commands, len(edges), time.monotonic() - began)


def _patterns(
    craft: Spacecraft, every: bool
) -> list[tuple[tuple[int, ...], complex, float, float]]:
    """Sets of open thrusters: zeros and ones, force on B (N), torque (N m), sum of forces (N).

    Of those with the same force and torque the cheapest, unless every set is asked for.
    """
    arms = []
    for thruster in craft.thrusters:
        push = thruster.force * np.array(thruster.direction[:2])
        lever = np.array(thruster.position[:2]) - np.array(craft.centre_of_mass[:2])
        arms.append((complex(*push), lever[0] * push[1] - lever[1] * push[0], thruster.force))
    found = {}
    for pattern in itertools.product((0, 1), repeat=len(arms)):
        force = sum(one * arm[0] for one, arm in zip(pattern, arms, strict=True))
        torque = sum(one * arm[1] for one, arm in zip(pattern, arms, strict=True))
        thrust = sum(one * arm[2] for one, arm in zip(pattern, arms, strict=True))
        rounded = (round(force.real, 9), round(force.imag, 9), round(torque, 9))
        key = pattern if every else rounded
        if key not in found or thrust < found[key][3]:
            found[key] = (pattern, complex(force), float(torque), float(thrust))
    return list(found.values())


def _graph(question: Question, most_fuel: float) -> Iterator[_Edge]:
    """Every edge on a path from the start to an attitude and a spin of the goal set."""
    craft = question.craft
    start = question.start
    goal = question.goal
    goals = question.goals
    period = question.period
    steps = question.steps
    least_on = question.least_on
    inertia = craft.inertia[2][2]
    patterns = _patterns(craft, every=least_on > 1)
    levels: list[dict[tuple[float, float], float]] = [{(0.0, 0.0): 0.0}]
    """Of each period its nodes, with the least fuel that leads there."""
    links: list[list[tuple[tuple[float, float], tuple[float, float], int]]] = []
    for _ in range(steps):
        following: dict[tuple[float, float], float] = {}
        found = []
        for (spin, turn), fuel in levels[-1].items():
            for number, (_, _, torque, thrust) in enumerate(patterns):
                needed = fuel + thrust * period
                if needed > most_fuel + 1e-9:
                    continue
                gain = torque / inertia * period
                node = (
                    round(spin + gain, _SPIN_DIGITS),
                    round(turn + (spin + 0.5 * gain) * period, _SPIN_DIGITS),
                )
                following[node] = min(needed, following.get(node, math.inf))
                found.append(((spin, turn), node, number))
        levels.append(following)
        links.append(found)

    # Backwards: only what leads into the goal set within the fuel.
    duration = steps * period

    def ends(node: tuple[float, float]) -> bool:
        spin, turn = node
        heading = start.attitude.angle + start.w * duration + turn - goal.attitude.angle
        heading = (heading + math.pi) % (2.0 * math.pi) - math.pi
        off = abs(start.w + spin - goal.w)
        return abs(heading) <= goals.heading and off <= goals.spin + 1e-9

    to_go = {node: 0.0 for node in levels[-1] if ends(node)}
    kept = []
    for k in reversed(range(steps)):
        earlier: dict[tuple[float, float], float] = {}
        for before, after, number in links[k]:
            thrust = patterns[number][3]
            if after not in to_go:
                continue
            rest = to_go[after] + thrust * period
            if levels[k][before] + rest > most_fuel + 1e-9:
                continue
            earlier[before] = min(rest, earlier.get(before, math.inf))
            kept.append((k, before, after, number))
        to_go = earlier

    # What each of them does to velocity and position.
    cache: dict[tuple[int, tuple[float, float], float], tuple[complex, complex]] = {}
    for k, before, after, number in kept:
        pattern, force, torque, thrust = patterns[number]
        key = (k, before, torque)
        if key not in cache:
            heading = start.attitude.angle + start.w * k * period + before[1]
            cache[key] = _response(
                heading, start.w + before[0], torque / inertia, period, (steps - k) * period
            )
        by_velocity, by_position = cache[key]
        yield _Edge(
            (k, *before),
            (k + 1, *after),
            by_velocity * force / craft.mass,
            by_position * force / craft.mass,
            thrust * period,
            pattern,
        )


def _response(
    heading: float, spin: float, acceleration: float, period: float, left: float
) -> tuple[complex, complex]:
    """Changes of v, and of p at the horizon, by a unit of acceleration along B's x over a period.

    SciPy integrates exp(i heading(s)) and (left - s) exp(i heading(s)).
    """

    def rates(s: float, _: np.ndarray) -> list[float]:
        angle = heading + spin * s + 0.5 * acceleration * s * s
        cosine = math.cos(angle)
        sine = math.sin(angle)
        return [cosine, sine, (left - s) * cosine, (left - s) * sine]

    answer = solve_ivp(rates, (0.0, period), [0.0] * 4, method="DOP853", rtol=1e-10, atol=1e-12)
    a, b, c, d = answer.y[:, -1]
    return complex(a, b), complex(c, d)


def _solve(
    edges: list[_Edge], question: Question, circumscribed: bool, seconds: float
) -> tuple[float, np.ndarray | None]:
    """The optimum with one kind of polygon, N s, and its commands."""
    craft = question.craft
    start = question.start
    goal = question.goal
    goals = question.goals
    period = question.period
    steps = question.steps
    least_on = question.least_on
    if not edges:
        return math.inf, None
    count = len(edges)
    rows: list[int] = []
    columns: list[int] = []
    entries: list[float] = []
    low: list[float] = []
    high: list[float] = []

    def add(columns_of: list[int], values: list[float], least: float, most: float) -> None:
        rows.extend([len(low)] * len(columns_of))
        columns.extend(columns_of)
        entries.extend(values)
        low.append(least)
        high.append(most)

    # One unit flows from the start on; what flows into a node flows out of it.
    leaving: dict[tuple[int, float, float], list[int]] = {}
    entering: dict[tuple[int, float, float], list[int]] = {}
    for number, edge in enumerate(edges):
        leaving.setdefault(edge.before, []).append(number)
        entering.setdefault(edge.after, []).append(number)
    for node, out in leaving.items():
        into = entering.get(node, [])
        supply = 1.0 if node[0] == 0 else 0.0
        add(out + into, [1.0] * len(out) + [-1.0] * len(into), supply, supply)

    # Balls of position and velocity, side by side of a polygon.
    duration = steps * period
    velocity = complex(start.v.x - goal.v.x, start.v.y - goal.v.y)
    position = complex(start.p.x - goal.p.x, start.p.y - goal.p.y)
    position += complex(start.v.x, start.v.y) * duration
    shrink = 1.0 if circumscribed else math.cos(math.pi / _SIDES)
    everything = list(range(count))
    for side in range(_SIDES):
        normal = complex(
            math.cos(2.0 * math.pi * side / _SIDES), math.sin(2.0 * math.pi * side / _SIDES)
        )
        for offset, radius, effects in (
            (velocity, goals.velocity, [edge.velocity for edge in edges]),
            (position, goals.position, [edge.position for edge in edges]),
        ):
            along = [(normal.conjugate() * effect).real for effect in effects]
            beyond = (normal.conjugate() * offset).real
            add(everything, along, -math.inf, shrink * radius - beyond)

    # A thruster that opens in period k is open in the periods that follow.
    if least_on > 1:
        open_in: dict[tuple[int, int], list[int]] = {}
        for number, edge in enumerate(edges):
            for thruster, opened in enumerate(edge.pattern):
                if opened:
                    open_in.setdefault((edge.before[0], thruster), []).append(number)
        for k in range(steps):
            for thruster in range(len(craft.thrusters)):
                now = open_in.get((k, thruster), [])
                past = open_in.get((k - 1, thruster), [])
                for later in range(k + 1, k + least_on):
                    then = open_in.get((later, thruster), [])
                    names = now + past + then
                    signs = [1.0] * len(now) + [-1.0] * len(past) + [-1.0] * len(then)
                    if now:
                        add(names, signs, -math.inf, 0.0)

    limits: Any = (np.array(low), np.array(high))  # SciPy's annotations know floats only
    matrix = coo_array((entries, (rows, columns)), shape=(len(low), count)).tocsr()
    answer = milp(
        np.array([edge.fuel for edge in edges]),
        integrality=np.ones(count),
        bounds=Bounds(0.0, 1.0),
        constraints=LinearConstraint(matrix, *limits),
        options={"time_limit": seconds, "mip_rel_gap": 0.0},
    )
    if answer.status == 2:  # proven: nothing arrives
        return math.inf, None
    if circumscribed:
        return max(0.0, answer.mip_dual_bound or 0.0), None
    if answer.x is None:
        return math.inf, None
    chosen = sorted(
        (edges[number] for number in np.flatnonzero(answer.x > 0.5)),
        key=lambda edge: edge.before[0],
    )
    return sum(edge.fuel for edge in chosen), np.array([edge.pattern for edge in chosen])


@dataclass(frozen=True)
class Row:
    """One start by both methods; fuels in N s, infinite where nothing arrives."""

    start: PlanarState
    lower: float
    """Certified: no on/off controller needs less."""
    upper: float
    """Of the control that the certificate's search found."""
    answer: Answer
    """Of the mixed-integer program."""
    held: float
    """What its control needs with the minimum on-time."""
    contained: bool
    """Whether the program's commands end in the goal set when the engines' equations fly them."""


@dataclass(frozen=True)
class MixedInteger:
    """Certified least fuel against a mixed-integer program that HiGHS proves, on short horizons."""

    spacecraft: str = "floating-platform"
    """Name of a planar on/off spacecraft, or your own TOML file."""
    starts: int = 12
    """Poses near the goal, at random, moving slowly."""
    steps: int = 6
    """Control periods until arrival."""
    control_period: float = 0.4
    """For which commands are held, s."""
    least_on: int = 2
    """Periods of the minimum on-time that is also solved for; 1 leaves it out."""
    seed: int = 0
    """Seed of the starts."""
    output: Path | None = None
    """JSON file to write."""

    def run(self) -> Study:
        """Print a line per start as it is done, and return the checks."""
        if min(self.starts, self.steps, self.least_on) < 1:
            raise ConfigError("starts, steps and least on must be >= 1.")
        craft = load_spacecraft(self.spacecraft)
        if craft.dimension != 2:
            raise ConfigError(f"{craft.name} moves in space: the program is for the plane.")
        print("start   lower   upper   milp: least  reached   held    edges  seconds")  # noqa: T201
        rows = []
        for number, start in enumerate(self._starts(craft)):
            row = compared(craft, start, self.control_period, self.steps, self.least_on)
            rows.append(row)
            answer = row.answer
            print(  # noqa: T201
                f"{number:5d} {row.lower:7.2f} {row.upper:7.2f} {answer.least:13.2f} "
                f"{answer.reached:8.2f} {row.held:6.2f} {answer.edges:8d} {answer.seconds:8.1f}",
                flush=True,
            )
        study = report(craft.name, rows)
        if self.output:
            study.write(self.output)
        return study

    def _starts(self, craft: Spacecraft) -> Iterator[PlanarState]:
        """Within a sixth of the way that one thruster pushes in the time, squared."""
        random = np.random.default_rng(self.seed)
        duration = self.steps * self.control_period
        push = max(thruster.force for thruster in craft.thrusters) / craft.mass
        reach = push * duration**2 / 6.0
        for _ in range(self.starts):
            position = reach * random.uniform(-1.0, 1.0, 2)
            velocity = reach / duration * random.uniform(-0.5, 0.5, 2)
            heading = float(random.uniform(-0.4, 0.4))
            yield PlanarState(
                Vec2(*map(float, position)), Heading(heading), Vec2(*map(float, velocity)), 0.0
            )


def compared(
    craft: Spacecraft, start: PlanarState, period: float, steps: int, least_on: int = 1
) -> Row:
    """One start by the certificate and by mixed integers, to rest at the origin."""
    goal = PlanarState(Vec2(0.0, 0.0), Heading(0.0), Vec2(0.0, 0.0), 0.0)
    goals = GoalSet()
    pulse = max(thruster.force for thruster in craft.thrusters) * period
    try:
        found = certified_least_fuel(
            bounder(craft, period), Problem(start, goal, goals), steps, SearchEffort(10.0)
        )
        lower, upper = found.lower, found.upper
    except Unreachable:
        lower = upper = math.inf
    # Of what is unreachable the program looks at cheap controls only: it must not find one either.
    budget = upper if math.isfinite(upper) else (lower if math.isfinite(lower) else 4 * pulse)
    question = Question(craft, start, goal, goals, period, steps)
    answer = least_fuel_by_mixed_integers(question, budget)
    held = math.inf
    if least_on > 1 and math.isfinite(answer.reached):
        longer = replace(question, least_on=least_on)
        held = least_fuel_by_mixed_integers(longer, budget + pulse).reached
    end = start if answer.commands is None else state_after(craft, start, answer.commands, period)
    contained = answer.commands is None or goals.contains(end, goal)
    return Row(start, lower, upper, answer, held, contained)


def report(name: str, rows: list[Row]) -> Study:
    """Whether certificate and program agree, of every start."""
    beaten = max(_excess(row.lower, row.answer.reached) for row in rows)
    impossible = max(_excess(row.answer.least, row.upper) for row in rows)
    eased = max(_excess(row.answer.least, row.held) for row in rows)
    outside = sum(not row.contained for row in rows)
    rounding = 1e-6
    checks = (
        Check(
            "bound above a control",
            beaten,
            rounding,
            "N s",
            "A bound is beaten by nothing; HiGHS keeps its rows to 1e-7 of their size.",
        ),
        Check(
            "control below a proof",
            impossible,
            rounding,
            "N s",
            "Nothing needs less than the program's optimum with circumscribed polygons.",
        ),
        Check(
            "cheaper with on-time",
            eased,
            rounding,
            "N s",
            "A further constraint saves nothing.",
        ),
        Check(
            "commands that miss",
            float(outside),
            0.0,
            "starts",
            "Inscribed polygons lie within the balls.",
        ),
    )
    both = [row for row in rows if math.isfinite(row.lower) and math.isfinite(row.answer.reached)]
    equal = sum(abs(row.lower - row.answer.reached) < rounding for row in both)
    return Study(
        f"least fuel of {name} by certificate and by mixed integers",
        checks,
        {
            "starts": len(rows),
            "reached by both": len(both),
            "of these the same fuel": equal,
            "seconds of the program": round(sum(row.answer.seconds for row in rows), 1),
        },
    )


def _excess(bound: float, value: float) -> float:
    """By how much a bound exceeds a value; none where nothing was found."""
    if not math.isfinite(value):
        return 0.0
    return max(0.0, bound - value)


def main() -> int:
    """Print the checks; 1 if one failed."""
    import tyro

    study = tyro.cli(MixedInteger).run()
    Terminal().table(study.table())
    print(", ".join(f"{name} {value}" for name, value in study.settings.items()))  # noqa: T201
    return 0 if study.passed else 1


if __name__ == "__main__":
    raise SystemExit(ended("mixed_integer", main))
