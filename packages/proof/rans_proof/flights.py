"""Simulated flights of a problem: their margins, and the search for a start whose flight breaks the property."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rans_proof.network import Layer, apply
from rans_proof.problem import Problem

_SUBSTEPS = 4
"""Runge-Kutta steps of order 4 of a control period."""
_SAMPLES = 1000
"""Starts of a search, half of them at corners."""
_BEST = 10
"""Starts around which it goes on."""
_ROUNDS = 3, 30
"""Rounds of the local search at least and most, whose steps become smaller from a quarter to a thousandth of the
range."""
_PERIODS = 1000
"""Control periods of all rounds together, some seconds."""


def lowest_margins(problem: Problem, layers: Sequence[Layer], start: np.ndarray) -> np.ndarray:
    """Lowest margins (N,) of simulated flights from starts (N, n), by Runge-Kutta steps of order 4.

    That of a flight which leaves the range of numbers is minus infinity.
    """
    least = np.full(len(start), np.inf)
    at_end = np.full(len(start), -np.inf)
    for number, states in enumerate(path(problem, layers, start)):
        period, part = divmod(number, _SUBSTEPS)
        if problem.keep is not None and period >= problem.begins:
            least = np.minimum(least, problem.keep.margins(states))
        if problem.end is not None and part == 0 and period >= (problem.earliest or problem.steps):
            at_end = np.maximum(at_end, problem.end.inside().margins(states))
    least = least if problem.end is None else np.minimum(least, at_end)
    return np.nan_to_num(least, nan=-np.inf, posinf=np.inf, neginf=-np.inf)


def path(problem: Problem, layers: Sequence[Layer], start: np.ndarray) -> list[np.ndarray]:
    """States (N, n) at the start and after each Runge-Kutta step of flights from starts (N, n).

    For the search only: a flight that breaks the property here is flown again by the checker before it counts.
    """
    h = problem.period / _SUBSTEPS
    inputs = problem.network_inputs()
    x = start
    states = [x]
    with np.errstate(all="ignore"):  # a flight may leave the range of numbers
        for _ in range(problem.steps):
            taken = x if inputs is None else x @ inputs[0].T + inputs[1]
            u = list(apply(list(layers), taken).T)

            def rate(state: np.ndarray, held: Sequence[np.ndarray] = u) -> np.ndarray:
                rates = np.empty_like(state)
                for column, value in enumerate(problem.rates(list(state.T), held)):
                    rates[:, column] = value
                return rates

            for _ in range(_SUBSTEPS):
                k1 = rate(x)
                k2 = rate(x + 0.5 * h * k1)
                k3 = rate(x + 0.5 * h * k2)
                k4 = rate(x + h * k3)
                x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
                states.append(x)
    return states


def at_decisions(problem: Problem, layers: Sequence[Layer], start: np.ndarray) -> np.ndarray:
    """States (steps + 1, n) at the control instants of the flight from one start (n,)."""
    return np.concatenate(path(problem, layers, start[None])[::_SUBSTEPS])


def worst_start(problem: Problem, layers: Sequence[Layer]) -> tuple[np.ndarray, float]:
    """The start (n,) of the flight with the lowest margin that a search finds, and this margin.

    Random starts and corners come first; around the worst of them it goes on with random steps. Random numbers have
    a fixed seed.
    """
    random = np.random.default_rng(0)
    low = np.array(problem.lower)
    high = np.array(problem.upper)
    start = random.uniform(low, high, (_SAMPLES, problem.states))
    start[::2] = np.where(random.random(start[::2].shape) < 0.5, low, high)
    margins = lowest_margins(problem, layers, start)
    rounds = int(np.clip(_PERIODS // problem.steps, *_ROUNDS))
    for size in np.geomspace(0.25, 0.001, rounds):
        best = np.argsort(margins)[:_BEST]
        start = start[best]
        margins = margins[best]
        if margins[0] < 0.0:
            break
        steps = size * (high - low) * random.normal(size=(10, *start.shape))
        more = np.clip(start + steps, low, high).reshape(-1, problem.states)
        start = np.concatenate((start, more))
        margins = np.concatenate((margins, lowest_margins(problem, layers, more)))
    worst = int(margins.argmin())
    return start[worst], float(margins[worst])
