"""What the importers make of planted files of other software (`tests.support.reader_questions`)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import rans
from rans.model.foreign import read_foreign
from tests.support.reader_questions import (
    Answer,
    Answers,
    check_complete,
    check_said,
    planted,
    written,
)


def link(name: str, mass: str = "17", pose: str = "", i: str = "0.3") -> str:
    tensor = f"<ixx>{i}</ixx><iyy>{i}</iyy><izz>{i}</izz>"
    inertial = f"<inertial><mass>{mass}</mass><inertia>{tensor}</inertia></inertial>"
    return f"<link name='{name}'>{pose}{inertial}</link>"


def jet(name: str, number: int) -> str:
    return (
        f"<plugin name='gz::sim::systems::SpacecraftThrusterModel'><link_name>{name}</link_name>"
        f"<actuator_number>{number}</actuator_number><max_thrust>1</max_thrust></plugin>"
    )


def sdf(*parts: str, read: Callable[[Path], object] = read_foreign) -> Any:
    return written("m.sdf", f"<sdf><model name='m'>{''.join(parts)}</model></sdf>", read)


def drafted(file: Path) -> object:
    return rans.init_spacecraft("mine", base=file, dimension=3)


FAR = "<pose>120 0 0 0 0 0</pose>"
ANSWERS: Answers = {
    "read_foreign": {
        "units": Answer(
            sdf(link("b"), link("jet", "0.1", FAR), jet("jet", 0), read=drafted),
            "positions in mm or cm",
            is_warning=True,
        ),
        "frames": Answer(sdf(link("b", pose="<pose relative_to='x'/>")), "relative to 'x'"),
        "times": "a body has none",
        "order": Answer(
            sdf(link("b"), link("c"), link("d"), jet("c", 1), jet("d", 1)), "one actuator_number, 1"
        ),
        "dropped": Answer(
            sdf(link("b"), link("jet"), jet("jet", 0), "<plugin name='Camera'/>", read=drafted),
            r"\['Camera'\] are not read",
            is_warning=True,
        ),
        "sizes": Answer(sdf(link("b"), "<!--" + "x" * 2**24 + "-->"), "are read; it is probably"),
        "evidence": Answer(sdf(link("b"), link("leg", "-1")), "mass of the link 'leg'"),
    },
}


def test_every_question_is_answered() -> None:
    check_complete(ANSWERS)


@pytest.mark.parametrize(("reader", "question"), planted(ANSWERS))
def test_a_file_that_means_something_else(reader: str, question: str, tmp_path: Path) -> None:
    check_said(ANSWERS, reader, question, tmp_path)
