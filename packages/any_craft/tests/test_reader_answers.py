"""What the importers make of planted files of other software (`tests.support.reader_questions`)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rans_any_craft.importers import read_foreign

import rans
from tests.support.reader_questions import (
    Answer,
    Answers,
    check_said,
    planted,
    written,
)


def link(name: str, mass: str = "17", xyz: str = "0 0 0", parent: str = "b", i: str = "0.3") -> str:
    """A link, and its fixed joint unless it is the root."""
    joint = (
        f"<joint name='j{name}' type='fixed'><origin xyz='{xyz}'/><parent link='{parent}'/>"
        f"<child link='{name}'/></joint>"
    )
    inertia = f"<inertia ixx='{i}' iyy='{i}' izz='{i}'/>"
    inertial = f"<inertial><mass value='{mass}'/>{inertia}</inertial>"
    return f"<link name='{name}'>{inertial}</link>{joint if name != 'b' else ''}"


def jet(name: str, number: int) -> str:
    return (
        f"<gazebo><plugin name='gz::sim::systems::SpacecraftThrusterModel'><link_name>{name}</link_name>"
        f"<actuator_number>{number}</actuator_number><max_thrust>1</max_thrust></plugin></gazebo>"
    )


def urdf(*parts: str, read: Callable[[Path], object] = read_foreign) -> Any:
    return written("m.urdf", f"<robot name='m'>{''.join(parts)}</robot>", read)


def drafted(file: Path) -> object:
    return rans.init_spacecraft("mine", base=file, dimension=3)


ANSWERS: Answers = {
    "read_foreign": {
        "units": Answer(
            urdf(link("b"), link("jet", "0.1", "120 0 0"), jet("jet", 0), read=drafted),
            "positions in mm or cm",
            is_warning=True,
        ),
        "frames": Answer(urdf(link("b"), link("c", parent="x")), "must be links"),
        "times": "a body has none",
        "order": Answer(
            urdf(link("b"), link("c"), link("d"), jet("c", 1), jet("d", 1)),
            "one actuator_number, 1",
        ),
        "dropped": Answer(
            urdf(
                link("b"),
                link("jet"),
                jet("jet", 0),
                "<gazebo><plugin name='Camera'/></gazebo>",
                read=drafted,
            ),
            r"\['Camera'\] are not read",
            is_warning=True,
        ),
        "sizes": Answer(urdf(link("b"), "<!--" + "x" * 2**24 + "-->"), "are read; it is probably"),
        "evidence": Answer(urdf(link("b"), link("leg", "-1")), "mass of the link 'leg'"),
    },
}


@planted(ANSWERS)
def test_a_file_that_means_something_else(answer: Answer, tmp_path: Path) -> None:
    check_said(answer, tmp_path)
