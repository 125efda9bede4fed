"""Layouts of thrusters as text."""

from __future__ import annotations

import pytest

from rans.model.spacecraft import Spacecraft, Thruster
from rans.model.spacecraft_file import load_spacecraft
from rans.show.tables.layout_text import layout_text
from tests.support.crafts import nasty_planar, nasty_spatial

UNIT_INERTIA = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@pytest.fixture(autouse=True)
def _wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables are as wide as they need to be."""
    monkeypatch.setenv("COLUMNS", "160")


@pytest.mark.parametrize(
    ("direction", "mark"),
    [
        ((0.6, 0.8, 0.0), "↗"),
        ((-0.8, 0.6, 0.0), "↖"),
        ((-0.6, -0.8, 0.0), "↙"),
        ((0.8, -0.6, 0.0), "↘"),
        ((0.0, 0.0, 1.0), "⊙"),
        ((0.0, 0.0, -1.0), "⊗"),
    ],
)
def test_arrow_of_a_force(direction: tuple[float, float, float], mark: str) -> None:
    with pytest.warns(UserWarning, match="cannot push"):
        craft = Spacecraft(
            "one",
            3,
            1.0,
            UNIT_INERTIA,
            (Thruster((0.0, 0.3, 0.0), direction, 1.0),),
            radius=0.31,
        )
    lines = layout_text(craft).splitlines()
    rows = [line for line in lines if f"0{mark}" in line]
    assert len(rows) == 1
    assert lines.index(rows[0]) < next(i for i, line in enumerate(lines) if "+" in line)  # y is up


@pytest.mark.parametrize(
    "craft",
    [load_spacecraft("free-flyer"), nasty_planar(), nasty_spatial()],
    ids=lambda craft: craft.name,
)
def test_no_thruster_hides_another(craft: Spacecraft) -> None:
    text = layout_text(craft)
    for letter in "→↗↑↖←↙↓↘⊙⊗":
        text = text.replace(letter, " ")
    assert sorted(int(word) for word in text.replace("·", " ").replace("+", " ").split()) == list(
        range(len(craft.thrusters))
    )
