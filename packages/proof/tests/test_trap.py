"""Trapping sets against simulated flights, the engine's agent, and planted errors."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from rans_proof.proved import stated
from rans_proof.relaxation import TorchLayer
from rans_proof.trap import (
    Grid,
    Loop,
    Trap,
    Uncertainty,
    broken_flight,
    largest_start,
    trapping_set,
    velocity_loop,
    write_trap,
)
from rans_proof.verdicts import recorded

from rans.cli import main
from rans.fast.agent_files.agent import actor_bytes
from rans.policy.architecture import Architecture
from rans.pretrained import pretrained_folder
from rans.tasks.derived import layout
from rans.tasks.tracking import TrackVelocity
from tests.support.processes import ROOT
from tests.support.trap_flights import leaving, read_trap

from .planted import Change, forge

PRETRAINED = ROOT / "rans/data/pretrained/track-velocity-2d"
ARM = 0.2192031021678297
ALONG = np.array([[1, -1], [-1, 1], [1, 1], [-1, -1], [-1, 1], [1, -1], [-1, -1], [1, 1]])
POINTS = ARM * np.array([[1, 1], [1, 1], [-1, 1], [-1, 1], [-1, -1], [-1, -1], [1, -1], [1, -1]])
MASS, INERTIA, PERIOD = 5.32, 0.2045008, 0.2
STEP = 0.31 * PERIOD / INERTIA
LIMIT, SPIN = 0.12, 0.16


def braking() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Weights of an agent whose thrusters open against a velocity of more than 6 cm/s along them."""
    hidden = np.zeros((8, 8))
    hidden[:, :2] = -0.5 * ALONG
    hidden[:, 4:6] = 0.5 * ALONG
    head = np.zeros((16, 8))
    head[1::2] = 16.0 * np.eye(8)
    bias = np.zeros(16)
    bias[1::2] = -16.0 * np.tanh(0.06 * np.sqrt(2.0))
    return hidden, np.zeros(8), head, bias


@pytest.fixture(scope="module")
def files() -> dict[str, bytes]:
    """Files of that agent."""
    hidden, shift, head, bias = braking()
    tensors = {
        "features_extractor.trunk.0.weight": hidden,
        "features_extractor.trunk.0.bias": shift,
        "action_net.weight": head,
        "action_net.bias": bias,
        "features_extractor.mean": np.array([0, 0, 0, 2, 0, 0, 0, 0]),
        "features_extractor.variance": np.full(8, 1.0 - 1e-6),
        "features_extractor.count": np.ones(()),
    }
    architecture = Architecture(layout(TrackVelocity(), 2), 8, (8,))
    weights = {name: torch.tensor(x, dtype=torch.float32) for name, x in tensors.items()}
    config = {
        "task": "track-velocity",
        "spacecraft": "floating-platform",
        "ppo": {"layers": [8]},
        "timing": {"control_period": PERIOD},
    }
    return {
        "agent.safetensors": actor_bytes(architecture, weights, 0),
        "config.json": json.dumps(config).encode(),
        "spacecraft.toml": (ROOT / "rans/data/spacecraft/floating-platform.toml").read_bytes(),
    }


@pytest.fixture(scope="module")
def loop() -> Loop:
    """The closed loop of that agent."""
    hidden, shift, head, bias = (x.astype(np.float32).astype(float) for x in braking())
    to_rest = np.zeros((8, 3))
    to_rest[[0, 1, 2, 4, 5], [0, 1, 2, 0, 1]] = [1, 1, 1, -1, -1]
    layers = [
        TorchLayer(torch.tensor(hidden @ to_rest), torch.tensor(shift), "tanh"),
        TorchLayer(torch.tensor(head[1::2]), torch.tensor(bias[1::2]), ""),
    ]
    along = ALONG / np.sqrt(2.0)
    lever = np.sign(POINTS[:, 0] * along[:, 1] - POINTS[:, 1] * along[:, 0])
    return Loop(layers, along / MASS, lever, STEP, PERIOD)


@pytest.fixture(scope="module")
def trap(loop: Loop) -> Trap:
    return trapping_set(loop, LIMIT, SPIN, grid=Grid(12, 32, 4))


START = (0.049, 0.05)


@pytest.fixture
def table(trap: Trap, files: dict[str, bytes], tmp_path: Path) -> dict[str, Any]:
    write_trap(trap, SPIN, START, files, tmp_path / "trap.json")
    return json.loads((tmp_path / "trap.json").read_text())


def written(files: dict[str, bytes], folder: Path) -> Path:
    """A folder of an agent's files."""
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder


def check(table: dict[str, Any], files: dict[str, bytes]) -> None:
    pytest.importorskip("flint")
    from rans_proof.check_trap import check_trap
    from rans_proof.flown import check_as_flown

    content = json.dumps(table).encode()
    check_trap(content, files)
    check_as_flown(content, files)


def test_no_flight_leaves_its_cells(loop: Loop, trap: Trap) -> None:
    assert largest_start(trap, loop, 0.05) >= START[0]
    assert leaving(loop, trap, 10_000, 10, 0) == 0


def test_no_flight_leaves_with_uncertainty(loop: Loop) -> None:
    trap = trapping_set(
        loop, LIMIT, SPIN, Uncertainty(0.02, 0.03, 0.002, 0.01), grid=Grid(12, 32, 4)
    )
    assert largest_start(trap, loop, 0.03) > 0.0
    assert leaving(loop, trap, 10_000, 10, 1) == 0


def test_the_checker_accepts(table: dict[str, Any], files: dict[str, bytes]) -> None:
    check(table, files)


def _with_file(name: str, old: bytes, new: bytes) -> Callable[..., None]:
    def change(table: dict[str, Any], files: dict[str, bytes]) -> None:
        assert old in files[name]
        files[name] = files[name].replace(old, new, 1)
        if name in table["agent"]:
            table["agent"][name] = hashlib.sha256(files[name]).hexdigest()

    return change


def _bias(table: dict[str, Any], files: dict[str, bytes]) -> None:
    """The last bias a little larger, so that a thruster opens later."""
    content = files["agent.safetensors"]
    value = np.frombuffer(content[-4:], "<f4") - np.float32(1.0)
    files["agent.safetensors"] = content[:-4] + value.tobytes()
    table["agent"]["agent.safetensors"] = hashlib.sha256(files["agent.safetensors"]).hexdigest()


def _all(_: object) -> list[list[int]]:
    """Every cell of the grid, in blocks."""
    return [
        [ring, ring + 1, sector, sector + 8, layer, layer + 1]
        for ring in range(12)
        for sector in range(0, 32, 8)
        for layer in (-2, -1, 0, 1)
    ]


FORGED: dict[str, Change] = {
    "another network": lambda table, files: files.update({"agent.safetensors": b"x"}),
    "another craft": lambda table, files: files.update({"spacecraft.toml": b"mass = 1.0"}),
    "another bias": _bias,
    "heavier": _with_file("spacecraft.toml", b"mass = 5.32", b"mass = 2.66"),
    "less inertia": _with_file("spacecraft.toml", b"inertia = 0.2045008", b"inertia = 0.10"),
    "stronger": _with_file("spacecraft.toml", b"force = 1.0", b"force = 1.000001"),
    "turned": _with_file(
        "spacecraft.toml", b"direction = [1.0, -1.0]", b"direction = [1.0, -1.01]"
    ),
    "shared": _with_file("spacecraft.toml", b'sharing = "none"', b'sharing = "split"'),
    "longer period": _with_file("config.json", b"0.2", b"0.9"),
    "another task": _with_file("config.json", b"track-velocity", b"go-to-pose"),
    "a missing first cell": ("cells", lambda cells: cells[1:]),
    "missing cells": ("cells", lambda cells: cells[::2]),
    "a cell beyond": ("cells", lambda cells: [*cells, [0, 13, 0, 1, 0, 1]]),
    "an empty cell": ("cells", lambda cells: [*cells, [0, 0, 0, 1, 0, 1]]),
    "broken numbers": ("cells", lambda cells: [*cells, [0.5, 1, 0, 1, 0, 1]]),
    "every cell": ("cells", _all),
    "larger start": ("start.speed", 0.119),
    "start beyond": ("start.spin", 0.3),
    "lower speed": ("keep.speed", 0.06),
    "lower spin": ("keep.spin", 0.05),
    "finer steps": ("grid.fine", 3),
    "wrong readings": ("uncertainty.velocity", 0.05),
    "uncertain mass": ("uncertainty.mass", 0.5),
    "late thrusters": ("uncertainty.delay", 0.05),
    "later than a period": ("uncertainty.delay", 0.3),
    # Values that no proof has.
    "no cells": ("cells", []),
    "null cells": ("cells", None),
    "a short cell": ("cells", [[0, 1, 0, 1, 0]]),
    "a cell of texts": ("cells", [["0", 1, 0, 1, 0, 1]]),
    "a cell of truths": ("cells", [[False, True, 0, 1, 0, 1]]),
    "a start below 0": ("start.speed", -1),
    "a null start": ("start.speed", None),
    "a start of no number": ("start.spin", float("nan")),
    "a start above its limit": ("start.speed", 0.13),
    "no limit": ("keep.speed", float("inf")),
    "a limit of 0": ("keep.spin", 0),
    "a limit below 0": ("keep.speed", -1.0),
    "a limit of a text": ("keep.speed", "0.16"),
    "a huge whole number": ("keep.speed", 10**400),
    "many sectors": ("grid.sectors", 10**9),
    "many cells": ("grid.layers", 10**6),
    "no sector": ("grid.sectors", 0),
    "half a ring": ("grid.rings", 12.5),
    "a null grid": ("grid", None),
    "an error of 1": ("uncertainty.mass", 1.0),
    "an error below 0": ("uncertainty.thrust", -0.1),
    "an error that nobody checks": ("uncertainty.thrusters_lost", 0.9),
    "a limit that nobody checks": ("keep.position", 0.1),
    "a start that nobody checks": ("start.position", 5.0),
    "a grid that nobody checks": ("grid.offset", 1),
    "a word that nobody checks": ("judged", "true"),
    "another format": ("format", 99),
    "the format before": ("format", 1),
    "another property": ("property", "safe"),
    "no digest": lambda table, files: table["agent"].update({"config.json": 5}),
    "a file more": lambda table, files: table["agent"].update({"card.json": "0" * 64}),
}  # fmt: skip


@pytest.mark.parametrize("forged", FORGED)
def test_forged_certificates_are_refused(
    forged: str, table: dict[str, Any], files: dict[str, bytes]
) -> None:
    pytest.importorskip("flint")
    from rans_proof.balls import Refused

    changed = dict(files)
    forge(table, FORGED[forged], changed)
    with pytest.raises(Refused):
        check(table, changed)


@pytest.mark.parametrize("forged", ["no cells", "null cells", "many sectors", "a null start"])
def test_a_refusal_of_the_command_is_one_sentence(
    forged: str,
    table: dict[str, Any],
    files: dict[str, bytes],
    tmp_path: Path,
    told: Any,
) -> None:
    pytest.importorskip("flint")
    forge(table, FORGED[forged])
    folder = written(files, tmp_path / "agent")
    (tmp_path / "forged.json").write_text(json.dumps(table))
    text = told(f"prove {folder} --check {tmp_path}/forged.json")
    assert "Accepted" not in text
    assert "Error" not in text  # the name of an exception
    assert text.endswith(".")


def test_what_is_false_ends_with_a_flight(loop: Loop) -> None:
    """A limit below what a pulse leaves: 2 N for 0.2 s on 5.32 kg are 7.5 cm/s."""
    trap = trapping_set(loop, 0.07, SPIN, grid=Grid(8, 32, 4))
    assert not trap.contains(loop, 0.069, 0.05)
    weak = trapping_set(loop, 0.03, SPIN, grid=Grid(4, 32, 4))
    found = broken_flight(loop, (weak.speed, 0.01), (0.03, 0.05))
    assert found is not None
    assert found[2] > 0.01


def test_the_shipped_agents_loop_is_its_controller() -> None:
    """Commands of the loop are those of the agent for observations that the task makes."""
    from rans.evaluation.fly.agent import load_policy

    run = load_policy(PRETRAINED)
    loop = velocity_loop(run.network, run.craft, run.timing.control_period)
    random = np.random.default_rng(3)
    count = 400
    heading = random.uniform(-np.pi, np.pi, count)
    velocity = random.uniform(-0.1, 0.1, (count, 2))
    spin = random.uniform(-0.5, 0.5, count)
    c, s = np.cos(heading), np.sin(heading)
    in_w = np.column_stack(
        (c * velocity[:, 0] - s * velocity[:, 1], s * velocity[:, 0] + c * velocity[:, 1])
    )
    nothing = np.zeros((count, 2))
    observation = np.column_stack((c, s, in_w, spin, np.full(count, 2.0), -in_w, nothing))
    network = run.network
    commands = network.deterministic_action(
        torch.tensor(observation, dtype=torch.float32), network.initial_state(count)
    )[0]
    odds = loop.log_odds(velocity, spin)
    clear = np.abs(odds) > 1e-3
    assert clear.mean() > 0.95
    np.testing.assert_array_equal(commands.numpy()[clear] > 0.5, odds[clear] > 0)


@pytest.mark.parametrize("engine", ["fast", "drake"])
def test_the_shipped_agents_loop_flies_as_an_engine(engine: str) -> None:
    """Ten periods from a velocity and a spin, of which commands are in single precision."""
    if engine == "drake":
        pytest.importorskip("pydrake")
    import rans

    pilot = rans.load_agent("track-velocity-2d")
    run = pilot.run
    assert run is not None
    loop = velocity_loop(run.network, run.craft, run.timing.control_period)
    begin, spin = np.array([[0.13, 0.02]]), np.array([0.9])
    start = rans.state((0.0, 0.0), 0.0, begin[0].tolist(), float(spin[0]))
    states = pilot.fly(engine=engine, start=start, goal=rans.state((0.0, 0.0))).states  # type: ignore[arg-type]
    velocity = begin
    for period in range(1, 11):
        commands = (loop.log_odds(velocity, spin) > 0).astype(float)
        velocity, spin = loop.fly(velocity, spin, commands)
        speed = float(np.hypot(states.v.x[period, 0], states.v.y[period, 0]))  # type: ignore[index]
        assert np.linalg.norm(velocity) == pytest.approx(speed, abs=1e-6)
        assert spin[0] == pytest.approx(float(states.w[period, 0]), abs=1e-6)  # type: ignore[index]


@pytest.mark.slow
def test_what_is_false_is_flown_in_both_engines(capsys: pytest.CaptureFixture[str]) -> None:
    """A pulse makes 3.8 cm/s, so that a velocity above it cannot stay below."""
    pytest.importorskip("pydrake")
    limits: str = "--property speed=0.05,spin=0.5 --from speed=0.04,spin=0.2"
    assert main(f"prove pretrained:track-velocity-2d {limits}".split()) == 1
    reached = re.findall(
        r"reaches ([\d.]+) m/s and ([\d.]+) rad/s", " ".join(capsys.readouterr().out.split())
    )
    assert len(reached) == 3
    for speed, spin in reached:
        assert float(speed) > 0.05 or float(spin) > 0.5


def test_the_command_checks_an_agents_certificate(
    table: dict[str, Any],
    files: dict[str, bytes],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Refused for another agent, accepted for its own."""
    pytest.importorskip("flint")
    folder = written(files, tmp_path / "agent")
    file = tmp_path / "trap.json"
    assert main(f"prove pretrained:track-velocity-2d --check {file}".split()) == 1
    assert "another agent" in capsys.readouterr().out
    assert recorded(stated(file.read_bytes(), file)) == ""
    assert main(f"prove {folder} --check {file}".split()) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "Accepted" in text
    certificate = stated(file.read_bytes(), file)
    assert certificate.theorem in text
    assert recorded(certificate) == "checked"


@pytest.mark.parametrize(
    ("typed", "sentence"),
    [
        ("speed=0.16,spin=1.5", "name the --property"),
        ("speed=0.16 --from speed=0.1,spin=0.1", "--property takes"),
        ("speed=0.16,spin=1 --from speed=0.2,spin=0.1", "--from speed must be"),
        ("speed=1,spin=1 --from speed=x,spin=0.1", "--from takes"),
    ],
)
def test_a_wrong_property_is_a_sentence(typed: str, sentence: str, refused: Any) -> None:
    assert sentence in refused(f"prove pretrained:track-velocity-2d --property {typed}")


def test_what_can_be_proved_is_said_before_a_property_is_asked_for(refused: Any) -> None:
    for options in ("", "--property speed=0.16,spin=1.5 --from speed=0.1,spin=0.1"):
        text = refused(f"prove pretrained:go-to-pose-2d {options}")
        assert "go-to-pose" in text
        assert "velocities in the plane" in text
        assert "ONNX" in text


def test_a_theorem_has_every_number_of_its_certificate(table: dict[str, Any]) -> None:
    """With all digits: a rounded limit is another theorem."""
    table["start"] = {"speed": 0.0312345678, "spin": 0.0212345678}
    table["keep"] = {"speed": 0.1212345678, "spin": 0.1612345678}
    off = {"mass": 0.011, "thrust": 0.012, "velocity": 0.0013, "spin": 0.0014, "delay": 0.0015}
    table["uncertainty"] = off
    theorem = stated(json.dumps(table).encode(), "it").theorem
    numbers = set(map(float, re.findall(r"\d+\.\d+", theorem)))
    assert numbers == {*table["start"].values(), *table["keep"].values(), *off.values()}
    assert re.search("one constant delay.* all valves.* open and.* shut", theorem)


def test_late_thrusters_are_in_the_errors(loop: Loop, trap: Trap) -> None:
    """Flights whose thrusters are late stay in cells that are proved for that, and leave those that are not."""
    off = Uncertainty(delay=0.004)
    proved = trapping_set(loop, LIMIT, SPIN, off, grid=Grid(12, 32, 4), start=(0.03, 0.02))
    assert proved.contains(loop, 0.03, 0.02)
    assert leaving(loop, proved, 10_000, 5, 2) == 0
    assert broken_flight(loop, (LIMIT, SPIN), (0.03, 0.02), off) is None
    # Four of eight thrusters push along x with 2 sqrt(2) N in all, or turn it with 4 times 0.31 N m.
    assert loop.strongest() == pytest.approx((2.0 * np.sqrt(2.0) / MASS, 4.0 * 0.31 / INERTIA))
    # The count can fail: a reading that is off by as much as the dead band opens no thruster in time.
    assert leaving(loop, replace(trap, uncertainty=Uncertainty(velocity=0.06)), 10_000, 5, 3) > 0


def test_a_search_ends_when_a_start_is_lost(loop: Loop) -> None:
    off = Uncertainty(velocity=0.05)
    trap = trapping_set(loop, LIMIT, SPIN, off, grid=Grid(12, 32, 4), start=START)
    assert len(trap.cells) == 0


@pytest.mark.slow
def test_the_shipped_agent_stays_slow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The page's command with errors, at a coarser grid; a part of its certificate, and flights from its cells.

    The certificate lies where the command runs, and not in the package.
    """
    pytest.importorskip("flint")
    from rans_proof.check_trap import check_trap
    from rans_proof.trap_certificate import FILES

    from rans.evaluation.fly.agent import load_policy

    monkeypatch.chdir(tmp_path)
    limits: str = "--property speed=0.16,spin=1.52 --from speed=0.14,spin=0.15"
    off = "--off velocity=0.0001,delay=0.00002"
    assert main(f"prove track-velocity-2d {limits} {off}".split()) == 0
    assert "Proved" in capsys.readouterr().out
    (file,) = tmp_path.iterdir()
    assert file.name == "track-velocity-2d.certificate.json"
    assert not (pretrained_folder("track-velocity-2d") / "proof.json").exists()
    content = file.read_bytes()
    table = json.loads(content)
    some = np.random.default_rng(0).choice(len(table["cells"]), 20, replace=False).tolist()
    check_trap(content, {name: (PRETRAINED / name).read_bytes() for name in FILES}, some)
    run = load_policy(PRETRAINED)
    loop = velocity_loop(run.network, run.craft, run.timing.control_period)
    assert leaving(loop, read_trap(file), 10_000, 1, 0) == 0
