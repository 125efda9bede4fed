"""Former names of settings: they mean what the present ones do, and warn."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import pytest

import rans
from rans.fast.learn.changes import change_entry
from rans.fast.learn.config import Failures, from_table, to_table
from rans.fast.learn.recipes import training
from rans.pretrained import pretrained_folder
from rans.structure import structure
from rans.tasks.rewards import Arrived


def test_a_former_keyword_sets_the_present_field() -> None:
    with pytest.warns(DeprecationWarning, match="name it checks"):
        timing: Any = rans.Timing(looks=4)  # type: ignore[call-arg]
    assert timing == rans.Timing(checks=4)
    with pytest.warns(DeprecationWarning, match="name it checks"):
        assert timing.looks == 4
    with pytest.warns(DeprecationWarning, match="name it trade_off"):
        task = rans.GoToPosePriced(knob=(0.2, 0.3), boundary_weight=2.0)  # type: ignore[call-arg]
    assert task == rans.GoToPosePriced(trade_off=(0.2, 0.3), boundary_weight=2.0)
    assert replace(task, price=(1.0, 2.0)).trade_off == (0.2, 0.3)
    assert pickle.loads(pickle.dumps(task)) == task


def test_a_former_key_of_a_table_is_read() -> None:
    with pytest.warns(DeprecationWarning, match="name it searches"):
        assert structure({"looks": 3}, Failures, "failures") == Failures(searches=3)
    with pytest.warns(DeprecationWarning, match="name it") as told:
        read = structure({"verge_weight": 2.0, "arrived_squarings": 3}, Arrived, "settings")
    assert read == Arrived(boundary_weight=2.0, arrived_sharpness=3)
    assert len(told) == 2


def test_a_config_written_by_the_version_before_is_read() -> None:
    config = training("go-to-pose-2d-trade-off", device="cpu")
    table = to_table(config)
    for owner, new, old in (
        ("settings", "boundary_weight", "verge_weight"),
        ("settings", "trade_off", "knob"),
        ("timing", "checks", "looks"),
    ):
        table[owner][old] = table[owner].pop(new)
    ramps = [dict(ramp) for ramp in table["curriculum"]]
    assert ramps[-1]["setting"] == "boundary_weight"
    ramps[-1]["setting"] = "verge_weight"
    with pytest.warns(DeprecationWarning, match="name it"):
        assert from_table(table | {"curriculum": ramps}) == config


def test_a_former_entry_is_changed() -> None:
    table = to_table(training("go-to-pose", device="cpu"))
    with pytest.warns(DeprecationWarning, match=r"name it timing\.checks"):
        change_entry(table, "timing.looks", 2)
    assert table["timing"]["checks"] == 2


def test_an_agent_keeps_its_former_name() -> None:
    with pytest.warns(DeprecationWarning, match="now called go-to-pose-2d-trade-off"):
        assert pretrained_folder("go-to-pose-2d-knob").name == "go-to-pose-2d-trade-off"
    with pytest.warns(DeprecationWarning, match="now called go-to-pose-2d-trade-off"):
        assert training("go-to-pose-2d-knob", device="cpu").task == "go-to-pose-priced"
