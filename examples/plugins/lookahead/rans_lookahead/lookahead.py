"""Look-ahead: an agent or controller simulates changes of its commands and takes the best one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from rans.episode import Outcome
from rans.evaluation.fly.agent import run_of
from rans.extend import (
    Agent,
    ConfigError,
    LoadedRun,
    Setup,
    Spacecraft,
    Task,
    World,
    brief,
    checked,
    is_finite,
    map_leaves,
    step,
)
from rans.model.actuators import ON_OFF
from rans.tasks.goal_set import arrived, asks_rest
from rans.tasks.rewards import RestReward, paid

LOOKAHEAD = "lookahead"
"""Word before a contestant's name, with a colon."""
HORIZON = 8.0
"""Length of simulations, s: a flight to a pose takes about 6 s, and the price of its rest shows soon after."""
CHANGE_WITHIN = 1.0
"""Latest time of a change that is tried, s."""


@dataclass(frozen=True)
class ArrivalCost:
    """Prices of late arrival, thrust and errors; the unit is a second with all thrusters open.

    >>> from rans_lookahead.lookahead import ArrivalCost, Lookahead
    >>> Lookahead(rans.load_agent("go-to-pose-2d"), arrival=ArrivalCost(late=1.5))
    <Lookahead: go-to-pose-2d, 8 s ahead>

    Raises:
        ConfigError: a price is no finite number >= 0.
    """

    late: float = 2.5
    """Price of a second before the goal set is reached (`rans.tasks.goal_set.arrived`), and of a second outside
    a tolerance after that."""
    position: float = 0.5
    """Price of a second in the goal set with a position error as large as its tolerance; it grows with the square
    of the error."""
    attitude: float = 0.07
    """Price of a second in the goal set with an attitude error as large as its tolerance; it grows with the square
    of the error. Other errors cost nothing within their tolerances."""

    def __post_init__(self) -> None:
        """Refuse prices that are negative or not finite."""
        for name, price in asdict(self).items():
            if not (is_finite(price) and price >= 0):
                raise ConfigError(f"the price {name} must be finite and >= 0, got {price!r}.")

    def cost(
        self, openings: np.ndarray, arrived: np.ndarray, errors: dict[str, np.ndarray]
    ) -> np.ndarray:
        """Cost (M,) of a second with shares (M,) of all thrust and errors (M,) in shares of their tolerances."""
        off = sum(getattr(self, name, 0.0) * error**2 for name, error in errors.items())
        return openings + np.where(arrived, off, self.late)


class _Policy(Protocol):
    """A policy as a function of its memory, which can be copied from episode to episode."""

    def initial_state(self, count: int) -> Any:
        """Memory of episodes that begin, one row for each."""
        ...

    def repeated(self, memory: Any, count: int) -> Any:
        """A memory with each row repeated ``count`` times."""
        ...

    def chosen(self, memory: Any, rows: np.ndarray) -> Any:
        """Some rows of a memory."""
        ...

    def commands(
        self, state: Any, goal: Any, observations: np.ndarray, memory: Any, change: np.ndarray
    ) -> tuple[np.ndarray, Any]:
        """Commands (M, thrusters), inverted where the change (M, thrusters) is 1, and the memory after them."""
        ...


class _AgentPolicy:
    """A trained agent, which reads the observation and remembers the commands that were flown."""

    def __init__(self, agent: Agent) -> None:
        self._network = agent.network

    def initial_state(self, count: int) -> Tensor | None:
        """See `_Policy`."""
        return self._network.initial_state(count)

    def repeated(self, memory: Tensor | None, count: int) -> Tensor | None:
        """See `_Policy`."""
        return None if memory is None else memory.repeat_interleave(count, dim=0)

    def chosen(self, memory: Tensor | None, rows: np.ndarray) -> Tensor | None:
        """See `_Policy`."""
        return None if memory is None else memory[rows]

    @torch.no_grad()
    def commands(
        self,
        state: Any,
        goal: Any,
        observations: np.ndarray,
        memory: Tensor | None,
        change: np.ndarray,
    ) -> tuple[np.ndarray, Tensor | None]:
        """See `_Policy`."""
        output, columns = self._network.forward(torch.from_numpy(observations), memory)
        command = (output.policy.mode() - torch.from_numpy(change)).abs()
        after = self._network.next_state(columns, memory, command)
        return command.double().numpy(), after


class _ControllerPolicy:
    """A controller without training, with methods ``memory`` and ``recall``, which reads states and goals."""

    def __init__(self, controller: Any) -> None:
        self._controller = controller

    def initial_state(self, count: int) -> np.ndarray:
        """See `_Policy`."""
        self._controller.reset(count)
        return self._controller.memory()

    def repeated(self, memory: np.ndarray, count: int) -> np.ndarray:
        """See `_Policy`."""
        return np.repeat(memory, count, axis=0)

    def chosen(self, memory: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """See `_Policy`."""
        return memory[rows]

    def commands(
        self,
        state: Any,
        goal: Any,
        observations: np.ndarray,
        memory: np.ndarray,
        change: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `_Policy`."""
        self._controller.recall(memory)
        command = np.abs(self._controller.act(state, goal, observations) - change)
        return command, self._controller.memory()


class Lookahead:
    """An agent or controller that compares its own commands with one change of a thruster in one period.

    >>> from rans_lookahead.lookahead import ArrivalCost, Lookahead
    >>> Lookahead(rans.load_agent("go-to-pose-2d"), horizon=4.0)
    <Lookahead: go-to-pose-2d, 4 s ahead>
    >>> Lookahead(rans.load_agent("lqr:go-to-pose-2d"), arrival=ArrivalCost())
    <Lookahead: LQR, 8 s ahead>

    It simulates every change, with its own commands in all other periods, without randomization and from the state
    as sensors read it. If the best change is one of this period, it opens a shut thruster or shuts an open one; if
    it is a later one, or none is better, it changes nothing. That is one step of policy improvement, the rollout
    algorithm (Bertsekas, Tsitsiklis and Wu, "Rollout algorithms for combinatorial optimization", J. Heuristics 3,
    1997). The best flight ends in the goal set with the least `ArrivalCost`; without a cost of arrival, it has the
    largest undiscounted return of the task.

    Args:
        run: an agent, or a controller with ``memory`` and ``recall`` (`rans.LQR`, `rans.Switching`, `rans.MPC`
            and `rans.VelocityToGain` have them), with its setup; the conditions are not used.
        horizon: length of simulations, s, rounded up to whole control periods.
        change_within: latest time of a change, s, rounded up likewise.
        arrival: prices of a flight; None: the task's rewards count.

    Raises:
        ConfigError: a controller has no methods memory and recall, an agent has a trade-off that is not fixed,
            thrusters are not on/off, or the horizon or the latest time of a change is no finite number > 0.
    """

    slow = True
    """Episodes are flown by several processes."""

    def __init__(
        self,
        run: object,
        horizon: float = HORIZON,
        change_within: float = CHANGE_WITHIN,
        arrival: ArrivalCost | None = None,
    ) -> None:
        loaded = run_of(run)
        if loaded is None:
            raise ConfigError(
                "look-ahead takes the result of rans.load_agent, as in Lookahead("
                f"rans.load_agent('go-to-pose-2d')), got {brief(run)}."
            )
        if arrival is not None:
            checked("arrival", arrival, ArrivalCost)
        agent = loaded.controller
        craft = loaded.craft
        task = loaded.task
        timing = loaded.timing
        _check_subject(agent, craft, task)
        for what, seconds in (
            ("the horizon", horizon),
            ("the time that changes come within", change_within),
        ):
            if not (is_finite(seconds) and seconds > 0):
                raise ConfigError(f"{what} must be finite and > 0 s, got {seconds!r}.")
        # What flies, with a fixed trade-off as further columns of the observation.
        self._trade_off = np.zeros((1, 0), np.float32)
        """Columns of a fixed trade-off, which follow the other columns of the observation."""
        if task.held_trade_off is not None:
            self._trade_off = np.full((1, 1), task.held_trade_off, np.float32)
            task = task.plain()
        self.name = f"{LOOKAHEAD}:{agent.name}"
        self._horizon = horizon
        self.arrival = arrival
        self._run = loaded
        self._policy: _Policy = (
            _AgentPolicy(agent) if isinstance(agent, Agent) else _ControllerPolicy(agent)
        )
        self._world = World(Setup(craft, task, timing))
        self._periods, last = (
            math.ceil(s / timing.control_period - 1e-9)
            for s in (horizon, min(change_within, horizon))
        )
        forces = np.array([thruster.force for thruster in craft.thrusters])
        self._shares = forces / forces.sum()
        count = len(forces)
        # (periods, choices, thrusters): no change, then one thruster in one of the periods.
        self._changes = np.zeros((self._periods, 1 + last * count, count), np.float32)
        for period in range(last):
            self._changes[period, 1 + period * count :][:count] = np.eye(count)
        self.reset(0)

    def __repr__(self) -> str:
        return f"<Lookahead: {self.name.removeprefix(f'{LOOKAHEAD}:')}, {self._horizon:g} s ahead>"

    @property
    def run(self) -> LoadedRun:
        """The run with this controller in place of its own."""
        return self._run._replace(controller=self)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; an agent with a memory forgets."""
        self._memory = self._policy.initial_state(count)
        self._last = np.zeros((count, len(self._shares)))
        self._been = np.zeros(count, dtype=bool)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; reads the observation and the state."""
        count = len(observation)
        choices = self._changes.shape[1]
        if self._trade_off.size:  # A fixed trade-off is in no goal.
            goal = replace(goal, notes=None)
        if self.arrival is not None:
            self._been |= arrived(self._world.task, state, goal)
        # Every episode is repeated for each choice, of which the first is no change.
        memory = self._policy.repeated(self._memory, choices)
        states, goals = (map_leaves(lambda x: np.repeat(x, choices), s) for s in (state, goal))
        observations = np.repeat(observation, choices, axis=0)
        command, after = self._changed(states, goals, observations, memory, 0)
        worth = self._earned if self.arrival is None else self._spared
        best = worth(states, goals, command, after).reshape(count, choices).argmax(axis=1)
        best += np.arange(count) * choices
        self._memory = self._policy.chosen(after, best)
        self._last = command[best]
        return self._last

    def _changed(
        self, state: Any, goal: Any, observation: np.ndarray, memory: Any, period: int
    ) -> tuple[np.ndarray, Any]:
        """Commands (M, thrusters) of a simulated period with each choice's change, and the memory after it."""
        change = np.tile(self._changes[period], (len(observation) // self._changes.shape[1], 1))
        return self._policy.commands(state, goal, observation, memory, change)

    def _earned(self, state: Any, goal: Any, command: np.ndarray, memory: Any) -> np.ndarray:
        """Return (M,) of simulations that begin with commands (M, thrusters), from the memory after them."""
        earned = np.zeros(len(command))
        lost = np.zeros(len(command), dtype=bool)
        for outcome in self._ahead(state, goal, command, memory):
            earned += np.where(lost, 0.0, paid(outcome.terms, outcome.terminated)[1])
            lost |= outcome.terminated
        return earned

    def _spared(self, state: Any, goal: Any, command: np.ndarray, memory: Any) -> np.ndarray:
        """Negative cost of arrival (M,) of the same simulations; -inf if a change does not end in the goal set."""
        assert self.arrival is not None
        task = self._world.task
        bounds = self._world.task.tolerances()
        spared = np.zeros(len(command))
        been = arrived_now = np.repeat(self._been, self._changes.shape[1])
        for outcome in self._ahead(state, goal, command, memory):
            now = outcome.episode.state, outcome.episode.goal
            been = been | arrived(task, *now)
            arrived_now = been & outcome.reached
            errors = task.errors(*now)
            spared -= self.arrival.cost(
                np.stack(outcome.command, axis=1) @ self._shares,
                arrived_now,
                {name: errors[name] / bound for name, bound in bounds.items()},
            )
        own = np.arange(len(command)) % self._changes.shape[1] == 0
        return np.where(arrived_now | own, spared, -math.inf)

    def _ahead(self, state: Any, goal: Any, command: np.ndarray, memory: Any) -> Iterator[Outcome]:
        """Outcomes of the periods of simulations that begin with commands (M, thrusters)."""
        now = self._world.begin(state, goal)
        if now.commands:  # The reward reads the previous command.
            now = replace(
                now, commands=(tuple(np.repeat(self._last, self._changes.shape[1], axis=0).T),)
            )
        for period in range(1, self._periods + 1):
            outcome = step(self._world, now, tuple(command.T))
            yield outcome
            now = outcome.episode
            if period < self._periods:
                observation = np.stack(self._world.observe(now), axis=1).astype(np.float32)
                observation = np.hstack(
                    (observation, self._trade_off.repeat(len(observation), axis=0))
                )
                command, memory = self._changed(now.state, now.goal, observation, memory, period)


def looking_ahead(run: LoadedRun) -> Lookahead:
    """Look-ahead of a contestant, with the default cost of arrival or with the task's rewards.

    The cost of arrival is for agents with a reward for arriving, and for controllers of tasks that ask for rest.
    """
    if isinstance(run.controller, Agent):
        arriving = getattr(run.task, "arrived", RestReward()).weight > 0
    else:
        arriving = asks_rest(run.task)
    return Lookahead(run, arrival=ArrivalCost() if arriving else None)


def _check_subject(agent: Any, craft: Spacecraft, task: Task) -> None:
    """Refuse agents, spacecraft and tasks of which single thrusters cannot be opened and shut ahead."""
    if not isinstance(agent, Agent) and not all(
        callable(getattr(agent, need, None)) for need in ("memory", "recall")
    ):
        raise ConfigError(
            f"{agent.name} cannot look ahead: it has no methods memory and recall, by which a flight goes "
            "on from an instant in several ways, as rans.LQR has."
        )
    if task.draws_trade_off:
        raise ConfigError(
            f"{agent.name} cannot look ahead: it has a trade-off; fix it, as in "
            f"{LOOKAHEAD}:{agent.name}#0.5."
        )
    if craft.actuators != ON_OFF:
        raise ConfigError(
            f"{agent.name} cannot look ahead: it would open and shut single thrusters, and "
            f"those of {craft.name} are {craft.actuators.kind}."
        )
    if not craft.has_only_thrusters:
        others = "reaction wheels" if craft.wheels else "effectors of other kinds"
        raise ConfigError(
            f"{agent.name} cannot look ahead: {craft.name} has {others}, and it would open and shut single "
            "thrusters."
        )
