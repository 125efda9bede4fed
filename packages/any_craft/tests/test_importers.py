"""Spacecraft from URDF, SDF and tables of 42, against Drake's reader, 42's own conventions and damage."""

from __future__ import annotations

import random
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import rans
from rans.errors import ConfigError
from rans.model.foreign import Foreign, read_foreign
from tests.support.damage import damaged


def six(chance: np.random.Generator, size: float = 1.0) -> str:
    return " ".join(f"{x:.6f}" for x in chance.uniform(-size, size, 3))


def inertia(chance: np.random.Generator, form: str) -> tuple[float, str]:
    """Mass, and the inertia of a random cloud of points as a body of this mass."""
    points = chance.normal(0.0, 0.1, (8, 3))
    points -= points.mean(axis=0)
    mass = float(chance.uniform(0.5, 5.0))
    tensor = mass / 8 * np.sum([p @ p * np.eye(3) - np.outer(p, p) for p in points], axis=0)
    names = {f"i{a}{b}": tensor["xyz".index(a), "xyz".index(b)] for a, b in PAIRS}
    if form == "urdf":
        return mass, "<inertia " + " ".join(f'{k}="{v:.9f}"' for k, v in names.items()) + "/>"
    return mass, "<inertia>" + "".join(
        f"<{k}>{v:.9f}</{k}>" for k, v in names.items()
    ) + "</inertia>"


PAIRS = ("xx", "xy", "xz", "yy", "yz", "zz")


def urdf(seed: int) -> str:
    """A chain of hull, mast and two thrusters with every frame turned."""
    chance = np.random.default_rng(seed)
    parts = ['<robot name="craft">']
    for name in ("hull", "mast", "thruster_a", "thruster_b"):
        mass, tensor = inertia(chance, "urdf")
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


def sdf(seed: int) -> str:
    """A hull and three thrusters, each of which states its frame in another way."""
    chance = np.random.default_rng(seed)
    places = {
        "hull": f"<pose>{six(chance)} {six(chance, 3.0)}</pose>",
        "nozzle_0": f'<pose relative_to="hull">{six(chance)} {six(chance, 3.0)}</pose>',
        "nozzle_1": f'<pose relative_to="tip" degrees="true">{six(chance)} {six(chance, 170.0)}</pose>',
        "nozzle_2": '<pose relative_to="weld">0.1 0.2 0.3 0 0 0</pose>',
    }
    parts = ["<sdf version='1.9'><model name='craft'>"]
    for name, pose in places.items():
        mass, tensor = inertia(chance, "sdf")
        parts.append(
            f"<link name='{name}'>{pose}<inertial><pose>{six(chance)} {six(chance, 3.0)}</pose>"
            f"<mass>{mass:.6f}</mass>{tensor}</inertial></link>"
        )
    quaternion = "0.1 -0.2 0.3 0.9273618495495703"
    parts.append(
        f'<frame name="tip" attached_to="hull"><pose>{six(chance)} {six(chance, 3.0)}</pose></frame>'
        "<joint name='weld' type='fixed'><parent>hull</parent><child>nozzle_2</child>"
        f'<pose relative_to="hull" rotation_format="quat_xyzw">{six(chance)} {quaternion}</pose></joint>'
    )
    parts.extend(
        f"<joint name='j{k}' type='fixed'><parent>hull</parent><child>nozzle_{k}</child></joint>"
        for k in (0, 1)
    )
    for k, force in ((2, 1.5), (0, 0.5), (1, 0.75)):
        parts.append(
            "<plugin filename='gz-sim-x' name='gz::sim::systems::SpacecraftThrusterModel'>"
            f"<link_name>nozzle_{k}</link_name><actuator_number>{k}</actuator_number>"
            f"<max_thrust>{force}</max_thrust></plugin>"
        )
    return "\n".join([*parts, "</model></sdf>"])


def read(text: str, suffix: str, folder: Path) -> Foreign:
    file = folder / f"craft{suffix}"
    file.write_text(text)
    return read_foreign(file)


@pytest.mark.parametrize("form", ["urdf", "sdf"])
@pytest.mark.parametrize("seed", range(4))
def test_drake_reads_the_same_body(form: str, seed: int, tmp_path: Path) -> None:
    pytest.importorskip("pydrake")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    text = urdf(seed) if form == "urdf" else sdf(seed)
    found = read(text, f".{form}", tmp_path)
    plant = MultibodyPlant(0.0)
    (model,) = Parser(plant).AddModelsFromString(text, form)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    root = plant.GetFrameByName("hull" if form == "urdf" else "__model__", model)
    bodies = plant.GetBodyIndices(model)
    whole = plant.CalcSpatialInertia(context, root, bodies)
    assert found.mass == pytest.approx(whole.get_mass(), rel=1e-9)
    assert np.array(found.centre_of_mass) == pytest.approx(whole.get_com(), abs=1e-9)
    about_centre = whole.Shift(whole.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    assert found.inertia is not None
    assert np.array(found.inertia) == pytest.approx(about_centre, abs=1e-8)
    assert len(found.nozzles) == (2 if form == "urdf" else 3)
    for nozzle in found.nozzles:
        body = plant.GetBodyByName(nozzle.name, model)
        pose = plant.CalcRelativeTransform(context, root, body.body_frame())
        centre = pose @ body.CalcCenterOfMassInBodyFrame(context)
        assert nozzle.position is not None
        assert np.array(nozzle.position) == pytest.approx(centre, abs=1e-9)
        assert np.array(nozzle.direction) == pytest.approx(pose.rotation().matrix()[:, 2], abs=1e-9)


def test_forces_come_from_plugins_in_the_order_of_actuators(tmp_path: Path) -> None:
    found = read(sdf(0), ".sdf", tmp_path)
    assert [(one.name, one.force) for one in found.nozzles] == [
        ("nozzle_0", 0.5),
        ("nozzle_1", 0.75),
        ("nozzle_2", 1.5),
    ]
    with pytest.raises(ConfigError, match=r"does not say the force of its thrusters.*--thruster"):
        read(urdf(0), ".urdf", tmp_path).thrusters(3)


TABLE = """<<<<<<<<<<<<<<<<<  42: Spacecraft Description File   >>>>>>>>>>>>>>>>>
Simple generic S/C          !  Description
************************************************************************
************************* Body Parameters ******************************
************************************************************************
1                           ! Number of Bodies
================================ Body 0 ================================
6.0                         ! Mass
0.9  0.8  0.7               ! Moments of Inertia (kg-m^2)
0.06 0.02 0.03              ! Products of Inertia (xy,xz,yz)
0.1  0.0  -0.2              ! Location of mass center, m
JustACube.obj               ! Geometry Input File Name
*************************** Wheel Parameters ***************************
2                           ! Number of wheels
=============================  Wheel 0  ================================
0.0                         ! Initial Momentum, N-m-sec
2.0   0.0   0.0             ! Wheel Axis Components, [X, Y, Z]
0.14   50.0                 ! Max Torque (N-m), Momentum (N-m-sec)
0.012                       ! Wheel Rotor Inertia, kg-m^2
=============================  Wheel 1  ================================
0.0                         ! Initial Momentum, N-m-sec
0.0   0.0  -1.0             ! Wheel Axis Components, [X, Y, Z]
0.15   40.0                 ! Max Torque (N-m), Momentum (N-m-sec)
0.013                       ! Wheel Rotor Inertia, kg-m^2
************************* Thruster Parameters **************************
2                           ! Number of Thrusters
==============================  Thr 0  =================================
 1.5                        ! Thrust Force (N)
-1.0  0.0  0.0              ! Thrust Axis
 1.0  1.0  1.0              ! Location in B0, m
0                           ! Body
==============================  Thr 1  =================================
 2.5                        ! Thrust Force (N)
0.0  3.0  4.0               ! Thrust Axis
 1.0  -1.0  1.0             ! Location in B0, m
0                           ! Body
******************************* Gyro ************************************
0                           ! Number of Gyro Axes
"""


def test_a_table_of_42_has_products_as_integrals(tmp_path: Path) -> None:
    """42init.c negates its products; its wheels and thrusters are in the frame of the table."""
    found = read(TABLE, ".txt", tmp_path)
    assert found.mass == 6.0
    assert found.inertia == ((0.9, -0.06, -0.02), (-0.06, 0.8, -0.03), (-0.02, -0.03, 0.7))
    assert found.centre_of_mass == (0.1, 0.0, -0.2)
    assert [one.axis for one in found.wheels] == [(1.0, 0.0, 0.0), (0.0, 0.0, -1.0)]
    assert (found.wheels[1].max_torque, found.wheels[1].max_momentum) == (0.15, 40.0)
    assert found.wheels[0].inertia == 0.012
    assert found.thrusters(3) == ("1, 1, 1; -1, 0, 0; 1.5", "1, -1, 1; 0, 0.6, 0.8; 2.5")


def test_a_table_without_places_of_thrusters_says_what_to_add(tmp_path: Path) -> None:
    """Later versions of 42 keep places in a file of nodes."""
    text = "\n".join(line for line in TABLE.split("\n") if "Location in B0" not in line)
    with pytest.raises(ConfigError, match=r"--thruster 'POSITION; -1, 0, 0; 1\.5'"):
        read(text, ".txt", tmp_path).thrusters(3)


def link(name: str, more: str = "", mass: str = "17", moments: str = "0.3 0.3 0.3") -> str:
    """A link of an SDF with principal moments along its axes."""
    tensor = "".join(
        f"<{k}>{x}</{k}>" for k, x in zip(("ixx", "iyy", "izz"), moments.split(), strict=True)
    )
    inertial = f"<inertial><mass>{mass}</mass><inertia>{tensor}</inertia></inertial>"
    return f"<link name='{name}'>{more}{inertial}</link>"


def jets(*poses: str, numbers: Sequence[object] | None = None, force: str = "1.4") -> str:
    """A hull with thrusters at these poses, as the tutorial of Gazebo's thrusters writes them."""
    parts = [link("base")]
    for k, pose in enumerate(poses):
        number = k if numbers is None else numbers[k]
        tag = "" if number is None else f"<actuator_number>{number}</actuator_number>"
        parts += [
            link(f"jet_{k}", f"<pose>{pose}</pose>", "0.001", "1e-5 1e-5 1e-5"),
            f"<plugin filename='x' name='gz::sim::systems::SpacecraftThrusterModel'>"
            f"<link_name>jet_{k}</link_name>{tag}<max_thrust>{force}</max_thrust></plugin>",
        ]
    return f"<sdf version='1.9'><model name='m'>{''.join(parts)}</model></sdf>"


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
    file = tmp_path / "m.sdf"
    file.write_text(jets(*(pose.format(pi=pi, half=half) for pose in FLAT)))
    craft = rans.init_spacecraft("mine", base=file, dimension=2).spacecraft
    for thruster, along in zip(craft.thrusters, [(1, 0), (-1, 0), (0, 1), (0, -1)], strict=True):
        # A hundredth of what makes an angle of five digits wrong.
        assert thruster.direction == pytest.approx((*along, 0.0), abs=1e-4)
        assert np.hypot(*thruster.direction[:2]) == pytest.approx(1.0, abs=1e-12)


def test_a_force_out_of_the_plane_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "m.sdf"
    file.write_text(jets("0 0.1 0 0 1.56 0"))
    with pytest.raises(ConfigError, match=r"jet_0 .* pushes along z, 0\.011 of its force"):
        rans.init_spacecraft("mine", base=file, dimension=2)


def test_comments_of_gazebo_are_read_and_texts_that_look_so_are_left(tmp_path: Path) -> None:
    """Its example worlds have `--msgtype` in a comment; tinyxml2 takes it, and the standard of XML does not."""
    body = link("base", "<a><![CDATA[<!-- not a comment --]]></a>")
    whole = f"<sdf><model name='m'>{body}</model></sdf>"
    text = whole.replace("<model", "<!-- gz topic --msgtype x\n<link name='no'/> --><model")
    assert read(text, ".sdf", tmp_path).mass == read(whole, ".sdf", tmp_path).mass == 17.0


BAD_BODIES = [("-1", "0.1 0.1 0.1"), ("1", "-0.2 0.1 0.1"), ("1", "0.0001 0.0001 0.9")]


@pytest.mark.parametrize(("mass", "moments"), BAD_BODIES)
@pytest.mark.parametrize("suffix", [".urdf", ".sdf", ".txt"])
def test_bodies_that_cannot_be_are_refused_by_name(
    suffix: str, mass: str, moments: str, tmp_path: Path
) -> None:
    """Although the whole craft could be: a heavy hull is beside the link."""
    x, y, z = moments.split()
    if suffix == ".sdf":
        text = f"<sdf><model name='m'>{link('base')}{link('leg', '', mass, moments)}</model></sdf>"
    elif suffix == ".urdf":
        text = (
            "<robot name='r'><link name='b'><inertial><mass value='10'/><inertia ixx='1' iyy='1' izz='1'/>"
            f"</inertial></link><link name='leg'><inertial><mass value='{mass}'/>"
            f"<inertia ixx='{x}' iyy='{y}' izz='{z}'/></inertial></link><joint name='j' type='fixed'>"
            "<origin xyz='0.5 0 0'/><parent link='b'/><child link='leg'/></joint></robot>"
        )
    else:
        text = TABLE.replace("6.0    ", f"{mass}    ").replace("0.9  0.8  0.7", moments)
        text = text.replace("0.06 0.02 0.03", "0 0 0")
    what = "mass" if mass == "-1" else "inertia"
    who = "its body" if suffix == ".txt" else "the link 'leg'"
    with pytest.raises(ConfigError, match=f"the {what} of {who} must be"):
        read(text, suffix, tmp_path)


def test_moments_of_a_plate_in_two_digits_are_read(tmp_path: Path) -> None:
    text = f"<sdf><model name='m'>{link('plate', '', '1', '0.050 0.050 0.1005')}</model></sdf>"
    assert read(text, ".sdf", tmp_path).inertia is not None


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (jets("0 0 0 0 0 0", "1 0 0 0 0 0", numbers=[2, 2]), "'jet_0' and 'jet_1' have one act.*2"),
        (jets("0 0 0 0 0 0", "1 0 0 0 0 0", numbers=[None, 0]), "'jet_0' has no <actuator_num"),
        (jets("0 0 0 0 0 0", numbers=["9" * 5000]), "actuator_number of 'jet_0' must be a whole"),
        (jets("0 0 0 0 0 0", numbers=["-1"]), "must be a whole number below a million, got '-1'"),
        (jets("0 0 0 0 0 0", numbers=["٣"]), "must be a whole number below a million"),
        (
            jets("0 0 0 0 0 0", "1 0 0 0 0 0").replace("<link_name>jet_1", "<link_name>jet_0"),
            "two plugins SpacecraftThrusterModel name the link 'jet_0'",
        ),
        (jets("0 0 0 0 0 0", force="x"), "max_thrust of jet_0 must be 1 finite number"),
    ],
)
def test_plugins_that_share_are_refused(text: str, reason: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=reason):
        read(text, ".sdf", tmp_path)


PROPORTIONAL = TABLE.replace(
    " 1.5                        ! Thrust Force",
    "PROPORTIONAL ! Mode (PULSED or PROPORTIONAL)\n 1.5  ! Thrust Force",
)


@pytest.mark.parametrize(
    ("suffix", "text", "remark"),
    [
        (".txt", PROPORTIONAL, "1 of 2 thrusters are PROPORTIONAL and become valves"),
        (
            ".txt",
            TABLE.replace("JustA", "0 5.0 0 ! Constant Embedded Momentum (Nms)\nJustA"),
            "its constant embedded momentum is not read, '0 5.0 0' N m s",
        ),
        (
            ".txt",
            TABLE.replace("0.0                         ! Initial", "-1e-3 ! Initial"),
            "wheels",
        ),
        (
            ".sdf",
            jets("1 0 0 0 0 0").replace("<plugin", "<plugin name='Camera'/><plugin", 1),
            r"its plugins \['Camera'\] are not read",
        ),
        (".sdf", jets("1 0 0 0 0 0", "2 0 0 0 0 0", numbers=[7, 3]), r"numbers \[3, 7\] become"),
        (
            ".sdf",
            jets("1 0 0 0 0 0").replace("<model name='m'>", "<model name='m'><link name='bare'/>"),
            r"1 kg and moments of 1 kg m\^2, SDF's defaults, are assumed where \['bare'\]",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:spacecraft .* cannot push and turn it")
def test_what_is_not_kept_is_named(suffix: str, text: str, remark: str, tmp_path: Path) -> None:
    """In a warning, and in the file that is written."""
    assert re.search(remark, "; ".join(read(text, suffix, tmp_path).remarks))
    file = tmp_path / f"m{suffix}"
    file.write_text(text)
    with pytest.warns(rans.RansWarning, match=remark):
        draft = rans.init_spacecraft("mine", base=file, dimension=3)
    assert re.search(rf"^# Of that file: .*{remark}", draft.text, re.MULTILINE)


def test_a_table_without_effectors_has_their_lines_as_a_pattern(tmp_path: Path) -> None:
    """They are no thrusters and wheels of the craft: nothing is said of them."""
    text = PROPORTIONAL.replace("2                           ! Number", "0   ! Number")
    text = text.replace("0.0                         ! Initial", "7.0 ! Initial")
    found = read(text, ".txt", tmp_path)
    assert (found.nozzles, found.wheels, found.remarks) == ((), (), ())


def test_the_numbers_of_plugins_are_the_order_of_commands(tmp_path: Path) -> None:
    found = read(jets("1 0 0 0 0 0", "2 0 0 0 0 0", numbers=[1, 0]), ".sdf", tmp_path)
    assert [nozzle.name for nozzle in found.nozzles] == ["jet_1", "jet_0"]


@pytest.mark.filterwarnings("ignore:spacecraft .* cannot push and turn it")
def test_a_file_in_millimetres_is_warned_of(tmp_path: Path) -> None:
    file = tmp_path / "mm.sdf"
    file.write_text(jets("120 0 200 0 0 0", "-120 0 200 0 0 0"))
    with pytest.warns(rans.RansWarning, match=r"a thruster is \d+ m .*positions in mm or cm"):
        rans.init_spacecraft("mine", base=file, dimension=3)


def test_the_hint_for_a_file_of_mujoco_is_no_command_that_refuses_it(tmp_path: Path) -> None:
    file = tmp_path / "m.xml"
    file.write_text("<mujoco/>")
    with pytest.raises(ConfigError, match="MJCF is not read"):
        rans.init_spacecraft("mine", base=file, dimension=3)
    (tmp_path / "m.urdf").write_text("")
    with pytest.raises(ConfigError, match=r"rans init m\.toml --from .*m\.urdf"):
        rans.load_spacecraft(tmp_path / "m.urdf")


@pytest.mark.parametrize(
    ("suffix", "text", "reason"),
    [
        (".urdf", "", "no XML, or damaged"),
        (".urdf", "<robot><link name='a'></robot>", "no XML, or damaged"),
        (".urdf", "<!DOCTYPE x [<!ENTITY a 'aa'>]><robot>&a;</robot>", "declares entities"),
        (".urdf", "<sdf/>", "root is <robot>"),
        (".urdf", "<robot/>", "1 to 10,000 links, got 0"),
        (".urdf", "<robot><link name='a'/></robot>", "no link has a mass"),
        (".urdf", "<robot><link name='a'/><link name='a'/></robot>", "name of its own"),
        (".urdf", "<robot><link name='a'/><link name='b'/></robot>", "one root link"),
        (".urdf", "<robot xmlns:x='http://xacro'><x:macro/><link name='a'/></robot>", "xacro file"),
        (
            ".urdf",
            "<robot><link name='a'><inertial><mass value='nan'/></inertial></link></robot>",
            "the mass of 'a' must be 1 finite number",
        ),
        (
            ".urdf",
            "<robot><link name='a'/><link name='b'/><link name='c'/>"
            "<joint name='j'><parent link='b'/><child link='c'/></joint>"
            "<joint name='k'><parent link='c'/><child link='b'/></joint></robot>",
            "form a ring",
        ),
        (".sdf", "<sdf><include/></sdf>", "includes another file"),
        (
            ".sdf",
            "<sdf><world><model><static>true</static><link name='floor'/></model><include/></world></sdf>",
            "one model that moves, got 0; it includes another file",
        ),
        (".sdf", "<sdf><model><include/><link name='a'/></model></sdf>", "has an <include> within"),
        (
            ".sdf",
            "<sdf><model><link name='a'><pose relative_to='b'/></link></model></sdf>",
            "relative to 'b'",
        ),
        (".txt", "a;b;c", "must be a spacecraft file of 42"),
        (
            ".txt",
            TABLE.replace("1                           ! Number of B", "2 ! Number of B"),
            "one body",
        ),
        (".txt", TABLE.replace("6.0   ", "6,0   "), "line 8, mass, must be 1 finite number"),
        (
            ".txt",
            TABLE.replace("2                           ! Number of T", "3 ! Number of T"),
            "at least 3",
        ),
    ],
)
def test_what_is_no_spacecraft_is_refused(
    suffix: str, text: str, reason: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=reason):
        read(text, suffix, tmp_path)


@pytest.mark.parametrize("count", [20, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("suffix", [".urdf", ".sdf", ".txt"])
def test_damage_is_read_as_it_is_or_refused(suffix: str, count: int, tmp_path: Path) -> None:
    whole = {".urdf": urdf(1), ".sdf": sdf(1), ".txt": TABLE}[suffix].encode()
    file = tmp_path / f"craft{suffix}"
    refused = 0
    for number in range(count):
        file.write_bytes(damaged(whole, random.Random(f"{suffix} {number}")))
        try:
            read_foreign(file)
        except ConfigError as error:
            refused += str(error).startswith(str(file)) or "craft" in str(error)
    assert refused > count / 4
