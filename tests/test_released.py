"""What earlier versions wrote opens with every command, or is said to be of that version.

``tests/support/released`` has a small training, an export with its card, and results, as each version wrote them:
0.2.0, the last commit before 0.3.0, and 0.3.0.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from rans import ConfigError
from rans.base.files import read_json, reading, write_json
from rans.base.structure import structure
from rans.cli import main
from rans.evaluation.fly.exported import read_contract
from rans.fast.learn.config import FilterSettings
from rans.fast.learn.run_folder import RunFolder
from rans.show.pages.report import sections_of

RELEASED = Path(__file__).parent / "support" / "released"
COMMANDS = (
    "evaluate {} --episodes 2",
    "view {} --save view.html",
    "export {} --output other --force",
    "report {}",
    "compare {} --with lqr --episodes 2 --certified 0",
    "assure {} --episodes 100",
    "stress {} --only latency --episodes 2",
    "dossier {}",
    "train {}/config.json --output more --total-timesteps 512",
)
OF_A_TRAINING = ("train --resume {} --total-timesteps 8704",)


@pytest.fixture
def copied(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda version: shutil.copytree(RELEASED / version, tmp_path, dirs_exist_ok=True)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.* was there already")
@pytest.mark.parametrize("version", ["0.2.0-last", "0.3.0"])
@pytest.mark.parametrize("command", [*COMMANDS, *OF_A_TRAINING])
def test_every_command_opens_what_an_earlier_version_wrote(version, command, copied):
    copied(version)
    folders = ["agent"] if command in OF_A_TRAINING else ["agent", "exported"]
    for folder in folders:
        shutil.rmtree("other", ignore_errors=True)
        shutil.rmtree("more", ignore_errors=True)
        assert main(command.format(folder).split()) == 0


@pytest.mark.parametrize("version", ["0.2.0-last", "0.3.0"])
def test_files_of_an_earlier_version_are_read(version, copied):
    copied(version)
    for name in ("agent", "exported"):
        run = RunFolder(Path(name))
        assert run.config().ppo.layers == (8,)
        assert run.training()["steps"] == 8192
    assert read_contract(Path("exported"))["rans"] == version[:5]
    assert sections_of(Path("agent"))


@pytest.mark.parametrize("command", [*COMMANDS, *OF_A_TRAINING])
@pytest.mark.parametrize("folder", ["agent", "exported"])
def test_what_cannot_be_read_is_said_to_be_of_its_version(command, folder, copied, capsys):
    """Settings of 0.2.0 that say something, which this version has not."""
    copied("0.2.0")
    if command == "report {}":  # of files, of which one is another
        Path(folder, "evaluation.json").unlink(missing_ok=True)
        folder = "agent"
    assert main(command.format(folder).split()) == 2
    assert "made by RANS 0.2.0, and this is " in " ".join(capsys.readouterr().err.split())


def test_keys_without_a_value_are_left_out_of_what_rans_has_written_alone():
    for nothing in ([], {}, "", None):
        table = {"drift": [1.0], "effects": nothing}
        assert structure(table, FilterSettings, "it", is_written=True).drift == (1.0,)
        with pytest.raises(ConfigError, match="unknown key 'effects'"):
            structure(table, FilterSettings, "it")
    for something in ([0.0], 0.0, False):
        with pytest.raises(ConfigError, match="unknown key 'effects'"):
            structure({"effects": something}, FilterSettings, "it", is_written=True)


@pytest.mark.parametrize("place", ["rans", "environment", "about", "training"])
def test_a_file_of_another_version_is_said_to_be_so_wherever_it_says_it(place, tmp_path):
    inner = {"rans": "0.1.0"}
    content = {"rans": inner, "environment": {"environment": inner}}.get(place, {place: inner})
    content = inner if place == "rans" else content
    write_json(tmp_path / "it.json", content)
    with (
        pytest.raises(ConfigError, match=r"made by RANS 0\.1\.0"),
        reading(tmp_path / "it.json") as table,
    ):
        table["missing"]
    assert read_json(tmp_path / "it.json")
