"""Commands by a value function: patterns of open valves with the least cost of some periods and the value after."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from rans.extend import fused
from rans.fast.learn.graph import graphed
from rans_value.problem import PoseProblem

_TRIED = 16
"""Patterns of open valves that are tried, of those whose valves alone promise the least cost. Of more than eight
thrusters as many as a quarter of their square: valves that are good only together promise little alone."""
_CHUNK = 65536
"""States and commands whose outcomes are computed at once on a GPU, by one recorded function of one size."""
_AHEAD = 4
"""Patterns after which a further period is searched."""
_LEVELS = (0.5, 0.25, 0.1)
"""Parts of the first `_AHEAD` patterns that are tried too where thrusters are throttled or pulsed. Commands of
least time or impulse open them wholly; holding a pose, or a spin between two pulses, takes less."""
_TORQUES = (-1.0, -0.5, -0.15, 0.15, 0.5, 1.0)
"""Torques of each wheel, of its largest, that are tried with the first `_AHEAD` patterns too."""


class Greedy:
    """Commands by a value function: the pattern of open valves with the least cost of a period and the value after.

    Costs of opening each thruster alone order the patterns, of which the first are tried.

    Args:
        problem: the flights.
        value: their value function.
        arriving: for flights that are not in the goal set yet. Holding it counts as much as their trade-off says:
            fast ones are there as soon as can be, thrifty ones do not come in faster than is cheap to hold.
    """

    def __init__(self, problem: PoseProblem, value: Any, arriving: bool = False) -> None:
        self.problem = problem
        self.value = value
        self._arriving = arriving
        device = value.mean.device
        count = problem.craft.thruster_count
        size = problem.craft.command_count
        self._single = torch.eye(size + 1)[: count + 1, 1:].to(device)
        wheels = torch.eye(size)[count:]
        self._turns = torch.cat([torque * wheels for torque in _TORQUES]).to(device)
        self._patterns = problem.patterns.to(device)
        # Open valves share what a shared supply gives, and so what each promises.
        self._shares = problem.mean_thrust(self._patterns).T
        self._count = min(max(_TRIED, count**2 // 4), len(self._patterns))
        self._whole = self._count + _AHEAD * len(self._turns)
        # On a GPU inputs are at addresses that stay, as launches would take longer than the computation.
        self._inputs: tuple[Tensor, ...] = ()
        if device.type == "cuda":
            shapes = ((problem.rows, _CHUNK), (_CHUNK, size))
            self._inputs = tuple(torch.zeros(shape, device=device) for shape in shapes)
        compiled = fused(self._outcome, device)
        self._recorded = graphed(lambda: compiled(*self._inputs), device)

    def _outcome(self, state: Tensor, command: Tensor) -> Tensor:
        after, cost, discount = self.problem.step(state, command)
        value = self.value(after)
        if self._arriving:
            value = value * torch.where(self.problem.inside(after)[1], state[-1], 1.0)
        return torch.cat((torch.stack((cost + discount * value, cost, discount)), after))

    def outcomes(self, state: Tensor, patterns: Tensor) -> Tensor:
        """What patterns (C, N, n) or (C, 1, n) do in a period from states (rows, N), (3 + rows, C, N).

        Rows are the cost with the value after the period, s, the cost of the period, s, its discount, and the
        states after it.
        """
        count = state.shape[1]
        each = state[:, None].expand(-1, len(patterns), -1).flatten(1)
        command = patterns.expand(-1, count, -1).flatten(0, 1)
        if not self._inputs:
            return self._outcome(each, command).unflatten(1, (len(patterns), count))
        parts = []
        for states, commands in zip(each.split(_CHUNK, dim=1), command.split(_CHUNK), strict=True):
            self._inputs[0][:, : len(commands)] = states
            self._inputs[1][: len(commands)] = commands
            parts.append(self._recorded()[:, : len(commands)].clone())
        return torch.cat(parts, dim=1).unflatten(1, (len(patterns), count))

    def tried(self, state: Tensor, periods: int) -> tuple[Tensor, Tensor]:
        """Patterns (C, N, n) from states (rows, N), and their `outcomes`, the costs over some periods.

        The best are searched further than a period. All others are moved by the mean of what that changes, and are
        no better than these.
        """
        costs = self.outcomes(state, self._single[:, None])[0]
        # A row of memory for each state, as thousands of patterns are compared.
        order = (costs[1:] - costs[:1]).T @ self._shares.T
        patterns = self._patterns[order.topk(self._count, dim=1, largest=False).indices.T]
        turned = patterns[:_AHEAD, None] + self._turns[:, None]
        patterns = torch.cat((patterns, turned.flatten(0, 1)))
        if self.problem.craft.actuators.is_continuous:
            parts = [level * patterns[:_AHEAD] for level in _LEVELS]
            patterns = torch.cat((patterns, *parts))
        outcomes = self.outcomes(state, patterns)
        if periods > 1:
            costs = outcomes[0]
            best = costs.topk(min(_AHEAD, len(costs)), dim=0, largest=False).indices
            _, first = _taken(patterns, outcomes, best)
            rest = self.best(first[3:].flatten(1), periods - 1)[1][0]
            ahead = first[1] + first[2] * rest.view_as(first[1])
            costs = costs + (ahead - first[0]).mean(dim=0)
            outcomes[0] = torch.maximum(costs, ahead.amax(dim=0)).scatter(0, best, ahead)
        return patterns, outcomes

    def best(self, state: Tensor, periods: int) -> tuple[Tensor, Tensor]:
        """Patterns (N, n) of least cost over some periods, and their `outcomes` (3 + rows, N)."""
        patterns, outcomes = self.tried(state, periods)
        chosen = outcomes[0].argmin(dim=0, keepdim=True)
        patterns, outcomes = _taken(patterns, outcomes, chosen)
        return patterns[0], outcomes[:, 0]

    def label(self, state: Tensor) -> tuple[Tensor, Tensor]:
        """Patterns (C, N, n) of valves wholly open, and costs of two periods above that of the best, (C, N), s."""
        patterns, outcomes = self.tried(state, 2)
        costs = outcomes[0, : self._whole]
        return patterns[: self._whole], costs - costs.amin(dim=0)


def _taken(patterns: Tensor, outcomes: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
    """Patterns (A, N, n) and outcomes (rows, A, N) at indices (A, N), of all patterns (C, N, n)."""
    return (
        patterns.gather(0, index[..., None].expand(-1, -1, patterns.shape[2])),
        outcomes.gather(1, index.expand(len(outcomes), -1, -1)),
    )
