"""The layer that flies orbital missions in two-body gravity."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from rans_missions.orbit_checks import orbit_checks

from rans.model.drift import ClohessyWiltshire
from rans.model.spacecraft_file import load_spacecraft


def test_craft_without_orbital_missions_have_no_checks() -> None:
    assert list(orbit_checks(load_spacecraft("floating-platform"), 0)) == []


@pytest.mark.slow
def test_a_mission_is_won_in_two_body_gravity() -> None:
    """Of the craft that docks; `rans validate` flies the others too."""
    found = list(orbit_checks(load_spacecraft("afrl-deputy"), 1))
    # On a circle and on an ellipse.
    assert len(found) == 6
    assert [check.name for check in found if not check.passed] == []


@pytest.mark.slow
def test_another_orbit_in_the_equations_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """Engine and guidance that agree on a wrong mean motion: only another gravity tells."""
    right: Any = ClohessyWiltshire.carry

    def carry(self: ClohessyWiltshire, *arguments: Any) -> Any:
        return right(replace(self, mean_motion=1.3 * self.mean_motion), *arguments)

    monkeypatch.setattr(ClohessyWiltshire, "carry", carry)
    assert any(not check.passed for check in orbit_checks(load_spacecraft("afrl-deputy"), 1))
