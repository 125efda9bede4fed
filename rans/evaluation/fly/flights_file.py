"""Flights from a file as a contestant: commands or changes of velocity against time, for each start."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rans.effectors.commands import check_commands, per_velocity
from rans.episode import Setup
from rans.errors import ConfigError, brief, counted
from rans.files import read_text
from rans.model.fields import Heading, Quat

_LARGEST = 2**26
"""Bytes: a thousand flights of a thousand control periods with six commands take 40 MB."""
_ROUNDING = 1e-6
"""Error of times, in control periods, and of commands, that is rounding."""


class FlightsFile:
    """Controller that flies what a file says, whatever the state is: for flights that were computed elsewhere.

    The file is CSV text with a header. Column ``start`` is the number of a start of the evaluation from 0, and
    ``time`` the beginning of a control period, s. The others are one ``command.k`` for each command k of the
    spacecraft, from 0 to 1 (signed for wheels), held for this period; or ``dv.x``, ``dv.y`` and ``dv.z``, a change
    of velocity in W, m/s, that is spread evenly over it. Periods without a row, or without commands in it, are
    coasts. Other columns are ignored: the file optimal.csv of `rans optimal` is such a file.

    Args:
        file: the file.
        setup: spacecraft, task and timing.

    Raises:
        ConfigError: the file is not of this form, a time is not that of a control period of an episode, or the
            spacecraft cannot give a command or a change of velocity; the message names the line.
    """

    observes = False
    together = True
    """Commands belong to the numbers of episodes (`rans.evaluation.fly.episodes.fly_episodes`)."""

    def __init__(self, file: str | Path, setup: Setup) -> None:
        self.name = Path(file).name
        self._setup = setup
        self._step = 0
        craft, timing = setup.craft, setup.timing
        # Header: what the rows hold.
        rows = list(csv.reader(io.StringIO(read_text(Path(file), _LARGEST, "the flights "))))
        if not rows:
            raise ConfigError(f"{file} is empty; it begins with a header such as start,time,dv.x.")
        header = [cell.strip() for cell in rows[0]]
        axes = [f"dv.{axis}" for axis in "xyz"[: craft.dimension]]
        commands = [f"command.{k}" for k in range(craft.command_count)]
        holds_changes = set(axes) <= set(header)
        columns = ["start", "time", *(axes if holds_changes else commands)]
        if missing := [name for name in columns if name not in header]:
            raise ConfigError(
                f"{file} has no column {missing[0]}; it needs start and time, and either "
                f"{commands[0]} to {commands[-1]} or {', '.join(axes)}."
            )
        # Flights: values by start and control period; a period without a row is a coast.
        flights = self._flights(file, header, columns, rows[1:])
        numbers = sorted(flights)
        if numbers != list(range(len(numbers))) or not numbers:
            raise ConfigError(
                f"{file} must have flights of the starts 0, 1, 2 and so on without a gap, got "
                f"{', '.join(map(str, numbers[:5])) or 'none'}."
            )
        self._given = np.zeros((timing.episode_steps, len(numbers), len(columns) - 2))
        for start, steps in flights.items():
            for step, values in steps.items():
                self._given[step, start] = values
        self._levers = (
            np.array(per_velocity(craft, timing.control_period)) if holds_changes else None
        )
        self._check()

    def _flights(
        self,
        file: str | Path,
        header: Sequence[str],
        columns: Sequence[str],
        rows: Iterable[Sequence[str]],
    ) -> dict[int, dict[int, np.ndarray]]:
        """Commands (n,) or changes of velocity (d,), m/s, by the number of the start and of the control period.

        A period that is named twice for one start is refused; one that is not named is a coast.
        """
        flights: dict[int, dict[int, np.ndarray]] = {}
        for line, row in enumerate(rows, start=2):
            if not any(map(str.strip, row)):
                continue
            where = f"{file}, line {line}"
            start, step, values = self._row(where, dict(zip(header, row, strict=False)), columns)
            steps = flights.setdefault(start, {})
            if values is None:
                continue
            if step in steps:
                time = step * self._setup.timing.control_period
                raise ConfigError(f"{where}: start {start} has two rows for {time:g} s.")
            steps[step] = values
        return flights

    @property
    def starts(self) -> int:
        """Number of starts that the file has flights of."""
        return self._given.shape[1]

    def check_starts(self, count: int) -> None:
        """Refuse (`ConfigError`) a file that does not have a flight of each of ``count`` starts."""
        if count > self.starts:
            raise ConfigError(
                f"{self.name} has flights of {counted(self.starts, 'start')}, and {count} fly; add --episodes "
                f"{self.starts}, or add flights to it."
            )

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; episode k flies the flight of start k."""
        self.check_starts(count)
        self._step = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) of this period's row; changes of velocity are turned to B. Counts periods.

        One call a period from `reset` on; rows are the starts in their order.
        """
        given = self._given[min(self._step, len(self._given) - 1), : len(observation)]
        self._step += 1
        if self._levers is None:
            return given
        flat = self._setup.craft.dimension == 2
        level = Heading(0.0) if flat else Quat(1.0, 0.0, 0.0, 0.0)
        change = state.attitude.to(level).rotate(type(state.p)(*given.T))
        in_body = np.stack(np.broadcast_arrays(*change.columns()), axis=1)
        return np.clip(in_body @ self._levers.T, 0.0, 1.0)

    def _row(
        self, where: str, cells: Mapping[str, str], columns: Sequence[str]
    ) -> tuple[int, int, np.ndarray | None]:
        """Number of the start, control period, and commands or changes of velocity of a row; None: a coast."""
        start = _number(where, "start", cells.get("start", ""))
        time = _number(where, "time", cells.get("time", ""))
        timing = self._setup.timing
        step = round(time / timing.control_period)
        if start < 0 or start != round(start):
            raise ConfigError(f"{where}: start must be a whole number >= 0, got {start:g}.")
        texts = [cells.get(name, "").strip() for name in columns[2:]]
        values = None
        if any(texts):
            pairs = zip(columns[2:], texts, strict=True)
            values = np.array([_number(where, name, text) for name, text in pairs])
        if abs(time / timing.control_period - step) > _ROUNDING:
            raise ConfigError(
                f"{where}: time must be a multiple of the control period of {timing.control_period:g} s, got "
                f"{time:g} s."
            )
        if values is not None and not 0 <= step < timing.episode_steps:
            last = (timing.episode_steps - 1) * timing.control_period
            raise ConfigError(f"{where}: time must be 0 to {last:g} s, got {time:g} s.")
        return int(start), step, values

    def _check(self) -> None:
        """Refuse (`ConfigError`) what the spacecraft cannot give in a period; rounds on/off commands in place."""
        craft, period = self._setup.craft, self._setup.timing.control_period
        if self._levers is None:
            flat = self._given.reshape(-1, craft.command_count)
            # Solvers end on a bound but for rounding.
            flat[:] = np.where(np.abs(flat - flat.round()) < _ROUNDING, flat.round(), flat)
            try:
                check_commands(craft, flat, len(flat))
            except ConfigError as error:
                raise ConfigError(f"{self.name}: {error}") from None
            return
        limit = 1.0 / np.abs(self._levers).max()
        largest = np.abs(self._given).max(axis=2)
        if largest.max() > limit * (1.0 + _ROUNDING):
            step, start = np.unravel_index(int(largest.argmax()), largest.shape)
            raise ConfigError(
                f"{self.name}: {craft.name} changes its velocity by at most {limit:.4g} m/s along an axis in a "
                f"control period of {period:g} s, and start {start} asks for {largest[step, start]:.4g} m/s at "
                f"{step * period:g} s; divide it among several periods."
            )


def _number(where: str, name: str, text: str) -> float:
    """A finite number in a cell, or a `ConfigError` of where it stands."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise ConfigError(f"{where}: {name} must be a finite number, got {brief(text.strip())}.")
    return value
