"""Flights: trajectories of a controller from a batch of scenarios, in one form for every engine.

Engines, pages and tables read this form; (T + 1, N) states include the start, (T, N, n) commands do not.
"""

from __future__ import annotations

import copy
import inspect
import math
import random
import warnings
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from types import MethodType, SimpleNamespace
from typing import Any, Protocol

import numpy as np

from rans.base.display import NotebookRepr, figure_of
from rans.base.errors import ConfigError, RansWarning, brief, checked, counted, text_of_name
from rans.base.files import write_text
from rans.base.settled import settled_alone
from rans.effectors.wheels import wheel_speeds
from rans.episode.scenario import Scenario
from rans.episode.step import Episode, Guard, Mover, Outcome, Setup, World, step
from rans.episode.verdict import FlightAccumulator
from rans.model.accuracy import chosen, fastest
from rans.model.body import Body, check_stores
from rans.model.fields import finite, leaves, map_leaves, unflatten
from rans.model.random import Draws
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.tasks import Task
from rans.tasks.base import reward_terms
from rans.tasks.rewards import Transition

_STEPS = (slice(None, -1), slice(1, None))
"""Instants at which control periods begin and end."""
_IMPOSSIBLE = 100.0
"""Departure from free motion in a control period that no craft has, as a multiple of what all designed thrusters
and `_PUSHED` do to the empty craft. Conditions warn beyond 10 times the thrust."""
_PUSHED = 0.1
"""Change of velocity in a control period by disturbances and masses that move in the craft, m/s. Times the
factor it is beyond kicks of 5 m/s, above which conditions warn."""


class Controller(Protocol):
    """Protocol of controllers, which compute commands from states: agents, LQR, MPC and others.

    Every flight flies a copy of its own (`begin_flight`), so that flights in other threads change nothing, and what
    a controller remembers is not in it after a flight.

    A controller that reads states alone may have an attribute ``observes`` that is False. Its observations then
    have no columns: those of a mission contain the recommended change of velocity, and cost as much as guidance.

    >>> import numpy as np
    >>> class Coasting:
    ...     name = "coasting"
    ...     def reset(self, count): pass
    ...     def act(self, state, goal, observation): return np.zeros((len(observation), 8))
    >>> starts = rans.scenarios(rans.GoToPose(), rans.load_spacecraft("floating-platform"), 7, 3)
    >>> rans.fly("floating-platform", "go-to-pose", Coasting(), starts, rans.Timing())
    <Flight of coasting: 3 episodes of 25 s with floating-platform (fast engine)>
    """

    @property
    def name(self) -> str:
        """Name of the controller in tables."""
        ...

    def reset(self, count: int) -> None:
        """Reset internal states for ``count`` new episodes."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, commands) of N episodes, usually 0 (shut) or 1 (open) per thruster.

        Args:
            state: measured states, a `State` of float64 arrays (N,).
            goal: goals, a `State` of float64 arrays (N,), or of numbers where all are the same.
            observation: observations (N, width), float32, in the order of `rans.tasks.observation_columns`.
        """
        ...


_COPIED_WHOLE = np.ndarray, np.random.Generator, random.Random
"""Parts of a controller that a flight may change in place, and that hold no other parts."""


def begin_flight(controller: Controller, count: int) -> Controller:
    """A copy of a controller that begins ``count`` new episodes; the controller itself stays as it is.

    Copied is what may remember: all parts with a ``reset``, and lists, dictionaries, sets, arrays and random
    numbers in them. The copies share everything else, such as networks and solvers. A part that has a method
    ``__copy__`` is copied by it.
    """
    own = _own(controller, {})
    own.reset(count)
    return own


def _own(part: Any, copies: dict[int, Any]) -> Any:
    """Copy of a part of a controller if it may remember, else the part; ``copies`` has earlier ones, by `id`."""
    if id(part) in copies:
        return copies[id(part)]
    if isinstance(part, _COPIED_WHOLE):
        result = copies[id(part)] = copy.deepcopy(part)
    elif isinstance(part, tuple):
        parts = [_own(x, copies) for x in part]
        changed = any(x is not y for x, y in zip(parts, part, strict=True))
        result = getattr(type(part), "_make", type(part))(parts) if changed else part
    elif isinstance(part, MethodType):
        owner = _own(part.__self__, copies)
        result = part if owner is part.__self__ else MethodType(part.__func__, owner)
    elif isinstance(part, list | dict | set | deque):
        filled: Any = copy.copy(part)
        result = copies[id(part)] = filled
        if isinstance(part, dict):
            filled.update({key: _own(x, copies) for key, x in part.items()})
        elif not isinstance(part, set):
            filled.clear()
            filled.extend(_own(x, copies) for x in part)
    elif not callable(getattr(part, "reset", None)) or isinstance(part, type):
        result = part
    elif hasattr(part, "__copy__") or not hasattr(part, "__dict__"):
        result = copies[id(part)] = copy.copy(part)
    else:
        plain = isinstance(part, SimpleNamespace)
        result = copies[id(part)] = copy.copy(part) if plain else object.__new__(type(part))
        for name, x in vars(part).items():
            object.__setattr__(result, name, _own(x, copies))
    return result


def informed(controller: Controller, conditions: Conditions | None) -> Controller:
    """The controller that expects the conditions of its flights, if it can: then it has a method ``expecting``.

    Only controllers that RANS makes by name are informed; those of users and plug-ins fly as they were made.

    Args:
        controller: any controller.
        conditions: conditions of its flights; None: everything is nominal.
    """
    expecting = getattr(controller, "expecting", None)
    return controller if expecting is None else expecting(conditions)


@dataclass(frozen=True)
class Flight(NotebookRepr):
    """Trajectories of N episodes over T control periods, from `fly`.

    >>> starts = rans.scenarios(rans.GoToPose(), rans.load_spacecraft("atmos"), 7, 3)
    >>> flight = rans.fly("atmos", "go-to-pose", rans.LQR("atmos", "go-to-pose"), starts, rans.Timing())
    >>> flight.errors()["position"].shape, flight.commands.shape
    ((126, 3), (125, 3, 8))
    """

    craft: Spacecraft
    task: Task
    timing: Timing
    states: Any
    """States, a `State` of float64 arrays (T + 1, N)."""
    goals: Any
    """Goals, a `State` of arrays (T + 1, N) if they vary, else (N,)."""
    commands: np.ndarray
    """Commands (T, N, commands) in the order of `rans.model.spacecraft.Spacecraft.commands`."""
    controller: str
    """Name of the controller."""
    engine: str = "fast"
    """"fast" (equations of `rans.model.dynamics`), or the ``engine`` of what moved it: "drake" (the reference)."""
    margins: dict[str, np.ndarray] = field(default_factory=dict)
    """Least margin (T, N) of each constraint in every period, by name; infinite after a success."""
    done: np.ndarray | None = None
    """Whether the mission succeeded, (N,) bool; None: the task lasts until it is truncated."""
    lengths: np.ndarray | None = None
    """Control periods until the mission succeeded, else T, (N,) int. Afterwards the state of a flight is constant
    and its thrusters are shut. None: T for all."""
    guarded: np.ndarray | None = None
    """Whether a safety filter replaced the command, (T, N) bool; None: there was none."""
    stopped: int = 0
    """Number of times that the controller's solver found no solution; 0 without a solver."""
    first: int = 0
    """Number of its first episode among those of its seed, as ``--episode`` of `rans view` names it."""

    def __repr__(self) -> str:
        duration = len(self.commands) * self.timing.control_period
        count = counted(self.commands.shape[1], "episode")
        return (
            f"<Flight of {self.controller}: {count} of {duration:g} s with {self.craft.name} "
            f"({self.engine} engine)>"
        )

    @property
    def times(self) -> np.ndarray:
        """Times of the states, s, (T + 1,)."""
        return np.arange(len(self.commands) + 1) * self.timing.control_period

    @property
    def openings(self) -> np.ndarray:
        """Commands (T, N, thrusters) of the thrusters alone: shares from 0 to 1, not how often valves open."""
        return self.commands[:, :, self.craft.thruster_commands]

    def errors(self) -> dict[str, np.ndarray]:
        """Errors of the task at every instant by quantity, (T + 1, N), SI units."""
        return self.task.errors(self.states, self.goals)

    def plot(self, episode: int = 0) -> Any:
        """A figure of matplotlib of one episode: path, errors with tolerances, and when each thruster was open.

        Raises:
            ConfigError: there is no such episode.
        """
        self._check_episode(episode)
        return figure_of(self, episode)

    def _check_episode(self, episode: int) -> None:
        count = self.commands.shape[1]
        if not 0 <= episode < count:
            raise ConfigError(f"episode must be >= 0 and < {count}, got {episode}.")

    def to_csv(self, file: str | Path, episode: int = 0) -> Path:
        """Write one episode as a table with a row for each instant, and return the file.

        The columns are the time, the state, the speeds of reaction wheels relative to the body (``s_0``, ...), and
        the commands that are held from then on, zero at the end; the heading has their units. `rans.identify` reads
        such a table.

        Raises:
            ConfigError: the file has no name, there is no such episode, or the disk refused.
        """
        file = Path(text_of_name("a file", file, Path))
        self._check_episode(episode)
        states = leaves(replace(self.states, notes=None, stores=()))
        speeds = wheel_speeds(self.craft, self.states)
        columns = np.stack([np.asarray(x)[:, episode] for x in (*states, *speeds)], axis=1)
        further = tuple(f"s_{k} (rad/s)" for k in range(len(speeds)))
        write_text(file, table(self.times, columns, self.commands[:, episode], further))
        return file

    def rewards(self) -> dict[str, np.ndarray]:
        """Reward terms of every step by name, (T, N); 0 after an episode's end.

        Kernels and engines pay the same terms as they fly; this computes them again from the stored states.
        """
        after = map_leaves(lambda x: x[1:], self.states)
        goals = map_leaves(lambda x: x[1:] if x.ndim == 2 else x, self.goals)
        command = np.moveaxis(self.commands, 2, 0)
        previous = np.insert(command[:, :-1], 0, 0.0, axis=1)
        steps = np.arange(len(self.commands))[:, None]
        done = None
        if self.done is not None:
            done = self.done & (steps == np.asarray(self.lengths) - 1)
        transition = Transition(
            after,
            goals,
            tuple(command),
            tuple(previous),
            map_leaves(lambda x: x[:-1], self.states),
            self.timing.control_period,
            tuple(thruster.force for thruster in self.craft.thrusters),
        )
        violated = self.violated_when() if self.margins else None
        terms = reward_terms(self.task, transition, done, violated)
        going = True if self.lengths is None else steps < self.lengths
        return {
            name: np.where(going, np.broadcast_to(term, command.shape[1:]), 0.0)
            for name, term in terms.items()
        }

    def violated_when(self) -> np.ndarray:
        """Whether the margin of a constraint was negative in each period, (T, N)."""
        violated = np.zeros(self.commands.shape[:2], dtype=bool)
        for margin in self.margins.values():
            violated |= margin < 0.0
        return violated

    def violated(self) -> np.ndarray:
        """Whether the margin of a constraint was ever negative, (N,)."""
        return np.asarray(self.violated_when().any(axis=0))

    @cached_property
    def verdict(self) -> FlightAccumulator:
        """Verdict on the N episodes, with arrays (N,): settled and when, solved, and failed."""
        steps = len(self.commands)
        timing = replace(self.timing, episode_steps=steps)
        setting = Setup(self.craft, self.task, timing)
        with np.errstate(invalid="ignore"):
            verdict = FlightAccumulator.begin(setting, self._episode(0))
            for outcome in self._outcomes():
                verdict = verdict.after(setting, outcome)
        return map_leaves(np.asarray, verdict)

    def failed(self) -> np.ndarray:
        """Whether each episode failed, (N,).

        An episode fails if the task declares a failure after a step, a constraint is violated that ends episodes,
        or the state is lost (`rans.episode.step.Outcome.lost`), in each case before a success.
        """
        return np.asarray(self.verdict.failed)

    def _episode(self, instant: int) -> Episode:
        """All N episodes at an instant."""

        def now(x: Any) -> Any:
            return x[instant] if np.ndim(x) == 2 else x

        clock = np.full(self.commands.shape[1], instant)
        return Episode(map_leaves(now, self.states), map_leaves(now, self.goals), clock=clock)

    def _outcomes(self) -> Iterator[Outcome]:
        """Outcome of every step of all N episodes for `rans.episode.verdict`, without rewards, T in all.

        It must judge as `rans.episode.step.step` does, from stored states (`tests/episode/test_flight.py`).
        """
        violated = self.violated_when()
        for k, commands in enumerate(self.commands):
            episode = self._episode(k + 1)
            lost = ~np.asarray(finite(*leaves(episode.state)))
            failed = self.task.failed(episode.state, episode.goal)
            if self.done is not None:
                failed = failed & ~(self.done & (self.lengths == k + 1))
            failed = failed | lost
            if self.margins and self.task.violation_ends:
                failed = failed | violated[k]
            done = None
            reached = self.task.reached(episode.state, episode.goal)
            if self.done is not None:
                done = reached = self.done & (self.lengths == k + 1)
            yield Outcome(
                episode=episode,
                command=tuple(commands.T),
                terms={},
                failed=failed,
                lost=lost,
                done=done,
                truncated=np.full(len(failed), k + 1 == len(self.commands)) & ~failed,
                reached=reached & ~failed,
                margins={name: margin[k] for name, margin in self.margins.items()},
            )


_COLUMNS = {
    6: "x (m),y (m),heading (rad),v_x (m/s),v_y (m/s),w (rad/s)",
    13: "x (m),y (m),z (m),q_w,q_x,q_y,q_z,v_x (m/s),v_y (m/s),v_z (m/s),w_x (rad/s),w_y (rad/s),w_z (rad/s)",
}
"""Headings of a state's numbers, by how many there are."""


def table(
    times: np.ndarray, states: np.ndarray, commands: np.ndarray, further: tuple[str, ...] = ()
) -> str:
    """Text of comma-separated values: a row for each instant, with the commands that are held from then on.

    Args:
        times: (T + 1,) s.
        states: (T + 1, k) position in W, heading or quaternion R_WB, velocity in W and spin, and further columns.
        commands: (T, commands); zeros in the last row.
        further: headings of the further columns; empty: they have numbers.
    """
    width = max(size for size in _COLUMNS if size <= states.shape[1])
    further = further or tuple(f"x_{k}" for k in range(width, states.shape[1]))
    names = [f"u_{k}" for k in range(commands.shape[1])]
    header = ",".join(["t (s)", _COLUMNS[width], *further, *names])
    held = np.vstack([commands, np.zeros(commands.shape[1])])
    rows = np.column_stack([times, states, held])
    return "\n".join([header, *(",".join(f"{x:.9g}" for x in row) for row in rows)]) + "\n"


@settled_alone
def fly(
    craft: Spacecraft,
    task: Task,
    controller: Controller,
    starts: Scenario,
    timing: Timing,
    move: Mover | None = None,
    body: Body | None = None,
    conditions: Conditions | None = None,
    draws: Draws | None = None,
    guard: Guard | None = None,
) -> Flight:
    """Simulate a controller from a batch of scenarios, in float64, as `rans.fly` says, which takes names too.

    Raises:
        ConfigError: see `rans.fly`.
    """
    # World and first states; what no array says is the same for all episodes.
    _check_starts(checked("starts", starts, Scenario), craft)
    _check_controller(controller, craft)
    checked("timing", timing, Timing)
    if body is not None:
        check_stores(craft, body)
    how = chosen(craft, timing, body) if conditions is None else timing
    world = World(Setup(craft, task, how, conditions, guard))
    now = world.begin(starts.start, starts.goal, 0, draws, body)
    count = len(leaves(starts.start)[0])
    if craft.stores:
        now = replace(now, state=map_leaves(lambda x: np.full(count, x), now.state))
    begun = now.state
    nowhere = map_leaves(lambda _: np.nan, begun)
    controller = begin_flight(controller, count)
    observes = getattr(controller, "observes", True)
    # History, of T + 1 states and goals, and of T commands and margins.
    states = [begun]
    goals = [starts.goal]
    commands = []
    margins = []
    guarded = []
    # Episodes whose state is finite, those whose mission is accomplished, and when it was.
    alive = np.ones(count, dtype=bool)
    won = None
    lengths = None
    for step_number in range(timing.episode_steps):
        observations = np.zeros((count, 0), dtype=np.float32)
        if observes:
            observations = np.stack(world.observe(now, draws), axis=1).astype(np.float32)
        desired = np.asarray(
            controller.act(world.sensed(now, draws), now.goal, observations), dtype=np.float64
        )
        if desired.shape != (count, craft.command_count):
            raise ConfigError(
                f"{controller.name} must answer {counted(count, 'observation')} with commands of the "
                f"shape {(count, craft.command_count)}, got {desired.shape}: was it made for another "
                f"craft than {craft.name}?"
            )
        # A control period: the guard may change commands.
        outcome = step(world, now, tuple(desired.T), draws, move, rewarded=False)
        command = np.stack(outcome.command, axis=1)
        if outcome.guarded is not None:
            changed = np.broadcast_to(outcome.guarded, count)
            guarded.append(changed if won is None else changed & ~won)
        period_margins = outcome.margins
        if outcome.done is not None:
            if won is None or lengths is None:
                won = np.zeros(count, dtype=bool)
                lengths = np.full(count, timing.episode_steps)
            # After a success the state is constant.
            before = now
            command = np.where(won[:, None], 0.0, command)
            period_margins = {k: np.where(won, np.inf, x) for k, x in outcome.margins.items()}
            arrived = outcome.episode
            now = replace(
                arrived,
                state=map_leaves(partial(np.where, won), before.state, arrived.state),
                goal=map_leaves(partial(np.where, won), before.goal, arrived.goal),
            )
            newly = outcome.done & ~won
            lengths[newly] = step_number + 1
            won = won | newly
        else:
            now = outcome.episode
        # A state that is not finite stays none in the history, and flies on from the start in vain.
        margins.append({name: np.broadcast_to(x, count) for name, x in period_margins.items()})
        alive = alive & ~(outcome.lost if won is None else outcome.lost & ~won)
        where_alive = partial(np.where, alive)
        states.append(map_leaves(where_alive, now.state, nowhere))
        now = replace(now, state=map_leaves(where_alive, now.state, begun))
        goals.append(now.goal)
        commands.append(command)
    stand_still = all(goal is starts.goal for goal in goals)
    flight = Flight(
        craft,
        task,
        timing,
        _stacked(states),
        starts.goal if stand_still else _stacked(goals),
        np.stack(commands),
        controller.name,
        "fast" if move is None else getattr(move, "engine", "other"),
        {name: np.stack([margin[name] for margin in margins]) for name in margins[0]},
        won,
        lengths,
        np.stack(guarded) if guarded else None,
        getattr(controller, "failures", 0),
    )
    if move is None:
        for refusal in outran(flight, world.timing):
            warnings.warn(refusal, RansWarning, stacklevel=2)
    return flight


def outran(flight: Flight, timing: Timing) -> list[str]:
    """Sentences about flights that reached motion which is inaccurate, or impossible, before they failed.

    Numbers of steps follow from what thrusters and wheels can do. Faults, disturbances and a poor controller may
    spin a craft up further, or a mass that moves in it. Bounds are `rans.model.accuracy.fastest`, and those of
    further effectors (`rans.effectors.effector.Effector.inaccuracy`). A path is impossible if it departs from free
    motion in a control period by 100 times as much as all thrusters can move the empty craft.

    Args:
        flight: flights.
        timing: timing of the flights with its number of substeps.
    """
    craft = flight.craft
    states = flight.states
    with np.errstate(invalid="ignore"):
        failed = np.broadcast_to(flight.task.failed(states, flight.goals), np.shape(states.p.x))
    going = ~np.logical_or.accumulate(failed, axis=0)
    spin = np.linalg.norm(np.array(states.spin()), axis=0)
    result = []
    reached = float(np.max(spin, where=going & np.isfinite(spin), initial=0.0))
    bound = fastest(craft, timing)
    steps = timing.substeps or 1
    # A mass that moves in the craft takes steps of its own (`Effector.inaccuracy`).
    if reached > bound and craft.is_rigid:
        result.append(
            f"{flight.controller} spins {craft.name} at up to {reached:.3g} rad/s, but its motion is accurate up "
            f"to {bound:.3g} rad/s with {counted(steps, 'substep')} of a control period of "
            f"{timing.control_period:g} s; set timing.substeps to {math.ceil(steps * reached / bound)} or more. "
            "The usual cause is a fault or a disturbance torque that the controller does not balance, or an agent "
            "that has not learnt to stop its spin."
        )
    reasons = (
        effector.inaccuracy(craft, states, going, timing) for effector in craft.further_effectors
    )
    result.extend(f"{flight.controller} {reason}" for reason in reasons if reason)
    result.extend(_lost(flight, timing, going))
    return result


def _lost(flight: Flight, timing: Timing, going: np.ndarray) -> Iterator[str]:
    """Sentence that flights left every path a craft can take, as broken motion does; none if all are on one."""
    craft = flight.craft
    period = timing.control_period
    before, after = (map_leaves(lambda x, part=part: x[part], flight.states) for part in _STEPS)
    goals = map_leaves(lambda x: x[:-1] if np.ndim(x) == 2 else x, flight.goals)
    # Positions and velocities apart from those of free motion.
    with np.errstate(all="ignore"):
        p, v = flight.task.drift_at(goals).carry(before.p, before.v, period)
        moved = np.array((after.p - p).columns()) / period
        faster = np.array((after.v - v).columns())
        apart = np.linalg.norm([*moved, *faster], axis=0)
    strength = sum(thruster.force for thruster in craft.thrusters)
    most = _IMPOSSIBLE * (strength / (craft.mass * craft.lightest) * period + _PUSHED)
    if flight.lengths is not None:  # a state is constant after a success
        going = going & (np.arange(len(going))[:, None] < flight.lengths)
    wild = going[:-1] & ~(apart <= most)  # also where a number is NaN
    if not wild.any():
        return
    number = int(wild.any(axis=0).sum())
    largest = float(np.nanmax(apart, where=wild & np.isfinite(apart), initial=0.0))
    change = "the state was no number"
    if largest > 0.0:
        change = f"the motion departed from free motion by {largest:.3g} m/s"
    most = strength / (craft.mass * craft.lightest) * period
    yield (
        f"{number} of {counted(wild.shape[1], 'flight')} of {craft.name} left every path that a craft can take: "
        f"within a control period of {period:g} s {change}, and all thrusters together give {most:.3g} m/s. The "
        "usual cause is a huge number in conditions, in the spacecraft's file or in a command; otherwise it is an "
        "error of RANS."
    )


def _check_starts(starts: Scenario, craft: Spacecraft) -> None:
    """Reject (`ConfigError`) starts that are not a batch, or are of another dimension."""
    shapes = {np.shape(field) for field in leaves(starts.start)}
    if len(shapes) != 1 or len(shape := shapes.pop()) != 1 or shape[0] < 1:
        raise ConfigError(
            "starts must have arrays of one length (N,), with at least one start, as "
            "rans.episode.scenario.scenarios returns them."
        )
    dimension = len(starts.start.p.columns())
    if dimension != craft.dimension:
        raise ConfigError(
            f"the starts are for {dimension} dimensions, but {craft.name} moves in "
            f"{craft.dimension}."
        )


def _takes(value: Any, method: str, arguments: int) -> bool:
    """Whether a value has a method that can be called with this number of arguments."""
    function = getattr(value, method, None)
    if not callable(function):
        return False
    try:
        inspect.signature(function).bind(*range(arguments))
    except TypeError:
        return False
    except ValueError:  # written in C, without a signature
        return True
    return True


def _check_controller(controller: Controller, craft: Spacecraft) -> None:
    """Reject (`ConfigError`) a value that is not a controller, or a controller of another kind of spacecraft."""
    if not (_takes(controller, "reset", 1) and _takes(controller, "act", 3)):
        raise ConfigError(
            "a controller has the methods reset(count) and act(state, goal, observation), see "
            f"rans.episode.flight.Controller, such as rans.load_agent(...).controller or a rans.LQR; "
            f"got {brief(controller)}."
        )
    own_craft = getattr(controller, "craft", None)
    if isinstance(own_craft, Spacecraft) and _form(own_craft) != _form(craft):
        raise ConfigError(
            f"{controller.name} was made for {own_craft.name}, with {len(own_craft.commands)} commands in "
            f"{own_craft.dimension} dimensions, but {craft.name} has {craft.command_count} in "
            f"{craft.dimension}."
        )


def _form(craft: Spacecraft) -> tuple[int, int]:
    """Dimension and number of commands, which a controller must match."""
    return craft.dimension, craft.command_count


def _stacked(trees: list[Any]) -> Any:
    """Tree whose fields (T, N) are stacked from those of many trees."""
    return unflatten(trees[0], [np.stack(x) for x in zip(*map(leaves, trees), strict=True)])
