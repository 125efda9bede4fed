"""An exported folder is a contestant like the run that it was written from."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import onnx
import pytest

import rans
from rans.base.pretrained import pretrained_folder
from rans.deploy.export import write_export


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    written = tmp_path_factory.mktemp("exported") / "mine"
    write_export(pretrained_folder("go-to-pose-2d"), written, "onnx", episodes=2)
    return written


@pytest.mark.slow
def test_it_flies_by_its_contract(folder):
    exported = rans.load_agent(folder)
    agent = rans.load_agent("go-to-pose-2d")
    assert (exported.craft, exported.task) == (agent.craft, agent.task)
    np.testing.assert_array_equal(exported.fly(4).commands, agent.fly(4).commands)


def test_at_another_period_an_episode_is_as_long(folder, tmp_path):
    faster = shutil.copytree(folder, tmp_path / "faster")
    contract = faster / "contract.json"
    table = json.loads(contract.read_text()) | {"control_period": 0.1, "episode_steps": 40}
    contract.write_text(json.dumps(table))
    assert len(rans.load_agent(faster).fly(1).commands) == 40
    del table["episode_steps"]  # of an earlier export
    contract.write_text(json.dumps(table))
    assert len(rans.load_agent(faster).fly(1).commands) == 250


def test_a_network_for_a_batch_of_one_is_asked_row_by_row(folder, tmp_path):
    """As exporters of other libraries write it."""
    network = onnx.load(folder / "agent.onnx")
    for value in (*network.graph.input, *network.graph.output):
        value.type.tensor_type.shape.dim[0].Clear()
        value.type.tensor_type.shape.dim[0].dim_value = 1
    onnx.save(network, tmp_path / "one.onnx")
    single = rans.load_agent(f"onnx:{tmp_path / 'one.onnx'}:go-to-pose-2d")
    np.testing.assert_array_equal(
        single.fly(3).commands, rans.load_agent("go-to-pose-2d").fly(3).commands
    )
