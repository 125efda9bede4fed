"""Policies of other libraries, as ONNX, exported like agents: with contract, watchdogs, golden pairs and card."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from rans.deploy.c.compiler import stack_of
from rans.deploy.c.files import write_c
from rans.deploy.contract import (
    FLIGHTS,
    PAIRED,
    RecordedFlights,
    contract,
    flights_of_policy,
    golden_of_policy,
)
from rans.deploy.export import check_alone, evaluated
from rans.deploy.forms import FORMATS
from rans.deploy.margins import measure_margins
from rans.deploy.numpy_file import write_numpy
from rans.deploy.onnx_file import write_onnx
from rans.deploy.program import Ports
from rans.evaluation.fly.exported import code_of
from rans.evaluation.fly.protocols import fitting_protocols
from rans.extend import (
    EVALUATION_SEED,
    ConfigError,
    ContestantName,
    LoadedRun,
    Program,
    Setup,
    TrainConfig,
    brief,
    contestant,
    map_leaves,
    to_toml,
    write_json,
    write_text,
)
from rans.files import plain
from rans.tasks import registered_name
from rans.tasks.derived import observation_width
from rans_robot.foreign.program import foreign_program

ForeignForm = Literal["onnx", "numpy", "c"]
_FLIGHTS_FOR_A_FLIGHT = 512
"""Flights of which the ranges of a network are taken that is exported to be flown at once."""
_SUMMARY = (
    "not known: another library trained this policy. Ranges and margins are those of flights with everything as "
    "designed"
)


class _Exported(NamedTuple):
    """What the files of a policy are made of."""

    run: LoadedRun
    program: Program
    ports: Ports
    flights: RecordedFlights
    pairs: dict[str, Any]
    about: dict[str, Any]
    title: str


def write_foreign_export(
    spec: str,
    folder: Path,
    form: str = "c",
    episodes: int = 1024,
    seed: int = EVALUATION_SEED,
    margins: int = 256,
) -> dict[str, Any]:
    """Write a policy "onnx:FILE:TASK-2d@SPACECRAFT" into a folder of its own, and return its card.

    The network is exported as it is: observations and commands are those that `rans evaluate` flies. Files,
    contract, golden pairs and card are those of `rans.deploy.export.write_export`.

    Args:
        spec: the policy's text, with its task.
        folder: folder to write, whose name becomes the policy's.
        form: "c", "numpy", "onnx", or one of `FORMATS`.
        episodes: flights for the card under each protocol.
        seed: of their starts.
        margins: flights of each latency, mass and sensor noise; 0: none.

    Raises:
        ConfigError: the file cannot be exported (`rans_robot.foreign.program.foreign_program`), its network does
            not fit the task and the spacecraft, or the disk refuses.
    """
    known = (*get_args(ForeignForm), *FORMATS)
    if form not in known:
        raise ConfigError(
            f"{brief(spec)} can be exported as {', '.join(known)}, not as {form}: rans and sb3 are "
            "formats of agents that RANS trained."
        )
    exported = _exported(spec, folder.resolve().name, FLIGHTS, margins)
    text = json.dumps(exported.pairs) + "\n"
    check_alone(folder, form, text)
    about = exported.about
    described = json.dumps(plain(about))
    # The form, then what stands beside it in every form.
    if form == "onnx":
        what = {"what": exported.title, "contract": described}
        write_onnx(folder / "agent.onnx", exported.program, exported.ports, what)
    elif form == "numpy":
        write_numpy(folder, exported.program, exported.ports, exported.title)
    elif form == "c":
        write_c(folder, exported.program, exported.ports, exported.title, described, exported.pairs)
    else:
        own = Setup(exported.run.craft, exported.run.task, exported.run.timing)
        parts = exported.program, exported.ports, exported.title, described, exported.pairs
        FORMATS[form](folder, *parts, own)
    _write_beside(exported, folder, text)
    # The card, which says that nothing is known of the training.
    run = exported.run
    card = {
        "name": about["agent"],
        "task": about["task"],
        "spacecraft": run.craft.name,
        "training": None,
        "source": Path(spec.removeprefix("onnx:")).name.partition(":")[0],
    }
    card |= evaluated(spec, fitting_protocols(run.craft), episodes, seed)
    write_json(folder / "card.json", card)
    return card


def export_foreign_for_flight(spec: str, folder: Path) -> None:
    """Write what a node flies of a policy of another library: NumPy, contract and golden pairs, without a card.

    Raises:
        ConfigError: see `write_foreign_export`.
    """
    label = Path(spec).name.partition(":")[0]
    exported = _exported(spec, label, _FLIGHTS_FOR_A_FLIGHT, margins=0)
    write_numpy(folder, exported.program, exported.ports, exported.title)
    _write_beside(exported, folder, json.dumps(exported.pairs) + "\n")


def _exported(spec: str, label: str, count: int, margins: int) -> _Exported:
    """Program, flights, golden pairs and contract of a policy; the program is compared with the flights first."""
    name = ContestantName.parse(spec)
    run = contestant(spec)
    file = name.policy_file
    if file is None or not name.name.startswith("onnx:"):
        raise ConfigError(
            f"{brief(spec)} is no ONNX network, and an export needs the operations of one. Let its own library "
            "write ONNX, as examples/trainers do by --save FILE, and export onnx:FILE:TASK-2d."
        )
    width = observation_width(run.task, run.craft.dimension)
    ports = Ports(width, run.craft.command_count)
    program = foreign_program(file, width, run.craft)
    # Flights with everything as designed: nothing is known of a training.
    setup = Setup(run.craft, run.task, run.timing)
    flights = flights_of_policy(run.controller, setup, count=count)
    few = RecordedFlights(*map_leaves(lambda x: x[:, :PAIRED], tuple(flights)))
    pairs = golden_of_policy(run.controller, few, run.craft, run.task)
    _check(program, ports, pairs, file)
    measured = measure_margins(run.controller, setup, margins) if margins else None
    task = registered_name(run.task) or name.setup.partition("@")[0]
    config = TrainConfig(task, run.task, run.craft.name, timing=run.timing)
    text = to_toml(run.craft)
    about = contract(label, config, run.craft, text, 0, flights.observations, measured)
    about["conditions"]["summary"] = _SUMMARY
    title = f"{label}: flies {run.craft.name} by RANS's task {task}, of the network {file.name}."
    return _Exported(run, program, ports, flights, pairs, about, title)


def _check(program: Program, ports: Ports, pairs: dict[str, Any], file: Path) -> None:
    """Refuse (`ConfigError`) a program whose commands, as printed for NumPy, are not those of ONNX Runtime.

    Nothing has been written by then but into a temporary folder.
    """
    with tempfile.TemporaryDirectory() as folder:
        write_numpy(Path(folder), program, ports, "check")
        agent = code_of(Path(folder) / "agent.py").Agent()
    observations = np.array(pairs["observation"], np.float32)
    agent.reset(len(observations))
    off = np.abs(agent.act(observations) - np.array(pairs["command"])).max()
    if not off <= pairs["tolerance"]:
        raise ConfigError(
            f"{file} cannot be exported: its operations as printed differ by {off:.3g} from what ONNX Runtime "
            "answers. The usual cause is a network that needs double precision."
        )


def _write_beside(exported: _Exported, folder: Path, pairs: str) -> None:
    """Spacecraft, contract and golden pairs."""
    about = dict(exported.about)
    if stack := stack_of(folder):
        about["c"] = {"stack": stack, "meaning": "bytes of stack that agent.c needs (agent.h)"}
    write_text(folder / "spacecraft.toml", to_toml(exported.run.craft))
    write_json(folder / "contract.json", about)
    write_text(folder / "golden.json", pairs)
