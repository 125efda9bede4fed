"""Spacecraft of other software's files: URDF, SDF, and the spacecraft tables of the simulator 42.

All links of a robot count as one rigid body with its joints at zero. Thrusters are the links that Gazebo's plugins
``SpacecraftThrusterModel`` name, with their ``max_thrust``, or else links whose names say that they are thrusters.
As in that plugin the force acts at the link's centre of mass along its z axis. What a file does not say is None.

Sources: wiki.ros.org/urdf/XML, sdformat.org/spec, gz-sim ``SpacecraftThrusterModel.cc``, and ``42init.c`` of
github.com/ericstoneking/42.

`rans.model.foreign` finds the two readers by entry points; everything here is in SI units and in the axes of the
file's root, and refusals are `ConfigError`. The files that `packages/any_craft/tests` reads come from those
programs.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from rans.extend import ConfigError, brief, counted
from rans.model.actuators import Wheel
from rans.model.foreign import Foreign, Nozzle

_DECLARES = re.compile(r"<!\s*(ENTITY|ATTLIST|DOCTYPE)", re.IGNORECASE)
"""Declarations of entities, which can grow without bound."""
_NOZZLE = re.compile("thruster|nozzle", re.IGNORECASE)
"""Names of links that are thrusters."""
_UNBALANCED = 0.01
"""Part of the largest principal moment of a link by which it may exceed the sum of the others, or by which another
may be below zero: files have moments with two or three digits."""
_COMMENT = re.compile(r"(<!\[CDATA\[.*?\]\]>)|<!--.*?-->", re.DOTALL)
"""A comment of XML, or text that may hold the beginning of one."""
_PLUGIN = "SpacecraftThrusterModel"
_MOST_LINKS = 10_000


# files


def urdf(text: str, name: str) -> Foreign:
    """See `rans.model.foreign.Importer`."""
    return _urdf(_xml(text), name)


def sdf(text: str, name: str) -> Foreign:
    """See `rans.model.foreign.Importer`."""
    return _sdf(_xml(text), name)


# rigid bodies


@dataclass(frozen=True)
class _Pose:
    """Rotation R and position p of a frame in another."""

    R: np.ndarray
    p: np.ndarray

    def then(self, child: _Pose) -> _Pose:
        return _Pose(self.R @ child.R, self.p + self.R @ child.p)


_AT_ORIGIN = _Pose(np.eye(3), np.zeros(3))


@dataclass(frozen=True)
class _Link:
    """Mass, centre and inertia of a link; pose and inertia in the frames of the file."""

    mass: float
    inertial: _Pose
    """Frame of the inertia, at the centre of mass, in the frame of the link."""
    inertia: np.ndarray


def _rpy(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Rotation matrix (3, 3) of angles (rad) about fixed x, then y, then z, as URDF and SDF have it."""
    cr, cp, cy = np.cos([roll, pitch, yaw])
    sr, sp, sy = np.sin([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _check_body(what: str, mass: float, inertia: np.ndarray) -> None:
    """Refuse (`ConfigError`) a mass (kg) or an inertia (3, 3) (kg m^2) that no body has; both may be zero."""
    if mass < 0.0:
        raise ConfigError(f"the mass of {what} must be at least 0 kg, got {mass:g}.")
    low, middle, high = np.linalg.eigvalsh(inertia)
    slack = _UNBALANCED * max(high, 0.0)
    if low < -slack or high > low + middle + slack:
        raise ConfigError(
            f"the inertia of {what} must be that of a body, no principal moment below zero or above the sum of the "
            f"others, got {low:.4g}, {middle:.4g} and {high:.4g} kg m^2."
        )


def _lumped(
    source: str,
    links: Mapping[str, _Link],
    poses: Mapping[str, _Pose],
    forces: Mapping[str, float | None],
    remarks: Iterable[str],
) -> Foreign:
    """One rigid body of all links, with the parallel-axis theorem; thrusters are links with an entry in forces.

    Inertia about the common centre of mass, in the axes of the root; remarks become sentences for the user.
    """
    for name, link in links.items():
        _check_body(f"the link {brief(name)}", link.mass, link.inertia)
    mass = sum(link.mass for link in links.values())
    if not mass > 0.0:
        raise ConfigError("no link has a mass; is <inertial> missing?")
    frames = {name: poses[name].then(link.inertial) for name, link in links.items()}
    moments = [link.mass * frames[name].p for name, link in links.items()]
    centre = np.sum(moments, axis=0) / mass
    inertia = np.zeros((3, 3))
    for name, link in links.items():
        frame = frames[name]
        arm = frame.p - centre
        inertia += frame.R @ link.inertia @ frame.R.T
        inertia += link.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    nozzles = tuple(
        Nozzle(name, _triple(frames[name].p), _triple(poses[name].R[:, 2]), force)
        for name, force in forces.items()
    )
    lumped = "" if len(links) == 1 else f", its {len(links)} links as one body with joints at zero"
    tensor = _tensor(inertia) if inertia.any() else None
    return Foreign(
        f"{source}{lumped}", mass, tensor, _triple(centre), nozzles, remarks=tuple(remarks)
    )


def _tensor(inertia: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    symmetric = 0.5 * (inertia + inertia.T)
    return tuple(_triple(row) for row in symmetric)


def _triple(vector: Iterable[float]) -> tuple[float, float, float]:
    """Three numbers without what rounding left in place of zeros: 1e-12 of metres, kg m^2 or a unit."""
    x, y, z = (0.0 if abs(a) < 1e-12 else float(f"{a:.12g}") for a in vector)
    return x, y, z


# XML


def _xml(text: str) -> ET.Element:
    """Root of an XML text that declares nothing.

    Comments are cut: Gazebo's reader takes "--" in them, as its own examples have it, and Python's does not.
    """
    text = _COMMENT.sub(lambda match: match[1] or "\n" * match[0].count("\n"), text)
    if _DECLARES.search(text):
        raise ConfigError("it declares entities or a document type, which robots do not need.")
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, ValueError) as error:
        raise ConfigError(f"it is no XML, or damaged: {error}.") from error
    return root


def _numbers(text: str | None, count: int, what: str) -> np.ndarray:
    """Exactly ``count`` finite numbers within +-1e9, separated by spaces, as (count,).

    Else a `ConfigError` of ``what``.
    """
    try:
        values = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        values = np.zeros(0)
    if len(values) != count or not np.isfinite(values).all() or (abs(values) > 1e9).any():
        raise ConfigError(
            f"{what} must be {counted(count, 'finite number')} up to 1e9, got {brief(text)}."
        )
    return values


def _forces(
    plugins: Iterable[ET.Element], links: Mapping[str, _Link], remarks: list[str]
) -> dict[str, float | None]:
    """Links that are thrusters, in the order of their commands, with their forces where a plugin says them.

    ``remarks`` gets clauses on what is not read. The order is that of the actuator numbers, where the file has
    them.
    """
    stated: dict[str, tuple[int | None, float | None]] = {}
    others: list[str] = []
    for plugin in plugins:
        if _PLUGIN not in plugin.get("name", "") + plugin.get("filename", ""):
            others.append(plugin.get("name") or plugin.get("filename") or "a plugin")
            continue
        # Gazebo's code reads snake_case, its page has camelCase.
        values = {
            re.sub("(?<=[a-z])([A-Z])", r"_\1", str(child.tag)).lower(): (child.text or "").strip()
            for child in plugin
        }
        link = values.get("link_name", "")
        if link not in links:
            raise ConfigError(f"a plugin {_PLUGIN} names the link {brief(link)}, which is none.")
        if link in stated:
            raise ConfigError(
                f"two plugins {_PLUGIN} name the link {brief(link)}: a thruster has one."
            )
        thrust = values.get("max_thrust")
        stated[link] = (
            _actuator_number(values.get("actuator_number"), link),
            None if thrust is None else float(_numbers(thrust, 1, f"max_thrust of {link}")[0]),
        )
    if others:
        remarks.append(f"its plugins {brief(sorted(set(others)))} are not read")
    if not stated:
        return {name: None for name in links if _NOZZLE.search(name)}
    # Gazebo sends each number of a command to the plugin of that number.
    owners: dict[int, str] = {}
    for link, (number, _) in stated.items():
        if number is None:
            if len(stated) > 1:
                raise ConfigError(
                    f"the plugin {_PLUGIN} of {brief(link)} has no <actuator_number>, which says its command."
                )
            number = 0
        if number in owners:
            raise ConfigError(
                f"the links {brief(owners[number])} and {brief(link)} have one actuator_number, {number}: "
                "thrusters that share a command are not read; give each a number of its own."
            )
        owners[number] = link
    numbers = sorted(owners)
    if numbers != list(range(len(numbers))):
        remarks.append(f"its actuator numbers {brief(numbers)} become commands from 0 on")
    return {owners[number]: stated[owners[number]][1] for number in numbers}


def _actuator_number(text: str | None, link: str) -> int | None:
    """Number of a thruster's command, which orders the thrusters of the craft; None: the file does not state it."""
    if text is None:
        return None
    if not re.fullmatch(r"\d{1,6}", text, re.ASCII):
        raise ConfigError(
            f"actuator_number of {brief(link)} must be a whole number below a million, got {brief(text)}."
        )
    return int(text)


def _inertia(
    element: ET.Element | None, read: Callable[[ET.Element, str], str | None]
) -> np.ndarray:
    """Tensor (3, 3), kg m^2, from ixx, ixy, ixz, iyy, iyz and izz; zeros without an element.

    ``read`` gets an entry's text.
    """
    if element is None:
        return np.zeros((3, 3))
    values = {}
    for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
        text = read(element, name)
        # Both formats have zero as the default of products.
        usual = "0" if name[1] != name[2] else None
        values[name] = float(_numbers(usual if text is None else text, 1, name)[0])
    xx, xy, xz, yy, yz, zz = values.values()
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


# URDF


def _urdf(root: ET.Element, name: str) -> Foreign:
    """Mass properties and thrusters of a URDF in the frame of its root link.

    Joints are at zero, whatever their limits are.
    """
    if root.tag != "robot":
        raise ConfigError(f"a URDF's root is <robot>, got <{brief(root.tag)[1:-1]}>.")
    if any("xacro" in str(element.tag) for element in root.iter()):
        raise ConfigError(f"it is a xacro file: run `xacro {name} > robot.urdf` first.")
    # Links, and of each child the parent and the pose in its frame.
    links = _distinct(root, "link", _urdf_link)
    joints = {}
    for joint in root.findall("joint"):
        ends = [
            end.get("link", "") if (end := joint.find(side)) is not None else ""
            for side in ("parent", "child")
        ]
        parent, child = ends
        if parent not in links or child not in links:
            raise ConfigError(
                f"the joint {brief(joint.get('name'))} joins {brief(parent)} and {brief(child)}, which must be "
                "links."
            )
        if child in joints:
            raise ConfigError(f"the link {brief(child)} is the child of two joints.")
        joints[child] = (parent, _urdf_origin(joint))
    roots = [link for link in links if link not in joints]
    if len(roots) != 1:
        raise ConfigError(f"it must have one root link, got {brief(roots)}.")
    # Poses in the frame of the root, parents before children.
    poses = {roots[0]: _AT_ORIGIN}
    waiting = dict(joints)
    while waiting:
        ready = [child for child, (parent, _) in waiting.items() if parent in poses]
        if not ready:
            raise ConfigError(f"the joints of {brief(sorted(waiting))} form a ring.")
        for child in ready:
            parent, origin = waiting.pop(child)
            poses[child] = poses[parent].then(origin)
    remarks: list[str] = []
    forces = _forces(root.iterfind("gazebo/plugin"), links, remarks)
    return _lumped(name, links, poses, forces, remarks)


def _urdf_link(link: ET.Element) -> _Link:
    """Mass, centre and inertia of a link of URDF; without an inertial element it weighs nothing, as URDF says."""
    inertial = link.find("inertial")
    if inertial is None:
        return _Link(0.0, _AT_ORIGIN, np.zeros((3, 3)))
    mass = inertial.find("mass")
    value = None if mass is None else mass.get("value")
    what = f"the mass of {brief(link.get('name'))}"
    return _Link(
        float(_numbers(value, 1, what)[0]),
        _urdf_origin(inertial),
        _inertia(inertial.find("inertia"), lambda element, entry: element.get(entry)),
    )


def _urdf_origin(element: ET.Element) -> _Pose:
    origin = element.find("origin")
    if origin is None:
        return _AT_ORIGIN
    what = f"an origin in {brief(element.get('name') or element.tag)}"
    zeros = "0 0 0"
    rpy = _numbers(origin.get("rpy", zeros), 3, f"rpy of {what}")
    return _Pose(_rpy(*rpy), _numbers(origin.get("xyz", zeros), 3, f"xyz of {what}"))


def _distinct(root: ET.Element, tag: str, read: Callable[[ET.Element], _Link]) -> dict[str, _Link]:
    """Elements of the root by their names, which must differ, 1 to `_MOST_LINKS` of them (else `ConfigError`)."""
    result: dict[str, _Link] = {}
    for element in root.findall(tag):
        name = element.get("name", "")
        if not name or name in result:
            raise ConfigError(f"every {tag} needs a name of its own, got {brief(name)} again.")
        result[name] = read(element)
    if not result or len(result) > _MOST_LINKS:
        raise ConfigError(f"it must have 1 to {_MOST_LINKS:,} links, got {len(result):,}.")
    return result


# SDF


def _sdf(root: ET.Element, name: str) -> Foreign:
    """Mass properties and thrusters of an SDF's only model, in the frame of the model.

    Poses are resolved through any chain of frames, as SDF's specification has it.
    """
    if root.tag != "sdf":
        raise ConfigError(f"an SDF's root is <sdf>, got <{brief(root.tag)[1:-1]}>.")
    # What never moves, such as a floor, is no spacecraft.
    models = [
        model
        for model in (*root.findall("model"), *root.findall("world/model"))
        if (model.findtext("static") or "").strip() not in ("true", "1")
    ]
    if len(models) != 1:
        hint = (
            "; it includes another file: name the model.sdf or model.urdf of that one"
            if root.find(".//include") is not None
            else ""
        )
        raise ConfigError(f"it must have one model that moves, got {len(models)}{hint}.")
    (model,) = models
    for tag in ("include", "model"):
        if model.find(tag) is not None:
            raise ConfigError(f"its model has an <{tag}> within, and only links are read.")
    links = _distinct(model, "link", _sdf_link)

    # Poses are relative to a frame that each names, or to its usual one.
    placed: dict[str, tuple[str, _Pose]] = {}
    for tag, usual in (("link", ""), ("joint", "child"), ("frame", "attached_to")):
        for element in model.findall(tag):
            own = element.get("name", "")
            if tag == "joint":
                child = element.find(usual)
                text = "" if child is None else (child.text or "").strip()
            else:
                text = element.get(usual, "") if usual else ""
            pose = element.find("pose")
            relative = "" if pose is None else pose.get("relative_to", "")
            if own in placed:
                raise ConfigError(f"two links, joints or frames have the name {brief(own)}.")
            placed[own] = (relative or text or "__model__", _sdf_pose(pose, own))
    poses = {"__model__": _AT_ORIGIN}
    waiting = dict(placed)
    while waiting:
        ready = [own for own, (parent, _) in waiting.items() if parent in poses]
        if not ready:
            own, (parent, _) = next(iter(waiting.items()))
            raise ConfigError(
                f"the pose of {brief(own)} is relative to {brief(parent)}, which is none or depends on it."
            )
        for own in ready:
            parent, pose = waiting.pop(own)
            poses[own] = poses[parent].then(pose)
    remarks: list[str] = []
    silent = [link.get("name", "") for link in model.findall("link") if _is_silent(link)]
    if silent:
        remarks.append(
            f"a mass of 1 kg and moments of 1 kg m^2, SDF's defaults, are assumed where {brief(silent)} state none"
        )
    forces = _forces(model.iterfind("plugin"), links, remarks)
    return _lumped(name, links, poses, forces, remarks)


def _is_silent(link: ET.Element) -> bool:
    """Whether a link leaves its mass or its inertia to the format's defaults."""
    inertial = link.find("inertial")
    return inertial is None or inertial.find("mass") is None or inertial.find("inertia") is None


def _sdf_link(link: ET.Element) -> _Link:
    """Mass, centre and inertia of a link of SDF; what it leaves out is 1 kg and the unit tensor, as SDF says."""
    inertial = link.find("inertial")
    name = link.get("name", "")
    if inertial is None:  # SDF's default
        return _Link(1.0, _AT_ORIGIN, np.eye(3))
    if inertial.get("auto", "false").strip().lower() in ("true", "1"):
        raise ConfigError(
            f"the inertia of {brief(name)} is computed from its shape (auto), which is not read; write it out."
        )
    pose = inertial.find("pose")
    if pose is not None and pose.get("relative_to"):
        raise ConfigError(f"the pose of the inertia of {brief(name)} may not be relative_to.")
    inertia = inertial.find("inertia")
    tensor = np.eye(3)  # SDF's default
    if inertia is not None:
        tensor = _inertia(inertia, lambda element, entry: element.findtext(entry))
    mass = inertial.findtext("mass", "1")
    return _Link(
        float(_numbers(mass, 1, f"the mass of {brief(name)}")[0]), _sdf_pose(pose, name), tensor
    )


def _sdf_pose(pose: ET.Element | None, name: str) -> _Pose:
    """The pose that an element of SDF states: a rotation and a position."""
    if pose is None:
        return _AT_ORIGIN
    what = f"the pose of {brief(name)}"
    if pose.get("rotation_format", "euler_rpy") == "quat_xyzw":
        x, y, z, *quaternion = _numbers(pose.text, 7, what)
        length = math.hypot(*quaternion)
        if not length > 0.0:
            raise ConfigError(f"{what} has a quaternion of zeros.")
        i, j, k, w = np.array(quaternion) / length
        across = np.array([[0.0, -k, j], [k, 0.0, -i], [-j, i, 0.0]])
        return _Pose(np.eye(3) + 2.0 * w * across + 2.0 * across @ across, np.array([x, y, z]))
    text = pose.text if (pose.text or "").strip() else "0 0 0 0 0 0"
    x, y, z, *angles = _numbers(text, 6, what)
    if pose.get("degrees", "false").strip().lower() in ("true", "1"):
        angles = list(np.radians(angles))
    return _Pose(_rpy(*angles), np.array([x, y, z]))


# tables of 42


class _Lines:
    """Lines "value ! comment" of a section, by the beginnings of their comments."""

    def __init__(self, section: str) -> None:
        self.section = section
        self.rows: list[tuple[int, str, str]] = []

    def all(self, comment: str) -> list[tuple[int, str]]:
        """Line numbers and values whose comments begin so."""
        return [(k, value) for k, value, remark in self.rows if remark.startswith(comment)]

    def numbers(self, comment: str, count: int, entry: int = 0) -> np.ndarray:
        """The numbers (count,) of the ``entry``-th line with this comment in the section.

        `ConfigError` if it is not there.
        """
        rows = self.all(comment)
        if len(rows) <= entry:
            raise ConfigError(
                f"its {self.section} parameters have {counted(len(rows), 'line')} {comment!r} instead of at least "
                f"{entry + 1}."
            )
        line, value = rows[entry]
        return _numbers(value, count, f"line {line}, {comment},")

    def count(self, comment: str) -> int:
        """Whole number of a line; 0 if there is none."""
        if not self.all(comment):
            return 0
        value = float(self.numbers(comment, 1)[0])
        if value != int(value) or not 0 <= value <= 1000:
            raise ConfigError(f"{comment} must be a whole number up to 1000, got {value:g}.")
        return int(value)


def table(text: str, name: str) -> Foreign:
    """Mass properties, thrusters and wheels of a spacecraft file of 42 (InOut/SC_*.txt) with one body."""
    lines = text.split("\n")
    if "42" not in lines[0] or "description" not in lines[0].lower():
        raise ConfigError(
            "a .txt file must be a spacecraft file of 42, whose first line has '42: Spacecraft Description File', "
            f"got {brief(lines[0])}."
        )
    # Sections and their lines, by the titles between asterisks.
    words = ("body", "wheel", "thruster", "mtb", "dynamics flags")
    sections = {word: _Lines(word) for word in words}
    current: _Lines | None = None
    for number, line in enumerate(lines, 1):
        title = re.match(r"\*+\s*(\w[\w\s]*?)\s*\*+\s*$", line)
        if title:
            current = sections.get(title[1].lower().removesuffix(" parameters"))
        elif current is not None and "!" in line:
            value, _, comment = line.partition("!")
            current.rows.append((number, value.strip(), comment.strip().lower()))
    body, wheel, thruster, *_ = sections.values()
    # Mass properties. Products of inertia of 42 have the other sign than a tensor's entries.
    bodies = body.count("number of bodies")
    if bodies != 1:
        raise ConfigError(f"it must have one body, got {bodies}: joints are not read.")
    mass = float(body.numbers("mass", 1)[0])
    x, y, z = body.numbers("moments of inertia", 3)
    # 42's products are integrals of x y dm; the entries of the tensor are their negatives.
    xy, xz, yz = -body.numbers("products of inertia", 3)
    tensor = np.array([[x, xy, xz], [xy, y, yz], [xz, yz, z]])
    _check_body("its body", mass, tensor)
    # Thrusters, then wheels.
    nozzles = []
    for k in range(thruster.count("number of thrusters")):
        position = None
        if thruster.all("location"):
            position = _triple(thruster.numbers("location", 3, k))
        axis = thruster.numbers("thrust axis", 3, k)
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            raise ConfigError(f"the thrust axis of thruster {k} is zero.")
        force = float(thruster.numbers("thrust force", 1, k)[0])
        nozzles.append(Nozzle(f"thruster {k}", position, _triple(axis / length), force))
    wheels = []
    for k in range(wheel.count("number of wheels")):
        axis = wheel.numbers("wheel axis", 3, k)
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            raise ConfigError(f"the axis of wheel {k} is zero.")
        torque, momentum = wheel.numbers("max torque", 2, k)
        inertia = float(wheel.numbers("wheel rotor inertia", 1, k)[0])
        wheels.append(Wheel(_triple(axis / length), float(torque), float(momentum), inertia))
    return Foreign(
        name,
        mass,
        _tensor(tensor),
        _triple(body.numbers("location of mass center", 3)),
        tuple(nozzles),
        tuple(wheels),
        tuple(_unread(sections)),
    )


def _unread(sections: Mapping[str, _Lines]) -> Iterator[str]:
    """What a table of 42 says and a spacecraft of RANS does not have, as clauses."""
    body, wheel, thruster, mtb, flags = sections.values()
    # A table with no thruster or wheel still has the lines of one, as a pattern.
    modes = thruster.all("mode")[: thruster.count("number of thrusters")]
    if proportional := sum("PROPORTIONAL" in mode.upper() for _, mode in modes):
        yield (
            f"{proportional} of {counted(thruster.count('number of thrusters'), 'thruster')} are PROPORTIONAL and "
            "become valves that are open or shut, unless --set actuators=throttle"
        )
    stored = wheel.all("initial momentum")[: wheel.count("number of wheels")]
    for rows, what in (
        (body.all("constant embedded momentum"), "constant embedded momentum"),
        (stored, "initial momentum of wheels"),
    ):
        values = [value for _, value in rows]
        if any(_is_nonzero(value) for value in values):
            yield f"its {what} is not read, {brief('; '.join(values))} N m s"
    if count := mtb.count("number of mtb"):
        yield f"its {counted(count, 'magnetic torquer')} are not read"
    if any(value.upper() == "TRUE" for _, value in flags.all("flex active")):
        yield "its flexible modes are not read"


def _is_nonzero(text: str) -> bool:
    """Whether a text has anything besides zeros."""
    return bool(re.search(r"[^0.\s+-]", re.sub(r"[eE][+-]?\d+", "", text)))
