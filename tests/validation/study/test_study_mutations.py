"""Classical errors, planted in our side of the comparison: the study finds each, and where it lies.

Every mutation patches what flies; Drake and the closed forms stay as they are. The layers run in the
study's order, from one thruster to the whole engine, and the first that fails must be the one that is
responsible.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import pytest

import validation.study.dynamics
import validation.study.engines
import validation.study.flights
import validation.study.oracles
import validation.study.sampling
from rans import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.plant import Plant
from tests.support.mutations import MUTATIONS, PLANE, SHARED, SHARING, SPACE, Patch
from validation.study.checks import Check
from validation.study.study import LAYERS, Scope


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


def name(value: Any) -> str:
    return getattr(value, "name", None) or getattr(value, "__name__", str(value))


def each(errors: Sequence[tuple[Spacecraft, Patch, str]]) -> Any:
    """By turns among the default tests and the slow ones."""
    return pytest.mark.parametrize(
        ("craft", "patch", "layer"),
        [
            pytest.param(*one, marks=pytest.mark.slow if number % 2 else ())
            for number, one in enumerate(errors)
        ],
        ids=name,
    )


@each(MUTATIONS)
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
@pytest.mark.parametrize("craft", [SHARING, SPACE], ids=name)
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
