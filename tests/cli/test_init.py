"""``rans init``: a template, and files of other software."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rans
from rans.cli import main
from rans.evaluation.fly.choice import Choice
from rans.model.spacecraft_file import load_spacecraft
from tests.support.processes import wait_until


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch, undrawn, request) -> None:
    """A folder of its own. Flights take seconds, and one test has them, another has their beginning."""
    monkeypatch.chdir(tmp_path)
    if request.function.__name__ not in (
        "test_a_batch_writes_a_file_that_reads_back",
        "test_a_long_flight_is_announced",
    ):
        flown = Choice(0.4, 0.2, 32, 32, 6.0, 17.0)
        monkeypatch.setattr("rans.evaluation.fly.choice.chosen", lambda *_, **__: flown)


def batch(*words: str) -> int:
    return main(["init", "mine.toml", *words])


@pytest.mark.filterwarnings("always::UserWarning", "ignore:of floating-platform")
def test_a_long_flight_is_announced(monkeypatch, capsys):
    """A craft that hardly moves, whose flights last for minutes, and whose mass is doubted before them."""
    said = []

    def is_announced():
        said.extend(capsys.readouterr().err.split())
        return "by any-craft-2d" in " ".join(said)

    def flown(*_, **__):
        wait_until(is_announced)
        raise KeyboardInterrupt

    monkeypatch.setenv("XDG_CACHE_HOME", str(Path.cwd()))
    monkeypatch.setattr("rans.evaluation.fly.choice._flown", flown)
    heavy = replace(load_spacecraft("floating-platform"), mass=5320.0)
    Path("heavy.toml").write_text(rans.init_spacecraft("heavy", base=heavy).text)
    assert batch("--from", "heavy.toml") == 130
    assert "the usual cause is a mass in g, or an inertia in other units" in " ".join(said)


@pytest.mark.slow
def test_a_batch_writes_a_file_that_reads_back(capsys):
    assert batch("--from", "atmos") == 0
    printed = capsys.readouterr().out.replace("\n", " ")
    assert re.search(r"any-craft-2d#[\d.]+: solved \d+ of \d+", printed)
    assert "A file without any one of its thrusters still settles" in printed
    assert load_spacecraft("mine.toml") == replace(load_spacecraft("atmos"), name="mine")
    assert Path("mine.toml").read_text().count("source:") >= 9
    assert Path("mine.svg").exists()


@pytest.mark.parametrize(("dimension", "template"), [(2, "floating-platform"), (3, "free-flyer")])
def test_without_a_base_a_template_is_written(dimension, template):
    assert batch("--dimension", str(dimension)) == 0
    assert load_spacecraft("mine.toml") == replace(load_spacecraft(template), name="mine")


@pytest.mark.parametrize("name", ["cubesat-6u", "mars-lander-steered"])
def test_everything_a_file_can_hold_is_written(name):
    assert batch("--from", name) == 0
    craft, start = load_spacecraft("mine.toml"), replace(load_spacecraft(name), name="mine")
    assert np.array(craft.wrench_map) == pytest.approx(np.array(start.wrench_map), rel=1e-12)
    assert replace(craft, thrusters=start.thrusters) == start  # directions are normalized once more


@pytest.mark.filterwarnings("ignore:.*cannot push and turn")
def test_a_training_of_what_cannot_be_steered_is_not_suggested(capsys):
    craft = load_spacecraft("floating-platform")
    single = replace(craft, thrusters=craft.thrusters[:1])
    Path("single.toml").write_text(rans.init_spacecraft("single", base=single).text)
    assert batch("--from", "single.toml") == 0
    said = capsys.readouterr().out
    assert "rans list mine.toml" in said
    assert "rans train" not in said
    assert "may be dead" not in said


def test_files_that_exist_are_kept(refused):
    Path("mine.svg").write_text("mine")
    assert "mine.svg exists" in refused("init mine.toml --from atmos")
    assert "must end in .toml" in refused("init mine.txt --from atmos")


HULL = """<robot name="craft"><link name="hull"><inertial><mass value="8"/>{inertia}</inertial></link>
{links}</robot>"""
LINK = """<link name="thruster_{k}"/><joint name="j{k}" type="fixed"><parent link="hull"/>
<child link="thruster_{k}"/><origin xyz="{x} 0.1 0.05" rpy="0 {turn} 0"/></joint>"""


@pytest.mark.filterwarnings("ignore:of robot.urdf", "ignore:.*cannot push and turn")
def test_what_a_robots_file_does_not_say_is_named(capsys):
    """Its dimension is asked for; a force, an inertia and thrusters are those of the template, and said to be."""
    pytest.importorskip("rans_any_craft")  # which reads such files
    file = Path("robot.urdf")
    turns = ((-0.2, "1.5707963267948966"), (0.2, "-1.5707963267948966"))
    links = "".join(LINK.format(k=k, x=x, turn=turn) for k, (x, turn) in enumerate(turns))
    moments = '<inertia ixx="0.2" iyy="0.2" izz="0.3"/>'
    file.write_text(HULL.format(inertia=moments, links=links))
    assert batch("--from", "robot.urdf") == 2
    assert "choose --dimension 2 or 3" in capsys.readouterr().err.replace("\n", " ")
    flat = rans.init_spacecraft("mine", base=file, dimension=2)
    craft = flat.spacecraft
    assert (craft.mass, craft.inertia[2][2], craft.radius) == (8.0, 0.3, pytest.approx(0.2236))
    assert [t.position for t in craft.thrusters] == [(-0.2, 0.1, 0.0), (0.2, 0.1, 0.0)]
    assert [t.direction[0] for t in craft.thrusters] == pytest.approx([1.0, -1.0])
    assert "the force of thruster_0, thruster_1, and 1 N here" in flat.text
    file.write_text(HULL.format(inertia="", links=""))
    usual = load_spacecraft("free-flyer")
    bare = rans.init_spacecraft("mine", base=file, dimension=3)
    assert (bare.spacecraft.inertia, bare.spacecraft.thrusters) == (usual.inertia, usual.thrusters)
    assert "the thrusters here are those of free-flyer" in bare.text
    assert "the one here is that of free-flyer" in bare.text
