"""Spacecraft of URDF files.

All links of a robot count as one rigid body with its joints at zero. Thrusters are the links that Gazebo's plugins
``SpacecraftThrusterModel`` name, with their ``max_thrust``, or else links whose names say that they are thrusters.
As in that plugin the force acts at the link's centre of mass along its z axis. What a file does not say is None.

Sources: wiki.ros.org/urdf/XML and gz-sim ``SpacecraftThrusterModel.cc``.

`rans.model.foreign` finds `imported` by its entry point; everything here is in SI units and in the axes of the
file's root, and refusals are `ConfigError`.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from rans.extend import ConfigError, Spacecraft, brief, counted, read_text
from rans_any_craft.foreign import Foreign, Nozzle
from rans_any_craft.joining import Lump, lumped

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
_MOST_RADIANS = 6.3
"""Largest angle of an origin: a turn, rounded up as people type it."""
_MOST_LINKS = 10_000
_LARGEST = 2**24
"""Bytes: descriptions have some ten thousand, their meshes lie in other files."""


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
    plugins: Iterable[ET.Element], links: Collection[str], remarks: list[str]
) -> dict[str, float | None]:
    """Links that are thrusters, in the order of their commands, with their forces where a plugin says them.

    ``remarks`` gets clauses on what is not read. The order is that of the actuator numbers, where the file has
    them.
    """
    stated: dict[str, tuple[int | None, float | None]] = {}
    others: list[str] = []
    for plugin in plugins:
        if _PLUGIN not in plugin.get("name", "") + plugin.get("filename", ""):
            if (joint := plugin.findtext("joint_name")) and _NOZZLE.search(
                plugin.get("name", "") + plugin.get("filename", "")
            ):
                raise ConfigError(
                    f"a plugin Thruster pushes along the axis of the joint {brief(joint)}, and forces are read of "
                    f"{_PLUGIN} alone, along z of its link: name the link in one of these."
                )
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


def _inertia(element: ET.Element | None) -> np.ndarray:
    """Tensor (3, 3), kg m^2, from ixx, ixy, ixz, iyy, iyz and izz; zeros without an element."""
    if element is None:
        return np.zeros((3, 3))
    values = {}
    for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
        # Products are zero by default.
        usual = "0" if name[1] != name[2] else None
        values[name] = float(_numbers(element.get(name, usual), 1, name)[0])
    xx, xy, xz, yy, yz, zz = values.values()
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


# URDF


def imported(file: Path, name: str, usual: Spacecraft) -> tuple[Spacecraft, str, tuple[str, ...]]:
    """See `rans.model.foreign.Importer`."""
    found = read_foreign(file)
    craft, remarks = found.spacecraft(name, usual)
    return craft, found.source, remarks


def read_foreign(file: Path) -> Foreign:
    """Mass properties and thrusters of a URDF.

    Raises:
        ConfigError: the file cannot be read, is damaged, or describes what is not one rigid body.
    """
    text = read_text(file, _LARGEST, "the spacecraft file ")
    try:
        return urdf(text, file.name)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from error


def urdf(text: str, name: str) -> Foreign:
    """Mass properties and thrusters of a URDF in the frame of its root link; messages have the name.

    Joints are at zero, whatever their limits are.
    """
    root = _xml(text)
    if root.tag != "robot":
        raise ConfigError(f"a URDF's root is <robot>, got <{brief(root.tag)[1:-1]}>.")
    if any("xacro" in str(element.tag) for element in root.iter()):
        raise ConfigError(f"it is a xacro file: run `xacro {name} > robot.urdf` first.")
    # Links in their own frames, and of each child the parent and the pose in its frame.
    links: dict[str, Lump] = {}
    for element in root.findall("link"):
        own = element.get("name", "")
        if not own or own in links:
            raise ConfigError(f"every link needs a name of its own, got {brief(own)} again.")
        links[own] = _link(element)
    if not links or len(links) > _MOST_LINKS:
        raise ConfigError(f"it must have 1 to {_MOST_LINKS:,} links, got {len(links):,}.")
    joints = {}
    for joint in root.findall("joint"):
        parent, child = (
            "" if end is None else end.get("link", "")
            for end in (joint.find("parent"), joint.find("child"))
        )
        if parent not in links or child not in links:
            raise ConfigError(
                f"the joint {brief(joint.get('name'))} joins {brief(parent)} and {brief(child)}, which must be "
                "links."
            )
        if child in joints:
            raise ConfigError(f"the link {brief(child)} is the child of two joints.")
        joints[child] = (parent, _origin(joint))
    roots = [link for link in links if link not in joints]
    if len(roots) != 1:
        raise ConfigError(f"it must have one root link, got {brief(roots)}.")
    # Poses in the frame of the root, parents before children.
    poses = {roots[0]: np.eye(4)}
    waiting = dict(joints)
    while waiting:
        ready = [child for child, (parent, _) in waiting.items() if parent in poses]
        if not ready:
            raise ConfigError(f"the joints of {brief(sorted(waiting))} form a ring.")
        for child in ready:
            parent, origin = waiting.pop(child)
            poses[child] = poses[parent] @ origin
    turning = [str(j.get("name")) for j in root.findall("joint") if j.get("type") == "continuous"]
    remarks: list[str] = []
    if turning:
        remarks.append(
            f"its joints {brief(turning)} turn without limits: a reaction wheel is a [[wheel]] of the file"
        )
    forces = _forces(root.iterfind("gazebo/plugin"), links, remarks)
    # One rigid body of all links, in the axes of the root.
    placed = {own: _moved(link, poses[own]) for own, link in links.items()}
    if not any(link.mass for link in links.values()):
        raise ConfigError("no link has a mass; is <inertial> missing?")
    whole = lumped(list(placed.values()))
    nozzles = tuple(
        Nozzle(own, _triple(placed[own].centre), _triple(poses[own][:3, 2]), force)
        for own, force in forces.items()
    )
    return Foreign(
        name
        if len(links) == 1
        else f"{name}, its {len(links)} links as one body with joints at zero",
        whole.mass,
        tuple(map(_triple, whole.inertia)) if whole.inertia.any() else None,
        _triple(whole.centre),
        nozzles,
        remarks=tuple(remarks),
    )


def _link(link: ET.Element) -> Lump:
    """Mass properties of a link in its own frame; without an inertial element it weighs nothing, as URDF says."""
    inertial = link.find("inertial")
    if inertial is None:
        return Lump(0.0, np.zeros(3), np.zeros((3, 3)))
    weighed = inertial.find("mass")
    what = brief(link.get("name"))
    text = None if weighed is None else weighed.get("value")
    mass = float(_numbers(text, 1, f"the mass of {what}")[0])
    tensor = _inertia(inertial.find("inertia"))
    _check_body(f"the link {what}", mass, tensor)
    return _moved(Lump(mass, np.zeros(3), tensor), _origin(inertial))


def _moved(body: Lump, pose: np.ndarray) -> Lump:
    """A body in the frame in which its own has a pose (4, 4)."""
    turn, place = pose[:3, :3], pose[:3, 3]
    return Lump(body.mass, turn @ body.centre + place, turn @ body.inertia @ turn.T)


def _origin(element: ET.Element) -> np.ndarray:
    """Pose (4, 4) of an element's origin; its angles are about fixed x, then y, then z, rad."""
    pose = np.eye(4)
    origin = element.find("origin")
    if origin is not None:
        what = f"an origin in {brief(element.get('name') or element.tag)}"
        angles = _numbers(origin.get("rpy", "0 0 0"), 3, f"rpy of {what}")
        if (abs(angles) > _MOST_RADIANS).any():
            raise ConfigError(
                f"rpy of {what} must be in rad, at most a turn, got {brief(origin.get('rpy'))}: degrees?"
            )
        pose[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
        pose[:3, 3] = _numbers(origin.get("xyz", "0 0 0"), 3, f"xyz of {what}")
    return pose
