"""An agent as a module of PX4, compiled with stand-ins of PX4's headers: golden pairs, a flight, refusals."""

from __future__ import annotations

import ctypes
import json
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_robot.frames import Motion, quaternion_of, swapped
from rans_robot.px4.export import write_px4
from rans_robot.twin import Craft, TwinPlan

from rans.deploy.export import write_export
from rans.extend import ConfigError, Ports, Program, load_spacecraft
from rans.pretrained import pretrained_folder
from rans.registry import typed

if shutil.which("c++") is None:
    pytest.skip("needs a C++ compiler", allow_module_level=True)

BUILD = """
cc -O2 -fPIC -Dmain=rans_agent_check -c agent.px4/agent.c agent.px4/agent_check.c &&
c++ -std=c++14 -O2 -fPIC -shared -Wall -Wextra -Werror -Wshadow -Wdouble-promotion -Wfloat-equal
  -Iagent.px4 -Ipx4 -I{here} {here}/px4_vehicle.cpp agent.o agent_check.o -o module.so
"""
"""With PX4's warnings."""
Motors = Callable[[float, float, Motion, Motion], np.ndarray]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("px4")
    form = typed("rans_robot.px4.export:write_px4")
    write_export(pretrained_folder("go-to-pose-2d"), folder, form, episodes=8)
    return folder


@pytest.fixture(scope="module")
def motors(folder: Path) -> Motors:
    """Twelve commands of the compiled module at a time, s, of an estimate of another time and a goal."""
    source = (folder / "agent.px4/rans_agent.cpp").read_text("utf-8")
    for name in re.findall("#include <(.+/.+)>", source):
        header = folder / "px4" / name
        header.parent.mkdir(parents=True, exist_ok=True)
        header.write_text('#include "px4_stand_in.hpp"\n')
    build = " ".join(BUILD.format(here=shlex.quote(str(Path(__file__).parent))).split())
    subprocess.run(build, shell=True, cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "module.so"))
    assert library.rans_agent_main(2, (ctypes.c_char_p * 2)(b"", b"check")) == 0

    def motors(now: float, sample: float, own: Motion, goal: Motion) -> np.ndarray:
        rows = [np.hstack(swapped(one)).astype(np.float32) for one in (own, goal)]
        result = np.zeros(12, np.float32)
        numbers = [x.ctypes.data_as(ctypes.c_void_p) for x in (*rows, result)]
        times = [ctypes.c_uint64(round(1e6 * time)) for time in (now, sample)]
        library.motors_of(*times, *numbers)
        return result

    return motors


def motion(one: dict[str, Any]) -> Motion:
    """Motion in space of a planar state of golden.json."""
    return Motion(
        np.array([*one["position"], 0.0]),
        quaternion_of(one["attitude"]),
        np.array([*one["velocity"], 0.0]),
        np.array([0.0, 0.0, one["spin"]]),
    )


def test_golden_pairs_through_messages(folder: Path, motors: Motors) -> None:
    """Motors that are shut are NaN; old estimates stop all of them."""
    pairs = json.loads((folder / "golden.json").read_text("utf-8"))
    now = 0.0
    moving = list[Motion]()
    for k, command in enumerate(pairs["command"]):
        now = 0.0 if pairs["begins"][k] else now + 0.2
        moving = [motion(pairs[name][k]) for name in ("state", "goal")]
        expected = np.where(command, command, np.nan)
        np.testing.assert_array_equal(motors(now, now, *moving)[: len(command)], expected)
    assert len(pairs["command"]) == 500
    assert np.isnan(motors(now + 0.3, now, *moving)).all()


def test_it_flies_the_twin(motors: Motors) -> None:
    """By its estimates in PX4's frames; it stays at its goal."""
    craft = Craft(TwinPlan(load_spacecraft("floating-platform"), 0.2, start=(2.0, -1.0, 120.0)))
    goal = motion({"position": (0.0, 0.0), "attitude": 0.0, "velocity": (0.0, 0.0), "spin": 0.0})
    for k in range(150):
        measured = craft.measured()
        assert measured is not None
        craft.hold(np.nan_to_num(motors(0.2 * k, 0.2 * k, measured, goal))[:8])
        for _ in range(20):
            craft.advance()
    assert np.linalg.norm(craft.motion.position) < 0.1
    assert abs(craft.motion.attitude[3]) < 0.05


@pytest.mark.parametrize(("low", "high"), [(-0.0077, 1.0), (0.0, 1.2251)])
def test_a_range_that_stops_or_saturates_a_motor_is_refused(low: float, high: float) -> None:
    """The numbers of PX4's issue 28417."""
    ranges = [{"name": "first", "low": low, "high": high}]
    with pytest.raises(ConfigError, match="first goes from"):
        write_px4(Path(), Program(), Ports(1, 1), "", json.dumps({"command": {"ranges": ranges}}))
