"""Spacecraft files: what arrives, and every way a file can be wrong."""

from __future__ import annotations

import dataclasses
import re
import warnings
from pathlib import Path

import pytest
from hypothesis import given, settings

from rans import ConfigError, Spacecraft, Thruster
from rans.base.registry import typed
from rans.model.spacecraft_file import (
    load_spacecraft,
    parse_spacecraft,
    spacecraft_text,
    to_toml,
)
from tests.support.crafts import nasty_spatial, spacecraft as any_spacecraft

VALID = """\
name = "probe"
dimension = 2
mass = 4.5
inertia = [[0.2, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.4]]
centre_of_mass = [0.1, 0.0]
radius = 0.3
shape = "cylinder"
thrust_sharing = "split"
thruster = [
  {position = [0.3, 0.2], direction = [-1, 0], force = 1.0},
  {position = [0.3, -0.2], direction = [-1, 0], force = 1.0},
  {position = [-0.3, 0.2], direction = [1, 0], force = 1.0},
  {position = [-0.3, -0.2], direction = [1, 0], force = 1.0},
  {position = [0.1, 0.3], direction = [0, -1], force = 2.0},
  {position = [0.1, -0.3], direction = [0, 1], force = 2.0},
]
"""


def test_every_key_of_a_file_arrives():
    craft = parse_spacecraft(VALID, "probe.toml")
    assert (craft.name, craft.dimension, craft.mass, craft.radius) == ("probe", 2, 4.5, 0.3)
    assert (craft.shape, craft.thrust_sharing) == ("cylinder", "split")
    assert craft.centre_of_mass == (0.1, 0, 0)
    assert craft.inertia[2][2] == 0.4
    assert craft.thrusters[4] == Thruster((0.1, 0.3, 0.0), (0.0, -1.0, 0.0), 2.0)
    assert craft.degrees_of_freedom == 3


def test_a_users_own_file_works_where_a_name_does(tmp_path):
    file = tmp_path / "my robot.toml"
    file.write_text(VALID, "utf-8")
    assert load_spacecraft(file) == load_spacecraft(str(file)) == parse_spacecraft(VALID, "x")
    assert hash(load_spacecraft(file)) == hash(load_spacecraft(file))


def test_directions_are_normalised_and_one_moment_is_a_sphere():
    text = VALID.replace("direction = [-1, 0]", "direction = [-3, 4]")
    assert parse_spacecraft(text, "x").thrusters[0].direction == pytest.approx((-0.6, 0.8, 0.0))
    text = VALID.replace("[[0.2, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.4]]", "0.25")
    assert parse_spacecraft(text, "x").inertia == ((0.25, 0, 0), (0, 0.25, 0), (0, 0, 0.25))


def test_a_craft_of_one_wheel_alone_is_read_with_a_warning_and_one_of_nothing_refused():
    text = """name = "turning"
dimension = 3
mass = 8.0
inertia = 0.2

[[wheel]]
axis = [1, 0, 0]
max_torque = 0.1
max_momentum = 1.0
inertia = 0.001
"""
    with pytest.warns(
        UserWarning, match="its 0 thrusters and 1 reaction wheel cannot push and turn"
    ):
        craft = parse_spacecraft(text, "probe.toml")
    assert (craft.thruster_count, craft.wheel_count) == (0, 1)
    assert craft.wrenches.shape == (0, 6)
    nothing = text[: text.index("[[wheel]]")]
    with pytest.raises(ConfigError, match="it needs a thruster, a reaction wheel, or another"):
        parse_spacecraft(nothing, "probe.toml")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("name = mine", 'name = "mine"'),
        ("[thruster]", "[[thruster]]"),
        ("inertia = nan", "got nan"),
    ],
)
def test_a_slip_of_a_beginner_is_told(line, said):
    text = to_toml(MADE).replace("dimension = 3", "dimension = 2")
    key = line.partition(" ")[0]
    kept = [row for row in text.split("\n") if row.partition(" ")[0] != key]
    changed = "\n".join([line, *kept] if key != "[thruster]" else [*kept, line])
    with pytest.raises(ConfigError, match=re.escape(said)):
        parse_spacecraft(changed, "probe.toml")


def test_files_that_cannot_be_read_are_named(tmp_path):
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "latin.toml").write_bytes(b'name = "\xe9"')
    for name in ("missing.toml", "folder.toml", "latin.toml", "nul\0.toml"):
        with pytest.raises(ConfigError, match="spacecraft file") as caught:
            load_spacecraft(tmp_path / name)
        assert name.partition("\0")[0] in str(caught.value)


@settings(max_examples=30)
@given(any_spacecraft(2) | any_spacecraft(3))
def test_written_as_toml_and_read_again(craft):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # random thrusters seldom control everything
        back = parse_spacecraft(to_toml(craft), "written")
    for field in dataclasses.fields(craft):
        if field.name != "thrusters":
            assert getattr(back, field.name) == getattr(craft, field.name)
    for read, written in zip(back.thrusters, craft.thrusters, strict=True):
        assert (read.position, read.force) == (written.position, written.force)
        assert read.direction == written.direction  # hashes of the text are of the same craft


MADE = nasty_spatial()
FLOATS = 7.0


def fails() -> Spacecraft:
    raise RuntimeError("no drawing board")


def test_spacecraft_made_in_python_by_their_module():
    here = "tests.model.test_spacecraft_file:"
    for name in ("MADE", "nasty_spatial"):  # an object, and a function that makes one
        craft = load_spacecraft(typed(here + name))
        assert (craft.mass, craft.inertia) == (MADE.mass, MADE.inertia)
        assert parse_spacecraft(spacecraft_text(here + name), "run folder") == craft
    for name, said in (
        ("FLOATS", "it must be a rans.Spacecraft, a function .*, got float"),
        ("fails", "RuntimeError: no drawing board"),
        ("missing", "tests.model.test_spacecraft_file has no 'missing'"),
    ):
        with pytest.raises(ConfigError, match=f"'{here}{name}' cannot be used: {said}"):
            load_spacecraft(typed(here + name))


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("a.urdf.xacro", "xacro a.urdf.xacro > a.urdf"),
        ("a.usda", "rans init a.toml"),
        ("A.TOML", "A.toml"),
    ],
)
def test_a_file_of_another_kind_is_named(name, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path(name).write_text("")
    with pytest.raises(ConfigError, match=re.escape(said)):
        load_spacecraft(name)
