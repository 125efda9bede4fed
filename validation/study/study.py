"""May I trust what the fast engine computes about this spacecraft? The study behind ``rans validate``."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from rans.base.errors import ConfigError, brief, meant
from rans.base.progress import Stages, unseen_stages
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import to_toml
from rans.randomization.conditions import Conditions
from validation.study.checks import NO_THRUSTERS, Check, Curve, Skipped, Study
from validation.study.closed_loop import closed_loop_checks
from validation.study.conditions import condition_checks
from validation.study.discretisation import discretisation_checks, order_curves
from validation.study.dynamics import (
    VALIDATION_SUBSTEPS,
    acceleration_checks,
    disturbance_checks,
    mass_checks,
    period_checks,
    thruster_checks,
    wrench_checks,
)
from validation.study.engines import compiled_checks, engine_checks, graph_checks
from validation.study.flights import bang_bang_checks, flight_checks, optimal_checks
from validation.study.invariants import invariant_checks
from validation.study.onsets import onset_checks
from validation.study.oracles import oracle_checks


@dataclass(frozen=True)
class Scope:
    """What is studied, and how much of it."""

    craft: Spacecraft
    seed: int
    """Of every random state and command."""
    states: int
    """Random states of a layer that looks at single moments or periods."""
    flights: int
    """Flights of 25 s of a layer that looks at these."""
    conditions: Conditions | None = None
    """Under which flights are checked too."""


Layer = Callable[[Scope], Iterable[Check | Skipped | Curve]]


def _of_thrusters(name: str, layer: Layer) -> Layer:
    """The layer, which a craft without thrusters leaves out under this name."""
    return lambda s: layer(s) if s.craft.thrusters else (Skipped(name, NO_THRUSTERS),)


def _of_rigid(name: str, layer: Layer) -> Layer:
    """The layer, which a craft in which a mass moves leaves out under this name."""
    why = (
        "A mass moves in the craft, whose flights are chaotic and whose momentum is that of all its masses: "
        "accelerations and control periods are compared."
    )
    return lambda s: layer(s) if s.craft.is_rigid else (Skipped(name, why),)


LAYERS: dict[str, Layer] = {
    "thrusters": _of_thrusters("every thruster", lambda s: thruster_checks(s.craft)),
    "commands": _of_thrusters(
        "random commands", lambda s: wrench_checks(s.craft, s.seed, s.states)
    ),
    "mass": lambda s: mass_checks(s.craft),
    "accelerations": lambda s: acceleration_checks(s.craft, s.seed, s.states),
    "period": lambda s: period_checks(s.craft, s.seed, s.states),
    "disturbances": lambda s: disturbance_checks(s.craft, s.seed, s.states),
    "invariants": lambda s: invariant_checks(
        s.craft, s.seed, s.states, VALIDATION_SUBSTEPS[s.craft.dimension]
    ),
    "oracles": lambda s: oracle_checks(s.craft, s.seed, s.states),
    "flights": _of_rigid("25 s", lambda s: flight_checks(s.craft, s.seed, s.flights)),
    "bang-bang": _of_rigid("bang-bang", lambda s: bang_bang_checks(s.craft, s.seed, s.flights)),
    "engine": _of_rigid("engine", lambda s: engine_checks(s.craft, s.seed, s.flights)),
    "onsets": _of_rigid("onsets", lambda s: onset_checks(s.craft, s.seed)),
    "conditions": lambda s: (
        ()
        if s.conditions is None
        else condition_checks(s.craft, s.conditions, s.seed, s.flights // 8)
    ),
}
"""Everything that is quick, from the smallest part to the whole: the first layer to fail says where to
look."""

FULL_LAYERS: dict[str, Layer] = LAYERS | {
    "optimal": lambda s: optimal_checks(s.craft, s.seed),
    "closed-loop": lambda s: closed_loop_checks(s.craft, s.seed, 2 * s.flights),
    "compiled": lambda s: compiled_checks(s.craft, s.seed, s.flights),
    "cuda": lambda s: graph_checks(s.craft, s.seed, s.flights),
    "order": lambda s: order_curves(s.craft, s.seed, s.states),
    "step": _of_thrusters(
        "default over 50 Hz Euler", lambda s: discretisation_checks(s.craft, s.seed, s.flights)
    ),
}
"""With what takes longer: optimisation, compilation, feedback, and step sizes for the figures."""


def study(
    craft: Spacecraft,
    seed: int = 0,
    quick: bool = False,
    layer: str | None = None,
    stages: Stages = unseen_stages,
    conditions: Conditions | None = None,
) -> Study:
    """Compare the engine's motion of a spacecraft with Drake and with the laws of mechanics.

    Args:
        craft: planar or spatial.
        seed: of every random state and command.
        quick: fewer states and flights, and the quick layers only.
        layer: the only layer to look at.
        stages: reports progress; every layer is a stage of one unit.
        conditions: under which flights are checked too, effect by effect.

    Ctrl-C in a layer ends the study, and the layers before it are its result.

    Raises:
        ConfigError: Drake refuses the spacecraft's mass properties, its valves cannot do what the conditions
            ask for, or there is no such layer.
    """
    started = time.perf_counter()
    if conditions is not None:
        conditions.check_craft(craft)
    scope = Scope(craft, seed, *((64, 16) if quick else (512, 128)), conditions)
    layers = _chosen(layer, LAYERS if quick and layer is None else FULL_LAYERS, conditions)
    found: list[Check | Skipped | Curve] = []
    seconds: dict[str, float] = {}
    for name, look in layers.items():
        progress = stages(name, 1)
        begun = time.perf_counter()
        try:
            found += [replace(x, layer=name) if isinstance(x, Check) else x for x in look(scope)]
        except KeyboardInterrupt:
            found.append(Skipped(f"{name} and what follows", "The study was interrupted."))
            break
        seconds[name] = round(time.perf_counter() - begun, 2)
        progress(1)
    settings = {
        "spacecraft": craft.name,
        "seed": seed,
        "quick": quick,
        "states": scope.states,
        "flights": scope.flights,
        "seconds": {"all": round(time.perf_counter() - started, 2)} | seconds,
    }
    return Study(
        f"Dynamics of {craft.name} ({craft.degrees_of_freedom}DoF)",
        tuple(x for x in found if isinstance(x, Check)),
        settings,
        tuple(x for x in found if isinstance(x, Skipped)),
        tuple(x for x in found if isinstance(x, Curve)),
        to_toml(craft),
        is_partial=len(seconds) < len(layers),
    )


def _chosen(
    layer: str | None, layers: dict[str, Layer], conditions: Conditions | None
) -> dict[str, Layer]:
    if conditions is None:
        layers = {name: look for name, look in layers.items() if name != "conditions"}
        if layer == "conditions":
            raise ConfigError(
                "the layer conditions needs some to fly under, as in --conditions lab."
            )
    if layer is None:
        return layers
    if layer not in layers:
        raise ConfigError(
            f"there is no layer named {brief(layer)}{meant(layer, layers)}; known are "
            f"{', '.join(layers)}."
        )
    return {layer: layers[layer]}
