"""Flights from a file as a contestant: commands or changes of velocity against time, for each start."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rans.base.csv_file import CsvFile, read_csv
from rans.effectors.commands import check_commands
from rans.extend import ConfigError, Heading, Quat, Setup, counted, per_velocity

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
    coasts. A unit may stand behind a name in parentheses. Other columns are ignored: the file optimal.csv of
    `rans optimal` is such a file.

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
        table = read_csv(Path(file), _LARGEST, "the flights ")
        axes = [f"dv.{axis}" for axis in "xyz"[: craft.dimension]]
        commands = [f"command.{k}" for k in range(craft.command_count)]
        units = {
            "start": (),
            "time": ("s",),
            **dict.fromkeys(axes, ("m/s",)),
            **dict.fromkeys(commands, ()),
        }
        places = table.columns(units)
        holds_changes = set(axes) <= set(places)
        columns = ["start", "time", *(axes if holds_changes else commands)]
        if missing := [name for name in columns if name not in places]:
            raise ConfigError(
                f"{file} has no column {missing[0]}; it needs start and time, and either "
                f"{commands[0]} to {commands[-1]} or {', '.join(axes)}."
            )
        # Flights: values by start and control period; a period without a row is a coast.
        flights = self._flights(table, {name: places[name] for name in columns})
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

    def _flights(self, table: CsvFile, places: dict[str, int]) -> dict[int, dict[int, np.ndarray]]:
        """Commands (n,) or changes of velocity (d,), m/s, by the number of the start and of the control period.

        A period that is named twice for one start is refused; one that is not named is a coast.
        """
        timing = self._setup.timing
        flights: dict[int, dict[int, np.ndarray]] = {}
        for line, row in table.rows:
            where = f"{table.what}, line {line}"
            cells = {name: row[place].strip() for name, place in places.items()}
            start, time = (table.number(line, name, cells.pop(name)) for name in ("start", "time"))
            step = self._step_of(where, start, time)
            steps = flights.setdefault(int(start), {})
            if not any(cells.values()):
                continue
            if not 0 <= step < timing.episode_steps:
                last = (timing.episode_steps - 1) * timing.control_period
                raise ConfigError(f"{where}: time must be 0 to {last:g} s, got {time:g} s.")
            if step in steps:
                raise ConfigError(f"{where}: start {start:g} has two rows for {time:g} s.")
            steps[step] = np.array([table.number(line, *cell) for cell in cells.items()])
        return flights

    @property
    def starts(self) -> int:
        """Number of starts that the file has flights of."""
        return self._given.shape[1]

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`; episode k flies the flight of start k.

        Raises:
            ConfigError: the file does not have a flight of each of so many starts.
        """
        if count > self.starts:
            raise ConfigError(
                f"{self.name} has flights of {counted(self.starts, 'start')}, and {count} fly; add --episodes "
                f"{self.starts}, or add flights to it."
            )
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

    def _step_of(self, where: str, start: float, time: float) -> int:
        """Number of the control period that begins at a time, s, of a flight from a start."""
        period = self._setup.timing.control_period
        # Beyond the clipped range every float is a whole number, and an infinite one would not be rounded.
        periods = float(np.clip(time / period, -(2.0**53), 2.0**53))
        step = round(periods)
        if start < 0 or start != round(start):
            raise ConfigError(f"{where}: start must be a whole number >= 0, got {start:g}.")
        if abs(periods - step) > _ROUNDING:
            raise ConfigError(
                f"{where}: time must be a multiple of the control period of {period:g} s, got {time:g} s."
            )
        return step

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
