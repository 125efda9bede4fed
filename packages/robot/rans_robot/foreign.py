"""Policies of other libraries, as ONNX, with contract, golden pairs and card, as agents of RANS are exported."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from rans.deploy.contract import (
    PAIRED,
    RecordedFlights,
    contract,
    flights_of_training,
    golden_pairs,
)
from rans.deploy.export import check_alone, evaluated
from rans.evaluation.fly.protocols import fitting_protocols
from rans.extend import (
    EVALUATION_SEED,
    ConfigError,
    ContestantName,
    LoadedRun,
    Setup,
    Task,
    TrainConfig,
    brief,
    contestant,
    observation_width,
    read_bytes,
    replace_file,
    to_toml,
    write_json,
    write_text,
)
from rans.tasks import registered_name

_LARGEST = 2**26
"""Bytes of an ONNX file that is copied; networks in control have less than a thousandth of it."""
_SUMMARY = (
    "not known: another library trained this policy. Ranges are those of flights with everything as "
    "designed"
)


def write_foreign_export(
    spec: str,
    folder: Path,
    form: str = "onnx",
    episodes: int = 1024,
    *,
    name: str = "",
) -> dict[str, Any]:
    """Write a policy "onnx:FILE:TASK-2d@SPACECRAFT" into a folder of its own, and return its card.

    The network is copied as it is: observations and commands are those that `rans evaluate` flies. Contract, golden
    pairs and card are those of `rans.deploy.export.write_export`.

    Args:
        spec: the policy's text, with its task.
        folder: folder to write.
        form: "onnx".
        episodes: flights for the card under each protocol; 0: no card is made.
        name: of the policy; "": that of the folder.

    Raises:
        ConfigError: it is no ONNX file, it has a memory, it does not fit the task and the spacecraft, or the disk
            refuses.
    """
    if form != "onnx":
        raise ConfigError(
            f"{brief(spec)} is exported as onnx, with its contract, and not as {form}: other formats are printed "
            "from the networks of agents that RANS trained."
        )
    parsed = ContestantName.parse(spec)
    file = parsed.policy_file
    if file is None or not parsed.name.startswith("onnx:"):
        raise ConfigError(
            f"{brief(spec)} is no ONNX network, which alone is exported. Let its own library write ONNX, as "
            "examples/trainers do by --save FILE, and export onnx:FILE:TASK-2d."
        )
    run = contestant(spec)
    policy: Any = run.controller
    width = observation_width(run.task, run.craft.dimension)
    if policy.decide(np.zeros((1, width), np.float32), None)[1] is not None:
        raise ConfigError(
            f"{file} has a memory: exported is a network of one input, the observation."
        )
    network = read_bytes(file, _LARGEST)
    # Flights with everything as designed: nothing is known of a training.
    setup = Setup(run.craft, run.task, run.timing)
    flights = flights_of_training(run.controller, setup)
    pairs = json.dumps(_golden(run, flights.of(slice(PAIRED)))) + "\n"
    check_alone(folder, form, pairs)
    name = name or folder.resolve().name
    config = TrainConfig(task_name(parsed, run.task), run.task, run.craft.name, timing=run.timing)
    text = to_toml(run.craft)
    about = contract(name, config, run.craft, text, 0, flights.observations)
    about["conditions"]["summary"] = _SUMMARY
    # The network and what stands beside it.
    folder.mkdir(parents=True, exist_ok=True)
    replace_file(folder / "agent.onnx", lambda draft: draft.write_bytes(network))
    write_text(folder / "spacecraft.toml", text)
    write_json(folder / "contract.json", about)
    write_text(folder / "golden.json", pairs)
    if not episodes:
        return {}
    # The card, which says that nothing is known of the training.
    card = {
        "name": name,
        "task": about["task"],
        "spacecraft": run.craft.name,
        "training": None,
        "source": Path(spec.removeprefix("onnx:")).name.partition(":")[0],
    }
    card |= evaluated(spec, fitting_protocols(run.craft), episodes, EVALUATION_SEED)
    write_json(folder / "card.json", card)
    return card


def task_name(name: ContestantName, task: Task) -> str:
    """Name of the task of a policy: a registered one, or where its code is, as the policy's text says."""
    return registered_name(task) or name.setup.partition("@")[0]


def _golden(run: LoadedRun, flights: RecordedFlights) -> dict[str, Any]:
    """Golden pairs of a policy that answers every observation by itself.

    Those flights are taken whose commands change least, and on/off commands not at all, where the observations
    change by a hundred times their rounding.
    """
    seen = flights.observations

    def answers(observations: np.ndarray) -> np.ndarray:
        rows = np.ascontiguousarray(observations.reshape(-1, seen.shape[-1]), dtype=np.float32)
        return run.controller.act(None, None, rows).reshape(*seen.shape[:2], -1)

    commands = answers(seen)
    changes = [
        np.abs(answers(seen * factor) - commands).max(axis=(0, 2)) for factor in (0.99999, 1.00001)
    ]
    order = np.argsort(np.maximum(*changes), kind="stable")
    return golden_pairs(
        seen, commands, order, run.craft.is_continuous, flights, run.craft, run.task
    )
