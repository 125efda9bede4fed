"""What a trajectory can be optimal for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, get_args

from rans.extend import (
    ConfigError,
    Spacecraft,
    Task,
    Transition,
    leaves,
    map_leaves,
    one_of,
    positive,
    scenario,
    whole,
)
from rans_optimal.arrival import Ending, rounded
from rans_optimal.checks import ObjectiveName
from rans_optimal.solver import ca


@dataclass(frozen=True)
class SymbolicTrajectory:
    """A trajectory in CasADi's symbols, T control periods long."""

    craft: Spacecraft
    task: Task
    start: Any
    """(leaves of the state,)."""
    states: Any
    """(leaves of the state, T), after every period."""
    commands: Any
    """(thrusters, T), 0 to 1."""
    period: Any
    """s."""
    goals: Any
    """(leaves of the goal, T), after every period: where the goal is then."""
    corner: Any = None
    """Radius by which corners are to be rounded off (`trajectory.arrival.rounded`); None: not at all."""


_MOST_PERIODS = 10_000
"""Largest number of control periods of a trajectory; each is a point of a nonlinear program."""


@dataclass(frozen=True)
class _GivenTime(ABC):
    """A trajectory of a given length.

    Raises:
        ConfigError: a time is not positive, or the horizon shorter than a control period.
    """

    horizon: float = 20.0
    """Length of the trajectory, s; cut into whole control periods."""
    control_period: float = 0.2
    """s."""
    kind: ClassVar[str]
    measure: ClassVar[str]
    """Name of the cost, with its unit."""

    def __post_init__(self) -> None:
        for name in ("horizon", "control_period"):
            positive(f"{self.kind}: {name}", getattr(self, name))
        if self.horizon < self.control_period * (1.0 - 1e-9):
            raise ConfigError(
                f"{self.kind}: horizon must be at least a control period of {self.control_period:g} s, got "
                f"{self.horizon:g} s."
            )
        if self.horizon / self.control_period > _MOST_PERIODS:
            raise ConfigError(
                f"{self.kind}: horizon must be at most {_MOST_PERIODS:,} control periods of "
                f"{self.control_period:g} s, got {self.horizon:g} s, whose program would take hours; the usual "
                "cause is a time in ms."
            )

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.kind} in {self.horizon:g} s"

    @property
    def intervals(self) -> int:
        """Control periods of the trajectory."""
        return max(1, round(self.horizon / self.control_period))

    @abstractmethod
    def cost(self, path: SymbolicTrajectory) -> Any:
        """Cost of a trajectory's symbols, which is minimised."""


@dataclass(frozen=True)
class MinimumFuel(_GivenTime):
    """Least thrust impulse, N s, that arrives within a given time."""

    ending: Ending = "exact"
    kind = "minimum fuel"
    measure = "fuel N s"

    def cost(self, path: SymbolicTrajectory) -> Any:
        """Thrust times time, summed over the thrusters, N s."""
        return path.period * ca.dot(_forces(path.craft), ca.sum2(path.commands))


@dataclass(frozen=True)
class MinimumEnergy(_GivenTime):
    """Least squared thrust, summed over the thrusters and over time, N^2 s."""

    ending: Ending = "exact"
    kind = "minimum energy"
    measure = "energy N^2 s"

    def cost(self, path: SymbolicTrajectory) -> Any:
        """The integral of the sum of the thrusters' squared forces, N^2 s."""
        return path.period * ca.dot(_forces(path.craft) ** 2, ca.sum2(path.commands**2))


@dataclass(frozen=True)
class MaximumReward(_GivenTime):
    """Greatest sum of the task's own rewards, so that an agent is measured by what it was told.

    No end is prescribed, and the failures that end an agent's episode are not looked for.
    """

    horizon: float = 25.0
    """Length of the episode, s."""

    ending: ClassVar[Ending] = "free"
    kind = "maximum reward"
    measure = "minus return"

    def cost(self, path: SymbolicTrajectory) -> Any:
        """Minus the return: the sum of all terms of `Task.reward` over all steps.

        The task's reward is traced as it is: what it branches on must be a field.
        """
        (state, goal), arguments = _symbols(path)
        earlier, _ = _symbols(path)[0]
        now, before = ([ca.SX.sym("u") for _ in path.craft.thrusters] for _ in range(2))
        period: Any = ca.SX.sym("h")
        forces = tuple(thruster.force for thruster in path.craft.thrusters)
        transition = Transition(state, goal, tuple(now), tuple(before), earlier, period, forces)
        terms = path.task.reward(transition)
        stage = ca.Function(
            "reward",
            [
                *arguments,
                ca.vertcat(*now),
                ca.vertcat(*before),
                ca.vertcat(*leaves(earlier)),
                period,
            ],
            [sum(terms.values())],
        )
        rewards = [
            path.states,
            path.goals,
            path.commands,
            ca.horzcat(ca.MX(len(now), 1), path.commands[:, :-1]),
            ca.horzcat(path.start, path.states[:, :-1]),
            ca.repmat(path.period, 1, self.intervals),
        ]
        if path.corner is not None:
            stage = rounded(stage, ca.SX.sym("corner"))
            rewards.append(ca.repmat(path.corner, 1, self.intervals))
        return -ca.sum2(stage.map(self.intervals)(*rewards))


@dataclass(frozen=True)
class MinimumTime:
    """Least time, s, in a given number of equal control periods."""

    intervals: int = 50
    """Control periods; for the paper's starts, 5 s away, 50 are finer than the default 5 Hz."""
    ending: Ending = "exact"
    name = "minimum time"
    measure = "time s"
    control_period = None

    def cost(self, path: SymbolicTrajectory) -> Any:
        """Time of arrival, s."""
        return self.intervals * path.period


Objective = MinimumFuel | MinimumEnergy | MaximumReward | MinimumTime


def objective_of(
    name: ObjectiveName,
    horizon: float | None,
    control_period: float,
    ending: Literal["exact", "set"],
    intervals: int,
) -> Objective:
    """The objective of this name.

    Args:
        name: least impulse, time or squared thrust, or greatest reward.
        horizon: length of the trajectory, s; None: 20, for reward 25; for time it follows.
        control_period: time a command is held, s; for time it follows.
        ending: arrive exactly, or within the task's tolerances; for fuel, time and energy.
        intervals: control periods of a least time.

    Raises:
        ConfigError: there is no such objective, or it does not go with the others.
    """
    one_of("objective", name, get_args(ObjectiveName))
    one_of("ending", ending, ("exact", "set"))
    if horizon is not None and name == "time":
        raise ConfigError("horizon is what the objective time looks for; leave it out.")
    if ending == "set" and name == "reward":
        raise ConfigError("the ending set is for fuel, time and energy; reward ends anywhere.")
    if name == "time":
        return MinimumTime(whole("intervals", intervals, bits=20), ending)
    if name == "reward":
        return MaximumReward(25.0 if horizon is None else horizon, control_period)
    length = 20.0 if horizon is None else horizon
    return (MinimumFuel if name == "fuel" else MinimumEnergy)(length, control_period, ending)


def _forces(craft: Spacecraft) -> ca.DM:
    return ca.DM([thruster.force for thruster in craft.thrusters])


def _symbols(path: SymbolicTrajectory) -> tuple[list[Any], list[ca.SX]]:
    """A state and a goal of SX symbols, and the columns of their leaves."""
    like = scenario(path.task, path.craft.dimension, seed=0, episode=0)
    states: list[Any] = [map_leaves(lambda _: ca.SX.sym("s"), s) for s in (like.start, like.goal)]
    return states, [ca.vertcat(*leaves(s)) for s in states]
