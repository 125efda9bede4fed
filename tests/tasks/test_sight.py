"""Tasks written for the names of the version before: they fly, with a warning."""

from __future__ import annotations

import importlib
from typing import Any

import pytest

from rans.tasks import GoToPosition, observation_columns


def test_a_task_that_names_its_terms_sight_is_observed_alike() -> None:
    with pytest.warns(DeprecationWarning, match="observation_terms"):

        class Former(GoToPosition):
            def sight(self, state: Any, goal: Any) -> Any:
                return super().sight(state, goal)  # type: ignore[misc]

    assert observation_columns(Former(), 2) == observation_columns(GoToPosition(), 2)


def test_kinds_of_terms_are_still_imported_from_sight() -> None:
    former = importlib.import_module("rans.tasks.sight")
    new = importlib.import_module("rans.tasks.observation_terms")
    with pytest.warns(DeprecationWarning, match="AngularVelocity"):
        assert former.Spin is new.AngularVelocity
    with pytest.raises(AttributeError):
        _ = former.Nothing
