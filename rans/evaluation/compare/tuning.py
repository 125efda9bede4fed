"""Tuning of controllers that need no training, by random search with a stated budget."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Mapping

import numpy as np

from rans.base.errors import ConfigError
from rans.base.progress import Progress, unseen
from rans.episode.scenario import TUNING_SEED
from rans.episode.step import Setup
from rans.evaluation.compare.contest import Contest, Contestant, Entry
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.evaluation.fly.tuned import Tuned, arguments, defaults, task_name, text_of_conditions
from rans.model.spacecraft_file import to_toml

_WIDE = 1 / 3
"""Share of the candidates that are drawn from the whole ranges; the others are close to the best so far."""
_STEPS = (0.3, 0.03)
"""Standard deviations of these, as shares of the logarithmic range: of the first and the last."""
_CHANGED = 0.4
"""Probability that a setting changes."""

Ranges = Mapping[str, tuple[float, float]]


def tuned_settings(
    name: str,
    setup: Setup,
    candidates: int,
    starts: int,
    price: float,
    command: str = "",
    progress: Progress = unseen,
    seconds: float = math.inf,
) -> Tuned:
    """Tune a controller: search settings with the least `cost` under the setup's conditions.

    The default settings are the first candidate, so that the result is never worse. An interrupt ends the search
    with the best settings so far.

    Args:
        name: name of the controller.
        setup: spacecraft, task with its starts, timing and conditions.
        candidates: number of settings that are flown.
        starts: number of starts, scenarios 0 to N - 1 of `TUNING_SEED`, which no report uses.
        price: price of thrust, s per N s.
        command: command line, for the record.
        progress: reports candidates.
        seconds: processor time after which no further candidate is flown, s, so that slow and quick controllers can
            have the same budget.

    Raises:
        ConfigError: the controller has no ``tunable``, or cannot fly this craft; the price is negative,
            or the time not positive.
    """
    if not seconds > 0:
        raise ConfigError(f"--seconds must be > 0 s of processor time, got {seconds}.")
    if not (math.isfinite(price) and price >= 0):
        raise ConfigError(f"the price must be finite and >= 0 s per N s, got {price}.")
    maker = CONTROLLERS[name]
    craft, task, timing, _, _ = setup
    contest = Contest(craft, task, timing, TUNING_SEED, starts, conditions=setup.conditions)
    within = ranges(name)
    results: list[tuple[float, dict[str, float]]] = []
    random = np.random.default_rng(TUNING_SEED)
    begun = _processor_time()
    # Candidates: the defaults first, then samples that close in on the best as the budget is spent.
    # First anywhere, then near the best (`_candidate`), until candidates or seconds are over.
    for number in range(candidates):
        spent = _processor_time() - begun
        if results and spent >= seconds:
            break
        gone = max(number / candidates, spent / seconds)
        settings = _candidate(gone, defaults(maker, within), within, results, random)
        tuned = maker(craft, task, timing, **arguments(maker, settings))
        try:
            flight = contest.fly(tuned)
        except KeyboardInterrupt:
            if not results:
                raise
            break
        results.append((cost(Entry(Contestant(name, tuned, "", ""), flight), price), settings))
        progress(1)
    least, best = min(results, key=lambda pair: pair[0])
    return Tuned(
        controller=name,
        task=task_name(task),
        tolerances=dict(task.tolerances()),
        control_period=timing.control_period,
        spacecraft=to_toml(craft),
        settings=best,
        candidates=len(results),
        starts=starts,
        seed=TUNING_SEED,
        price=price,
        costs={"default": results[0][0], "tuned": least},
        command=command,
        conditions=text_of_conditions(setup),
        seconds=_processor_time() - begun,
    )


def _processor_time() -> float:
    """Processor time of this process and of those that it has waited for, s."""
    waited_for = os.times()
    return time.process_time() + waited_for.children_user + waited_for.children_system


def ranges(name: str) -> Ranges:
    """Ranges of the settings of a controller, by "argument.field".

    Raises:
        ConfigError: the controller has no ``tunable``.
    """
    result = getattr(CONTROLLERS[name], "tunable", None)
    if not result:
        raise ConfigError(
            f"the controller {name!r} has no settings that can be tuned; its class needs a "
            '`tunable` such as {"weights.position": (0.1, 3.0)}.'
        )
    return result


def cost(entry: Entry, price: float) -> float:
    """Mean over starts, s: half the settling time, half the time to rest in the goal set, and priced thrust.

    A time of an event that never happens counts as twice the episode.
    """
    times = np.minimum([entry.settling, entry.arrival], 2.0 * entry.flight.times[-1])
    return float(times.mean() + price * entry.thrust.mean())


def _candidate(
    fraction: float,
    first: dict[str, float],
    within: Ranges,
    flown: list[tuple[float, dict[str, float]]],
    random: np.random.Generator,
) -> dict[str, float]:
    """Settings after a share of the search: the default ones, any, then ever closer to the best so far.

    It draws once for each candidate but the first; ``fraction`` decides how far from the best.
    """
    if not flown:
        return first
    low, high = np.log(list(within.values())).T
    if fraction < _WIDE:
        chosen = random.uniform(low, high)
    else:
        begin, end = _STEPS
        step = begin + (fraction - _WIDE) / (1.0 - _WIDE) * (end - begin)
        _, best = min(flown, key=lambda pair: pair[0])
        change = random.normal(scale=step, size=len(low)) * (random.random(len(low)) < _CHANGED)
        chosen = np.log(list(best.values())) + change * (high - low)
    values = np.exp(np.clip(chosen, low, high))
    return {
        key: round(value) if isinstance(first[key], int) else float(f"{value:.3g}")
        for key, value in zip(within, values, strict=True)
    }
