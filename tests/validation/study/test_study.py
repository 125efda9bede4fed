"""The bounds of every check, as they were agreed: who loosens one changes this table too."""

from __future__ import annotations

from typing import Any

import pytest

from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.reference.plant import Plant
from rans.tasks import TASKS
from validation.study import engines, flights, invariants, onsets, oracles
from validation.study.checks import Check, Curve, Skipped
from validation.study.missions import MISSIONS
from validation.study.study import FULL_LAYERS, LAYERS, Scope, study

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
QUANTITIES = {"position": "m", "attitude": "rad", "velocity": "m/s", "spin": "rad/s"}


def four(**layers: float) -> dict[str, tuple[float, str]]:
    """The same bound for all four quantities of a layer."""
    return {
        f"{layer}: {name}": (bound, unit)
        for layer, bound in layers.items()
        for name, unit in QUANTITIES.items()
    }


BOTH = {
    "every thruster: force": (1e-12, "N"),
    "every thruster: torque": (1e-12, "N m"),
    "random commands: force": (1e-12, "N"),
    "random commands: torque": (1e-12, "N m"),
    "mass matrix": (1e-12, "relative"),
    "accelerations: linear": (1e-12, "relative"),
    "accelerations: angular": (1e-12, "relative"),
    "coasting: velocity": (1e-12, "m/s"),
    "superposition of forces": (1e-13, "m/s"),
    **four(
        **{
            "one control period": 1e-9,
            "disturbed period": 1e-9,
            "world turned": 1e-12,
            "engine, NumPy float64": 1e-11,
            "engine, torch float64": 1e-11,
            "engine, float32": 1e-3,
        }
    ),
}
SHARED = {
    **{
        f"draws: {name}": (8.0, "decades")
        for name in (
            "start",
            "body and thrust",
            "valves",
            "pushes",
            "sensors",
            "delay of readings",
            "number of faults",
            "thruster that fails",
            "kind of fault",
            "time and share of faults",
            "each beside the others",
            "each beside the episode before",
            "each beside another seed",
        )
    },
    "draws: an effect alone and among others": (0.0, "SI"),
    **{
        f"readings: {name}": (8.0, "decades")
        for name in (
            "size of biases",
            "dropouts of different periods",
            "first outage",
            *(f"noise of {name}" for name in QUANTITIES),
            *(f"dropouts of {name}" for name in QUANTITIES),
            *(f"{name} after a dropout" for name in QUANTITIES),
            *(f"noise of different {what}" for what in ("components", "periods", "episodes")),
        )
    },
    "readings: control periods of an outage": (0.0, "periods"),
    "readings: quantities that stop alone": (0.0, "periods"),
    "readings: change of a bias": (1e-12, "SI"),
    "readings: two control periods old": (0.0, "SI"),
    **{
        f"onsets: {name}": (0.0, "periods")
        for name in (
            "a fault at 2 s",
            "a valve 0.3 s late",
            "open for 0.5 s at least",
        )
    },
    "onsets: speed of a steady force": (1e-12, "m/s"),
    "onsets: way of a steady force": (1e-12, "m"),
    "onsets: angular momentum of a steady torque": (1e-7, "s"),
    "onsets: momentum of a swinging force": (5e-3, "relative"),
    "onsets: kicks of an episode less one": (0.0, "-"),
    "onsets: control period of a kick": (8.0, "decades"),
    "onsets: speed of a kick": (8.0, "decades"),
    **{
        f"tasks: {name}": (1e-12, "-")
        for name in (
            "prices",
            "reward where sensors err",
            *(f"reward of {task}" for task in TASKS if task not in {name for name, _ in MISSIONS}),
        )
    },
    "tasks: observations": (1e-12, "SI"),
    **{
        f"tasks: {name}": (0.0, "-")
        for name in (
            "failing beyond 8 m",
            "reached within 5 cm",
            "tracking fails beyond 6 rad/s",
            "cut off after 125 control periods",
        )
    },
}
"""Of what Drake is given by our code, and judges nothing of."""
PLANE = (
    BOTH
    | SHARED
    | {
        "draws: torques to the left": (8.0, "decades"),
        "coasting: angular momentum": (1e-12, "relative"),
        "coasting: energy": (1e-12, "relative"),
        "work less energy gained": (1e-10, "relative"),
        "one substep against eight": (1e-10, "SI"),
        **four(**{"Fresnel integrals": 1e-9, "DOP853": 1e-9, "25 s": 1e-9, "bang-bang": 1e-9}),
        "Drake's own error: position": (1e-10, "m"),
        "Drake's own error: attitude": (1e-10, "rad"),
    }
)
SPACE = (
    BOTH
    | SHARED
    | {
        "coasting: angular momentum": (1e-9, "relative"),
        "coasting: energy": (1e-9, "relative"),
        "work less energy gained": (1e-8, "relative"),
        "order of integration short of 6": (0.3, "-"),
        "asymmetric top: spin": (1e-9, "rad/s"),
        **four(**{"DOP853": 1e-8, "25 s, 32 substeps": 1e-6, "bang-bang, 32 substeps": 1e-6}),
        "Drake's own error: position": (1e-7, "m"),
        "Drake's own error: attitude": (1e-7, "rad"),
        "25 s, default substeps: position": (1e-4, "m"),
        "25 s, default substeps: attitude": (1e-5, "rad"),
        "bang-bang, default substeps: position": (4e-4, "m"),
        "bang-bang, default substeps: attitude": (4e-5, "rad"),
    }
)
COMPILED = four(**{"engine, compiled float64": 1e-11})
GRAPHS = four(**{"engine, CUDA graph float64": 1e-11, "engine, CUDA graph float32": 1e-3})


def missions(dimension: int) -> dict[str, tuple[float, str]]:
    """Of every mission that the dimension has."""
    found = {}
    for (name, size), declared in MISSIONS.items():
        if size == dimension:
            found |= {
                f"tasks: {name} draws {what}": (1e-9, "of the range") for what in declared.draws
            }
            if declared.margins:
                found[f"tasks: margins of {name}"] = (1e-8, "m, m/s, -")
    return found


def bounds(checks: Any) -> dict[str, tuple[float, str]]:
    return {c.name: (c.tolerance, c.unit) for c in checks if isinstance(c, Check)}


def agreed(table: dict[str, tuple[float, str]]) -> dict[str, Any]:
    return {name: (pytest.approx(bound), unit) for name, (bound, unit) in table.items()}


@pytest.fixture
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Flights of 1 s, whose bounds are those of 25 s near the goal: within 10 m nothing is loosened."""
    for module in (flights, engines):
        monkeypatch.setattr(
            module, "Timing", lambda **values: Timing(**{"episode_steps": 5} | values)
        )
    monkeypatch.setattr(engines, "_TIMING", Timing(episode_steps=5))
    monkeypatch.setattr(oracles, "_PERIODS", 2)


@pytest.mark.slow
@pytest.mark.usefixtures("_short")
@pytest.mark.parametrize(
    ("craft", "table"),
    [(PLATFORM, PLANE | missions(2)), (FLYER, SPACE | missions(3))],
    ids=["plane", "space"],
)
def test_bounds_of_every_quick_layer(craft: Any, table: dict[str, tuple[float, str]]) -> None:
    scope = Scope(craft, seed=1, states=4, flights=1)
    assert bounds(check for look in LAYERS.values() for check in look(scope)) == agreed(table)


@pytest.mark.usefixtures("_short")
def test_a_craft_without_thrusters_passes_and_names_what_it_lacks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Three wheels alone, in every layer that computes with thrusters or with what effectors store."""
    monkeypatch.setattr(invariants, "_COAST", 0.2)
    # Half of the seconds, and no thruster takes part in them.
    for name in ("_kick_checks", "_steady_checks"):
        monkeypatch.setattr(onsets, name, lambda *_: ())
    dynamics = ("thrusters", "commands", "accelerations", "period", "disturbances", "invariants")
    names = (*dynamics, "bang-bang", "draws", "onsets", "tasks", "closed-loop", "step")
    scope = Scope(load_spacecraft("innocube"), seed=1, states=4, flights=1)
    found = {name: list(FULL_LAYERS[name](scope)) for name in names}
    checks = {name: [x for x in one if isinstance(x, Check)] for name, one in found.items()}
    assert [check for some in checks.values() for check in some if not check.passed] == []
    assert {name for name in names if not checks[name]} == {
        "thrusters",
        "commands",
        "closed-loop",
        "step",
    }
    assert Plant(scope.craft).thruster_wrenches().shape == (0, 6)


def test_bounds_of_optimal_input() -> None:
    """That Drake flies it as our equations do, to 1e-9."""
    checks = [c for c in FULL_LAYERS["optimal"](Scope(PLATFORM, 1, 4, 1)) if isinstance(c, Check)]
    assert bounds(checks) == agreed(four(**{"optimal input": 1e-9}))
    assert all(check.passed for check in checks)


@pytest.mark.usefixtures("_short")
@pytest.mark.parametrize(("layer", "table"), [("compiled", COMPILED), ("cuda", GRAPHS)])
def test_bounds_of_other_paths(
    layer: str, table: dict[str, tuple[float, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With eager engines in the place of compiled ones, which take a compiler or a GPU."""
    monkeypatch.setattr(engines.shutil, "which", lambda _: "c++")
    monkeypatch.setattr(engines.torch.cuda, "is_available", lambda: True)
    made = []
    true = engines._engine

    def engine(
        craft: Any, seed: int, count: int, dtype: Any, device: str = "cpu", compiled: Any = None
    ) -> Any:
        made.append((str(dtype), device, compiled))
        return true(craft, seed, count, dtype, compiled=False)

    monkeypatch.setattr(engines, "_engine", engine)
    monkeypatch.setattr(engines, "graphed", lambda step, _: made.append("graph") or step)
    found = list(FULL_LAYERS[layer](Scope(PLATFORM, 1, 4, 2)))
    assert bounds(found) == agreed(table)
    assert all(check.passed for check in found if isinstance(check, Check))
    whole = "torch.float64"
    single = "torch.float32"
    # Each against NumPy's engine: compiled is asked for, and of CUDA graphs both precisions are.
    assert sorted(map(str, made)) == sorted(
        map(
            str,
            (
                [(whole, "cpu", True), (whole, "cpu", None)]
                if layer == "compiled"
                else [
                    (whole, "cpu", None),
                    (whole, "cuda", None),
                    "graph",
                    (single, "cuda", None),
                    "graph",
                ]
            ),
        )
    )


def test_the_float32_engine_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its difference from float64 is that of seven digits: less would be no float32, more an error."""
    monkeypatch.setattr(engines, "_TIMING", Timing(episode_steps=5))
    values = {
        c.name: c.value for c in LAYERS["engine"](Scope(PLATFORM, 1, 4, 2)) if isinstance(c, Check)
    }
    assert 1e-9 < values["engine, float32: position"] < 1e-5
    assert values["engine, torch float64: position"] < 1e-13


# What is looked at.


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Layers that only remember their scope."""
    scopes: list[Any] = []

    def look(name: str) -> Any:
        def found(scope: Scope) -> list[Any]:
            scopes.append((name, scope.seed, scope.states, scope.flights))
            return [
                Check(f"of {name}", 0.5, 1.0, "m", "Because."),
                Skipped(name, "Absent."),
                Curve("figure", name, (1.0,), (2.0,)),
            ]

        return found

    names = {"thrusters": look("thrusters"), "period": look("period")}
    monkeypatch.setattr("validation.study.study.LAYERS", names)
    monkeypatch.setattr("validation.study.study.FULL_LAYERS", names | {"cuda": look("cuda")})
    return scopes


def test_a_quick_study_looks_at_less(asked: list[Any]) -> None:
    told: list[Any] = []

    def stages(*said: Any) -> Any:
        told.append(said)
        return told.append

    found = study(PLATFORM, 7, quick=True, stages=stages)
    assert asked == [("thrusters", 7, 64, 16), ("period", 7, 64, 16)]
    assert told == [("thrusters", 1), 1, ("period", 1), 1]
    assert [(c.name, c.layer) for c in found.checks] == [
        ("of thrusters", "thrusters"),
        ("of period", "period"),
    ]
    assert (
        [s.name for s in found.skipped] == [c.name for c in found.curves] == ["thrusters", "period"]
    )
    assert found.title == "Dynamics of floating-platform (3DoF)"
    assert {
        key: found.settings[key] for key in ("spacecraft", "seed", "quick", "states", "flights")
    } == {"spacecraft": "floating-platform", "seed": 7, "quick": True, "states": 64, "flights": 16}
    assert list(found.settings["layers"]) == ["thrusters", "period"]


def test_a_whole_study_looks_at_more(asked: list[Any]) -> None:
    study(FLYER)
    assert asked == [(name, 0, 512, 128) for name in ("thrusters", "period", "cuda")]


def test_one_layer_may_be_a_slow_one_even_if_quick(asked: list[Any]) -> None:
    study(PLATFORM, quick=True, layer="cuda")
    assert asked == [("cuda", 0, 64, 16)]
