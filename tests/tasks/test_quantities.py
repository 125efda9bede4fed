"""Quantities of errors: a fifth one is declared once, and metrics and tables know it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import rans
from rans import ConfigError, Timing
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.evaluation.measure.metrics import samples
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.quantities import QUANTITIES, Quantity, declare

PLATFORM = load_spacecraft("floating-platform")


@dataclass(frozen=True)
class Gapped(rans.GoToPosition):
    """Go to a position, with the distance from a wall as an error more."""

    gap_tolerance: float = 0.5

    def errors(self, state: Any, goal: Any) -> dict[str, Any]:
        return super().errors(state, goal) | {"gap": (goal.p - state.p).norm() * 0.25}

    def failed(self, state: Any, goal: Any) -> Any:
        return (goal.p - state.p).norm() > 50.0

    def reward(self, transition: Any) -> dict[str, Any]:
        return {"gap": (transition.goal.p - transition.state.p).norm() * -1.0}


@pytest.fixture
def gap(monkeypatch) -> Quantity:
    quantity = Quantity("gap", "m", "mm", 1000.0)
    monkeypatch.setitem(QUANTITIES, "gap", quantity)
    return quantity


def test_a_fifth_quantity_is_declared_once(gap):
    task = Gapped()
    timing = Timing(episode_steps=10)
    flight = fly(PLATFORM, task, rans.LQR(PLATFORM, task), scenarios(task, PLATFORM, 3, 4), timing)
    found = {one.name: one for one in samples(flight)}
    assert found["gap error"].unit == "mm"
    np.testing.assert_allclose(
        found["gap error"].values, 2.5 * found["position error"].values, rtol=1e-12
    )
    assert not [name for name in found if name.startswith("solved to") and "mm" in name]


def test_a_name_has_one_meaning(gap):
    declare(gap)
    with pytest.raises(ConfigError, match="exists already"):
        declare(Quantity("gap", "m", "cm", 100.0))
