from __future__ import annotations

import re
from collections.abc import Callable
from importlib import resources

import pytest

from rans import Conditions
from rans.cli import main
from rans.model.spacecraft_file import spacecraft_names
from rans.tasks import TASKS, GoToPose, gymnasium_ids


@pytest.fixture(autouse=True)
def _wide(monkeypatch) -> None:
    """Tables are as wide as they need to be."""
    monkeypatch.setenv("COLUMNS", "160")


@pytest.fixture
def listed(capsys) -> Callable[..., str]:
    """What the command prints with these arguments."""

    def run(*arguments: str) -> str:
        assert main(["list", *arguments]) == 0
        return capsys.readouterr().out

    return run


def test_everything_is_listed(listed):
    text = listed()
    for name in (*spacecraft_names(), *TASKS):
        assert name in text
    text = listed("TASKS")
    assert {*re.findall(r"rans/\w+-v0", text)} == {
        i for n in TASKS for i in gymnasium_ids(n).values()
    }


def test_own_file(listed, tmp_path):
    shipped = resources.files("rans") / "data" / "spacecraft" / "floating-platform.toml"
    file = tmp_path / "mine.toml"
    text = shipped.read_text("utf-8").replace('"floating-platform"', '"[bold]mine"')
    file.write_text(text.replace("mass = 5.32", "mass = 7.25"))
    shown = listed(str(file))
    assert "7.25 kg" in shown
    assert "[bold]mine" in shown  # a name is no markup


def test_unknown_name(refused):
    text = refused("list floating-plattform")
    for part in (
        "'floating-plattform' (did you mean floating-platform?)",
        "`rans list` prints all",
        ".toml",
    ):
        assert part in text


def test_a_file_of_other_software_is_imported_first(refused, tmp_path):
    file = tmp_path / "craft.urdf"
    file.write_text("<robot/>")
    assert f"`rans init craft.toml --from {file}`" in refused(f"list {file}")


class Own(GoToPose):
    """Of a module that is nowhere enrolled."""


class Bare:
    def reset(self, count: int) -> None: ...

    def act(self, state: object, goal: object, observation: object) -> None: ...


WINDY = Conditions(description="windy")


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("tests.cli.test_list:Own", "Of a module that is nowhere enrolled"),
        ("tests.cli.test_list:Own", "SpacecraftEnv('tests.cli.test_list:Own', 2)"),
        ("tests.cli.test_list:WINDY", 'description = "windy"'),
        ("tests.cli.test_list:Bare", "no docstring"),
        ("rans.control.lqr:LQR", "rans.control.lqr:LQR after a first one"),
        ("tests.support.crafts:nasty_planar", "Thrusters"),
    ],
)
def test_whatever_a_module_has(listed, name, told):
    assert told in listed(name)


def test_picture(listed, tmp_path):
    file = tmp_path / "x.pdf"
    assert str(file) in listed("free-flyer", "--picture", str(file)).replace("\n", "")
    assert file.read_bytes().startswith(b"%PDF")


def test_wrong_pictures(refused, tmp_path):
    picture = "list free-flyer --picture"
    (tmp_path / "file").touch()
    assert "cannot write" in refused(f"{picture} {tmp_path}/file/x.png")


def test_a_file_of_conditions_is_known_from_a_spacecraft(listed, refused, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("[thrusters]\nlatency = [0.0, 0.1]\n")
    assert listed(str(file)) == file.read_text()
    file.write_text('base = "lab"\ndescription = "as in the laboratory"\n')
    assert listed(str(file)) == file.read_text()
    file.write_text("[thrusters]\nlatncy = 0.1\n")
    assert "'latncy' (did you mean latency?)" in refused(f"list {file}")
    file.write_text("wings = 2\n")
    assert "unknown key 'wings'" in refused(f"list {file}")
    file.write_text("mas = 3.0\n")
    assert "did you mean mass?" in refused(f"list {file}")


def test_a_task_tells_its_reward_ends_and_keys(listed):
    text = listed("go-to-pose")
    for told in (
        "exp(-distance / scale)",
        "settings.thrust_weight",
        "too far away",
        "125 control periods of 0.2 s",
    ):
        assert told in text
    assert "ppo.n_envs" in listed("TRAINING")


def test_a_task_of_a_module_has_no_id_of_gymnasium(listed):
    assert "rans.SpacecraftEnv('tests.cli.test_list:Own', 2)" in listed("tests.cli.test_list:Own")
