"""Former names of settings: they mean what the present ones do, and warn."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import pytest

import rans
from rans.errors import ConfigError
from rans.fast.learn.changes import change_entry
from rans.fast.learn.config import from_table, to_table
from rans.fast.learn.recipes import training
from rans.structure import structure
from tests.support.switching import SwitchingGoToPose


def test_a_former_keyword_sets_the_present_field() -> None:
    with pytest.warns(DeprecationWarning, match="name it checks"):
        timing: Any = rans.Timing(looks=4)  # type: ignore[call-arg]
    assert timing == rans.Timing(checks=4)
    with pytest.warns(DeprecationWarning, match="name it checks"):
        assert timing.looks == 4
    with pytest.warns(DeprecationWarning, match="name it") as warned:
        task = rans.GoToPosePriced(knob=(0.2, 0.3), boundary_weight=2.0)  # type: ignore[call-arg]
    assert len(warned) == 2
    assert task == rans.GoToPosePriced(
        trade_off=(0.2, 0.3), arrived=rans.RestReward(boundary_weight=2.0)
    )
    assert replace(task, price=(1.0, 2.0)).trade_off == (0.2, 0.3)
    assert pickle.loads(pickle.dumps(task)) == task
    with pytest.warns(DeprecationWarning, match=r"name it arrived\.boundary_weight"):
        assert task.boundary_weight == 2.0  # type: ignore[attr-defined]


def test_a_former_keyword_changes_the_present_value_alone() -> None:
    """Of a value within the settings the others stay."""
    task: Any = rans.GoToPose(arrived=rans.RestReward(weight=6.0, sharpness=3))
    with pytest.warns(DeprecationWarning, match=r"name it arrived\.within"):
        changed = replace(task, arrived_within=0.5)
    assert changed.arrived == rans.RestReward(weight=6.0, sharpness=3, within=0.5)


def test_a_former_key_of_a_table_is_read() -> None:
    former = {"verge_weight": 2.0, "arrived_squarings": 3, "arrived": {"weight": 6.0}}
    with pytest.warns(DeprecationWarning, match="name it") as warned:
        read = structure(former, rans.GoToPose, "settings")
    assert read.arrived == rans.RestReward(weight=6.0, boundary_weight=2.0, sharpness=3)
    assert len(warned) == 2


def test_a_former_setting_that_is_a_constant_now() -> None:
    constants = {"approach_scale": 1.5, "speed_weight": 0.0, "thrust_weight": 0.1}
    with pytest.warns(DeprecationWarning, match="leave it out, as it is always") as warned:
        assert structure(constants, rans.GoToPose, "settings") == rans.GoToPose(thrust_weight=0.1)
    assert len(warned) == 2
    with pytest.warns(DeprecationWarning, match="switching_weight is deprecated"):
        rans.TrackTwist(switching_weight=0.0)  # type: ignore[call-arg]
    says = r"GoToPose\.turn_scale is no longer a setting: it is always 1\.0, got 2\.0"
    with pytest.raises(ConfigError, match=says):
        structure({"turn_scale": 2.0}, rans.GoToPose, "settings")
    with pytest.raises(ConfigError, match=says):
        rans.GoToPose(turn_scale=2.0)  # type: ignore[call-arg]


def test_two_former_scales_are_one() -> None:
    scales = {"fine_position_scale": 0.006, "fine_attitude_scale": 0.006}
    with pytest.warns(DeprecationWarning, match="name it fine_scale"):
        assert structure(scales, rans.GoToPose, "settings") == rans.GoToPose(fine_scale=0.006)
    with (
        pytest.warns(DeprecationWarning, match="name it fine_scale"),
        pytest.raises(ConfigError, match=r"they must be equal, got 0\.01 and 0\.006"),
    ):
        structure(scales | {"fine_attitude_scale": 0.01}, rans.GoToPose, "settings")


def test_a_setting_of_a_derived_task_may_have_a_former_name() -> None:
    assert SwitchingGoToPose(switching_weight=0.4).switching_weight == 0.4
    table = {"switching_weight": 0.3}
    assert structure(table, SwitchingGoToPose, "settings").switching_weight == 0.3


def test_a_config_written_by_the_version_before_is_read() -> None:
    config = training("go-to-pose-2d-trade-off", device="cpu")
    table = to_table(config)
    boundary = table["settings"]["arrived"].pop("boundary_weight")
    table["settings"] |= {"boundary_weight": boundary, "switching_weight": 0.0}
    table["settings"]["knob"] = table["settings"].pop("trade_off")
    table["timing"]["looks"] = table["timing"].pop("checks")
    ramps = [dict(ramp) for ramp in table["curriculum"]]
    assert ramps[-1]["setting"] == "arrived.boundary_weight"
    ramps[-1]["setting"] = "boundary_weight"
    with pytest.warns(DeprecationWarning, match="is deprecated"):
        assert from_table(table | {"curriculum": ramps}) == config


def test_a_former_entry_is_changed() -> None:
    table = to_table(training("go-to-pose", device="cpu"))
    with pytest.warns(DeprecationWarning, match="name it checks"):
        change_entry(table, "timing.looks", 2)
    assert table["timing"]["checks"] == 2
    with pytest.warns(DeprecationWarning, match=r"name it arrived\.weight"):
        change_entry(table, "arrived_weight", 3.0)
    assert table["settings"]["arrived"]["weight"] == 3.0
    before = from_table(table)
    with pytest.warns(DeprecationWarning, match="always 0"):
        change_entry(table, "settings.speed_weight", 0.0)
    assert from_table(table) == before
    with pytest.raises(ConfigError, match="no longer a setting"):
        change_entry(table, "settings.speed_weight", 0.2)


def test_a_config_with_failures_of_the_version_before() -> None:
    config = training("go-to-pose", device="cpu")
    failures = {"share": 0.0, "begin": 0.5, "searches": 8, "flights": 65_536}
    assert from_table(to_table(config) | {"failures": failures}) == config
    with pytest.raises(ConfigError, match=r"failures\.share is no longer a setting, got 0\.25"):
        from_table(to_table(config) | {"failures": failures | {"share": 0.25}})
