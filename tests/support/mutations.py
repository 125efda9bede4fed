"""Classical errors of simulators, each as a patch of what we fly."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rans.episode
import rans.model.dynamics
import rans.model.fields
import rans.model.rotation
import rans.randomization.parameters
import rans.randomization.sensors
import validation.study.dynamics
import validation.study.engines
import validation.study.flights
import validation.study.oracles
import validation.study.sampling
from rans import Spacecraft
from rans.episode import World
from rans.model.body import Body
from rans.model.dynamics import PlanarState, Wrench
from rans.model.fields import Quat
from tests.support.crafts import nasty_planar, nasty_spatial

Patch = Callable[[pytest.MonkeyPatch], None]

PLANE = nasty_planar()
SPACE = nasty_spatial()
SHARING = replace(PLANE, thrust_sharing="split")


def wrench_map(monkeypatch: pytest.MonkeyPatch, change: Callable[[np.ndarray], Any]) -> None:
    """Change the table of full-on wrenches (thrusters, 3 or 6) that our equations use."""
    true = Spacecraft.wrench_map.func  # type: ignore[attr-defined]

    def changed(craft: Spacecraft) -> Any:
        return tuple(map(tuple, change(np.array(true(craft)))))

    monkeypatch.setattr(Spacecraft, "wrench_map", property(changed))


def reversed_torque(monkeypatch: pytest.MonkeyPatch) -> None:
    def change(table: np.ndarray) -> np.ndarray:
        table[0, -1] *= -1
        return table

    wrench_map(monkeypatch, change)


def swapped_thrusters(monkeypatch: pytest.MonkeyPatch) -> None:
    wrench_map(monkeypatch, lambda table: table[[1, 0, *range(2, len(table))]])


def thrusters_about_the_frame_not_the_centre_of_mass(monkeypatch: pytest.MonkeyPatch) -> None:
    true = Spacecraft.wrench_map.func  # type: ignore[attr-defined]

    def about_frame(craft: Spacecraft) -> Any:
        forces = np.array([np.array(t.direction) * t.force for t in craft.thrusters])
        shift = np.cross(craft.centre_of_mass, forces)
        extra = shift if craft.dimension == 3 else shift[:, 2:]
        return tuple(
            map(tuple, np.array(true(craft)) + np.pad(extra, ((0, 0), (craft.dimension, 0))))
        )

    monkeypatch.setattr(Spacecraft, "wrench_map", property(about_frame))


def degrees_for_radians(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("cos", "sin"):
        true = getattr(rans.model.fields, name)
        monkeypatch.setattr(rans.model.fields, name, lambda x, f=true: f(x * math.pi / 180))


def sharing_ignored(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rans.model.dynamics, "thrust", lambda _, command, *body: tuple(command))


def mass_properties(**changes: Callable[[Any], Any]) -> Patch:
    """Change what resists the wrench."""

    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        true = Body.of

        def of(craft: Spacecraft) -> Body:
            body = true(craft)
            return replace(body, **{key: f(getattr(body, key)) for key, f in changes.items()})

        monkeypatch.setattr(Body, "of", of)

    return patch


def products_of_the_other_sign(inertia: tuple[float, ...]) -> tuple[float, ...]:
    xx, xy, xz, yy, yz, zz = inertia
    return (xx, -xy, -xz, yy, -yz, zz)


def step(change: Callable[[Any, Any, Any, Any], Any]) -> Patch:
    """Change a step in space, given the true one."""

    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        true = rans.model.dynamics._advance_spatial
        monkeypatch.setattr(
            rans.model.dynamics,
            "_advance_spatial",
            lambda state, load, h: change(state, load, h, true),
        )

    return patch


def without_gyroscopic_torque(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rans.model.rotation, "last_product", lambda a, b: a[0].scale(0.0))


def force_in_world(state: Any, load: Any, h: Any, true: Any) -> Any:
    unturned = replace(state, attitude=Quat(1.0, 0.0, 0.0, 0.0))
    return replace(true(state, load, h), v=true(unturned, load, h).v)


def disturbance_in_body(state: Any, load: Any, h: Any, true: Any) -> Any:
    """A disturbance stays put in the world; taken for a wrench in B it would turn with the craft."""
    if load.disturbance is None:
        return true(state, load, h)
    thrust, change = load.thrust
    push = load.disturbance
    both = Wrench(thrust.force + push.force, thrust.torque + push.torque)
    return true(state, replace(load, thrust=(both, change), disturbance=None), h)


def disturbance_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    true = rans.model.dynamics._advance_planar
    monkeypatch.setattr(
        rans.model.dynamics,
        "_advance_planar",
        lambda state, load, *rest: true(state, replace(load, disturbance=None), *rest),
    )


def spin_in_world(state: Any, load: Any, h: Any, true: Any) -> Any:
    """To turn before the attitude and not after it is right for a spin given in W."""
    moved = true(state, load, h)
    turn = state.attitude.inverse().times(moved.attitude)
    return replace(moved, attitude=turn.times(state.attitude))


def velocity_before_the_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Position advanced with the old velocity only: explicit Euler in the plane."""
    true = rans.model.dynamics._advance_planar

    def explicit(state: PlanarState, load: Any, h: float, nodes: int) -> Any:
        return replace(true(state, load, h, nodes), p=state.p + state.v.scale(h))

    monkeypatch.setattr(rans.model.dynamics, "_advance_planar", explicit)


def stale_command(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each command acts one period late, as a discrete Drake plant may do."""
    true = validation.study.sampling.rollout

    def late(craft: Any, start: Any, commands: Any, *rest: Any) -> Any:
        return true(craft, start, np.concatenate([commands[:1], commands[:-1]]), *rest)

    for module in (validation.study.sampling, validation.study.flights, validation.study.oracles):
        monkeypatch.setattr(module, "rollout", late)


def late_in(module: Any, only_full: bool = False) -> Patch:
    """Commands act one period late in a layer's flights only, or only where most thrusters fire."""

    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        true = module.rollout

        def late(craft: Any, start: Any, commands: Any, *rest: Any) -> Any:
            shifted = np.concatenate([commands[:1], commands[:-1]])
            return true(
                craft, start, commands if only_full and commands.mean() < 0.2 else shifted, *rest
            )

        monkeypatch.setattr(module, "rollout", late)

    return patch


def two_nodes_in_space(monkeypatch: pytest.MonkeyPatch) -> None:
    """Order four instead of six: with validation's substeps as exact as anything that Drake sees."""
    rules = rans.model.dynamics.RULES
    nodes = rans.model.dynamics._SPATIAL_NODES
    monkeypatch.setitem(rules, nodes, rules[2])


def engine_of_another_mass(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the engine's craft is heavier, by a millionth."""
    true = validation.study.engines.Engine
    monkeypatch.setattr(
        validation.study.engines,
        "Engine",
        lambda craft, *rest, **more: true(
            replace(craft, mass=craft.mass * (1 + 1e-6)), *rest, **more
        ),
    )


# What Drake is given by our code: when it acts.


def changed(owner: Any, name: str, change: Callable[..., Any]) -> Patch:
    """A function of ours that is called with the true one before its own arguments."""

    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        true = getattr(owner, name)
        monkeypatch.setattr(
            owner, name, lambda *arguments, **named: change(true, *arguments, **named)
        )

    patch.__name__ = change.__name__
    return patch


def a_period_early(true: Any, world: Any, episode: Any, *rest: Any) -> Any:
    return true(world, replace(episode, clock=episode.clock + 1), *rest)


def valves_that_need_not_stay(
    true: Any, hold: Any, command: Any, before: Any, period: float
) -> Any:
    return true(hold, command, before, 2.0 * period)


SHARED: list[tuple[Spacecraft, Patch, str]] = [
    (PLANE, changed(World, "step_inputs", a_period_early), "onsets"),
    (
        PLANE,
        changed(rans.randomization.parameters.MinimumDwell, "enforced", valves_that_need_not_stay),
        "onsets",
    ),
]
"""Errors that Drake shares, as our code says when what was drawn acts."""

MUTATIONS: list[tuple[Spacecraft, Patch, str]] = [
    (PLANE, reversed_torque, "thrusters"),
    (SPACE, swapped_thrusters, "thrusters"),
    (SPACE, thrusters_about_the_frame_not_the_centre_of_mass, "thrusters"),
    # One thruster at a time shares with nobody: only several can show it.
    (SHARING, sharing_ignored, "commands"),
    (PLANE, mass_properties(mass=lambda m: m * 9.81), "mass"),
    (SPACE, mass_properties(inertia=products_of_the_other_sign), "mass"),
    (SPACE, without_gyroscopic_torque, "accelerations"),
    (SPACE, step(force_in_world), "accelerations"),
    (PLANE, degrees_for_radians, "accelerations"),
    (SPACE, step(spin_in_world), "period"),
    (PLANE, velocity_before_the_step, "period"),
    (SPACE, step(disturbance_in_body), "disturbances"),
    (PLANE, disturbance_forgotten, "disturbances"),
    # Single periods have one command: only flights have a later one.
    (SPACE, two_nodes_in_space, "invariants"),
    (PLANE, late_in(validation.study.flights), "flights"),
    (PLANE, late_in(validation.study.flights, only_full=True), "bang-bang"),
    (PLANE, engine_of_another_mass, "engine"),
    (PLANE, stale_command, "oracles"),
]
