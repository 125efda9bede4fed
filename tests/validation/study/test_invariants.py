"""Every invariant finds an error that breaks it, planted in the motion it looks at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

import rans.model.dynamics
from rans import Spacecraft
from rans.model.dynamics import PlanarState, advance
from tests.support.crafts import nasty_planar, nasty_spatial
from validation.study import invariants
from validation.study.invariants import (
    invariant_checks,
)

PLANE = nasty_planar()
SPACE = nasty_spatial()
Motion = Callable[..., Any]


def later(change: Callable[[Any], Any]) -> Motion:
    """The true motion, and then a change to the state."""
    return lambda *arguments: change(advance(*arguments))


def spun(state: Any, factor: float) -> Any:
    return replace(
        state, w=state.w * factor if isinstance(state, PlanarState) else state.w.scale(factor)
    )


def moved(vector: Any) -> Any:
    """By a nanometre, or by so much a second, along every axis of W."""
    return vector + type(vector)(*(1e-9 for _ in vector.columns()))


def pushed(change: Callable[[Any], Any]) -> Motion:
    """The true motion under another force."""
    return lambda state, applied, *rest: advance(
        state, replace(applied, force=change(applied.force)), *rest
    )


def coarse(state: Any, applied: Any, body: Any, duration: float, steps: int = 1) -> Any:
    return advance(state, applied, body, duration, steps, 2)


def failed(craft: Spacecraft) -> list[str]:
    """Eight steps a period instead of validation's 32: as good for four gentle states, and quicker."""
    return [
        c.name for c in invariant_checks(craft, 1, 4, {2: 1, 3: 8}[craft.dimension]) if not c.passed
    ]


@pytest.mark.parametrize("craft", [PLANE, SPACE], ids=["plane", "space"])
def test_nothing_planted_nothing_found(craft):
    assert failed(craft) == []


@pytest.mark.parametrize(
    ("craft", "motion", "name"),
    [
        # By turns in the plane and in space.
        # 2e-13 a period is within the bound once, and five times beyond it after 25 periods.
        (PLANE, later(lambda x: replace(x, v=x.v.scale(1 + 2e-13))), "coasting: velocity"),
        (SPACE, later(lambda x: spun(x, 1 + 2e-9)), "coasting: angular momentum"),
        (PLANE, later(lambda x: spun(x, 1 + 2e-9)), "coasting: energy"),
        (SPACE, pushed(lambda f: f.scale(1 + 1e-6)), "work less energy gained"),
        (PLANE, pushed(lambda f: f.scale(1.0 + 1e-9 * f.norm())), "superposition of forces"),
        (SPACE, later(lambda x: replace(x, v=moved(x.v))), "world turned: velocity"),
        (PLANE, later(lambda x: replace(x, p=moved(x.p))), "world turned: position"),
    ],
    ids=["drag", "momentum", "energy", "work", "superposition", "wind", "drift"],
)
def test_every_invariant_finds_what_breaks_it(craft, motion, name, monkeypatch):
    monkeypatch.setattr(invariants, "advance", motion)
    assert name in failed(craft)


def test_a_step_in_the_plane_that_is_not_exact_is_found(monkeypatch):
    monkeypatch.setattr(invariants, "advance", coarse)
    assert "one substep against eight" in failed(PLANE)


@pytest.mark.parametrize("nodes", [1, 2])
def test_a_lower_order_in_space_is_found(nodes, monkeypatch):
    """Two and four instead of six."""
    rules = rans.model.dynamics.RULES
    monkeypatch.setitem(rules, rans.model.dynamics._SPATIAL_NODES, rules[nodes])
    assert "order of integration short of 6" in failed(SPACE)
