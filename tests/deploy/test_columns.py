"""Meanings of observed columns."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rans import ConfigError
from rans.base.pretrained import pretrained_folder
from rans.deploy.columns import written_columns
from rans.deploy.contract import (
    contract,
    wiring,
)
from rans.fast.learn.run_folder import RunFolder
from rans.tasks.derived import observation_width


def columns_and_wiring(name: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Columns of a shipped agent's contract by name, and its states and goals with their observations."""
    about, pairs = contract_and_wiring(name)
    return {column["name"]: column for column in about["observation"]}, pairs


def contract_and_wiring(name: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """A shipped agent's contract, and its states and goals with their observations."""
    run = RunFolder(pretrained_folder(name))
    config = run.config()
    craft = run.spacecraft()
    seen = np.zeros((1, 1, observation_width(config.settings, craft.dimension)), np.float32)
    return contract(name, config, craft, "", 0, seen), wiring(config.settings, craft)


@pytest.mark.parametrize(
    "name", ["avoid-2d", "avoid-3d", "dock-port-2d", "dock-port-3d", "land-3d"]
)
def test_every_column_of_a_mission_has_a_meaning(name):
    columns, _ = columns_and_wiring(name)
    assert all(column["meaning"] for column in columns.values())


def test_columns_of_the_nearest_zone_are_what_their_meaning_says():
    """Worked out from the zones in the notes of the goal."""
    columns, pairs = columns_and_wiring("avoid-2d")
    assert columns["zone 1 dx"]["meaning"] == "position of the centre of zone 1 minus own"
    assert columns["zone 1 dv_y"]["meaning"] == "velocity of zone 1 minus own"
    assert "of length 1 at its surface" in columns["zone 1 near x"]["meaning"]
    for state, goal, row in zip(pairs["state"], pairs["goal"], pairs["observation"], strict=True):
        own = np.array(state["position"])
        zones = np.reshape(goal["notes"]["zones"], (-1, 5))  # centre, velocity and radius of each
        gaps = np.linalg.norm(zones[:, :2] - own, axis=1) - zones[:, 4]
        x, y, _, vy, radius = zones[np.argmin(gaps)]
        way = [x, y] - own
        known = {
            "zone 1 dx": way[0],
            "zone 1 dv_y": vy - state["velocity"][1],
            "zone 1 gap": np.linalg.norm(way) - radius,
        }
        for column, value in known.items():
            assert row[columns[column]["column"]] == pytest.approx(value, abs=1e-4)


@pytest.mark.parametrize(
    "name", ["go-to-pose-2d", "go-to-pose-3d", "track-velocity-2d", "track-twist-3d-shared"]
)
def test_columns_written_for_other_software_are_the_observation(name):
    about, pairs = contract_and_wiring(name)
    written = written_columns(about)
    for *moving, row in zip(pairs["state"], pairs["goal"], pairs["observation"], strict=True):
        own, goal = (
            SimpleNamespace(
                p=one["position"],
                v=one["velocity"],
                w=np.resize(one["spin"], 3),
                R=Rotation.from_quat(one["attitude"], scalar_first=True).as_matrix()
                if np.ndim(one["attitude"])
                else Rotation.from_rotvec([0, 0, one["attitude"]]).as_matrix(),
            )
            for one in moving
        )
        names = {"own": own, "goal": goal, "turn": own.R.T @ goal.R}
        assert [eval(text, names) for text in written] == pytest.approx(row, abs=1e-4)


@pytest.mark.parametrize(
    ("name", "reason"), [("land-3d", "opposite to gravity"), ("multi-task-2d", "several")]
)
def test_columns_of_something_else_are_refused(name, reason):
    about, _ = contract_and_wiring(name)
    with pytest.raises(ConfigError, match=reason):
        written_columns(about)
