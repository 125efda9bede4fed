"""Random craft with any effects, flown by RANS and by an oracle (`tests.support.pair_oracle`)."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Collection
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np

import rans
from rans import (
    BodyConditions,
    Conditions,
    DisturbanceConditions,
    FaultConditions,
    GoToPose,
    ThrusterConditions,
    Timing,
)
from rans.episode.flight import Flight, fly
from rans.episode.scenario import Scenario, draws, scenarios
from rans.model.actuators import OnOff, Propellant, Pulsed, Throttle, Wheel
from rans.model.body import Body
from rans.model.drift import ClohessyWiltshire, Drift, UniformGravity
from rans.model.fields import unflatten
from rans.model.random import Draws
from rans.model.spacecraft import Spacecraft, Store, Thruster
from rans.randomization.parameters import draw
from rans.reference.flight import fly_in_drake
from tests.support.crafts import triple
from tests.support.pair_oracle import Oracle
from tests.support.played import Played
from validation.study.sampling import Restless, gaps

_SECTIONS: dict[str, Any] = {
    "body": BodyConditions,
    "thrusters": ThrusterConditions,
    "faults": FaultConditions,
    "disturbances": DisturbanceConditions,
}
_CONDITIONS: dict[str, tuple[str, dict[str, Any]]] = {
    "body": ("body", {"mass": (0.7, 1.4), "inertia": (0.7, 1.4), "centre": (0.0, 0.03)}),
    "thrust": ("thrusters", {"thrust": (0.7, 1.3), "pressure": (0.8, 1.0), "droop": (0.0, 0.3)}),
    "latency": ("thrusters", {"latency": (0.0, 0.1), "command_delay": (0.0, 0.2)}),
    "ramps": ("thrusters", {"rise": (0.0, 0.1)}),
    "mountings": ("thrusters", {"misalignment": (0.0, 0.1)}),
    "dwell": ("thrusters", {"least_on": (0.0, 0.6)}),
    "faults": (
        "faults",
        {
            "count": 1.0,
            "kinds": ("dead", "stuck", "weak"),
            "share": (0.1, 0.3),
            "time": (0.5, 4.5),
        },
    ),
    "push": ("disturbances", {"force": (0.1, 0.3), "torque": (0.003, 0.01)}),
    "swing": ("disturbances", {"slow_force": (0.1, 0.3)}),
    "kick": ("disturbances", {"kick": (0.1, 1.0)}),
}
"""Ranges that a thruster of the craft below can balance, by effect."""
_SCALED = ("force", "torque", "slow_force", "kick")
GRADIENT = "gradient"
"""Orbit on which gravity turns the craft, in space alone."""
STIFF = "stiff"
"""Unequal moments, forces twice as large, a centre of mass aside and bang-bang control; in no pair."""
PLACE = "place"
"""A tank at a place."""
EFFECTS = (
    "pulsed",
    "throttle",
    "wheels",
    "tank",
    PLACE,
    "slosh",
    "orbit",
    "gravity",
    GRADIENT,
    *_CONDITIONS,
)
_APART = (
    {"pulsed", "throttle"},
    {"orbit", "gravity"},
    {GRADIENT, "gravity"},
    {GRADIENT, "orbit"},
    {GRADIENT, "slosh"},
    {"slosh", "tank"},
    {"slosh", PLACE},
    {"tank", PLACE},
    {"slosh", "orbit"},
    {"dwell", "pulsed"},
    {"dwell", "throttle"},
)
"""Pairs that no craft can have."""
PAIRS = [pair for pair in itertools.combinations(EFFECTS, 2) if {*pair} not in _APART]


def groups(size: int) -> list[tuple[str, ...]]:
    """Sets of at most so many effects, in which every pair of effects is in some set."""
    left = set(PAIRS)
    found: list[tuple[str, ...]] = []
    while left:
        group = min(left, key=PAIRS.index)
        while len(group) < size:
            new = {
                one: sum(pair in left for pair in _pairs_with(one, group))
                for one in EFFECTS
                if one not in group and all(pair in PAIRS for pair in _pairs_with(one, group))
            }
            if not any(new.values()):
                break
            group = (*group, max(new, key=lambda one: new[one]))
        group = tuple(sorted(group, key=EFFECTS.index))
        left -= set(itertools.combinations(group, 2))
        found.append(group)
    return found


def _pairs_with(effect: str, group: tuple[str, ...]) -> list[tuple[str, ...]]:
    return [tuple(sorted((effect, other), key=EFFECTS.index)) for other in group]


def under(drift: Drift) -> Any:
    """The task go-to-pose where craft drift so."""
    return type("Drifting", (GoToPose,), {"drift": property(lambda _: drift)})


InOrbit = under(ClohessyWiltshire(0.03))
"""In the Hill frame of an orbit of 209 s, whose terms are as large as the thrust."""
TurnedByGravity = under(ClohessyWiltshire(0.03, gravity_gradient=True))
"""On the same orbit, on which gravity turns a craft in half a minute."""
FallingInThePlane = under(UniformGravity((0.01, -0.02)))
FallingInSpace = under(UniformGravity((0.01, -0.02, 0.03)))


def craft_with(
    effects: Collection[str], dimension: Literal[2, 3], seed: int, force: float | None = None
) -> Spacecraft:
    """A random craft that its thrusters can control, with the effectors that are among the effects.

    Args:
        effects: names of effects.
        dimension: 2 or 3.
        seed: of the craft.
        force: of every nozzle, N, with mass, inertia, wheels and liquid in proportion; None: 0.2 to 0.8 N each.
    """
    size = 1.0 if force is None else 2.0 * force
    random = np.random.default_rng([seed, dimension, 7])
    flat = np.array([1.0, 1.0, dimension - 2.0])
    is_stiff = STIFF in effects
    strength = 2.0 if is_stiff else 1.0
    kinds = {"pulsed": Pulsed(10, 1), "throttle": Throttle(0.1)}
    actuators = next((kinds[one] for one in effects if one in kinds), OnOff())
    while True:
        a, b, c = random.uniform(0.02, 0.2, 3)
        if is_stiff:  # one may be a hundredth of another
            a, b, c = np.exp(random.uniform(math.log(0.005), math.log(0.5), 3))
        axes, _ = np.linalg.qr(random.normal(size=(3, 3)))
        if dimension == 2:
            axes = np.eye(3)
        tensor = axes @ np.diag([b + c, a + c, a + b]) @ axes.T * size
        nozzles = tuple(
            Thruster(
                triple(random.uniform(-0.3, 0.3, 3) * flat),
                _unit(random.normal(size=3) * flat),
                strength * random.uniform(0.2, 0.8) if force is None else force,
            )
            for _ in range(8 if dimension == 2 else 14)
        )
        wheels: tuple[Wheel, ...] = ()
        if "wheels" in effects:
            ways = (
                random.normal(size=(2, 3)) if dimension == 3 else np.diag([0.0, 0.0, 1.0])[[2, 2]]
            )
            wheels = tuple(
                Wheel(
                    _unit(way),
                    random.uniform(0.01, 0.05) * size,
                    random.uniform(0.05, 0.2) * size,
                    random.uniform(1e-4, 1e-3) * size,
                )
                for way in ways
            )
        mass = random.uniform(4.0, 12.0) * size
        tank = None
        if "tank" in effects or PLACE in effects:
            # All thrusters together burn a full tank within 8 s, which is far more than any real craft does.
            burned = random.uniform(0.2, 0.5) * mass
            thrust = sum(one.force for one in nozzles)
            tank = Propellant(burned, thrust * 8.0 / (burned * 9.80665))
            if PLACE in effects:
                # What the arm adds to the inertia is up to a quarter of the least that is there.
                arm = _unit(random.normal(size=3) * flat)
                spread = (a + b if dimension == 2 else min(a, b, c)) * size
                away = random.uniform(0.3, 0.5) * math.sqrt(spread * (1.0 / burned - 1.0 / mass))
                tank = replace(tank, position=triple(away * np.array(arm)), radius=0.5 * away)
        further: tuple[Any, ...] = ()
        if "slosh" in effects:
            # Up to a tenth of the mass, with a hundredth of critical friction at 0.3 m/s^2.
            swings = random.uniform(0.03, 0.1) * mass
            length = random.uniform(0.04, 0.08)
            slosh = rans.Slosh(
                swings,
                length,
                triple(random.uniform(-0.05, 0.05, 3) * flat),
                _unit(random.normal(size=3) * flat),
                0.02 * swings * length**2 * math.sqrt(0.3 / length),
            )
            further = (slosh,)
        with warnings.catch_warnings():  # drawn again where it cannot be controlled
            warnings.simplefilter("ignore", UserWarning)
            craft = Spacecraft(
                "random",
                dimension,
                mass,
                tuple(map(triple, (tensor + tensor.T) / 2)),
                nozzles,
                centre_of_mass=triple(random.uniform(-0.1, 0.1, 3) * flat * is_stiff),
                thrust_sharing="split" if is_stiff and random.random() < 0.5 else "none",
                wheels=wheels,
                propellant=tank,
                further_effectors=further,
                actuators=actuators,
            )
        if craft.controls_every_direction:
            return craft


def _unit(vector: Any) -> tuple[float, float, float]:
    return triple(vector / np.linalg.norm(vector))


def conditions_of(effects: Collection[str], force: float | None = None) -> Conditions | None:
    """Conditions with those of the effects that are conditions; None: there are none.

    Disturbances are in proportion to the force of `craft_with`.
    """
    size = 1.0 if force is None else 2.0 * force
    sections: dict[str, dict[str, Any]] = {}
    for name in (one for one in effects if one in _CONDITIONS):
        section, values = _CONDITIONS[name]
        if section == "disturbances":
            values = {
                key: tuple(size * x for x in value) if key in _SCALED else value
                for key, value in values.items()
            }
        sections.setdefault(section, {}).update(values)
    if not sections:
        return None
    return Conditions(**{name: _SECTIONS[name](**values) for name, values in sections.items()})


class Apart(NamedTuple):
    """Largest differences between two engines at any instant of a flight."""

    position: float
    """m."""
    attitude: float
    """rad."""
    stores: float
    """kg and N m s."""


class Flown(NamedTuple):
    """A flight of RANS, and what another engine needs to repeat it."""

    flight: Flight
    starts: Scenario
    conditions: Conditions | None
    draws: Draws


def flown(
    effects: Collection[str],
    dimension: Literal[2, 3],
    period: float,
    seed: int,
    seconds: float = 25.0,
    force: float | None = None,
    substeps: int | None = None,
) -> Flown:
    """Fly a random craft under some effects; without substeps RANS chooses them; force as of `craft_with`."""
    craft = craft_with(effects, dimension, seed, force)
    conditions = conditions_of(effects, force)
    task_class: Any = GoToPose
    if "orbit" in effects:
        task_class = InOrbit
    if GRADIENT in effects:
        task_class = TurnedByGravity
    if "gravity" in effects:
        task_class = FallingInThePlane if dimension == 2 else FallingInSpace
    task = task_class(fail_distance=1e6, fail_spin=1e6)
    timing = Timing(period, substeps, round(seconds / period))
    starts = scenarios(task, craft, seed, 1)
    if not {"tank", PLACE, "wheels"}.isdisjoint(effects):
        # Part of a tank, so that some flights run empty, and wheels that turn.
        random = np.random.default_rng([seed, 5])
        stores = tuple(
            np.array([random.uniform(0.3 * s.high if s.low == 0.0 else 0.5 * s.low, 0.5 * s.high)])
            for s in craft.stores
            if s not in _stores_of_rod(craft)
        )
        stores += tuple(np.array([s.initial]) for s in _stores_of_rod(craft))
        starts = replace(starts, start=replace(starts.start, stores=stores))
    own = draws(seed, 1)
    with warnings.catch_warnings():  # a period of 0.5 s is too long for some of them, or a step
        for known in ("can hardly be controlled", "set timing.substeps"):
            warnings.filterwarnings("ignore", message=f".*{known}")
        pilot = Restless(craft, seed, *([0.0] if STIFF in effects else []))
        flight = fly(craft, task, pilot, starts, timing, conditions=conditions, draws=own)
    return Flown(flight, starts, conditions, own)


def compare(*given: Any, **how: Any) -> Apart:
    """Fly a random craft under some effects in RANS, and again by the oracle; see `flown`."""
    flight, _, conditions, own = flown(*given, **how)
    drawn = None
    if conditions is not None:
        craft = flight.craft
        steps = flight.timing.episode_steps
        drawn = draw(conditions, craft, Body.of(craft), steps, own.first, own)
    rows = Oracle(flight, drawn, 0).fly()
    return _apart(flight, unflatten(flight.states, [column[:, None] for column in rows.T]))


def compare_with_drake(*given: Any, seconds: float = 10.0, max_step: float | None = None) -> Apart:
    """Fly a random craft under some effects in RANS, and its commands again in Drake, in steps of so many s."""
    flight, starts, conditions, own = flown(*given, seconds=seconds)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*can hardly be controlled")
        judged = fly_in_drake(
            flight.craft,
            flight.task,
            Played(flight.commands),
            starts,
            flight.timing,
            conditions=conditions,
            draws=own,
            max_step=max_step,
        )
    return _apart(flight, judged.states)


def _stores_of_rod(craft: Spacecraft) -> tuple[Store, ...]:
    return tuple(store for effector in craft.mounted for store in effector.stores)


def _apart(flight: Flight, others: Any) -> Apart:
    # The rod's direction and rate, which follow from the motion, are no amounts that are kept.
    amounts = len(flight.craft.stores) - len(_stores_of_rod(flight.craft))
    ours, theirs = (replace(x, stores=x.stores[:amounts]) for x in (flight.states, others))
    off = gaps(ours, theirs)
    return Apart(
        float(off["position"].max()),
        float(off["attitude"].max()),
        float(np.max(off.get("stores", 0.0))),
    )
