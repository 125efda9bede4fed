"""The bounds of every check, as they were agreed: who loosens one changes this table too."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest

from rans import Timing
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.plant import Plant
from validation.study import engines, flights, invariants, onsets, oracles
from validation.study.checks import Check
from validation.study.dynamics import mass_checks
from validation.study.study import FULL_LAYERS, LAYERS, Scope, study

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
BOTH = {
    "thrusters": {1e-12: 2},
    "commands": {1e-12: 2},
    "mass": {1e-12: 1},
    "accelerations": {1e-12: 2},
    "period": {1e-9: 4},
    "disturbances": {1e-9: 4},
    "engine": {1e-11: 8, 1e-3: 4},
    "onsets": {1e-12: 3, 1e-7: 1, 5e-3: 1, 0.0: 4},
    "conditions": {},
}
"""By layer, how many checks have which tolerance."""
PLANE = {
    "invariants": {1e-12: 7, 1e-10: 2, 1e-13: 1},
    "oracles": {1e-9: 8},
    "flights": {1e-10: 2, 1e-9: 4},
    "bang-bang": {1e-9: 4},
}
SPACE = {
    "invariants": {1e-12: 5, 1e-9: 2, 1e-8: 1, 1e-13: 1, 0.3: 1},
    "oracles": {1e-9: 1, 1e-8: 4},
    "flights": {1e-7: 2, 1e-4: 1, 1e-5: 1, 1e-6: 4},
    "bang-bang": {4e-4: 1, 4e-5: 1, 1e-6: 4},
}


def tolerances(checks: Any) -> Counter[float]:
    return Counter(float(f"{c.tolerance:.3g}") for c in checks if isinstance(c, Check))


@pytest.fixture
def _short(monkeypatch) -> None:
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
    ("craft", "own"), [(PLATFORM, PLANE), (FLYER, SPACE)], ids=["plane", "space"]
)
def test_tolerances_of_every_quick_layer(craft, own):
    scope = Scope(craft, seed=1, states=4, flights=1)
    found = {name: tolerances(look(scope)) for name, look in LAYERS.items()}
    assert found == BOTH | own


@pytest.mark.slow
@pytest.mark.usefixtures("_short")
def test_a_craft_without_thrusters_passes_and_names_what_it_lacks(monkeypatch):
    """Three wheels alone, in every layer that computes with thrusters or with what effectors store."""
    monkeypatch.setattr(invariants, "_COAST", 0.2)
    # Half of the seconds, and no thruster takes part in them.
    for name in ("_kick_checks", "_steady_checks"):
        monkeypatch.setattr(onsets, name, lambda *_: ())
    dynamics = ("thrusters", "commands", "accelerations", "period", "disturbances", "invariants")
    names = (*dynamics, "bang-bang", "onsets", "closed-loop", "step")
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


def test_the_float32_engine_rounds(monkeypatch):
    """Its difference from float64 is that of seven digits: less would be no float32, more an error."""
    monkeypatch.setattr(engines, "_TIMING", Timing(episode_steps=5))
    values = {
        c.name: c.value for c in LAYERS["engine"](Scope(PLATFORM, 1, 4, 2)) if isinstance(c, Check)
    }
    assert 1e-9 < values["engine, float32: position"] < 1e-5
    assert values["engine, torch float64: position"] < 1e-13


# What is looked at.


def test_one_layer_may_be_a_slow_one_even_if_quick(monkeypatch):
    asked = []

    def layer(scope):
        asked.append(scope)
        return [Check("of cuda", 0.5, 1.0, "m", "Because.")]

    monkeypatch.setattr("validation.study.study.FULL_LAYERS", {"cuda": layer})
    study(PLATFORM, quick=True, layer="cuda")
    assert [(scope.seed, scope.states, scope.flights) for scope in asked] == [(0, 64, 16)]


def test_an_interrupted_study_is_of_a_part(monkeypatch):
    """However far it came: what follows was not checked, and a dossier must not take it as evidence."""

    def interrupted(_: Scope) -> Any:
        raise KeyboardInterrupt

    for layers, is_partial in (
        ({"a": lambda s: [], "b": interrupted}, True),
        (
            {"a": lambda s: [Check("x", 0.0, 1.0, "m", "")], "b": interrupted, "c": interrupted},
            True,
        ),
        ({"a": lambda s: [Check("x", 0.0, 1.0, "m", "")]}, False),
    ):
        monkeypatch.setattr("validation.study.study.FULL_LAYERS", layers)
        found = study(PLATFORM)
        assert found.is_partial is found.to_json()["is_partial"] is is_partial
        assert found.passed is not is_partial


def test_a_mass_matrix_is_judged_by_its_worst_entry(monkeypatch):
    """One of 36 is off by three times the tolerance, so that their mean is within it."""
    right = Plant.mass_matrix

    def wrong(plant: Plant) -> Any:
        matrix = right(plant)
        matrix[0, 1] += 3e-12 * matrix[0, 0]
        return matrix

    monkeypatch.setattr(Plant, "mass_matrix", wrong)
    (check,) = mass_checks(FLYER)
    assert not check.passed
