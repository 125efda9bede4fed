"""What a file says of a spacecraft's looks: read strictly, whole wherever it goes, nothing from elsewhere."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rans.errors import ConfigError
from rans.model.solids import Solid, triangles
from rans.model.spacecraft_file import load_spacecraft, parse_spacecraft, spacecraft_text, to_toml

PLATFORM = spacecraft_text("floating-platform")
MESH = "# a square, as a fan\nv 0 0 0\nv 1 0 0\nv 1 1 0 1.0\nvn 0 0 1\nv 0 1 0\nf 1//1 2//1 3//1 4//1\n"


def file_with(folder: Path, solid: str) -> Path:
    (folder / "craft.toml").write_text(f"{PLATFORM}\n[[solid]]\n{solid}\n")
    return folder / "craft.toml"


def test_solids_of_a_file(tmp_path: Path) -> None:
    craft = load_spacecraft(
        file_with(
            tmp_path,
            'shape = "cylinder"\nsize = [0.1, 0.4]\naxis = [1, 0, 0]\n'
            'position = [0, 0, 0.2]\ncolour = "#aabbCC"',
        )
    )
    (one,) = craft.solids
    assert one == Solid("cylinder", (0.1, 0.4), (0.0, 0.0, 0.2), (1.0, 0.0, 0.0), "#aabbCC")
    assert parse_spacecraft(to_toml(craft), "written").solids == craft.solids
    assert "solid" not in to_toml(
        load_spacecraft("floating-platform")
    )  # tuned settings go by this text


@pytest.mark.parametrize("quote", ['"', "'"])
def test_a_mesh_travels_with_its_spacecraft(tmp_path: Path, quote: str) -> None:
    (tmp_path / "hull.obj").write_text(MESH)
    file = file_with(tmp_path, f'shape = "mesh"\nsize = [0.5]\nmesh = {quote}hull.obj{quote}')
    craft = load_spacecraft(file)
    text = spacecraft_text(file)
    assert craft.solids[0].mesh == MESH
    assert parse_spacecraft(text, "in a run folder") == craft
    assert parse_spacecraft(to_toml(craft), "written").solids == craft.solids
    assert triangles(craft.solids[0].mesh)[1] == [(0, 1, 2), (0, 2, 3)]


@pytest.mark.parametrize(
    ("solid", "said"),
    [
        ('shape = "torus"\nsize = [1.0]', "must be 'box' or 'cylinder' or"),
        ('shape = "box"\nsize = [1.0]', r"size of a box must be \[x, y, z\]"),
        ('shape = "sphere"\nsize = [0.0]', "each from 1e-6"),
        ('shape = "sphere"\nsize = [nan]', "each from 1e-6"),
        ('shape = "sphere"\nsize = [1.0]\ncolour = "red"', "#rrggbb"),
        ('shape = "sphere"\nsize = [1.0]\naxis = [0, 0, 0]', "axis must be"),
        ('shape = "sphere"\nsize = [1.0]\nposition = [1e9, 0, 0]', "within 1e6 m"),
        ('shape = "sphere"\nsize = [1.0]\nmass = 3.0', "unknown key 'mass'"),
        ('shape = "sphere"\nsize = [1.0]\nmesh = "v\\n"', 'the shape "mesh", and no other'),
        ('shape = "mesh"\nsize = [1.0]', 'the shape "mesh", and no other'),
        ('shape = "mesh"\nsize = [1.0]\nmesh = "hull.stl"', r"name of an \.obj file"),
        ('shape = "mesh"\nsize = [1.0]\nmesh = "no.obj"', r"no\.obj"),
        ('shape = "mesh"\nsize = [1.0]\nmesh = "../up.obj"', "beside the spacecraft's file"),
        ('shape = "mesh"\nsize = [1.0]\nmesh = "/etc/x.obj"', "beside the spacecraft's file"),
        ('shape = "mesh"\nsize = [1.0]\nmesh = "v 0 0 0\\nf 1 1 9"', "line 2 of the mesh"),
        ('shape = "mesh"\nsize = [1.0]\nmesh = "v 0 0 x\\n"', "line 1 of the mesh"),
        ('shape = "mesh"\nsize = [1.0]\nmesh = "v 0 0 0\\n"', "no triangle"),
    ],
)
def test_what_cannot_be_drawn_is_a_sentence(tmp_path: Path, solid: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        load_spacecraft(file_with(tmp_path, solid))


def test_a_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "elsewhere.obj").write_text(MESH)
    (tmp_path / "mine").mkdir()
    os.symlink(tmp_path / "elsewhere.obj", tmp_path / "mine" / "hull.obj")
    with pytest.raises(ConfigError, match="beside the spacecraft's file"):
        load_spacecraft(
            file_with(tmp_path / "mine", 'shape = "mesh"\nsize = [1.0]\nmesh = "hull.obj"')
        )


def test_too_much_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="of at most 1,000,000 characters"):
        Solid("mesh", (1.0,), mesh="v 0 0 0\n" * 125_001)
    many = '\n[[solid]]\nshape = "sphere"\nsize = [1.0]' * 201
    with pytest.raises(ConfigError, match="at most 200 solids"):
        parse_spacecraft(PLATFORM + many, "many.toml")


@given(st.text(alphabet="vf 0123456789-./\neninf", max_size=60))
def test_no_text_passes_for_a_mesh_that_is_none(text: str) -> None:
    try:
        corners, faces = triangles(f"{text}\n")
    except ConfigError:
        return
    assert faces
    assert all(0 <= k < len(corners) for face in faces for k in face)
