"""FMUs of craft, checked and flown by FMPy beside the engine."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from rans_robot.fmu.craft import drift_of, entries_of, state_of, write_craft
from scipy.spatial.transform import Rotation

import rans
from rans.cli import main
from rans.extend import Body, Setup, Spacecraft, World, load_spacecraft
from rans.model.actuators import Propellant, Throttle
from rans.model.fields import leaves
from rans.model.spacecraft_file import to_toml
from rans.randomization.parameters import StepInputs

fmpy = pytest.importorskip("fmpy")
fmi2 = pytest.importorskip("fmpy.fmi2")
validation = pytest.importorskip("fmpy.validation")
if shutil.which("cc") is None:
    pytest.skip("needs a C compiler", allow_module_level=True)

PLANE = ("x", "y", "heading", "vx", "vy", "spin")
FOLDER = TemporaryDirectory()
SPACE = ("x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz")


@cache
def unzipped_of(name: str) -> str:
    """Folder of a unit of `CRAFT`, in which FMPy finds no problem."""
    folder = Path(FOLDER.name) / name
    folder.mkdir()
    write_craft(folder, CRAFT[name]())
    file = str(folder / "craft.fmu")
    assert validation.validate_fmu(file) == []
    return str(fmpy.extract(file, unzipdir=str(folder / "unzipped")))


def unit_of(name: str, said: list[str] | None = None) -> tuple[Any, dict[str, int]]:
    """The unit before its initialization, and the references of its variables; what it says is added to a list."""
    unzipped = unzipped_of(name)
    about = fmpy.read_model_description(unzipped)
    slave = fmi2.FMU2Slave(
        guid=about.guid, unzipDirectory=unzipped, modelIdentifier="craft", instanceName="one"
    )
    if said is None:
        slave.instantiate()
    else:
        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(
            lambda _env, _name, _status, _kind, message: said.append(message.decode())
        )
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        slave.instantiate(callbacks=callbacks)
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    return slave, {one.name: one.valueReference for one in about.modelVariables}


def commands_of(craft: Spacecraft, steps: int) -> np.ndarray:
    """Random commands in their ranges; on/off thrusters have 0 and 1."""
    random = np.random.default_rng(1)
    low, high = (np.array([getattr(one, key) for one in craft.commands]) for key in ("low", "high"))
    drawn = random.random((steps, len(low)))
    switches = np.array([one.kind == "on-off" for one in craft.commands])
    return low + (high - low) * np.where(switches, np.round(drawn), drawn)


def start_of(craft: Spacecraft) -> dict[str, float]:
    """Turned, moving and spinning."""
    random = np.random.default_rng(2)
    if craft.dimension == 2:
        return dict(zip(PLANE, [1.0, -2.0, 0.7, 0.1, -0.05, 0.4], strict=True))
    x, y, z, w = Rotation.from_rotvec([0.9, -0.5, 1.4]).as_quat()
    motion = random.normal(0.0, 0.3, 9)
    return dict(zip(SPACE, [*motion[:3], w, x, y, z, *motion[3:]], strict=True))


def tank(craft: Spacecraft) -> Spacecraft:
    """The craft throttled, with a hundredth of it propellant, which runs out within a second."""
    propellant = Propellant(mass=0.01 * craft.mass, specific_impulse=2.0)
    return replace(craft, actuators=Throttle(), propellant=propellant)


CRAFT: dict[str, Callable[[], Setup]] = {
    "plane": lambda: Setup(load_spacecraft("floating-platform"), rans.GoToPose()),
    "space": lambda: Setup(load_spacecraft("free-flyer"), rans.GoToPose()),
    "wheels": lambda: Setup(load_spacecraft("cubesat-6u"), rans.GoToPose()),
    "propellant": lambda: Setup(tank(load_spacecraft("floating-platform")), rans.GoToPose()),
    "orbit": lambda: Setup(
        load_spacecraft("free-flyer"),
        rans.Dock(orbit=rans.TargetOrbit(gravity_gradient=True)),
    ),
    "ellipse": lambda: Setup(
        load_spacecraft("free-flyer"),
        rans.Dock(
            orbit=rans.TargetOrbit(
                eccentricity=0.3, semi_major_axis_km=9683.0, gravity_gradient=True
            )
        ),
    ),
    "oblate": lambda: Setup(
        load_spacecraft("floating-platform"),
        rans.Rendezvous(
            orbit=rans.TargetOrbit(
                oblate=True, inclination_degrees=51.6, target_drag=4e-7, ballistic_ratio=0.5
            )
        ),
    ),
}


@pytest.mark.parametrize("name", CRAFT)
def test_fmpy_flies_it_as_the_engine(name: str) -> None:
    """Every state of 100 control periods under random commands, within rounding of a state of order one.

    The unit's C and NumPy round sines and quotients by constants differently: 1e-16 each, which a spin
    carries along.
    """
    setup = CRAFT[name]()
    craft = setup.craft
    unit, at = unit_of(name)
    drift = setup.task.drift
    angles = [key for key in ("mean_anomaly", "latitude") if key in at]
    start = start_of(craft) | dict.fromkeys(angles, 2.0)
    drift = drift_of(drift, [2.0] * len(angles))
    unit.setReal([at[f"start_{key}"] for key in start], list(start.values()))
    unit.exitInitializationMode()
    names = [key.removeprefix("start_") for key in at if key.startswith("start_")]
    assert unit.getReal([at[key] for key in start]) == list(start.values())

    world = World(setup)
    own = [start[key] for key in start if key not in angles]
    state = state_of(craft, [*own, *(store.initial for store in craft.stores)])
    period = world.timing.control_period
    worst = 0.0
    for k, command in enumerate(commands_of(craft, 100)):
        unit.setReal(list(range(len(command))), [float(x) for x in command])
        unit.doStep(k * period, period)
        inputs = StepInputs(Body.of(craft), (tuple(map(float, command)),), drift=drift)
        state = world.move(state, inputs)[-1]
        drift = drift.later(period)
        got = np.array(unit.getReal([at[key] for key in names]))
        expected = [*leaves(state), *entries_of(drift, setup.task.drift)]
        worst = max(worst, float(np.abs(got - np.array(expected, float)).max()))
    assert worst < 1e-13
    left = state.stores[0] - 0.01 * craft.mass if craft.propellant else 0.0
    assert unit.getReal([at["mass"]])[0] == pytest.approx(craft.mass + left, rel=1e-15)
    ended(unit)


def test_several_control_periods_are_one_step() -> None:
    """A step of three periods is three steps of one, and a restart begins anew."""
    unit, at = unit_of("space")
    unit.exitInitializationMode()
    outputs = [at[name] for name in SPACE]
    command = [float(k % 3 == 0) for k in range(sum(name.startswith("command") for name in at))]

    def flown(steps: list[float]) -> list[float]:
        unit.setReal(list(range(len(command))), command)
        time = 0.0
        for step in steps:
            unit.doStep(time, step)
            time += step
        return list(unit.getReal(outputs))

    once = flown([0.2, 0.2, 0.2])
    assert max(map(abs, once[7:])) > 0.01
    unit.reset()
    unit.setupExperiment(startTime=0.0)
    unit.enterInitializationMode()
    unit.exitInitializationMode()
    assert flown([0.6]) == once
    ended(unit)


@pytest.mark.parametrize(
    ("name", "value", "step", "complaint"),
    [
        ("command[0]", 0.4, 0.2, "takes 0 or 1"),
        ("command[0]", np.nan, 0.2, "takes 0 or 1"),
        ("command[0]", 1.0, 0.3, "no whole number of control periods"),
        ("start_qw", 0.5, None, "have the length 0.5"),
        ("start_x", np.nan, None, "outside its range"),
    ],
)
def test_what_it_cannot_fly_is_refused_in_a_sentence(
    name: str, value: float, step: float | None, complaint: str
) -> None:
    said: list[str] = []
    unit, at = unit_of("space", said)
    unit.setReal([at[name]], [value])
    if step is None:
        refused = unit.exitInitializationMode
    else:
        unit.exitInitializationMode()
        refused = partial(unit.doStep, 0.0, step)
    with pytest.raises(Exception, match="status"):
        refused()
    assert any(complaint in line for line in said), said
    ended(unit)


def test_fmpy_simulates_it_from_its_description(tmp_path: Path) -> None:
    """With FMPy's own master and an input table: a thruster of the plane that pushes for a second."""
    setup = CRAFT["plane"]()
    write_craft(tmp_path, setup)
    table = np.array([(0.0, 1.0), (1.0, 0.0)], dtype=[("time", float), ("command[0]", float)])
    rows = fmpy.simulate_fmu(
        str(tmp_path / "craft.fmu"),
        stop_time=2.0,
        start_values={"start_x": 3.0},
        input=table,
        output=["x", "vx", "vy"],
    )
    assert rows["time"].tolist() == pytest.approx(np.arange(0.0, 2.1, 0.2).tolist())
    assert rows["x"][0] == 3.0
    speed = np.hypot(rows["vx"], rows["vy"])
    # Force times time over mass; the craft turns meanwhile, by a tenth at most of the change.
    force = setup.craft.thrusters[0].force / setup.craft.mass
    assert speed[5] == pytest.approx(force, rel=0.1)
    assert speed[-1] == speed[5]


def test_the_command_writes_a_spacecraft_alone(tmp_path: Path, refused: Any) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(to_toml(replace(load_spacecraft("pingu"), name="mine")), "utf-8")
    out = str(tmp_path / "out")
    assert main(f"export {file} --format fmu --output {out}".split()) == 0
    assert load_spacecraft(f"{out}/spacecraft.toml").name == "mine"
    assert "is exported as fmu, not as c" in refused(f"export {file} --format c --output {out}")


def ended(unit: Any) -> None:
    """Free the library."""
    unit.freeInstance()
