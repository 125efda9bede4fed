"""Flights from given random numbers, for the search for the worst case.

Everything that an episode draws once (start, goal, body, push ...) is a function of uniform numbers in [0, 1),
which are given here. Numbers that sensors draw in every step follow from the number of the episode as usual.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

import numpy as np

from rans.extend import Draws, Field, Random, Setup, World, bounds, floor
from rans.randomization.sensors import PER_STEP
from rans.structure import is_range

Slot = tuple[int, int]
"""A uniform number, by its block and its index in the block."""
_UNSIZED = ("count", "share", "time")
"""Ranges of numbers, kinds and times of faults, which have no size."""


class Sized(tuple[float, float]):
    """A range with its nominal value, about which it can be widened or narrowed."""

    nominal: float
    name: str
    """Name of its setting, such as thrusters.latency."""

    @classmethod
    def of(cls, values: Any, nominal: float | None, name: str = "") -> Sized:
        """Make one from a range, and the default and the name of its setting."""
        new = cls(bounds(values))
        new.nominal = new[0] if nominal is None else nominal
        new.name = name
        return new


def sized(conditions: Any, prefix: str = "") -> Any:
    """Conditions whose ranges are `Sized` where they differ from a perfect world's; `_Given` scales only these.

    A size of 1 gives the conditions as they are, and 0 a perfect world.
    """
    perfect = type(conditions)()
    changed = {}
    for condition in fields(conditions):
        value = getattr(conditions, condition.name)
        usual = getattr(perfect, condition.name)
        if is_dataclass(value):
            changed[condition.name] = sized(value, f"{prefix}{condition.name}.")
        elif is_range(condition) and value != usual and condition.name not in _UNSIZED:
            changed[condition.name] = Sized.of(value, usual, f"{prefix}{condition.name}")
    return replace(conditions, **changed)


@dataclass(frozen=True)
class Chosen(Draws):
    """Random numbers of N episodes, most of which are given."""

    given: Mapping[Slot, Field] = field(default_factory=dict)
    """Uniform numbers in [0, 1), (N,) each; one that is missing raises a KeyError."""
    size: Field = None
    """Factor on `Sized` ranges: 1 leaves them as they are, 0 makes all nominal. None: 1."""
    noted: dict[str, list[Field]] = field(default_factory=dict)
    """What was drawn from `Sized` ranges so far, with the factor, by the names of their settings."""

    def random(self, dimension: Any, number: Field, block: Field = 0) -> Random:
        """See `Draws.random`."""
        if isinstance(block, int) and block < PER_STEP:
            return _Given(self, dimension, number, block)
        return super().random(dimension, number, block)


class _Given(Random):
    def __init__(self, draws: Chosen, dimension: Any, number: Field, block: int) -> None:
        super().__init__(dimension, draws.low, draws.high, number, draws.dtype, block)
        self._draws = draws
        self._at = (block, 0)

    def unit(self) -> Field:
        """The next of the given numbers."""
        block, index = self._at
        self._at = block, index + 1
        return self._draws.given[block, index]

    def within(self, values: Any) -> Field:
        """Number within a range, see `Random.within`; a range of one value takes no random number.

        It draws as `Random.within` does, one number or none, so that places of numbers are the same for every size.
        """
        low, high = bounds(values)
        return self._sized(low if low == high else low + (high - low) * self.unit(), values)

    def whole(self, values: Any) -> Field:
        """Whole number within a range, see `Random.whole`."""
        low, high = bounds(values)
        value = low if low == high else super().whole(values)
        return self._sized(value, values, is_whole=True)

    def _sized(self, value: Field, values: Any, is_whole: bool = False) -> Field:
        """A number drawn from a range at the size of these draws; of a `Sized` range it is noted."""
        size = self._draws.size
        if size is None or not isinstance(values, Sized):
            return value
        result = values.nominal + (value - values.nominal) * size
        if is_whole:
            result = floor(result + 1e-6)
        self._draws.noted.setdefault(values.name, []).append(result)
        return result


class _Noted(dict[Slot, Field]):
    """Mapping that has every number and notes which were asked for."""

    def __missing__(self, slot: Slot) -> Field:
        self[slot] = np.full(1, 0.5)
        return self[slot]


@dataclass(frozen=True)
class Chances:
    """The uniform numbers that decide an episode."""

    setup: Setup
    """What flies, and under which conditions."""
    places: tuple[Slot, ...]
    """Where an episode asks for each of the D numbers, in ascending order; row k of given numbers is of place k."""

    @classmethod
    def of(cls, setup: Setup) -> Chances:
        """Uniform numbers that flights of a setup ask for; of mixed conditions, of all that an episode may meet.

        It finds them by beginning one episode and noting what is asked: a draw that depends on a value would be
        missed.
        """
        noted = _Noted()
        number = np.zeros(1, dtype=np.int32)
        draws = Chosen(
            low=0, high=0, first=number, stride=0, dtype=np.float64, given=noted, size=np.ones(1)
        )
        world = World(Setup(setup.craft, setup.task, setup.timing, setup.conditions))
        world.begin(*world.scenario(number, draws), number, draws)
        return cls(setup, tuple(sorted(noted)))

    def draws(
        self, units: np.ndarray, number: np.ndarray, size: np.ndarray | None = None
    ) -> Chosen:
        """Random numbers of N episodes.

        Words of the seed and the stride are 0, as in `of`: only numbers of sensors are still drawn, by that seed
        and the number of the episode.

        Args:
            units: (D, N) in [0, 1], as many as there are places.
            number: (N,) int32 numbers of the episodes, from which the numbers of sensors follow.
            size: (N,) factors on the conditions; see `Chosen`.
        """
        # A distribution's tail rounds up to 1, which draws never are.
        units = np.minimum(units, 1.0 - 2.0**-24)
        return Chosen(
            low=0,
            high=0,
            first=number,
            stride=0,
            dtype=np.float64,
            given=dict(zip(self.places, units, strict=True)),
            size=size,
        )
