"""An agent as a module of PX4: golden pairs, a flight, refusals.

It is compiled with stand-ins of PX4's headers, and by PX4 itself where the environment's PX4_TREE is a checkout of
it (3a734bc846 of 2025-08-29, 1.17) with its submodules mavlink, libevents, heatshrink and gps/devices.
"""

from __future__ import annotations

import ctypes
import json
import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_robot.frames import Motion, quaternion_of, swapped
from rans_robot.px4.export import write_px4
from rans_robot.twin import Craft, TwinPlan

from rans import load_spacecraft
from rans.base.pretrained import pretrained_folder
from rans.base.registry import typed
from rans.deploy.export import write_export
from rans.extend import ConfigError, Ports, Program

if shutil.which("c++") is None:
    pytest.skip("needs a C++ compiler", allow_module_level=True)

BUILD = """
cc -O2 -fPIC -Dmain=rans_agent_check -c agent.px4/agent.c agent.px4/agent_check.c &&
c++ -std=c++14 -O2 -fPIC -shared -Wall -Wextra -Werror -Wshadow -Wdouble-promotion -Wfloat-equal
  -Iagent.px4 -Ipx4 -I{here} {here}/px4_vehicle.cpp agent.o agent_check.o -o module.so
"""
"""With PX4's warnings."""
IN_PX4 = [
    pytest.mark.slow,
    pytest.mark.skipif("PX4_TREE" not in os.environ, reason="PX4_TREE names no checkout of PX4"),
]
Motors = Callable[[float, float, Motion, Motion], np.ndarray]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("px4")
    form = typed("rans_robot.px4.export:write_px4")
    write_export(pretrained_folder("go-to-pose-2d"), folder, form, episodes=8)
    return folder


@pytest.fixture(scope="module")
def motors_of_stand_in(folder) -> Motors:
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

    motors.library = library  # type: ignore[attr-defined]
    return motors


BUILT_IN = {"PLATFORM_POSIX", "BOARD_ETHERNET", "BOARD_ROOT_PATH", "SYSTEMCMDS_PARAM"}
BUILT_IN |= {"SYSTEMCMDS_SHUTDOWN", "SYSTEMCMDS_UORB"}
"""Parts of PX4's simulation that suffice to run modules; all others are left out of the build."""
COMMANDS = """
. ./px4-alias.sh
param select parameters.bson
rans_agent check && rans_agent start && rans_vehicle {folder}/motions {folder}/motors
shutdown
"""


@pytest.fixture(scope="module")
def motors_of_px4(folder) -> Iterator[Motors]:
    """See `motors`: the module runs in a process of PX4, at the pace of its clock; a time of 0 begins anew."""
    tree = Path(os.environ["PX4_TREE"])
    modules = tree / "src/modules"
    shutil.copytree(folder / "agent.px4", modules / "rans_agent", dirs_exist_ok=True)
    here = Path(__file__).parent / "rans_vehicle"
    shutil.copytree(here, modules / "rans_vehicle", dirs_exist_ok=True)
    board = tree / "boards/px4/sitl"
    usual = re.findall("CONFIG_(.+)=y", (board / "default.px4board").read_text("utf-8"))
    lines = [f"CONFIG_{name}=n\n" for name in usual if name not in BUILT_IN]
    own = "BOARD_NOLOCKSTEP", "MODULES_RANS_AGENT", "MODULES_RANS_VEHICLE"
    lines += [f"CONFIG_{name}=y\n" for name in own]
    (board / "rans.px4board").write_text("".join(lines), "utf-8")
    alone = {**os.environ, "GIT_SUBMODULES_ARE_EVIL": "1"}
    subprocess.run(["make", "px4_sitl_rans"], cwd=tree, env=alone, check=True)

    for name in ("motions", "motors"):
        os.mkfifo(folder / name)
    (folder / "commands").write_text(COMMANDS.format(folder=folder), "utf-8")
    binaries = tree / "build/px4_sitl_rans/bin"
    shutil.copy(binaries / "px4-alias.sh", folder)
    with (
        subprocess.Popen([binaries / "px4", "-d", "-s", "commands"], cwd=folder) as process,
        (folder / "motions").open("w") as motions,
        (folder / "motors").open() as commands,
    ):

        def motors(now: float, sample: float, own: Motion, goal: Motion) -> np.ndarray:
            rows = np.hstack([*swapped(own), *swapped(goal)])
            lines = list[str]()
            for age in [1.0, now - sample] if now == 0.0 else [now - sample]:  # too old, it forgets
                print(1e3 * age, *map(float, rows), file=motions, flush=True)
                lines.append(commands.readline())
            return np.array(lines[-1].split(), dtype=np.float32)

        yield motors
        motions.close()
        assert process.wait(30) == 0


@pytest.fixture(scope="module", params=["stand_in", pytest.param("px4", marks=IN_PX4)])
def motors(request) -> Motors:
    """Twelve commands of the compiled module at a time, s, of an estimate of another time and a goal."""
    return request.getfixturevalue(f"motors_of_{request.param}")


def motion(one: dict[str, Any]) -> Motion:
    """Motion in space of a planar state of golden.json."""
    return Motion(
        np.array([*one["position"], 0.0]),
        quaternion_of(one["attitude"]),
        np.array([*one["velocity"], 0.0]),
        np.array([0.0, 0.0, one["spin"]]),
    )


def test_golden_pairs_through_messages(folder, motors):
    """Motors that are shut are NaN; old estimates stop all of them."""
    pairs = json.loads((folder / "golden.json").read_text("utf-8"))
    now = 0.0
    moving = list[Motion]()
    for k, command in enumerate(pairs["command"]):
        now = 0.0 if pairs["begins"][k] else now + 0.2
        moving = [motion(pairs[name][k]) for name in ("state", "goal")]
        expected = np.where(command, command, np.nan)
        np.testing.assert_array_equal(motors(now, now, *moving)[: len(command)], expected)
    assert len(pairs["command"]) == 160
    assert np.isnan(motors(now + 0.3, now, *moving)).all()


def test_an_estimate_that_repeats_stops_the_motors(motors):
    own = motion({"position": (2.0, 1.0), "attitude": 0.5, "velocity": (0.0, 0.0), "spin": 0.0})
    goal = motion({"position": (0.0, 0.0), "attitude": 0.0, "velocity": (0.0, 0.0), "spin": 0.0})
    stopped = [bool(np.isnan(motors(0.2 * k, 0.2 * k, own, goal)).all()) for k in range(5)]
    assert stopped == [False, False, True, True, True]


def test_stop_shuts_the_motors(motors_of_stand_in):
    after = np.zeros(12, np.float32)
    motors_of_stand_in.library.motors_of_stop(after.ctypes.data_as(ctypes.c_void_p))
    assert np.isnan(after).all()


def test_it_flies_the_twin(motors):
    """By its estimates in PX4's frames; it stays at its goal."""
    craft = Craft(
        TwinPlan(load_spacecraft("floating-platform"), 0.2, start=(2.0, -1.0, 120.0), rate=25.0)
    )
    goal = motion({"position": (0.0, 0.0), "attitude": 0.0, "velocity": (0.0, 0.0), "spin": 0.0})
    for k in range(150):
        measured = craft.measured()
        craft.hold(np.nan_to_num(motors(0.2 * k, 0.2 * k, measured, goal))[:8])
        for _ in range(5):
            craft.advance()
    assert np.linalg.norm(craft.motion.position) < 0.1
    assert abs(craft.motion.attitude[3]) < 0.05


@pytest.mark.parametrize(("low", "high"), [(-0.0077, 1.0), (0.0, 1.2251)])
def test_a_range_that_stops_or_saturates_a_motor_is_refused(low, high):
    """The numbers of PX4's issue 28417."""
    ranges = [{"name": "first", "low": low, "high": high}]
    with pytest.raises(ConfigError, match="first goes from"):
        write_px4(Path(), Program(), Ports(1, 1), "", json.dumps({"command": {"ranges": ranges}}))
