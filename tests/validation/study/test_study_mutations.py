"""Classical errors, planted in our side of the comparison: the study finds each, and where it lies.

Every mutation patches what flies; Drake and the closed forms stay as they are. The layers run in the
study's order, from one thruster to the whole engine, and the first that fails must be the one that is
responsible.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import validation.study.dynamics
import validation.study.engines
from rans import Spacecraft
from rans.episode.step import World
from rans.model import dynamics, fields, rotation
from rans.model.body import Body
from rans.model.dynamics import Wrench
from rans.model.fields import Quat
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.parameters import MinimumDwell
from rans.reference.plant import Plant
from tests.support.crafts import nasty_planar, nasty_spatial
from validation.study import flights, oracles, sampling
from validation.study.checks import Check
from validation.study.study import LAYERS, Scope

Patch = Callable[[pytest.MonkeyPatch], None]
PLANE = nasty_planar()
SPACE = nasty_spatial()
SHARING = replace(PLANE, thrust_sharing="split")


def changed(name: str, change: Callable[..., Any], *owners: Any) -> Patch:
    """A function of ours that is called with the true one before its own arguments, wherever it is known."""

    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        for owner in owners:
            true = getattr(owner, name)
            monkeypatch.setattr(
                owner, name, lambda *given, true=true, **named: change(true, *given, **named)
            )

    return patch


def wrench_map(change: Callable[[Spacecraft, np.ndarray], Any]) -> Patch:
    """Change the table of full-on wrenches (thrusters, 3 or 6) that our equations use."""

    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        true = Spacecraft.wrench_map.func  # type: ignore[attr-defined]
        changed = property(lambda craft: tuple(map(tuple, change(craft, np.array(true(craft))))))
        monkeypatch.setattr(Spacecraft, "wrench_map", changed)

    return patch


def reversed_torque(_: Spacecraft, table: np.ndarray) -> np.ndarray:
    table[0, -1] *= -1
    return table


def about_the_frame(craft: Spacecraft, table: np.ndarray) -> np.ndarray:
    forces = np.array([np.array(t.direction) * t.force for t in craft.thrusters])
    shift = np.cross(craft.centre_of_mass, forces)
    extra = shift if craft.dimension == 3 else shift[:, 2:]
    return table + np.pad(extra, ((0, 0), (craft.dimension, 0)))


def degrees_for_radians(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("cos", "sin"):
        changed(name, lambda true, x: true(x * math.pi / 180), fields)(monkeypatch)


def products_of_the_other_sign(true: Any, craft: Spacecraft) -> Body:
    body = true(craft)
    xx, xy, xz, yy, yz, zz = body.inertia
    return replace(body, inertia=(xx, -xy, -xz, yy, -yz, zz))


def force_in_world(true: Any, state: Any, load: Any, h: Any) -> Any:
    unturned = replace(state, attitude=Quat(1.0, 0.0, 0.0, 0.0))
    return replace(true(state, load, h), v=true(unturned, load, h).v)


def disturbance_in_body(true: Any, state: Any, load: Any, h: Any) -> Any:
    """A disturbance stays put in the world; taken for a wrench in B it would turn with the craft."""
    if load.disturbance is None:
        return true(state, load, h)
    thrust, change = load.thrust
    push = load.disturbance
    both = Wrench(thrust.force + push.force, thrust.torque + push.torque)
    return true(state, replace(load, thrust=(both, change), disturbance=None), h)


def spin_in_world(true: Any, state: Any, load: Any, h: Any) -> Any:
    """To turn before the attitude and not after it is right for a spin given in W."""
    moved = true(state, load, h)
    turn = state.attitude.inverse().times(moved.attitude)
    return replace(moved, attitude=turn.times(state.attitude))


def velocity_before_the_step(true: Any, state: Any, load: Any, h: float, nodes: int) -> Any:
    """Position advanced with the old velocity only: explicit Euler in the plane."""
    return replace(true(state, load, h, nodes), p=state.p + state.v.scale(h))


def late(true: Any, craft: Any, start: Any, commands: np.ndarray, *rest: Any) -> Any:
    """Each command acts one period late, as a discrete Drake plant may do."""
    return true(craft, start, np.concatenate([commands[:1], commands[:-1]]), *rest)


def late_where_most_fire(
    true: Any, craft: Any, start: Any, commands: np.ndarray, *rest: Any
) -> Any:
    if commands.mean() < 0.2:
        return true(craft, start, commands, *rest)
    return late(true, craft, start, commands, *rest)


def two_nodes_in_space(monkeypatch: pytest.MonkeyPatch) -> None:
    """Order four instead of six: with validation's substeps as exact as anything that Drake sees."""
    monkeypatch.setitem(dynamics.RULES, dynamics._SPATIAL_NODES, dynamics.RULES[2])


def heavier(true: Any, craft: Spacecraft, *rest: Any, **more: Any) -> Any:
    """By a millionth."""
    return true(replace(craft, mass=craft.mass * (1 + 1e-6)), *rest, **more)


ERRORS: dict[str, tuple[Spacecraft, Patch, str]] = {
    "reversed torque": (PLANE, wrench_map(reversed_torque), "thrusters"),
    "swapped thrusters": (
        SPACE,
        wrench_map(lambda _, table: table[[1, 0, *range(2, len(table))]]),
        "thrusters",
    ),
    "thrusters about the frame": (SPACE, wrench_map(about_the_frame), "thrusters"),
    # One thruster at a time shares with nobody: only several can show it.
    "sharing ignored": (
        SHARING,
        changed("thrust", lambda _, craft, command, *body: tuple(command), dynamics),
        "commands",
    ),
    "mass of another unit": (
        PLANE,
        changed("of", lambda true, craft: replace(true(craft), mass=craft.mass * 9.81), Body),
        "mass",
    ),
    "products of the other sign": (SPACE, changed("of", products_of_the_other_sign, Body), "mass"),
    "no gyroscopic torque": (
        SPACE,
        changed("last_product", lambda _, a, b: a[0].scale(0.0), rotation),
        "accelerations",
    ),
    "force in W": (SPACE, changed("_advance_spatial", force_in_world, dynamics), "accelerations"),
    "degrees": (PLANE, degrees_for_radians, "accelerations"),
    "spin in W": (SPACE, changed("_advance_spatial", spin_in_world, dynamics), "period"),
    "explicit Euler": (
        PLANE,
        changed("_advance_planar", velocity_before_the_step, dynamics),
        "period",
    ),
    "disturbance in B": (
        SPACE,
        changed("_advance_spatial", disturbance_in_body, dynamics),
        "disturbances",
    ),
    "no disturbance": (
        PLANE,
        changed(
            "_advance_planar",
            lambda true, state, load, *rest: true(state, replace(load, disturbance=None), *rest),
            dynamics,
        ),
        "disturbances",
    ),
    # Single periods have one command: only flights have a later one.
    "order four": (SPACE, two_nodes_in_space, "invariants"),
    "late in flights": (PLANE, changed("rollout", late, flights), "flights"),
    "late where most fire": (PLANE, changed("rollout", late_where_most_fire, flights), "bang-bang"),
    "another mass in the engine": (
        PLANE,
        changed("Engine", heavier, validation.study.engines),
        "engine",
    ),
    "late everywhere": (PLANE, changed("rollout", late, sampling, flights, oracles), "oracles"),
}
SHARED: dict[str, tuple[Spacecraft, Patch, str]] = {
    "a period early": (
        PLANE,
        changed(
            "step_inputs",
            lambda true, world, episode, *rest: true(
                world, replace(episode, clock=episode.clock + 1), *rest
            ),
            World,
        ),
        "onsets",
    ),
    "valves need not stay": (
        PLANE,
        changed(
            "enforced",
            lambda true, hold, command, before, period: true(hold, command, before, 2.0 * period),
            MinimumDwell,
        ),
        "onsets",
    ),
}
"""Errors that Drake shares, as our code says when what was drawn acts."""


@pytest.fixture(autouse=True)
def _short_coasts(monkeypatch) -> None:
    """What breaks a law does so within a second too."""
    monkeypatch.setattr("validation.study.invariants._COAST", 1.0)


def failures(craft: Spacecraft) -> Iterator[tuple[str, str]]:
    """Layer and check of everything that is found, in order."""
    scope = Scope(craft, seed=1, states=8, flights=1)
    # What whole flights find is planted in the plane only, and they take their time in space.
    for name in LAYERS if craft is not SPACE else list(LAYERS)[: list(LAYERS).index("flights")]:
        look = LAYERS[name]
        yield from ((name, c.name) for c in look(scope) if isinstance(c, Check) and not c.passed)


def found_in_what_is_shared(scope: Scope) -> Iterator[Check]:
    """Checks that find something in what Drake is given by our code."""
    yield from (c for c in LAYERS["onsets"](scope) if isinstance(c, Check) and not c.passed)


def each(errors: dict[str, tuple[Spacecraft, Patch, str]]) -> Any:
    """By turns among the default tests and the slow ones."""
    return pytest.mark.parametrize(
        ("craft", "patch", "layer"),
        [
            pytest.param(*one, marks=pytest.mark.slow if number % 2 else (), id=name)
            for number, (name, one) in enumerate(errors.items())
        ],
    )


@each(ERRORS)
def test_found_where_it_lies(craft, patch, layer, monkeypatch):
    patch(monkeypatch)
    assert next(failures(craft), ("nowhere", ""))[0] == layer


@each(SHARED)
def test_found_although_drake_shares_it(craft, patch, layer, monkeypatch):
    patch(monkeypatch)
    assert layer == "onsets"
    assert list(found_in_what_is_shared(Scope(craft, seed=1, states=8, flights=1)))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:spacecraft 'nasty-planar'. its 1 thruster cannot push")
@pytest.mark.parametrize(("craft", "seed"), [("free-flyer-shared", 1), ("one thruster", 2)])
def test_what_is_shared_is_right_for_any_valves_and_seed(craft, seed):
    alone = replace(PLANE, thrusters=PLANE.thrusters[:1])
    scope = Scope(
        alone if craft == "one thruster" else load_spacecraft(craft), seed, states=8, flights=1
    )
    assert list(found_in_what_is_shared(scope)) == []


@pytest.mark.slow
@pytest.mark.parametrize("craft", [SHARING, SPACE], ids=lambda craft: craft.name)
def test_nothing_planted_nothing_found(craft):
    assert list(failures(craft)) == []


@pytest.mark.parametrize(
    "change",
    [
        {"mass": SPACE.mass * (1 + 1e-9)},
        {"centre_of_mass": (SPACE.centre_of_mass[0] + 1e-6, *SPACE.centre_of_mass[1:])},
        {
            "thrusters": (
                replace(SPACE.thrusters[0], force=SPACE.thrusters[0].force * (1 + 1e-9)),
                *SPACE.thrusters[1:],
            )
        },
    ],
    ids=["mass", "centre of mass", "force"],
)
def test_a_millionth_is_enough(change, monkeypatch):
    """Drake flies a spacecraft that differs from ours by next to nothing."""

    def other(craft, *arguments):
        return Plant(replace(craft, **change), *arguments)

    monkeypatch.setattr(validation.study.dynamics, "Plant", other)
    assert next(failures(SPACE), None) is not None
