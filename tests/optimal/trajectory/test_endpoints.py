"""States that a user names, by hand."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from rans.errors import ConfigError
from rans.model.fields import leaves
from rans.optimal.trajectory.endpoints import endpoint
from tests.support.states import planar, spatial


def test_keys_in_the_plane() -> None:
    found = endpoint(["p.x=3", "heading=1.5", "v.y=-0.1", "w=0.2"], planar(x=9.0))
    assert leaves(found) == (3.0, 0.0, 1.5, 0.0, -0.1, 0.2)


def test_a_quaternion_is_made_a_unit() -> None:
    found = endpoint(["p.z=1", "q.w=1", "q.x=1"], spatial())
    half = math.sqrt(0.5)
    assert leaves(found) == pytest.approx((0, 0, 1, half, half, 0, 0, 0, 0, 0, 0, 0, 0))
    assert leaves(endpoint([], spatial()))[3:7] == (1.0, 0.0, 0.0, 0.0)
    # Half a turn: of what is named in part, the rest is zero.
    assert leaves(endpoint(["q.z=1"], spatial()))[3:7] == (0.0, 0.0, 0.0, 1.0)


def test_a_file_names_the_same_keys(tmp_path: Path) -> None:
    file = tmp_path / "start.toml"
    file.write_text("heading = 1.5\n[p]\nx = 3\n")
    assert leaves(endpoint([str(file)], planar())) == (3.0, 0.0, 1.5, 0.0, 0.0, 0.0)
    file.write_text("heading = true\n")
    with pytest.raises(ConfigError, match="heading must be a finite number, got True"):
        endpoint([str(file)], planar())
