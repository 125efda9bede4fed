"""Latencies, masses and sensor noise that an agent tolerates around its training conditions, for its export."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import radians
from operator import attrgetter
from typing import Any, Literal, NamedTuple

import numpy as np

from rans.episode import Setup
from rans.evaluation.fly.episodes import fly_draws
from rans.evaluation.stress.effects import applicable_effects
from rans.evaluation.stress.outcome import WANTED
from rans.flight import Controller
from rans.model.fields import Field
from rans.model.random import Draws, Random
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions, bounds
from rans.randomization.parameters import MIXTURE
from rans.scenario import EVALUATION_SEED, draws

Measure = Callable[[Sequence[Conditions]], list[float]]
"""Share of the flights that are solved, under each of several conditions."""


class SheetQuantity(NamedTuple):
    """A setting of conditions that a data sheet of a robot answers."""

    name: str
    unit: str
    factor: float
    """Unit, in that of the setting."""
    nominal: float
    path: tuple[str, ...]
    """Names of the setting and of what holds it, from the outside."""
    effects: tuple[str, ...]
    """Effects of `rans stress` whose sizes are flown."""


QUANTITIES = (
    SheetQuantity("latency", "s", 1.0, 0.0, ("thrusters", "latency"), ("latency",)),
    SheetQuantity("mass", "times", 1.0, 1.0, ("body", "mass"), ("less mass", "more mass")),
    *(
        SheetQuantity(
            f"noise of {name}", unit, factor, 0.0, ("sensors", name, "noise"), (f"noise of {name}",)
        )
        for name, unit, factor in (
            ("position", "cm", 0.01),
            ("attitude", "degrees", radians(1.0)),
            ("velocity", "cm/s", 0.01),
            ("spin", "degrees/s", radians(1.0)),
        )
    ),
)


def measure_margins(controller: Controller, setup: Setup, flights: int) -> dict[str, Any]:
    """Interval of each `SheetQuantity` in which an agent solves its task, everything else as in its training.

    Every value has the same starts, those of ``rans stress``: of an agent that was trained with everything as
    designed both find the same limits. A mixture stays one: a quantity has its value in each of its parts.

    Args:
        controller: agent.
        setup: what it is evaluated in, with the conditions of its training.
        flights: flights of each value of each quantity.

    Returns:
        See `margins_around`; also "flights" and "seed".
    """

    def measure(several: Sequence[Conditions]) -> list[float]:
        """Shares solved under each of several conditions, flown together as a mixture of equal weights."""
        parts = [
            replace(part, others=(), weight=part.weight / sum(variant.weight for variant in every))
            for level in several
            for every in [(level, *level.others)]
            for part in every
        ]
        mixed = replace(parts[0], others=tuple(parts[1:]))
        own = _under_each(draws(EVALUATION_SEED, flights), len(several))
        flight = fly_draws(controller, setup._replace(conditions=mixed), own)
        shares = flight.verdict.solved.reshape(len(several), flights).mean(axis=1)
        return [float(one) for one in shares]

    conditions = setup.conditions or Conditions()
    margins = margins_around(conditions, setup.craft, setup.timing, measure)
    return {"flights": flights, "seed": EVALUATION_SEED} | margins


@dataclass(frozen=True)
class _UnderEach(Draws):
    """Draws of the same episodes under each of several conditions, which are the parts of a mixture."""

    level: Any
    """Number of each episode's conditions, (N,)."""
    levels: int
    """Number of conditions."""

    def random(self, dimension: Literal[2, 3], number: Field, block: Field = 0) -> Random:
        """See `Draws`; the random number that selects from the mixture is within the share of the episode's own."""
        if not (isinstance(block, int) and block == MIXTURE):
            return super().random(dimension, number, block)
        chance = (self.level + super().random(dimension, number, block).unit()) / self.levels
        return _Selected(chance, dimension, self.low, self.high, number, self.dtype, block)


class _Selected(Random):
    """Random numbers of which the uniform ones are known.

    Args:
        chance: (N,) uniform number.
        *arguments: see `Random`.
    """

    def __init__(self, chance: Field, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._chance = chance

    def unit(self) -> Field:
        """See `Random`."""
        return self._chance


def _under_each(own: Draws, levels: int) -> _UnderEach:
    """Draws of episodes, (N,), under each of so many conditions one after the other, (levels N,)."""
    level = np.repeat(np.arange(levels), len(own.first))
    first = np.tile(own.first, levels)
    return _UnderEach(own.low, own.high, first, own.stride, own.dtype, level, levels)


def margins_around(
    conditions: Conditions, craft: Spacecraft, timing: Timing, measure: Measure
) -> dict[str, Any]:
    """Interval of each `SheetQuantity` around training conditions in which enough flights are solved.

    Keys are an interface of contracts and cards.

    Args:
        conditions: of the training. Under them everything is flown but the quantity whose values are tried.
        craft: spacecraft.
        timing: control period.
        measure: shares of the flights that are solved.

    Returns:
        "wanted_share", at least which must be solved; "training" and "nominal", the shares solved under the
        training conditions and with everything as designed; and by quantity its "unit", the range
        "of_training", "held", the share by value, and "holds": least and largest value of the interval around
        the middle of the training's range in which enough are solved at every value flown, None if they are not
        in the middle.
    """
    sizes = {
        disturbance.name: disturbance.sizes for disturbance in applicable_effects(craft, timing)
    }
    grids = dict[str, list[float]]()
    ranges = dict[str, tuple[float, float]]()
    for margin in QUANTITIES:
        pairs = [
            bounds(attrgetter(".".join(margin.path))(part))
            for part in (conditions, *conditions.others)
        ]
        low = min(pair[0] for pair in pairs) / margin.factor
        high = max(pair[1] for pair in pairs) / margin.factor
        ranges[margin.name] = low, high
        magnitudes = [size for effect in margin.effects for size in sizes[effect]]
        values = (low, (low + high) / 2.0, high, margin.nominal, *magnitudes)
        grids[margin.name] = sorted({_rounded(value) for value in values})

    tried = {
        (quantity.name, value): _changed(conditions, quantity.path, value * quantity.factor)
        for quantity in QUANTITIES
        for value in grids[quantity.name]
    }
    # Equal conditions of several quantities fly once.
    several = list(dict.fromkeys([conditions, *tried.values()]))
    rates = dict(zip(several, measure(several), strict=True))
    perfect = Conditions()
    if perfect not in rates:  # apart: a mixture may differ in ranges only
        rates |= zip([perfect], measure([perfect]), strict=True)

    # Intervals around the training in which enough flights are solved.
    result: dict[str, Any] = {
        "wanted_share": WANTED,
        "training": round(rates[conditions], 4),
        "nominal": round(rates[perfect], 4),
    }
    for margin in QUANTITIES:
        values = grids[margin.name]
        low, high = ranges[margin.name]
        held = [rates[tried[margin.name, value]] for value in values]
        middle = values.index(_rounded((low + high) / 2.0))
        result[margin.name] = {
            "unit": margin.unit,
            "of_training": [_rounded(low), _rounded(high)],
            "holds": _around(middle, values, held),
            "held": {f"{x:g}": round(y, 4) for x, y in zip(values, held, strict=True)},
        }
    return result


def margin_lines(margins: dict[str, Any], is_foreign: bool = False) -> list[str]:
    """What a user of the agent should know of its margins, in a few lines.

    Of another library's policy the training is not known: its margins are those around everything as designed.
    """
    if is_foreign:
        rate = margins["nominal"]
        lines = [f"Holds its goal in {rate:.1%} of flights with everything as designed."]
        if rate >= margins["wanted_share"]:
            lines.append(_tolerated(margins, "as designed"))
        else:
            lines.append(
                f"Warning: below {margins['wanted_share']:.0%}; it tolerates nothing that is measured."
            )
        return lines
    lines = [
        f"Solves {margins['training']:.1%} of flights under its training conditions, and in "
        f"{margins['nominal']:.1%} with everything as designed."
    ]
    lines.append(_tolerated(margins, "as in the training"))
    for name, where in (
        (
            "training",
            "under the conditions of its own training: train it longer, or in milder ones",
        ),
        (
            "nominal",
            "with everything as designed: its training left that out. Train with ranges that reach it, "
            "such as latency = [0.0, 0.05], if your robot may be so",
        ),
    ):
        if not margins[name] >= margins["wanted_share"]:
            lines.append(f"Warning: it solves only {margins[name]:.1%} of flights {where}.")
            break  # what it has not learnt, its training did not leave out
    return lines


def _tolerated(margins: dict[str, Any], rest: str) -> str:
    """Sentence with the interval of each quantity in which enough flights are solved, all else being ``rest``."""
    parts = []
    for quantity in QUANTITIES:
        holds = margins[quantity.name]["holds"]
        if holds is None:
            interval = "nowhere"
        elif not any(holds):
            interval = "none"  # not even the smallest that is tried
        else:
            interval = f"{holds[0]:g} to {holds[1]:g} {quantity.unit}"
        parts.append(f"{quantity.name} {interval}")
    return (
        f"At least {margins['wanted_share']:.0%} solved, all else {rest}, at: {'; '.join(parts)}."
    )


def _around(middle: int, values: Sequence[float], held: Sequence[float]) -> list[float] | None:
    """First and last of the values around the middle one, without a gap, at which enough flights are solved.

    An island beyond a gap does not count, since a robot may be in the gap.
    """
    if not held[middle] >= WANTED:
        return None
    first = last = middle
    while first > 0 and held[first - 1] >= WANTED:
        first -= 1
    while last < len(values) - 1 and held[last + 1] >= WANTED:
        last += 1
    return [values[first], values[last]]


def _rounded(value: float) -> float:
    """A value that two ways of computing it agree on."""
    return float(f"{value:.6g}")


def _changed(conditions: Conditions, path: Sequence[str], value: float) -> Conditions:
    """Conditions, and all of their mixture, with one setting at a value."""

    def replaced(part: Any, path: Sequence[str]) -> Any:
        inner = value if len(path) == 1 else replaced(getattr(part, path[0]), path[1:])
        return replace(part, **{path[0]: inner})

    changed = replaced(conditions, path)
    return replace(changed, others=tuple(replaced(part, path) for part in conditions.others))
