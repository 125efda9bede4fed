from __future__ import annotations

import json
import shutil
import sys
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import pytest

import rans.base.pretrained
from rans import ConfigError
from rans.cli import main
from rans.deploy.export import check_alone, write_export
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.evaluation.fly.agent import load_policy
from rans.evaluation.fly.any_craft import write_for_spacecraft
from rans.evaluation.fly.contestant_name import ContestantName
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.measure.aggregate import measure
from rans.fast.learn.run_folder import RunFolder
from rans.model.spacecraft_file import load_spacecraft, to_toml


@pytest.fixture(scope="module")
def run(trained, tmp_path_factory) -> Path:
    return Path(shutil.copytree(trained, tmp_path_factory.mktemp("runs") / "first"))


@pytest.fixture(scope="module")
def shipped(run, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("pretrained") / "small-pose-2d"
    words = f"export {run} --format rans --output {folder} --episodes 16"
    assert main(words.split()) == 2  # a hardly trained agent
    assert not folder.exists()
    assert main([*words.split(), "--force"]) == 0
    return folder


def test_without_its_critic_it_is_the_same_agent(run, shipped):
    observations = np.random.default_rng(1).normal(size=(200, 10)).astype(np.float32)
    before = load_policy(run)
    after = load_policy(shipped)
    expected = before.controller.act(None, None, observations)
    np.testing.assert_array_equal(after.controller.act(None, None, observations), expected)
    assert (after.craft, after.task, after.timing) == (before.craft, before.task, before.timing)
    assert {file.name for file in shipped.iterdir()} == {
        "agent.safetensors",
        "config.json",
        "spacecraft.toml",
        "card.json",
        "contract.json",
        "golden.json",
    }
    sizes = [(folder / "agent.safetensors").stat().st_size for folder in (shipped, run)]
    assert sizes[0] < sizes[1]


def test_the_card_says_what_evaluate_finds(run, shipped):
    card = json.loads((shipped / "card.json").read_text("utf-8"))
    assert card["episodes"] == 16
    assert (card["name"], card["task"], card["spacecraft"]) == (
        "small-pose-2d",
        "go-to-pose",
        "floating-platform",
    )
    assert card["training"]["seed"] == 0
    assert card["training"]["steps"] == 256
    assert card["training"]["environment"]["torch"] == version("torch")
    assert card["evaluation"].keys() == {"own", "paper"}
    loaded = contestant(str(run), "paper")
    craft = loaded.craft
    task = loaded.task
    task = task.for_evaluation()
    starts = scenarios(task, craft, card["evaluation_seed"], card["episodes"])
    measured = measure(fly(craft, task, loaded.controller, starts, loaded.timing))
    # The card keeps five digits.
    assert card["evaluation"]["paper"][""]["duty"][0] == pytest.approx(
        measured["duty"].value, rel=1e-4
    )
    assert card["evaluation"]["paper"][""]["settling time"][0] == "inf"  # half of them never settle


def test_an_agent_keeps_its_name_in_a_folder_of_another(tmp_path):
    """The file in a robot says which agent it is, and not where it was written."""
    craft = tmp_path / "mine.toml"
    craft.write_text(to_toml(replace(load_spacecraft("floating-platform"), name="mine")), "utf-8")
    agent = ContestantName.parse(f"any-craft-2d@{craft}")
    source = write_for_spacecraft(agent.own_folder, contestant(agent), tmp_path / "run")
    card = write_export(source, tmp_path / "firmware", "c", episodes=2)
    assert card["name"] == "any-craft-2d"
    assert "any-craft-2d: flies mine" in (tmp_path / "firmware/agent.h").read_text("utf-8")
    assert json.loads((tmp_path / "firmware/card.json").read_text("utf-8"))["name"] == card["name"]


@pytest.mark.usefixtures("undrawn")
def test_it_comes_with_rans_by_name(shipped, monkeypatch, capsys, here):
    write_export(shipped, here / "pretrained" / "small-pose-2d", "rans")
    monkeypatch.setattr(rans.base.pretrained, "FOLDER", here / "pretrained")
    assert main(["evaluate", "pretrained:small-pose-2d", "--episodes", "4"]) == 0
    assert (here / "runs/evaluations/pretrained-small-pose-2d/evaluation.json").exists()
    capsys.readouterr()
    assert main(["list"]) == 0
    assert "small-pose-2d" in capsys.readouterr().out
    assert main(["list", "small-pose-2d"]) == 0
    text = capsys.readouterr().out
    assert "Trained with seed 0 for 256 steps" in text
    assert "settling time" in text


def test_an_exported_agent_keeps_its_card(shipped, tmp_path):
    before = json.loads((shipped / "card.json").read_text("utf-8"))
    assert write_export(shipped, tmp_path / "again", "numpy", episodes=1) == before


def test_an_export_is_not_exported_again(refused, tmp_path):
    (tmp_path / "contract.json").write_text("{}")
    assert f"{tmp_path} is an export already: export the run" in refused(f"export {tmp_path}")


def test_an_agent_leaves_for_a_craft_of_a_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    mine = replace(load_spacecraft("floating-platform"), name="mine")
    Path("mine.toml").write_text(to_toml(mine), "utf-8")
    words = ["export", "any-craft-2d@mine.toml", "--format", "numpy", "--output", "out"]
    assert main([*words, "--episodes", "1"]) == 0
    assert load_spacecraft("out/spacecraft.toml").name == "mine"
    # One that is not there is an agent without its craft, not a spacecraft.
    assert main(["export", "any-craft-2d@other.toml", "--format", "numpy"]) == 2
    assert "there is no spacecraft file other.toml" in " ".join(capsys.readouterr().err.split())


def test_what_cannot_be_exported_is_one_sentence(run, shipped, tmp_path):
    with pytest.raises(ConfigError, match="is the run itself"):
        write_export(run, run)
    odd = Path(shutil.copytree(shipped, tmp_path / "odd"))
    (odd / "card.json").unlink()
    with pytest.raises(ConfigError, match=r"has no rows of metrics\.jsonl and no card"):
        write_export(odd, tmp_path / "again")
    assert not (tmp_path / "again").exists()
    bare = Path(shutil.copytree(run, tmp_path / "bare"))
    (bare / "agent.safetensors").unlink()
    with pytest.raises(ConfigError, match=r"has no agent\.safetensors: its training has not"):
        write_export(bare, tmp_path / "again")


def test_a_missing_package_is_told_before_any_flight(tmp_path, monkeypatch, refused):
    def flown(*_, **__):
        raise AssertionError

    monkeypatch.setattr("rans.deploy.export.write_export", flown)
    monkeypatch.setitem(sys.modules, "onnx", None)
    output = tmp_path / "exported"
    assert "[onnx]" in refused(f"export go-to-pose-2d --format onnx --output {output}")
    assert not output.exists()


@pytest.mark.slow
def test_a_copy_of_the_sources_that_is_not_installed(run, tmp_path, monkeypatch):
    def unknown(package):
        raise PackageNotFoundError(package)

    monkeypatch.setattr("rans.base.files.version", unknown)
    write_export(run, tmp_path / "first", episodes=2)
    assert json.loads((tmp_path / "first" / "contract.json").read_text())["rans"] == "not installed"
    assert rans.__version__ == "not installed"


def test_files_in_forms_of_packages_are_another_agents_too(tmp_path):
    """A form that a package adds writes agent.FORM, or files that end so; its own are written over."""
    (tmp_path / "golden.json").write_text("of another")
    for name in ("agent.fmu", "agent.1.px4", "agent.2.px4"):
        (tmp_path / name).write_text("")
    with pytest.raises(ConfigError, match=r"holds another agent's agent\.1\.px4 and agent\.2\.px4"):
        check_alone(tmp_path, "fmu", "mine")
    (tmp_path / "agent.fmu").unlink()
    check_alone(tmp_path, "px4", "mine")
    check_alone(tmp_path, "numpy", "of another")
    with pytest.raises(ConfigError, match=r"agent\.1\.px4"):
        check_alone(tmp_path, "numpy", "mine")


def test_a_policy_of_another_trainer_is_refused_with_what_to_do(tmp_path):
    from rans.cli.export import Export

    with pytest.raises(ConfigError, match="onnx:FILE:TASK"):
        Export("sb3:policy.zip:go-to-pose-2d", tmp_path / "out").run()
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("here")
def test_the_folder_of_an_agent_for_any_craft_names_its_craft(monkeypatch, capsys):
    written = []

    def write(run, output, *_, **__):
        written.append((RunFolder(run).spacecraft().name, output))
        output.mkdir(parents=True)
        return {"episodes": 4}

    monkeypatch.setattr("rans.deploy.export.write_export", write)
    arguments = ["export", "--format", "numpy", "--episodes", "4"]
    assert main([*arguments, "any-craft-3d@spheres"]) == 0
    assert main([*arguments, "any-craft-3d@astrobee-iss"]) == 0
    assert written == [
        ("spheres", Path("runs/exports/any-craft-3d-spheres")),
        ("astrobee-iss", Path("runs/exports/any-craft-3d-astrobee-iss")),
    ]
    printed = capsys.readouterr().out
    assert "any-craft-3d-spheres has the agent" in printed
