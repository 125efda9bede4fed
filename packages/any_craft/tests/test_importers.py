"""Spacecraft from URDF, against Drake's reader and damage."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_any_craft.foreign import Foreign
from rans_any_craft.importers import read_foreign

import rans
from rans.base.errors import ConfigError
from tests.support.damage import check


def six(chance: np.random.Generator, size: float = 1.0) -> str:
    return " ".join(f"{x:.6f}" for x in chance.uniform(-size, size, 3))


def inertia(chance: np.random.Generator) -> tuple[float, str]:
    """Mass, and the inertia of a random cloud of points as a body of this mass."""
    points = chance.normal(0.0, 0.1, (8, 3))
    points -= points.mean(axis=0)
    mass = float(chance.uniform(0.5, 5.0))
    tensor = mass / 8 * np.sum([p @ p * np.eye(3) - np.outer(p, p) for p in points], axis=0)
    names = {f"i{a}{b}": tensor["xyz".index(a), "xyz".index(b)] for a, b in PAIRS}
    return mass, "<inertia " + " ".join(f'{k}="{v:.9f}"' for k, v in names.items()) + "/>"


PAIRS = ("xx", "xy", "xz", "yy", "yz", "zz")


def urdf(seed: int) -> str:
    """A chain of hull, mast and two thrusters with every frame turned."""
    chance = np.random.default_rng(seed)
    parts = ['<robot name="craft">']
    for name in ("hull", "mast", "thruster_a", "thruster_b"):
        mass, tensor = inertia(chance)
        origin = f'<origin xyz="{six(chance)}" rpy="{six(chance, 3.0)}"/>'
        parts.append(
            f'<link name="{name}"><inertial>{origin}<mass value="{mass:.6f}"/>{tensor}</inertial></link>'
        )
    joints = (
        ("hull", "mast", "fixed"),
        ("mast", "thruster_a", "fixed"),
        ("hull", "thruster_b", "revolute"),
    )
    for number, (parent, child, kind) in enumerate(joints):
        limit = (
            '<limit effort="1" velocity="1" lower="-1" upper="1"/>' if kind == "revolute" else ""
        )
        parts.append(
            f'<joint name="j{number}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{six(chance)}" rpy="{six(chance, 3.0)}"/>{limit}</joint>'
        )
    return "\n".join([*parts, "</robot>"])


def read(text: str, folder: Path) -> Foreign:
    file = folder / "craft.urdf"
    file.write_text(text)
    return read_foreign(file)


def drafted(text: str, dimension: int, folder: Path) -> Any:
    """What `rans init --from` makes of the file."""
    file = folder / "craft.urdf"
    file.write_text(text)
    return rans.init_spacecraft("mine", base=file, dimension=dimension)


@pytest.mark.parametrize("seed", range(4))
def test_drake_reads_the_same_body(seed: int, tmp_path: Path) -> None:
    pytest.importorskip("pydrake")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    text = urdf(seed)
    found = read(text, tmp_path)
    plant = MultibodyPlant(0.0)
    (model,) = Parser(plant).AddModelsFromString(text, "urdf")
    plant.Finalize()
    context = plant.CreateDefaultContext()
    root = plant.GetFrameByName("hull", model)
    bodies = plant.GetBodyIndices(model)
    whole = plant.CalcSpatialInertia(context, root, bodies)
    assert found.mass == pytest.approx(whole.get_mass(), rel=1e-9)
    assert np.array(found.centre_of_mass) == pytest.approx(whole.get_com(), abs=1e-9)
    about_centre = whole.Shift(whole.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    assert found.inertia is not None
    assert np.array(found.inertia) == pytest.approx(about_centre, abs=1e-8)
    assert len(found.nozzles) == 2
    for nozzle in found.nozzles:
        body = plant.GetBodyByName(nozzle.name, model)
        pose = plant.CalcRelativeTransform(context, root, body.body_frame())
        centre = pose @ body.CalcCenterOfMassInBodyFrame(context)
        assert np.array(nozzle.position) == pytest.approx(centre, abs=1e-9)
        assert np.array(nozzle.direction) == pytest.approx(pose.rotation().matrix()[:, 2], abs=1e-9)


def link(name: str, mass: str = "17", moments: str = "0.3 0.3 0.3") -> str:
    """A link with principal moments along its axes."""
    tensor = " ".join(
        f"{k}='{x}'" for k, x in zip(("ixx", "iyy", "izz"), moments.split(), strict=True)
    )
    return (
        f"<link name='{name}'><inertial><mass value='{mass}'/><inertia {tensor}/></inertial></link>"
    )


def jets(*poses: str, numbers: Sequence[object] | None = None, force: str = "1.4") -> str:
    """A hull with thrusters at these poses, with Gazebo's plugins of thrusters."""
    parts = [link("base")]
    for k, pose in enumerate(poses):
        number = k if numbers is None else numbers[k]
        tag = "" if number is None else f"<actuator_number>{number}</actuator_number>"
        x, y, z, *angles = pose.split()
        parts += [
            link(f"jet_{k}", "0.001", "1e-5 1e-5 1e-5"),
            f"<joint name='j{k}' type='fixed'><origin xyz='{x} {y} {z}' rpy='{' '.join(angles)}'/>"
            f"<parent link='base'/><child link='jet_{k}'/></joint>",
            f"<gazebo><plugin filename='x' name='gz::sim::systems::SpacecraftThrusterModel'>"
            f"<link_name>jet_{k}</link_name>{tag}<max_thrust>{force}</max_thrust></plugin></gazebo>",
        ]
    return f"<robot name='m'>{''.join(parts)}</robot>"


FLAT = [
    "-0.12 0.12 0.2 {pi} {half} {pi}",
    "0.12 0.12 0.2 0 {half} {pi}",
    "0.12 -0.12 0.2 {half} 0 {pi}",
    "0.12 0.12 0.2 {half} 0 0",
]
"""Thrusters that push along x, -x, y and -y."""


@pytest.mark.parametrize(
    ("pi", "half"),
    [("3.14159265358979", "1.5707963267949"), ("3.14159", "1.57079"), ("3.1416", "1.5708")],
)
@pytest.mark.filterwarnings("ignore:spacecraft .* cannot push and turn it")
def test_typed_angles_are_laid_into_the_plane(pi: str, half: str, tmp_path: Path) -> None:
    text = jets(*(pose.format(pi=pi, half=half) for pose in FLAT))
    craft = drafted(text, 2, tmp_path).spacecraft
    for thruster, along in zip(craft.thrusters, [(1, 0), (-1, 0), (0, 1), (0, -1)], strict=True):
        # A hundredth of what makes an angle of five digits wrong.
        assert thruster.direction == pytest.approx((*along, 0.0), abs=1e-4)
        assert np.hypot(*thruster.direction[:2]) == pytest.approx(1.0, abs=1e-12)


def test_a_force_out_of_the_plane_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"jet_0 .* pushes along z, 0\.011 of its force"):
        drafted(jets("0 0.1 0 0 1.56 0"), 2, tmp_path)


def test_comments_of_gazebo_are_read_and_texts_that_look_so_are_left(tmp_path: Path) -> None:
    """Its example worlds have `--msgtype` in a comment; tinyxml2 takes it, and the standard of XML does not."""
    whole = f"<robot name='m'><a><![CDATA[<!-- not a comment --]]></a>{link('base')}</robot>"
    text = whole.replace("<a>", "<!-- gz topic --msgtype x\n<link name='no'/> --><a>")
    assert read(text, tmp_path).mass == read(whole, tmp_path).mass == 17.0


def test_moments_of_a_plate_in_two_digits_are_read(tmp_path: Path) -> None:
    text = f"<robot name='m'>{link('plate', '1', '0.050 0.050 0.1005')}</robot>"
    assert read(text, tmp_path).inertia is not None


@pytest.mark.parametrize(
    ("text", "remark"),
    [
        (jets("1 0 0 0 0 0", "2 0 0 0 0 0", numbers=[7, 3]), r"numbers \[3, 7\] become"),
        (
            jets("1 0 0 0 0 0").replace("fixed", "continuous"),
            r"joints \['j0'\] turn without limits",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:spacecraft .* cannot push and turn it")
def test_what_is_not_kept_is_named(text: str, remark: str, tmp_path: Path) -> None:
    """In a warning, and in the file that is written; plugins are planted in test_reader_answers.py."""
    with pytest.warns(rans.RansWarning, match=remark):
        draft = drafted(text, 3, tmp_path)
    assert re.search(rf"^# Of that file: .*{remark}", draft.text, re.MULTILINE)


def test_the_numbers_of_plugins_are_the_order_of_commands(tmp_path: Path) -> None:
    found = read(jets("1 0 0 0 0 0", "2 0 0 0 0 0", numbers=[1, 0]), tmp_path)
    assert [nozzle.name for nozzle in found.nozzles] == ["jet_1", "jet_0"]


def test_the_hint_for_a_file_of_mujoco_is_no_command_that_refuses_it(tmp_path: Path) -> None:
    file = tmp_path / "m.xml"
    file.write_text("<mujoco/>")
    with pytest.raises(ConfigError, match="MJCF is not read"):
        rans.init_spacecraft("mine", base=file, dimension=3)
    (tmp_path / "m.urdf").write_text("")
    with pytest.raises(ConfigError, match=r"rans init m\.toml --from .*m\.urdf"):
        rans.load_spacecraft(tmp_path / "m.urdf")


@pytest.mark.parametrize("often", [2.5, pytest.param(125.0, marks=pytest.mark.slow)])
def test_damage_is_read_as_it_is_or_refused(often: float, tmp_path: Path) -> None:
    file = tmp_path / "craft.urdf"
    file.write_text(urdf(1))
    check([file], lambda: read_foreign(file), often)
