"""Identification from logs of a simulator that shares no code with the engine or with the fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rans_robot.identify.fit import Fit, fit

from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft

from .second_simulator import Noise, flown_log


def hidden(sheet: Spacecraft, random: np.random.Generator, inertia: float) -> Spacecraft:
    """A craft whose forces and centre of mass are not those of its data sheet."""

    def factor() -> float:
        return float(random.uniform(0.8, 1.2))

    x, y, z = sheet.centre_of_mass
    return replace(
        sheet,
        inertia=tuple(tuple(inertia * m for m in row) for row in sheet.inertia),  # pyrefly: ignore[bad-argument-type]
        centre_of_mass=(x + float(random.uniform(-0.02, 0.02)), y + 0.01, z),
        thrusters=tuple(replace(t, force=factor() * t.force) for t in sheet.thrusters),
    )


def random_commands(craft: Spacecraft, count: int, random: np.random.Generator) -> np.ndarray:
    """Valves that are open a quarter of the time."""
    return (random.random((count, craft.thruster_count)) < 0.25).astype(float)


def readings(count: int, period: float, random: np.random.Generator) -> np.ndarray:
    """Times between the commands, uneven by 20 ms, of which a tenth is missing; none at the first command."""
    times = period * np.arange(count - 1) + 0.018 + random.uniform(0.0, 0.02, count - 1)
    return times[random.random(len(times)) > 0.1]


def errors(found: Fit, true: Spacecraft, sheet: Spacecraft, **others: float) -> dict[str, float]:
    """Errors of a fit in its standard deviations, by quantity; what the names do not say is 0."""
    values = {f"force of thruster {k}": t.force for k, t in enumerate(true.thrusters)}
    values["inertia zz"] = true.inertia[2][2]
    moved = np.subtract(true.centre_of_mass, sheet.centre_of_mass)
    values |= {f"centre {axis}": float(x) for axis, x in zip("xyz", moved, strict=True)}
    values |= {name.replace("_", " "): value for name, value in others.items()}
    return {
        one.name: (value - values.get(one.name, 0.0)) / deviation
        for one, value, deviation in zip(
            found.parameters, found.values, found.deviations, strict=True
        )
        if one.name not in ("latency", "rise")  # their sum is determined, each alone is not
    }


@pytest.mark.slow
def test_intervals_hold_the_truth_of_another_simulator() -> None:
    """Forces, inertia, centre, disturbance and delay of three platforms; their moments are 2.5 times the sheet's.

    Of 45 intervals of 95 % 38 or more hold in 999 of 1,000 cases; the errors of one fit depend on each other.
    """
    sheet = load_spacecraft("floating-platform")
    held = 0
    for seed in range(3):
        random = np.random.default_rng(seed)
        true = hidden(sheet, random, 2.5)
        log = flown_log(
            true,
            random_commands(true, 120, random),
            0.2,
            readings(120, 0.2, random),
            random,
            Noise(),
            latency=0.04,
            rise=0.05,
            force=(0.02, -0.03, 0.0),
            torque=(0.0, 0.0, 0.004),
        )
        found = fit(sheet, [log])
        names = dict(disturbance_x=0.02, disturbance_y=-0.03, torque_z=0.004)
        held += sum(abs(error) < 1.96 for error in errors(found, true, sheet, **names).values())
        weights = np.array(
            [{"latency": 1.0, "rise": 0.5}.get(one.name, 0.0) for one in found.parameters]
        )
        delay = float(weights @ found.values)
        deviation = float(np.sqrt(weights @ found.covariance @ weights))
        held += abs(delay - 0.065) < 1.96 * deviation
    assert held >= 38


@pytest.mark.slow
@pytest.mark.parametrize("is_steady", [True, False])
def test_commands_that_came_late_are_dated_by_what_explains_the_readings(is_steady: bool) -> None:
    """They left at a steady rate and came up to 40 ms late, or left as unevenly as they came.

    By arrival forces of 1 N were 0.84 to 1.13 N, with intervals of 2 %. Errors weighed by their covariance: 16
    squares, below 39.3 in 999 of 1,000 samples.
    """
    sheet = load_spacecraft("floating-platform")
    random = np.random.default_rng(5)
    commands = random_commands(sheet, 150, random)
    even = 0.2 * np.arange(150)
    late = even + np.append(0.0, random.uniform(0.0, 0.04, 149))
    given = even if is_steady else late
    log = flown_log(
        sheet, commands, given, readings(150, 0.2, random), random, Noise(), latency=0.04
    )
    found = fit(sheet, [replace(log, command_times=late, steady_times=even)])
    assert ("left every" in " ".join(found.logs[0].notes)) == is_steady
    truth = np.array([one.nominal for one in found.parameters])
    truth[[one.name for one in found.parameters].index("latency")] = 0.04
    error = found.values - truth
    assert float(error @ np.linalg.solve(found.covariance, error)) < 39.3
    assert found.values[:8] == pytest.approx(np.ones(8), abs=0.03)
