"""Files with random damage, of every kind that is read: each is read as it is, or refused in a sentence."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import rans
from rans import GoToPose
from rans.base.files import write_json
from rans.base.pretrained import pretrained_folder
from rans.deploy.export import write_export
from rans.episode.step import Setup
from rans.evaluation.fly.exported import load_exported
from rans.evaluation.fly.tuned import OWN, tuned
from rans.fast.learn.run_folder import RunFolder
from rans.show.pages.report import report_from_run, sections_of
from tests.support.damage import check
from tests.support.written_files import TUNED, contents


@pytest.fixture(scope="module")
def export(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("export") / "mine"
    write_export(pretrained_folder("go-to-pose-2d"), folder, "onnx", episodes=8)
    return folder


@pytest.fixture
def mine(export, tmp_path) -> Path:
    return Path(shutil.copytree(export, tmp_path / "mine"))


@pytest.mark.slow
def test_exports(mine):
    names = "contract.json", "spacecraft.toml", "agent.onnx"
    check([mine / name for name in names], lambda: (load_exported(mine), [*sections_of(mine)]))
    check([mine / "card.json"], lambda: (RunFolder(mine).training(), RunFolder(mine).card()))


def test_run_folders(trained, tmp_path):
    run = Path(shutil.copytree(trained, tmp_path / "run"))
    files = [run / name for name in ("config.json", "spacecraft.toml", "agent.safetensors")]
    check(files, lambda: rans.load_agent(run), 0.5)
    files = [run / "checkpoint.safetensors", run / "metrics.jsonl"]
    check(files, lambda: (RunFolder(run).load_checkpoint("cpu"), RunFolder(run).training()))


@pytest.mark.parametrize("name", sorted({*contents()} - {"config.json"}))
def test_results(name, tmp_path):
    write_json(tmp_path / name, contents()[name])
    write_json(tmp_path / "config.json", {"seed": 0, "about": {"command": "c"}})
    page = tmp_path / "report.html"
    check([tmp_path / name], lambda: report_from_run(tmp_path).write(page), 2)


def test_tuned_settings(here):
    OWN.mkdir(parents=True)
    file = Path(shutil.copy(TUNED, OWN / "lqr.json"))
    setup = Setup(rans.load_spacecraft("floating-platform"), GoToPose(), rans.Timing())

    def read():
        found = tuned("lqr", setup)
        assert found is not None
        found.outlasts(found)
        found.budget()

    check([file], read, 3)


def test_texts(tmp_path):
    data = Path(rans.__file__).with_name("data")
    craft = tmp_path / "craft.toml"
    shutil.copy(data / "spacecraft" / "floating-platform.toml", craft)
    check([craft], lambda: rans.load_spacecraft(craft))
    world = tmp_path / "world.toml"
    shutil.copy(data / "conditions" / "lab.toml", world)
    check([world], lambda: rans.load_conditions(world))


def test_a_byte_order_mark_is_read_over(tmp_path):
    """As editors of Windows write files."""
    file = tmp_path / "world.toml"
    file.write_bytes(b'\xef\xbb\xbfbase = "lab"\n')
    assert rans.load_conditions(file) == rans.load_conditions("lab")
