"""Names of contestants: each form has its parts, and loads nothing."""

from pathlib import Path

import pytest

from rans import ConfigError
from rans.evaluation.fly.contestant_name import ContestantName


@pytest.mark.parametrize(
    ("exists", "text", "parts"),
    [
        ("", "runs/my-agent", ("run folder", "runs/my-agent", "", "")),
        ("", "runs/my-agent#go-to-pose", ("run folder", "runs/my-agent", "", "go-to-pose")),
        ("", "go-to-pose-2d", ("pretrained", "go-to-pose-2d", "", "")),
        ("", "pretrained:any#0.3", ("pretrained", "any", "", "0.3")),
        ("", "lqr", ("controller", "lqr", "", "")),
        ("", "lqr:dock@atmos", ("controller", "lqr", "dock@atmos", "")),
        ("", "mine.py:Best:dock-3d", ("controller", "mine.py:Best", "dock-3d", "")),
        ("", "onnx:a/b.onnx:dock", ("policy", "onnx:a/b.onnx", "dock", "")),
        ("", "python:mine:act", ("policy", "python:mine:act", "", "")),
        ("x#1", "x#1", ("run folder", "x#1", "", "")),
        ("x#1", "x#1#dock", ("run folder", "x#1", "", "dock")),
        ("12:30.onnx", "onnx:12:30.onnx:dock", ("policy", "onnx:12:30.onnx", "dock", "")),
        ("12:30.onnx", "onnx:12:30.onnx", ("policy", "onnx:12:30.onnx", "", "")),
    ],
)
def test_every_form_has_its_parts_and_the_longest_name_that_exists(here, exists, text, parts):
    if exists:
        (here / exists).write_bytes(b"")
    name = ContestantName.parse(text)
    assert (name.kind, name.name, name.setup, name.part) == parts
    assert name.text == text


@pytest.mark.parametrize("text", ["policy.pt", "nn/last_ep_300.pth", "mine.onnx", "model.zip"])
def test_files_of_other_libraries_are_answered_by_what_to_type(text):
    with pytest.raises(ConfigError, match=r"(onnx|sb3):FILE\.\w+:TASK-2d"):
        ContestantName.parse(text)


def test_a_controllers_name_may_be_that_of_a_folder(here):
    """After an earlier contestant it is the controller; alone it is the folder, if there is one."""
    name = ContestantName.parse("lqr")
    assert name.needs_setup
    with pytest.raises(ConfigError, match="lqr has no task; add one"):
        _ = name.output_folder
    (here / "lqr").mkdir()
    assert name.folder == name.output_folder == Path("lqr")


def test_only_a_policys_own_file_is_its_file(tmp_path):
    file = tmp_path / "policy.onnx"
    assert ContestantName.parse(f"onnx:{file}:dock").policy_file is None
    file.write_bytes(b"")
    assert ContestantName.parse(f"onnx:{file}:dock").policy_file == file
    assert ContestantName.parse("python:mine:act").policy_file is None


def test_an_agent_that_adapts_has_files_of_its_own():
    name = ContestantName.parse("adaptive:any-craft-2d@atmos")
    assert (name.kind, name.name, name.craft, name.adapts) == (
        "pretrained",
        "any-craft-2d",
        "atmos",
        True,
    )
    plain = ContestantName.parse("any-craft-2d@atmos")
    assert not plain.adapts
    assert name.output_folder != plain.output_folder
    with pytest.raises(ConfigError, match="'lqr:hold-3d' is no agent for any craft"):
        ContestantName.parse("adaptive:lqr:hold-3d")
