"""What a spacecraft looks like, against geometry worked by hand and the text of its meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import Rgba

from rans.model.solids import Solid
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.show.scene.craft import (
    PLUME,
    craft_parts,
    hull_parts,
    plume_parts,
    plumes,
)
from tests.support.drawings import corners, volume

PLATFORM = load_spacecraft("floating-platform")
PYRAMID = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def test_plumes_leave_against_the_thrust(shipped: Spacecraft) -> None:
    for pose, thruster in zip(plumes(shipped), shipped.thrusters, strict=True):
        way = pose.translation() + np.array(shipped.centre_of_mass) - thruster.position
        for along in (pose.rotation().matrix()[:, 2], way / np.linalg.norm(way)):
            np.testing.assert_allclose(along, -np.array(thruster.direction), atol=1e-12)


@given(command=st.floats(0.01, 1.0), radius=st.floats(0.05, 5.0))
@settings(max_examples=25)
def test_a_plume_is_as_long_as_its_command(command: float, radius: float) -> None:
    """From the mouth of the nozzle on; numbers in a mesh have five digits."""
    parts = plume_parts(replace(PLATFORM, radius=radius), command)
    far = max(corners(part)[:, 2].max() for part in parts)
    assert far == pytest.approx(PLUME * command * radius, rel=1e-4)
    assert min(corners(part)[:, 2].min() for part in parts) == 0.0


def test_parts_have_names_of_their_own(shipped: Spacecraft) -> None:
    """Equal names would replace one another on the page."""
    parts = craft_parts(shipped, Rgba())
    assert len({part.name for part in parts}) == len(parts)
    assert sum(part.name.startswith("nozzle") for part in parts) == len(shipped.thrusters)


def test_a_spacecraft_looks_as_its_file_says() -> None:
    """Solids are in G, whose origin is not the centre of mass; everything else is as it was."""
    craft = replace(
        PLATFORM,
        centre_of_mass=(0.01, 0.02, 0.0),
        solids=(
            Solid("box", (0.1, 0.2, 0.3), position=(0.11, 0.02, 0.0), colour="#ff8000"),
            Solid("cone", (0.1, 0.4), axis=(2.0, 0.0, 0.0)),
            Solid("mesh", (0.5,), mesh=PYRAMID),
        ),
    )
    box, cone, mesh = hull_parts(craft, Rgba(0.1, 0.2, 0.3))
    assert box.shape.size().tolist() == [0.1, 0.2, 0.3]  # type: ignore[attr-defined]
    np.testing.assert_allclose(box.pose.translation(), [0.1, 0.0, 0.0], atol=1e-15)
    assert [round(255 * x) for x in (box.colour.r(), box.colour.g(), box.colour.b())] == [
        255,
        128,
        0,
    ]
    tip = cone.pose @ [0.0, 0.0, 0.4]
    np.testing.assert_allclose(
        tip, [0.19, -0.02, 0.0], atol=1e-12
    )  # half its length along x from G
    assert (cone.colour.r(), cone.colour.g()) == (0.1, 0.2)
    assert mesh.shape.scale() == 0.5  # type: ignore[attr-defined]
    assert corners(mesh).tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert volume(mesh) == pytest.approx(1.0 / 6.0)
    assert len(craft_parts(craft, Rgba())) > 3 + len(PLATFORM.thrusters)


def test_a_ghost_is_of_one_colour_and_a_little_larger() -> None:
    ghost, hull = (
        hull_parts(PLATFORM, Rgba(0.0, 1.0, 0.0, 0.3), scale, one)
        for scale, one in ((1.04, True), (1.0, False))
    )
    assert {part.colour.a() for part in ghost} == {0.3}
    for large, part in zip(ghost, hull, strict=True):
        grown = np.multiply(1.04, part.pose.translation())
        np.testing.assert_allclose(large.pose.translation(), grown, atol=1e-12)
