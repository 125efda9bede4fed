"""Thrusters of a spreadsheet become those of a file."""

from __future__ import annotations

import pytest
from rans_any_craft.thruster_table import of_table

from rans import ConfigError, init_spacecraft
from rans.model.spacecraft_file import load_spacecraft

pytestmark = pytest.mark.filterwarnings("ignore:.*(cannot push|has thrusters alone|no inertia)")
PLATFORM = load_spacecraft("floating-platform")
TABLE = """name, X [cm], y (mm), angle_deg, Force (mN)
right, -20, 100, 0, 500
left, 20, -100, 180.0, 250
"""


def test_units_of_the_header_become_si(tmp_path):
    file = tmp_path / "thrusters.csv"
    file.write_text(TABLE)
    craft = init_spacecraft("mine", base=file, dimension=2).spacecraft
    assert [one.position for one in craft.thrusters] == [(-0.2, 0.1, 0.0), (0.2, -0.1, 0.0)]
    assert [one.force for one in craft.thrusters] == [0.5, 0.25]
    for one, x in zip(craft.thrusters, (1.0, -1.0), strict=True):
        assert one.direction == pytest.approx((x, 0.0, 0.0), abs=1e-12)
    assert craft.mass == PLATFORM.mass


def test_in_space_a_direction_is_a_vector(tmp_path):
    file = tmp_path / "thrusters.csv"
    file.write_text("x (m),y (m),z (m),dx,dy,dz,force (N)\n1,2,3,0,0,-2,4\n")
    craft, source, _ = of_table(file, "mine", load_spacecraft("free-flyer"))
    assert [(one.position, one.direction, one.force) for one in craft.thrusters] == [
        ((1.0, 2.0, 3.0), (0.0, 0.0, -1.0), 4.0)
    ]
    assert "thrusters.csv" in source


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("X [cm]", "X", "with its unit, m or cm or mm"),
        ("y (mm)", "y (inch)", "with its unit"),
        ("y (mm)", "x (mm)", "must be there once"),
        ("angle_deg", "way", "has no column dx, dy"),
        ("Force (mN)", "thrust", "has no column force"),
        ("180.0", "west", "line 3: angle must be a finite number, got 'west'"),
        (",", ";", "write commas"),
    ],
)
def test_what_is_no_table_of_thrusters_is_refused(old, new, said, tmp_path):
    file = tmp_path / "thrusters.csv"
    file.write_text(TABLE.replace(old, new))
    with pytest.raises(ConfigError, match=said):
        of_table(file, "mine", PLATFORM)
