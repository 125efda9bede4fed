"""The loop around L2F's batches, whose resets are ours to ask for; a stand-in has none of its physics."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from validation.peers import runner


class Batch:
    """Three environments of 4 steps at most; the first ends in every step."""

    def __init__(self) -> None:
        self.started: dict[str, list[list[bool]]] = {"parameters": [], "state": []}

    def __getattr__(self, name: str) -> Any:
        """Initialisation, dynamics, rewards and observations do nothing."""
        return lambda *_: None

    def VectorEnvironment(self) -> Any:
        return SimpleNamespace(OBSERVATION_DIM=5, EPISODE_STEP_LIMIT=4)

    def VectorState(self) -> Any:
        return SimpleNamespace(assign=lambda _: None)

    def terminated(self, *given: Any) -> None:
        ended = given[-2]
        ended[:] = [True, False, False]

    def sample_initial_parameters_if_truncated(self, *given: Any) -> None:
        self.started["parameters"].append(given[-2].tolist())

    def sample_initial_state_if_truncated(self, *given: Any) -> None:
        self.started["state"].append(given[-2].tolist())


def test_who_ended_or_flew_long_enough_starts_again(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = Batch()
    monkeypatch.setitem(
        sys.modules, "l2f", SimpleNamespace(vector_selector={3: calls}, Device=object)
    )
    monkeypatch.syspath_prepend(str(Path(runner.__file__).parent))
    batch = importlib.import_module("l2f_hover")._Batch(3, seed=0)
    for _ in range(9):
        batch.step()
    assert calls.started["parameters"] == calls.started["state"]
    assert np.array(calls.started["state"]).sum(axis=0).tolist() == [9, 2, 2]
    assert calls.started["state"][3] == calls.started["state"][7] == [True, True, True]
