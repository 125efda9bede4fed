"""Networks of other trainers are exported as they are, with a contract by which they fly."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_robot.foreign import write_foreign_export
from rans_robot.pilot import exported_agent

from rans import ConfigError, RansWarning
from rans.base.pretrained import pretrained_folder
from rans.deploy.export import write_export
from tests.support.graphs import model_of, step

onnxruntime = pytest.importorskip("onnxruntime")

TRAINERS = Path(__file__).parents[3] / "examples" / "trainers"
WIDTH = 10


@pytest.mark.slow
def test_the_folder_flies_as_its_contract_says(tmp_path):
    file = TRAINERS / "agents/sb3-sac.onnx"
    spec = f"onnx:{file}:go-to-pose-2d@{TRAINERS / 'throttled-platform.toml'}"
    folder = tmp_path / "sac"
    with pytest.warns(RansWarning, match=r"flown every 0\.1 s"):
        card = write_foreign_export(spec, folder, episodes=16)
    assert card["training"] is None
    about = json.loads((folder / "contract.json").read_text("utf-8"))
    assert about["control_period"] == 0.1
    assert about["task"] == "go-to-pose"
    assert "not known" in about["conditions"]["summary"]
    assert (folder / "agent.onnx").read_bytes() == file.read_bytes()
    # Golden pairs of another network are noticed.
    exported_agent(folder)
    (folder / "agent.onnx").write_bytes((TRAINERS / "agents/sb3-td3.onnx").read_bytes())
    with pytest.raises(ConfigError, match="golden pairs"):
        exported_agent(folder)
    with pytest.raises(ConfigError, match="not as c"):
        write_foreign_export(spec, tmp_path / "other", "c", episodes=16)


def test_one_thruster_of_one_golden_pair_is_enough_to_refuse_an_export(tmp_path):
    write_export(pretrained_folder("go-to-pose-2d"), tmp_path, "onnx", episodes=2)
    exported_agent(tmp_path)
    file = tmp_path / "golden.json"
    pairs = json.loads(file.read_text("utf-8"))
    pairs["command"][7][3] = 1 - pairs["command"][7][3]
    file.write_text(json.dumps(pairs))
    with pytest.raises(ConfigError, match=f"1 of {len(pairs['command'])} golden pairs"):
        exported_agent(tmp_path)


@pytest.mark.parametrize(
    ("policy", "sentence"),
    [
        ("onnx:missing.onnx:go-to-pose-2d", "there is no file missing.onnx"),
        ("python:mine:act:go-to-pose-2d", "is no ONNX file"),
    ],
)
def test_a_policy_that_cannot_be_exported_is_a_sentence(policy, sentence, refused):
    assert sentence in refused(f"export {policy} --format onnx")


def test_a_network_with_states_is_not_exported(tmp_path):
    """As RSL-RL exports recurrent networks: the states go in beside the observation, and come out."""
    nodes = [
        step("Slice", "obs first last axis", "some"),
        step("Add", "some h_in", "h_out"),
        step("Sigmoid", "h_out", "duties"),
        step("Round", "duties", "actions"),
    ]
    places: dict[str, Any] = {
        name: np.array([k]) for name, k in (("first", 0), ("last", 8), ("axis", 1))
    }
    inputs = {"obs": ("N", WIDTH), "h_in": ("N", 8)}
    outputs = {"actions": ("N", 8), "h_out": ("N", 8)}
    file = tmp_path / "memory.onnx"
    file.write_bytes(model_of(nodes, inputs, outputs, **places))
    with pytest.raises(ConfigError, match="has a memory"):
        write_foreign_export(f"onnx:{file}:go-to-pose-2d@floating-platform", tmp_path / "flown")
