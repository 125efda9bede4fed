"""``rans init``: a template, values of options, and files of other software."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rans.cli import main
from rans.evaluation.fly.choice import Choice
from rans.model.actuators import OnOff, Wheel
from rans.model.spacecraft_file import load_spacecraft
from tests.support.processes import wait_until

SQUARE = [
    "-0.2, 0.1; 1, 0; 1.5",
    "0.2, 0.1; -1, 0; 1.5",
    "-0.2, -0.1; 1, 0; 1.5",
    "0.2, -0.1; -1, 0; 1.5",
    "0, -0.2; 0, 2; 1",
    "0, 0.2; 0, -2; 1",
]
BOX = "--set dimension=2 --set mass=12 --set size=0.4,0.4"


@pytest.fixture(autouse=True)
def _here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, undrawn: None, request: pytest.FixtureRequest
) -> None:
    """A folder of its own. Flights take seconds, and one test has them, another has their beginning."""
    monkeypatch.chdir(tmp_path)
    if request.function.__name__ not in (
        "test_a_batch_writes_a_file_that_reads_back",
        "test_a_long_flight_is_announced",
    ):
        flown = Choice(0.4, 0.2, 32, 32, 6.0, 17.0)
        monkeypatch.setattr("rans.evaluation.fly.choice.chosen", lambda *_: flown)


def batch(*words: str) -> int:
    return main(["init", "mine.toml", *words])


@pytest.mark.filterwarnings("always::UserWarning")
def test_a_long_flight_is_announced(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A craft that hardly moves, whose flights last for minutes, and whose mass is doubted before them."""
    said: list[str] = []

    def is_announced() -> bool:
        said.extend(capsys.readouterr().err.split())
        return "by any-craft-2d" in " ".join(said)

    def flown(*_: object, **__: object) -> None:
        wait_until(is_announced)
        raise KeyboardInterrupt

    monkeypatch.setenv("XDG_CACHE_HOME", str(Path.cwd()))
    monkeypatch.setattr("rans.evaluation.fly.choice._flown", flown)
    assert batch("--from", "floating-platform", "--set", "mass=5320") == 130
    assert "the usual cause is a mass in g, or an inertia in other units" in " ".join(said)


@pytest.mark.slow
def test_a_batch_writes_a_file_that_reads_back(capsys: pytest.CaptureFixture[str]) -> None:
    thrusters = [f"--thruster={one}" for one in SQUARE]
    assert batch(*BOX.split(), *thrusters, "--wheel=0,0,2;0.1;0.7;0.001") == 0
    craft = load_spacecraft("mine.toml")
    assert (craft.name, craft.dimension, craft.mass) == ("mine", 2, 12.0)
    # A box of 12 kg and 0.4 m by 0.4 m about z: 12 (0.16 + 0.16) / 12.
    assert craft.inertia[2][2] == pytest.approx(0.32)
    assert craft.thrusters[4].direction == (0.0, 1.0, 0.0)
    assert craft.actuators == OnOff()
    assert craft.wheels == (Wheel((0.0, 0.0, 1.0), 0.1, 0.7, 0.001),)
    printed = capsys.readouterr()
    assert "any-craft-2d#0.4: solved 256 of 256" in printed.out.replace("\n", " ")
    assert "3 N" in printed.out
    assert "dead: 0, 1, 2, 3; without" in printed.out.replace("\n", " ")
    assert "twice" not in printed.err
    text = Path("mine.toml").read_text()
    assert text.count("source:") >= 9
    assert Path("mine.svg").exists()


@pytest.mark.parametrize(
    ("options", "template"), [("", "floating-platform"), ("--set dimension=3", "free-flyer")]
)
def test_without_values_a_template_is_written(
    options: str, template: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert batch(*options.split()) == 0
    assert load_spacecraft("mine.toml") == replace(load_spacecraft(template), name="mine")
    assert f"is that of {template}: write your own" in capsys.readouterr().out.replace("\n", " ")


def test_from_a_spacecraft_everything_else_stays() -> None:
    assert batch("--from", "atmos", "--set", "mass=16", "--set", "name=our atmos") == 0
    craft, start = load_spacecraft("mine.toml"), load_spacecraft("atmos")
    assert (craft.name, craft.mass) == ("our atmos", 16.0)
    assert (craft.thrusters, craft.inertia, craft.actuators, craft.radius) == (
        start.thrusters,
        start.inertia,
        start.actuators,
        start.radius,
    )


@pytest.mark.parametrize("name", ["apollo-csm", "cubesat-6u", "mars-lander-steered"])
def test_everything_a_file_can_hold_is_written(name: str) -> None:
    assert batch("--from", name, "--set", f"name={name}") == 0
    craft, start = load_spacecraft("mine.toml"), load_spacecraft(name)
    assert np.array(craft.wrench_map) == pytest.approx(np.array(start.wrench_map), rel=1e-12)
    assert replace(craft, thrusters=start.thrusters) == start  # directions are normalized once more


@pytest.mark.filterwarnings("ignore:.*cannot push and turn")
def test_a_training_of_what_cannot_be_steered_is_not_suggested(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert batch(*BOX.split(), "--thruster=0.2,0.1;1,0;1") == 0
    said = capsys.readouterr().out
    assert "rans list mine.toml" in said
    assert "rans train" not in said
    assert "may be dead" not in said


def test_files_that_exist_are_kept(capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine.svg").write_text("mine")
    assert batch("--from", "atmos") == 2
    assert "mine.svg exists" in capsys.readouterr().err
    assert main(["init", "mine.txt", "--from", "atmos"]) == 2
    assert "must end in .toml" in capsys.readouterr().err


ROBOT = """<robot name="craft"><link name="hull"><inertial><mass value="8"/>
<inertia ixx="0.2" iyy="0.2" izz="0.3"/></inertial></link>
{links}</robot>"""
LINK = """<link name="thruster_{k}"/><joint name="j{k}" type="fixed"><parent link="hull"/>
<child link="thruster_{k}"/><origin xyz="{x} {y} 0.1" rpy="{rpy}"/></joint>"""
TURNS = {
    "x": "0 1.5707963267948966 0",
    "-x": "0 -1.5707963267948966 0",
    "y": "-1.5707963267948966 0 0",
    "-y": "1.5707963267948966 0 0",
}


def robot() -> Path:
    """A URDF whose six links of thrusters push along their z axes."""
    pytest.importorskip("rans_any_craft")  # which reads such files
    places = (
        (-0.2, 0.1, "x"),
        (0.2, 0.1, "-x"),
        (-0.2, -0.1, "x"),
        (0.2, -0.1, "-x"),
        (0, -0.2, "y"),
        (0, 0.2, "-y"),
    )
    links = "".join(
        LINK.format(k=k, x=x, y=y, rpy=TURNS[axis]) for k, (x, y, axis) in enumerate(places)
    )
    file = Path("robot.urdf")
    file.write_text(ROBOT.format(links=links))
    return file


def test_what_a_robots_file_does_not_say_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    robot()
    assert batch("--from", "robot.urdf") == 2
    assert "set dimension to 2 or 3" in capsys.readouterr().err
    assert batch("--from", "robot.urdf", "--set", "dimension=2") == 2
    said = capsys.readouterr().err.replace("\n", " ")
    assert "--thruster '0.2, 0.1; -1, 0; FORCE'" in " ".join(said.split())
    assert not Path("mine.toml").exists()
