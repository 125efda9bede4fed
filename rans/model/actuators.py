"""What a craft's thrusters can be told, and what they do with it within one control period."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from rans.errors import ConfigError, brief
from rans.model.fields import Field, ascending, at_least, floor, where

if TYPE_CHECKING:
    from gymnasium import spaces

Command = Sequence[Field]
"""One field per thruster."""


@dataclass(frozen=True)
class Actuators:
    """How thrusters take commands. The craft says which kind they are."""

    kind: ClassVar[str]
    """Its name in spacecraft files."""
    is_continuous: ClassVar[bool] = True
    """Whether commands between 0 and 1 mean something."""
    dtype: ClassVar[Literal["int8", "float32"]] = "float32"
    """In which a command is remembered."""
    allowed: ClassVar[str]
    """What a command's entries may be, in words."""

    def action_space(self, n: int) -> spaces.Space[np.ndarray]:
        """Gymnasium's space of the commands of n thrusters: 0 to 1 for each."""
        from gymnasium import spaces

        return spaces.Box(0.0, 1.0, (n,), np.float32)

    def pulses(self, command: Command) -> Iterator[tuple[Field, Command]]:
        """Pieces of a control period: their share of it, and that of its force which each thruster gives."""
        yield 1.0, command

    def check(self, values: Any, *shape: int) -> None:
        """Refuse commands, (n,) for n thrusters or (N, n) for N spacecraft, that thrusters cannot follow.

        Raises:
            ConfigError: there are not so many, or one of them is not allowed.
        """
        given = np.asarray(values)
        if given.shape != shape or given.dtype.kind not in "biuf" or not self._possible(given):
            many = "" if len(shape) == 1 else f"{shape[0]:,} times "
            raise ConfigError(
                f"an action must be {many}{shape[-1]} numbers, {self.allowed}, one per "
                f"thruster, got {_shown(given, shape, values)}."
            )

    def _possible(self, values: np.ndarray) -> bool:
        """Whether every number is allowed; NaN is not."""
        return bool(((values >= 0) & (values <= 1)).all())


@dataclass(frozen=True)
class OnOff(Actuators):
    """Valves that stay open or shut for a whole control period.

    >>> rans.load_spacecraft("floating-platform").actuators
    OnOff()
    """

    kind: ClassVar[str] = "on-off"
    is_continuous: ClassVar[bool] = False
    dtype: ClassVar[Literal["int8", "float32"]] = "int8"
    allowed: ClassVar[str] = "0 (shut) or 1 (open)"

    def action_space(self, n: int) -> spaces.MultiDiscrete:
        """One choice of two per thruster."""
        from gymnasium import spaces

        return spaces.MultiDiscrete([2] * n)

    def _possible(self, values: np.ndarray) -> bool:
        return bool(np.isin(values, (0, 1)).all())


@dataclass(frozen=True)
class Throttle(Actuators):
    """Thrusters that give any share of their force, steadily.

    >>> dataclasses.replace(rans.load_spacecraft("floating-platform"), actuators=rans.Throttle()).actuators
    Throttle()
    """

    kind: ClassVar[str] = "throttle"
    allowed: ClassVar[str] = "0 (no thrust) to 1 (full thrust)"


@dataclass(frozen=True)
class Pulsed(Actuators):
    """Valves that open once a control period, at its beginning, for whole counts of it.

    >>> rans.Pulsed(counts=10, least=2)  # of a period of 0.1 s: in steps of 10 ms, for 20 ms at least
    Pulsed(counts=10, least=2)

    A duty of d opens a thruster at full force for the first round(d * counts) counts, halves rounded up, and
    not at all for fewer than ``least``.

    Raises:
        ConfigError: ``counts`` is not a whole number >= 1 or ``least`` none from 0 to ``counts``.
    """

    counts: int
    """In which a control period is divided."""
    least: int = 0
    """Shortest pulse a valve can give, counts."""
    kind: ClassVar[str] = "pulsed"
    allowed: ClassVar[str] = "0 (shut) to 1 (open all the time)"

    def __post_init__(self) -> None:
        for key, low, high in (("counts", 1, 2**20), ("least", 0, self.counts)):
            value = getattr(self, key)
            if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
                raise ConfigError(
                    f"{key} of pulsed actuators must be a whole number from {low} to {high:,}, "
                    f"got {value!r}."
                )

    def pulses(self, command: Command) -> Iterator[tuple[Field, Command]]:
        """See `Actuators.pulses`: pieces end where a valve may shut, or in order where each one does."""
        widths = [self._width(duty) for duty in command]
        begun = past = 0.0
        regular = self.counts <= len(widths) + 1
        ends = [float(k) for k in range(1, self.counts)] if regular else ascending(widths)
        for end in (*ends, float(self.counts)):
            zero = [width * 0.0 for width in widths]
            open_ = [
                where(width > past, none + 1.0, none)
                for width, none in zip(widths, zero, strict=True)
            ]
            yield (end - begun) * (1.0 / self.counts), open_
            # Those open to the end do not shut, not even in a last piece of no length.
            begun = end
            past = end if regular else -at_least(-end, 0.5 - self.counts)

    def _width(self, duty: Field) -> Field:
        """Counts for which a thruster is open."""
        whole = floor(duty * float(self.counts) + 0.5)
        return where(whole < self.least, whole * 0.0, whole) if self.least > 1 else whole


ON_OFF = OnOff()

KINDS: dict[str, type[Actuators]] = {kind.kind: kind for kind in (OnOff, Pulsed, Throttle)}


def _shown(given: np.ndarray, shape: tuple[int, ...], values: Any) -> str:
    """Few values whole, of many only what is wrong with them."""
    if given.size <= 32:
        return " ".join(brief(values).split())
    if given.shape != shape:
        return f"an array of shape {given.shape}"
    return (
        f"numbers from {given.min()} to {given.max()}"
        if given.dtype.kind in "biuf"
        else f"{given.dtype}"
    )
