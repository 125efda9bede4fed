"""Thrusters that fail within a control period: what they give until then and from then on, by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from rans import (
    Conditions,
    Engine,
    FaultConditions,
    Spacecraft,
    Thruster,
    ThrusterConditions,
    Timing,
)
from rans.episode.flight import fly
from rans.episode.scenario import draws, scenarios
from rans.model.actuators import OnOff, Pulsed, Throttle
from rans.model.fields import leaves
from rans.reference.flight import fly_in_drake
from tests.support.played import Played
from tests.support.random_flights import TASK

pytestmark = pytest.mark.filterwarnings("ignore:spacecraft 'one thruster'")
PERIOD = 0.2
INSTANT = 0.07
SHARE = 0.4
"""s, s into the second period, and what is left of a weak thruster or given by a stuck one."""
MASS = 2.0
FORCE = 1.0
ARM = 0.5
MOMENT = 4.0
"""kg, N, m and kg m^2."""
SEED = 7
NEITHER = ThrusterConditions()


def craft(dimension: Any, kind: Any, arm: float) -> Spacecraft:
    """One thruster that pushes along x, so far beside the middle that it turns about z."""
    nozzle = Thruster((0.0, -arm, 0.0), (1.0, 0.0, 0.0), FORCE)
    inertia = ((MOMENT, 0.0, 0.0), (0.0, 5.0, 0.0), (0.0, 0.0, MOMENT))
    return Spacecraft("one thruster", dimension, MASS, inertia, (nozzle,), actuators=kind)


def in_torch(
    one: Spacecraft,
    task: Any,
    pilot: Played,
    starts: Any,
    timing: Timing,
    conditions: Conditions,
    draws: Any,
) -> Any:
    """The rows of a torch engine's states, which begins as the others do: operation by operation."""
    engine = Engine(
        one, task, 1, timing, seed=SEED, dtype=torch.float64, compiled=False, conditions=conditions
    )
    rows = [np.array([np.asarray(x) for x in leaves(engine.state)])]
    for _ in range(2):
        engine.step(torch.from_numpy(pilot.act(None, None, np.zeros(0))))
        rows.append(np.array([np.asarray(x) for x in leaves(engine.state)]))
    return rows


def gained(
    engine: Callable[..., Any], one: Spacecraft, conditions: Conditions, *commands: float
) -> tuple[float, float]:
    """In the second period: speed, and spin about z."""
    # One step more than is flown: an engine begins the next episode with the last one.
    given = (*commands, 0.0)
    pilot = Played(lambda step, count: np.full((count, 1), given[step]))
    timing = Timing(PERIOD, episode_steps=3)
    starts = scenarios(TASK, one, SEED, 1)
    own = draws(SEED, 1)
    pilot.reset(1)
    flight = engine(one, TASK, pilot, starts, timing, conditions=conditions, draws=own)
    rows = flight if isinstance(flight, list) else np.stack(leaves(flight.states), axis=1)
    before, after = (np.asarray(row)[:, 0] for row in (rows[1], rows[2]))
    speed, spin = (slice(3, 5), 5) if one.dimension == 2 else (slice(7, 10), 12)
    gained = float(np.linalg.norm(after[speed] - before[speed]))
    return gained, float(after[spin] - before[spin])


CASES: list[Any] = [
    # On or off, at once: full thrust for 0.07 s, then what is left of it for 0.13 s; in N s of 1 N.
    (OnOff(), NEITHER, "dead", (0.0, 1.0), 0.07),
    (OnOff(), NEITHER, "stuck-open", (0.0, 0.0), 0.13),
    (OnOff(), NEITHER, "weak", (0.0, 1.0), 0.07 + 0.4 * 0.13),
    (OnOff(), NEITHER, "stuck", (0.0, 1.0), 0.07 + 0.4 * 0.13),
    # Throttled to a half.
    (Throttle(), NEITHER, "dead", (0.0, 0.5), 0.5 * 0.07),
    (Throttle(), NEITHER, "stuck-open", (0.0, 0.5), 0.5 * 0.07 + 0.13),
    # A pulse of 0.1 s that the fault cuts, and one of 0.05 s that is over.
    *(
        (Pulsed(counts), NEITHER, *rest)
        for counts in (4, 1000)
        for rest in (
            ("dead", (0.0, 0.5), 0.07),
            ("weak", (0.0, 0.5), 0.07 + 0.4 * 0.03),
            ("stuck-open", (0.0, 0.5), 0.07 + 0.13),
        )
    ),
    (Pulsed(4), NEITHER, "dead", (0.0, 0.25), 0.05),
    (Pulsed(4), NEITHER, "stuck-open", (0.0, 0.25), 0.05 + 0.13),
    # The valve opens after 0.05 s, or would have after 0.1 s; a pulse of 0.1 s lasts until 0.15 s.
    (OnOff(), ThrusterConditions(latency=0.05), "dead", (0.0, 1.0), 0.02),
    (OnOff(), ThrusterConditions(latency=0.1), "stuck-open", (0.0, 1.0), 0.13),
    # Shut, but felt after 0.1 s only.
    (OnOff(), ThrusterConditions(latency=0.1), "weak", (1.0, 0.0), 0.07 + 0.4 * 0.03),
    (Pulsed(4), ThrusterConditions(latency=0.05), "weak", (0.0, 0.5), 0.02 + 0.4 * 0.08),
    # Later than a period: what was given first is felt from 0.05 s of the second on.
    (OnOff(), ThrusterConditions(latency=0.25), "weak", (1.0, 0.0), 0.02 + 0.4 * 0.13),
    # A rise of 0.1 s is at 0.7 when the thruster fails: a triangle before, then a trapezium and 0.1 s of all.
    (OnOff(), ThrusterConditions(rise=0.1), "dead", (0.0, 1.0), 0.07 * 0.7 / 2),
    (
        OnOff(),
        ThrusterConditions(rise=0.1),
        "weak",
        (0.0, 1.0),
        0.07 * 0.7 / 2 + 0.4 * (0.03 * (0.7 + 1.0) / 2 + 0.1),
    ),
    (OnOff(), ThrusterConditions(rise=0.1), "stuck-open", (0.0, 1.0), 0.07 * 0.7 / 2 + 0.13),
    (Throttle(), ThrusterConditions(rise=0.1), "dead", (0.0, 0.5), 0.5 * 0.07 * 0.7 / 2),
    # As bounds are not known where they are drawn: from 0.05 s on, at 0.2 when it fails.
    (
        OnOff(),
        ThrusterConditions(latency=0.05, rise=0.1),
        "weak",
        (0.0, 1.0),
        0.02 * 0.2 / 2 + 0.4 * (0.08 * (0.2 + 1.0) / 2 + 0.05),
    ),
    # Longer than a period: at 0.175 when it fails, at 0.5 in the end.
    (
        OnOff(),
        ThrusterConditions(rise=0.4),
        "weak",
        (0.0, 1.0),
        0.07 * 0.175 / 2 + 0.4 * 0.13 * (0.175 + 0.5) / 2,
    ),
    # It falls within 0.1 s and is at 0.3 when it fails, or in the end of the pulse at 0.1 s is weak already.
    (OnOff(), ThrusterConditions(rise=0.1), "dead", (1.0, 0.0), 0.07 * (1.0 + 0.3) / 2),
    (
        OnOff(),
        ThrusterConditions(rise=0.1),
        "weak",
        (1.0, 0.0),
        0.07 * (1.0 + 0.3) / 2 + 0.4 * 0.03 * 0.3 / 2,
    ),
    (
        Pulsed(4),
        ThrusterConditions(rise=0.1),
        "weak",
        (0.0, 0.5),
        0.07 * 0.7 / 2 + 0.4 * (0.03 * (0.7 + 1.0) / 2 + 0.1 / 2),
    ),
]


@pytest.mark.parametrize(
    ("number", "engine"),
    [
        (number, engine)
        for number in range(len(CASES))
        for engine in ((fly, in_torch)[number % 2], *([fly_in_drake] if number % 3 == 0 else []))
    ],
)
def test_momentum_by_hand(engine, number):
    """By turns in the plane and in space: when a thruster fails does not depend on that."""
    dimension = 2 + number % 2
    kind, valves, failure, given, impulse = CASES[number]
    faults = FaultConditions(1.0, (failure,), SHARE, PERIOD + INSTANT)
    conditions = Conditions(thrusters=valves, faults=faults)
    speed, spin = gained(engine, craft(dimension, kind, 0.0), conditions, *given)
    # Rounding of speeds below 0.2 m/s, and of what Drake adds up in some 20 integration steps.
    assert speed == pytest.approx(FORCE * impulse / MASS, abs=1e-14)
    assert spin == pytest.approx(0.0, abs=1e-14)
    _, spin = gained(engine, craft(dimension, kind, ARM), conditions, *given)
    assert spin == pytest.approx(ARM * FORCE * impulse / MOMENT, abs=1e-14)
