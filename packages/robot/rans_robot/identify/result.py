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
    ConfigError,
    Spacecraft,
    conditions_text,
    ready_folder,
    to_toml,
    write_json,
    write_text,
)
from rans_robot.identify.fit import CHANNELS, LEAST_NOISE, Channel, Fit, physics_of

SPREAD = 1.96
"""Standard deviations of a two-sided interval of 95 %."""
_MEAN = np.array([1.0, 0.5])
"""Weights of latency and rise in the mean delay."""
UNITS = {"position": "m", "attitude": "rad", "velocity": "m/s", "spin": "rad/s"}


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
        body = physics_of(craft, self.fit.values).body
        thrusters = tuple(
            replace(thruster, force=float(gain * thruster.force))
            for thruster, gain in zip(craft.thrusters, body.gain, strict=True)
        )
        tensor = body.inertia[0] * np.eye(3)
        if craft.dimension == 3:
            xx, xy, xz, yy, yz, zz = body.inertia
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        centre = np.array(craft.centre_of_mass)
        centre[: craft.dimension] += body.centre
        return replace(
            craft,
            name=f"{craft.name}-identified",
            thrusters=thrusters,
            inertia=tuple(map(tuple, tensor.tolist())),
            centre_of_mass=tuple(centre.tolist()),
        )

    def _of(self, *names: str) -> tuple[np.ndarray, np.ndarray]:
        """Values of quantities whose names begin so, and half of their intervals."""
        rows = [k for k, one in enumerate(self.fit.parameters) if one.name.startswith(names)]
        return self.fit.values[rows], SPREAD * self.fit.deviations[rows]

    def _relative(self, *names: str) -> tuple[float, float]:
        """Range of the factor on such quantities that the largest of their intervals has."""
        values, halves = self._of(*names)
        part = float(np.max(halves / values))
        return round(max(1.0 - part, 0.05), 4), round(1.0 + part, 4)

    def _magnitude(self, name: str) -> tuple[float, float]:
        """Range of the length of a vector."""
        values, halves = self._of(name)
        return _around(np.linalg.norm(values), max(halves))

    @property
    def conditions(self) -> Conditions:
        """Conditions whose ranges are the intervals of what was identified, for the identified spacecraft.

        Where the rise of the force could not be separated from the latency, the latency has half of it.
        """
        # Thrust and its delays, then body, disturbance and noise.
        thrusters = ThrusterConditions(thrust=self._relative("force"))
        if self.fit.is_identifiable()[-1]:
            (latency, rise), halves = self._of("latency", "rise")
            latency, rise = _around(latency, halves[0]), _around(rise, halves[1])
            thrusters = replace(thrusters, latency=latency, rise=rise)
        else:
            latency = _around(self.delay, SPREAD * self.delay_deviation)
            thrusters = replace(thrusters, latency=latency)
        position, attitude, velocity, spin = (
            SensorConditions(noise=round(self.fit.noise.get(name, 0.0), 6)) for name in CHANNELS
        )
        centre = float(np.linalg.norm(self._of("centre")[1]))
        return Conditions(
            body=BodyConditions(
                inertia=self._relative("inertia xx", "inertia yy", "inertia zz"),
                centre=(0.0, round(centre, 5)),
            ),
            thrusters=thrusters,
            disturbances=DisturbanceConditions(
                force=self._magnitude("disturbance"), torque=self._magnitude("torque")
            ),
            sensors=SensorsConditions(position, attitude, velocity, spin),
            description=f"identified from {len(self.fit.logs)} log(s) of {self.fit.craft.name}",
        )

    @property
    def delay(self) -> float:
        """Mean delay of the force after a command, s: latency plus half of the rise."""
        return float(_MEAN @ self.fit.values[-2:])

    @property
    def delay_deviation(self) -> float:
        """Standard deviation of `delay`, s."""
        return float(np.sqrt(_MEAN @ self.fit.covariance[-2:, -2:] @ _MEAN))

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
        return self.fit.channels()

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


def _around(value: Any, half: Any) -> tuple[float, float]:
    """Interval of what is not negative, with as many digits as files have."""
    return round(max(float(value - half), 0.0), 6), round(max(float(value + half), 0.0), 6)
