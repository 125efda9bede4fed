"""A package of somebody else, as examples/plugin is one, through the commands that a user gives."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from rans_example.spacecraft import puck

from rans.model.spacecraft_file import to_toml
from tests.support.processes import ROOT, printed

FLIER = "steer:keep-distance-2d@puck"


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """A folder with the package installed below site/, without a network."""
    folder = tmp_path_factory.mktemp("user")
    source = shutil.copytree(
        ROOT / "examples" / "plugin", folder / "source"
    )  # setuptools writes beside it
    printed(
        *("-m", "pip", "install", "--quiet", "--no-index", "--no-build-isolation", "--no-deps"),
        *("--target", folder / "site", source),
    )
    return folder


def rans(place: Path, *commands: str) -> list[str]:
    """What every command prints; it must succeed. One process gives them, which draws nothing: torch and
    Drake start once, and figures take seconds."""
    script = (
        "import sys; from matplotlib.figure import Figure; from rans.cli import main\n"
        "Figure.draw_without_rendering = lambda _: None\n"
        "svg = '<svg xmlns=\"http://www.w3.org/2000/svg\"/>'\n"
        "write = lambda file: file.write_text if hasattr(file, 'write_text') else file.write\n"
        "Figure.savefig = lambda _, file, **__: write(file)(svg)\n"
        "for line in sys.argv[1:]: assert main(line.split()) == 0, line; print(end='\\f')"
    )
    path = os.pathsep.join((str(place / "site"), str(ROOT)))
    text = printed("-c", script, *commands, cwd=place, PYTHONPATH=path, COLUMNS="160")
    return text.split("\f")[:-1]


@pytest.mark.slow
def test_a_package_gives_every_command_its_task_spacecraft_and_controller(place):
    text = to_toml(puck()) + "\n[torquer]\naxis = [0.0, 0.0, 1.0]\ntorque = 0.02\ncharge = 5.0\n"
    (place / "turned.toml").write_text(text.replace('"puck"', '"turned"'), "utf-8")
    listed, task, _, _, evaluated, compared, least, validated, _, _, _, reported = rans(
        place,
        "list",
        "list keep-distance",
        "train keep-distance --spacecraft turned.toml --device cpu --set total_timesteps=2000 "
        "--set algorithm=a2c --output turned",
        "train keep-distance --spacecraft puck --device cpu --set total_timesteps=9000 --output keep",
        "evaluate keep --episodes 8 --engine drake --conditions workshop",  # Drake judges it too
        f"compare keep {FLIER} --with steer optimal --certified 2 --episodes 8",
        "least --episodes 2",
        "validate turned.toml --quick --layer thrusters",  # and Drake's half of the torquer
        "export keep --output outlined --format outline --episodes 8 --force",
        "export keep --output gift --episodes 8 --force",
        f"view gift {FLIER} --save page.html",
        "report keep",
    )
    for name in ("keep-distance", "puck", "steer", "workshop", "a2c"):
        assert f"{name} (of rans-example)" in listed
    assert "rans/KeepDistance3D-v0" in task

    config = json.loads((place / "keep" / "config.json").read_text())
    assert (config["task"], config["spacecraft"]) == ("keep-distance", "puck")
    assert config["settings"]["distance"] == 1.0
    assert 'name = "puck"' in (place / "keep" / "spacecraft.toml").read_text()
    assert (place / "keep" / "evaluation-workshop-drake.json").exists()
    comparison = json.loads((place / "keep" / "compare.json").read_text())
    names = [row["contestant"] for row in comparison["summary"]]
    assert names[:2] == ["keep", "steer"]  # nobody flies twice
    bounds = comparison["per_start"]["certified"]
    assert [bound["kind"] for bound in bounds] == ["settling", "settling"]
    for bound in bounds:
        assert f"{bound['hull']:.2f} s" in least
    assert "command (8)" in (place / "outlined" / "agent.outline").read_text()
    # A key metric stands in the short tables, and its section adds to what the core says of the file.
    assert "early duty" in evaluated
    assert "early duty, %" in compared
    assert "early_duty" in np.load(place / "keep" / "episodes-workshop-drake.npz")
    assert "2 of 2 checks passed" in validated
    assert reported
    page = (place / "page.html").read_text("utf-8")
    assert page.count('"arrival":') == 2  # two flights
