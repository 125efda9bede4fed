"""What was identified: a spacecraft, the conditions to train for, and how well they predict the log.

Command, files and Python print what it says; a fit that does not explain a channel is no result.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rans import (
    BodyConditions,
    Conditions,
    DisturbanceConditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.extend import (
    Body,
    ConfigError,
    Spacecraft,
    conditions_text,
    ready_folder,
    to_toml,
    write_json,
    write_text,
)
from rans_robot.identify.fit import CHANNELS, LEAST_NOISE, Fit, channel_columns

_SYSTEMATIC = 0.2
"""Part of what a coast leaves of a channel, up to which errors that the next reading repeats may be. Two swapped
valves leave 0.3 at least, filters over three readings 0.1."""
_PERFECT = 2.0 * LEAST_NOISE
"""Noise (SI) below which nothing is left to explain."""
_LARGEST_ANGLE = 0.5
"""rad: noise of an attitude, above which it is none; angles that say nothing have 1.8 rad."""
SPREAD = 1.96
"""Standard deviations of a two-sided interval of 95 %."""
UNITS = {"position": "m", "attitude": "rad", "velocity": "m/s", "spin": "rad/s"}


@dataclass(frozen=True)
class Channel:
    """How well one measured quantity was predicted over the windows of the logs."""

    name: str
    before: float
    """Root mean square of reading minus prediction with the data sheet, in the unit of `UNITS`."""
    after: float
    """Root mean square of reading minus prediction with what was identified."""
    correlation: float
    """Correlation of successive residuals; 0 for white ones."""
    bound: float
    """Correlation that white residuals exceed in one of a thousand logs at most."""
    is_explained: bool
    """Whether the model leaves nothing but independent noise, or little of what a coast leaves."""

    @property
    def is_white(self) -> bool:
        """Whether the model explains all but independent errors of the readings.

        Fitted starts of short windows make residuals unlike the ones before them, which is no fault of the model.
        """
        return self.correlation <= self.bound


@dataclass(frozen=True)
class Identified:
    """Row of a table: a quantity with its data sheet's value and its interval of 95 %."""

    name: str
    unit: str
    nominal: float
    value: float
    low: float
    high: float
    is_identifiable: bool
    """Whether the logs determine it: they halve the standard deviation that was assumed before, at least."""


@dataclass(frozen=True)
class Identification:
    """Spacecraft and conditions that logs of flights determine (`rans.identify`).

    Raises:
        ConfigError: the fit leaves more than noise of a sensor, so that no number of it can be believed.
    """

    fit: Fit

    def __post_init__(self) -> None:
        """Refuse a fit whose residuals are no noise of a sensor, or that needs a thruster without force."""
        wrong = [channel for channel in self.channels() if not channel.is_explained]
        if wrong:
            names = ", ".join(
                f"{channel.name} (error {channel.after:.3g} {UNITS[channel.name]})"
                for channel in wrong
            )
            raise ConfigError(
                f"the commands of the logs do not explain {names}: that is no noise of a sensor, and nothing is "
                "identified. The usual cause is a column in other units, such as a heading in degrees, or in "
                "another frame or order, two thrusters exchanged, a filter that lags, or another spacecraft."
            )
        floored = [
            row.name
            for row, parameter in zip(self.rows(), self.fit.parameters, strict=True)
            if row.is_identifiable and 0.0 < row.value <= 1.01 * parameter.least
        ]
        if floored:
            raise ConfigError(
                f"the logs are explained best without {' and '.join(floored)}: nothing is identified. The usual "
                "cause is a valve that did not open, or commands of two thrusters in one another's columns."
            )

    @property
    def spacecraft(self) -> Spacecraft:
        """The spacecraft with the identified forces, inertia and centre of mass.

        Its file is what `rans identify` writes and agents are then trained for; the name gets "-identified".
        """
        craft = self.fit.craft
        count = craft.thruster_count
        values = [float(x) for x in self.fit.values]
        thrusters = tuple(
            replace(thruster, force=force)
            for thruster, force in zip(craft.thrusters, values[:count], strict=True)
        )
        moments = values[count : count + len(Body.of(craft).inertia)]
        if craft.dimension == 2:
            tensor = (moments[0] * np.eye(3)).tolist()
        else:
            xx, xy, xz, yy, yz, zz = moments
            tensor = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
        offset = [self.fit.value(f"centre {axis}") for axis in "xyz"[: craft.dimension]]
        centre = np.array(craft.centre_of_mass)
        centre[: craft.dimension] += offset
        return replace(
            craft,
            name=f"{craft.name}-identified",
            thrusters=thrusters,
            inertia=tuple(map(tuple, tensor)),  # pyrefly: ignore[bad-argument-type]
            centre_of_mass=tuple(map(float, centre)),  # pyrefly: ignore[bad-argument-type]
        )

    def _relative(self, rows: list[int]) -> tuple[float, float]:
        """Range of the factor on quantities of these numbers that the largest of their intervals has."""
        part = SPREAD * float(np.max(self.fit.deviations[rows] / self.fit.values[rows]))
        return round(max(1.0 - part, 0.05), 4), round(1.0 + part, 4)

    @property
    def conditions(self) -> Conditions:
        """Conditions whose ranges are the intervals of what was identified, for the identified spacecraft.

        Where the rise of the force could not be separated from the latency, the latency has half of it.
        """
        rows = {row.name: row for row in self.rows()}
        craft = self.fit.craft
        count = craft.thruster_count
        diagonal = [0] if len(Body.of(craft).inertia) == 1 else [0, 3, 5]
        axes = "xyz"[: craft.dimension]
        centre = float(
            np.linalg.norm([rows[f"centre {a}"].high - rows[f"centre {a}"].value for a in axes])
        )
        names = [parameter.name for parameter in self.fit.parameters]
        latency, rise = (names.index(name) for name in ("latency", "rise"))
        # Thrust and its delays, then body, disturbance and noise.
        thrusters = ThrusterConditions(thrust=self._relative(list(range(count))))
        if rows["rise"].is_identifiable:
            thrusters = replace(
                thrusters,
                latency=_positive(rows["latency"].low, rows["latency"].high),
                rise=_positive(rows["rise"].low, rows["rise"].high),
            )
        else:
            mean = self.fit.values[latency] + 0.5 * self.fit.values[rise]
            spread = SPREAD * self.delay_deviation
            thrusters = replace(thrusters, latency=_positive(mean - spread, mean + spread))
        turns = ("z",) if craft.dimension == 2 else axes
        noise = self.fit.noise
        position, attitude, velocity, spin = (
            SensorConditions(noise=round(noise.get(name, 0.0), 6)) for name in CHANNELS
        )
        return Conditions(
            body=BodyConditions(
                inertia=self._relative([count + k for k in diagonal]),
                centre=(0.0, round(centre, 5)),
            ),
            thrusters=thrusters,
            disturbances=DisturbanceConditions(
                force=self._magnitude([f"disturbance {axis}" for axis in axes]),
                torque=self._magnitude([f"torque {axis}" for axis in turns]),
            ),
            sensors=SensorsConditions(position, attitude, velocity, spin),
            description=f"identified from {len(self.fit.logs)} log(s) of {craft.name}",
        )

    @property
    def delay(self) -> float:
        """Mean delay of the force after a command, s: latency plus half of the rise."""
        return self.fit.value("latency") + 0.5 * self.fit.value("rise")

    @property
    def delay_deviation(self) -> float:
        """Standard deviation of `delay`, s: of the latency plus half of the rise."""
        names = [parameter.name for parameter in self.fit.parameters]
        weights = np.zeros(len(names))
        weights[names.index("latency")] = 1.0
        weights[names.index("rise")] = 0.5
        return float(np.sqrt(weights @ self.fit.covariance @ weights))

    def _magnitude(self, names: list[str]) -> tuple[float, float]:
        rows = [row for row in self.rows() if row.name in names]
        size = float(np.linalg.norm([row.value for row in rows]))
        spread = max(row.high - row.value for row in rows)
        return _positive(size - spread, size + spread)

    def rows(self) -> list[Identified]:
        """Every quantity with its interval, in the order of the spacecraft file.

        Tables, `identified.json` and the conditions of the next training read them.
        """
        identifiable = self.fit.is_identifiable()
        return [
            Identified(
                parameter.name,
                parameter.unit,
                parameter.nominal,
                float(value),
                max(float(value - SPREAD * deviation), parameter.least),
                float(value + SPREAD * deviation),
                bool(is_identifiable),
            )
            for parameter, value, deviation, is_identifiable in zip(
                self.fit.parameters, self.fit.values, self.fit.deviations, identifiable, strict=True
            )
        ]

    def channels(self) -> list[Channel]:
        """How well each measured quantity is predicted, before and after."""
        columns = channel_columns(self.fit.craft)
        result = []
        for name in CHANNELS:
            if name not in self.fit.noise:
                continue
            before, after = (
                float(np.sqrt(np.nanmean(rows[:, columns[name]] ** 2)))
                for rows in (self.fit.nominal_residuals, self.fit.residuals)
            )
            correlation, bound = self.fit.correlation(name)
            noise = self.fit.noise[name]
            # The correlation of residuals is the part of their power that the next reading repeats.
            repeated = noise * np.sqrt(max(correlation, 0.0))
            is_small = repeated < max(_SYSTEMATIC * self.fit.coasting.get(name, np.inf), _PERFECT)
            explained = (is_small or correlation <= bound) and not (
                name == "attitude" and noise > _LARGEST_ANGLE
            )
            result.append(Channel(name, before, after, correlation, bound, explained))
        return result

    def notes(self) -> list[str]:
        """Sentences on what the logs do not determine, and whether the intervals can be believed.

        Terminal and `identified.json` have them as they are.
        """
        craft = self.fit.craft
        result = [
            f"Motion determines forces and inertia only in proportion to the mass: the mass is {craft.mass:g} kg, "
            "as in the file. Weigh the spacecraft."
        ]
        result.append(
            "The mean delay has in it what lies between the clocks of commands and readings, such as an offset, or "
            "readings that are late."
        )
        # What the logs leave open, then whether intervals can be believed.
        silent = [row.name for row in self.rows() if not row.is_identifiable]
        if "latency" in silent and self.delay_deviation < 0.05:
            silent.remove("latency")
        if silent:
            result.append(
                f"The logs do not determine: {', '.join(silent)}. Their intervals are those assumed before; fire "
                "thrusters that the flight did not fire, one at a time and in both directions."
            )
        # Below the least noise residuals are those of the grid, for which intervals are wide enough.
        coloured = [
            channel
            for channel in self.channels()
            if not channel.is_white and self.fit.noise[channel.name] > LEAST_NOISE
        ]
        if coloured:
            names = ", ".join(f"{pair.name} ({pair.correlation:+.2f})" for pair in coloured)
            result.append(
                f"Successive residuals are correlated in {names}: something acts that the model lacks, or a filter "
                "smooths the readings, and intervals are too narrow."
            )
        return [*result, *(note for log in self.fit.logs for note in log.notes)]

    def write(self, folder: str | Path) -> Path:
        """Write spacecraft.toml, conditions.toml and identified.json, and return the folder.

        Raises:
            ConfigError: the folder cannot be made or written.
        """
        folder = ready_folder(folder)
        write_text(folder / "spacecraft.toml", to_toml(self.spacecraft))
        write_text(folder / "conditions.toml", conditions_text(self.conditions))
        write_json(folder / "identified.json", self.table())
        return folder

    def table(self) -> dict[str, Any]:
        """Quantities, prediction, notes and sources as plain values.

        The content of identified.json, whose keys are an interface.
        """
        return {
            "logs": [log.source for log in self.fit.logs],
            "seconds": sum(log.duration for log in self.fit.logs),
            "quantities": [vars(row) for row in self.rows()],
            "prediction": [vars(channel) for channel in self.channels()],
            "notes": self.notes(),
            "window, s": self.fit.window,
            "mean delay, s": [self.delay, SPREAD * self.delay_deviation],
        }


def _positive(low: float, high: float) -> tuple[float, float]:
    return round(max(float(low), 0.0), 6), round(max(float(high), 0.0), 6)
