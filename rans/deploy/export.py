"""Agents to share: in a form that flies, with a contract to fly them by and a card of what they are worth.

Forms differ in files alone: contract, golden pairs and card are those of the same flights.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

from rans.base.errors import ConfigError, one_line
from rans.base.files import (
    environment,
    inside,
    plain,
    read_text,
    replace_file,
    write_json,
    write_text,
)
from rans.base.registry import Registry
from rans.base.structure import LARGEST_TOML
from rans.deploy.contract import (
    FLIGHTS,
    contract,
    flights_of_training,
    golden,
)
from rans.deploy.forms import FORMATS
from rans.deploy.program import Ports, agent_program
from rans.episode.scenario import EVALUATION_SEED
from rans.episode.step import Setup
from rans.evaluation.fly.agent import Agent, load_policy
from rans.evaluation.fly.contestants import contestant, judged_separately
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.fly.evidence import about as made
from rans.evaluation.fly.protocols import ProtocolName, fitting_protocols
from rans.evaluation.measure.aggregate import measure
from rans.fast.agent_files.agent import AGENT, SavedPolicy, actor_bytes, read_policy
from rans.fast.learn.config import to_table
from rans.fast.learn.run_folder import RunFolder, solved_percent
from rans.model.spacecraft import Spacecraft


class Exporter(Protocol):
    """Writes contestants of a kind as exports; see `write_export` for the arguments and what is written."""

    def __call__(
        self,
        spec: str,
        folder: Path,
        form: str = ...,
        episodes: int = ...,
        *,
        name: str = ...,
    ) -> dict[str, Any]:
        """Write the contestant that a text names into a folder, and return its card."""
        ...


EXPORTERS: Registry[Exporter] = Registry("export of a", "rans.exporters")
"""What installed packages export beside agents of RANS: by `ContestantName.kind`, and spacecraft."""

OWN = "rans"
"""Form that is the agent's own weights and config; `FORMATS` are printed from its program."""


def write_export(
    run: Path,
    folder: Path,
    form: str = OWN,
    episodes: int = 1024,
    least: float = 0.0,
    prefix: str = "",
    spec: str = "",
    name: str = "",
) -> dict[str, Any]:
    """Write an agent into a folder of its own, to fly it here or elsewhere, and return its card.

    "rans": agent.safetensors, without the critic, and config.json, which `load_agent` opens; "onnx":
    agent.onnx, for any runtime; "numpy": agent.py and agent.npz, which need NumPy only; others are of packages.
    Beside them spacecraft.toml, contract.json (`rans.deploy.contract`), golden.json and card.json, the same for
    every form, so that several may share a folder. Without a name an agent that was exported before keeps its own;
    a trained one has that of the folder. Everything is written anew: nothing that was hidden in the run's files is
    handed on.

    For the card so many episodes are flown under each of `fitting_protocols` and, by
    a multi-task agent, with each of its tasks; 0: there is no card. An agent that was exported before keeps its
    card. The prefix is that of a `Format` which takes one, and the spec the contestant's text, of which the
    contract's evidence is.

    Raises:
        ConfigError: the run holds no agent, the folder is a run or another agent's, a package is missing, or
            the disk refused; or less than ``least`` percent of the flights of the card are solved.
    """
    if folder.resolve() == run.resolve():
        raise ConfigError(f"{folder} is the run itself: export it into another folder.")
    loaded = load_policy(run)  # says what is wrong with it, if anything
    source = RunFolder(run)
    target = RunFolder(folder)
    # An agent that was exported before, or comes with RANS, keeps its card, whose keys others read.
    known = {} if source.metrics_file.exists() else source.card()
    name = name or known.get("name", "") or folder.resolve().name
    name = one_line("the name of an agent", name)
    craft = source.spacecraft()
    # What the agent is, and what it does on flights of its training.
    config = source.config()
    card: dict[str, Any] = {}
    if episodes:
        known = known or {"training": source.training()}
        if known == {"training": {}}:
            raise ConfigError(
                f"{run} has no rows of metrics.jsonl and no card, so that a card could not say how the agent was "
                "trained: export the run itself."
            )
        own = {"name": name, "task": config.task, "spacecraft": craft.name}
        card = own | known | own
    saved = read_policy(source.agent_file)
    reduced = None if form == OWN else FORMATS[form].reduced
    if reduced is not None:
        # From here on this is the agent: golden pairs are its own.
        saved = saved._replace(network=reduced(saved.network))
        loaded = loaded._replace(controller=Agent(saved.network, loaded.controller.name, craft))
    network = saved.network
    text = read_text(source.spacecraft_file, LARGEST_TOML)
    setup = Setup(craft, config.settings, config.timing, config.conditions.or_none)
    flights = flights_of_training(loaded.controller, setup, count=FLIGHTS)
    chosen = golden(network, flights, craft, config.settings)
    pairs = json.dumps(chosen) + "\n"
    # Its contract, and what the conditions of a flight may be.
    check_alone(folder, form, pairs)
    if episodes and "evaluation" not in card:
        card |= evaluated(str(run), fitting_protocols(craft), episodes, EVALUATION_SEED)
    if (percent := solved_percent(card)) < least:
        raise ConfigError(
            f"{percent:.3g} % of the flights of {name} are solved, and an agent that loses half of them is not "
            "exported without --force (force=True): rans evaluate says how it fails, and rans train makes another."
        )
    about = contract(
        name,
        config,
        craft,
        text,
        network.architecture.memory,
        flights.observations,
    )
    # Files: the agent in its form, then those of every form.
    write_agent(
        folder,
        form,
        saved,
        f"{name}: flies {craft.name} by RANS's task {config.task}.",
        json.dumps(plain(about)),
        craft,
        chosen,
        prefix,
    )
    if form == OWN:
        own = {"spacecraft": craft.name, "rans": about["rans"]}
        write_json(target.config_file, to_table(config) | own)
    write_text(target.spacecraft_file, text)
    about["about"] = made(spec or str(run), setup, "rans.export")
    if stack := stack_of(folder):
        about["c"] = {"stack": stack, "meaning": "bytes of stack that agent.c needs (agent.h)"}
    write_json(folder / "contract.json", about)
    write_text(folder / "golden.json", pairs)
    if card:
        write_json(folder / "card.json", card)
    return card


def stack_of(folder: Path) -> int | None:
    """Bytes of stack that agent.h in a folder states; None: there is none, or no compiler measured it."""
    file = folder / "agent.h"
    line = re.search(r"^#define \w+_STACK (\d+)", read_text(file), re.M) if file.exists() else None
    return int(line[1]) if line else None


def check_alone(folder: Path, form: str, pairs: str) -> None:
    """Refuse to lay an agent's contract and golden pairs beside files that are another agent's."""
    if RunFolder(folder).metrics_file.exists():
        raise ConfigError(f"{folder} is the run folder of a training: export into another folder.")
    own = (AGENT, "config.json") if form == OWN else FORMATS[form].files
    agents = sorted(file.name for file in folder.glob("agent[._]*"))
    others = [
        name
        for name in ("config.json", *agents)
        if name not in own and not name.endswith(f".{form}") and (folder / name).exists()
    ]
    file = inside(folder, "golden.json")
    if others and not (file.exists() and read_text(file) == pairs):
        raise ConfigError(
            f"{folder} holds another agent's {' and '.join(others)}, to which this one's "
            "contract and golden pairs would not apply: export into another folder, or delete "
            "them."
        )


def write_agent(
    folder: Path,
    form: str,
    saved: SavedPolicy,
    title: str,
    contract: str = "",
    craft: Spacecraft | None = None,
    pairs: dict[str, Any] | None = None,
    prefix: str = "",
) -> None:
    """The agent alone, in a form of `write_export`.

    Only programs give commands in the craft's ranges: its own form holds a policy, whose outputs are 0 to 1.
    """
    network = saved.network
    if form != OWN:
        write = FORMATS[form].write
        ports = Ports.of(network.architecture)
        more = {"prefix": prefix} if prefix else {}
        write(folder, agent_program(network, craft), ports, title, contract, pairs, **more)
    else:
        content = actor_bytes(network.architecture, network.weights(), saved.steps)
        replace_file(folder / AGENT, lambda draft: draft.write_bytes(content))


def evaluated(
    spec: str, protocols: Iterable[ProtocolName], episodes: int, seed: int
) -> dict[str, Any]:
    """What a card says of an agent's flights: their number and seed, the figures, and what made these, when.

    Keys of cards are an interface; `_judged` says what stands under each protocol.
    """
    return {
        "episodes": episodes,
        "evaluation_seed": seed,
        "date": datetime.now(UTC).date().isoformat(),
        "evaluation_environment": environment(),
        "evaluation": {protocol: _judged(spec, protocol, episodes, seed) for protocol in protocols},
    }


def _judged(spec: str, protocol: ProtocolName, episodes: int, seed: int) -> dict[str, Any]:
    """[value, low, high, unit] of every metric, with its 95 % interval, by the task's name ("" if there is one).

    Cards of agents have it as it is (`card.json`), and pages and tests read it from there.
    """
    result = {}
    for judged in judged_separately(spec):
        run = contestant(judged, protocol)
        rows = measure(fly_episodes(run.controller, run.judged, seed, episodes)).rows
        result[str(judged).removeprefix(spec).removeprefix("#")] = {
            r.name: [*(float(f"{x:.5g}") for x in (r.value, r.low, r.high)), r.unit] for r in rows
        }
    return result
