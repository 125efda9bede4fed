"""The outline of a craft, by numbers worked out by hand."""

from __future__ import annotations

import shutil
import subprocess
import warnings
from importlib.resources import files
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from rans import RansWarning, Spacecraft, Thruster
from rans.episode.outline import nozzles, outline_values

THRUSTERS = (
    Thruster((1.5, 0.0, 0.0), (0.0, 1.0, 0.0), 2.0),
    Thruster((0.5, -1.0, 0.0), (-0.6, 0.8, 0.0), 0.5),
)
INERTIA = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def crafted(dimension: Literal[2, 3], thrusters: tuple[Thruster, ...]) -> Spacecraft:
    """A craft of radius 2 m, whose centre of mass is half a metre from the origin of its file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RansWarning)  # they cannot push it in every direction
        return Spacecraft("some", dimension, 1.0, INERTIA, thrusters, (0.5, 0.0, 0.0), radius=2.0)


CRAFT = crafted(2, THRUSTERS)


def test_nozzles_lie_about_the_centre_of_mass_against_their_forces():
    first, second = nozzles(CRAFT)
    np.testing.assert_allclose(first.root, (1.0, 0.0, 0.0))
    np.testing.assert_allclose(first.exhaust, (0.0, -1.0, 0.0))
    np.testing.assert_allclose(first.mouth, (1.0, -0.6, 0.0))  # 0.3 radii of 2 m
    np.testing.assert_allclose(second.root, (0.0, -1.0, 0.0))
    np.testing.assert_allclose(second.mouth, (0.36, -1.48, 0.0))
    assert (first.strength, second.strength) == (1.0, 0.25)


def test_a_page_is_given_places_and_forces():
    values = outline_values(CRAFT, 3)
    assert (values["planar"], values["radius"]) == (True, 2.0)
    assert values["thrusters"][1] == {"at": [0.0, -1.0, 0.0], "along": [-0.15, 0.2, 0.0]}
    assert "-0.0" not in str(values)


SCRIPT = """
const calls = [];
const pen = new Proxy({globalAlpha: 1}, {
  get: (own, name) => name in own ? own[name] : (...values) => { calls.push([name, ...values]); },
});
"""
"""A canvas's pen that lists what it is told."""


def drawn(call: str, told: str, folder: Path) -> str:
    """What Node.js prints of the calls of the pen after one of the script."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs Node.js to run JavaScript")
    code = (files("rans.show.pages") / "craft.js").read_text("utf-8")
    file = folder / "drawn.js"
    file.write_text(f"{SCRIPT}{code}\n{call};\nconsole.log({told});", "utf-8")
    done = subprocess.run([node, str(file)], check=True, capture_output=True, text=True)
    return done.stdout.strip()


def test_plumes_leave_against_the_force(tmp_path):
    """The second is shut; 0.9 radii of 2 m, half the force, half open."""
    craft = "{planar: true, radius: 2, thrusters: [{at: [1, 0], along: [0, 0.5]}, {at: [0, 1], along: [1, 0]}]}"
    call = f'plumes(pen, {craft}, point => point, [0.5, 0], "red", 1)'
    ways = 'JSON.stringify(calls.filter(([name]) => name.endsWith("To")))'
    assert drawn(call, ways, tmp_path) == '[["moveTo",1,0],["lineTo",1,-0.45]]'
