"""Agents to share: a run folder without what only training needs, and a card with what it is worth."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rans.errors import ConfigError
from rans.evaluation.fly.agent import load_agent
from rans.evaluation.fly.contestants import contestant, judged_separately
from rans.evaluation.fly.judge import flown
from rans.evaluation.fly.protocols import ProtocolName, fitting_protocols
from rans.evaluation.measure.aggregate import measure
from rans.fast.learn.config import to_table
from rans.fast.learn.run_folder import RunFolder
from rans.fast.policy import write_policy
from rans.fast.saved import read_policy
from rans.files import read_json, write_json, write_text
from rans.scenario import EVALUATION_SEED


def export(run: Path, folder: Path, episodes: int = 1024, seed: int = EVALUATION_SEED) -> dict[str, Any]:
    """Write policy.zip, config.json, spacecraft.toml and card.json of a run into a folder of its own.

    The archive is written anew, so that nothing which was hidden in the run's is handed on, and without what
    only training needs.

    `load_agent` and ``stable_baselines3.PPO.load`` open it as they open the run. The folder's name is the
    agent's. For the card, which is returned, so many episodes are flown from starts of the seed under each of
    `fitting_protocols` and, by a multi-task agent, with each of its tasks.

    Raises:
        ConfigError: the run holds no agent, the folder is the run, or the disk refused.
    """
    if folder.resolve() == run.resolve():
        raise ConfigError(f"{folder} is the run itself: export it into another folder.")
    load_agent(run)  # says what is wrong with it, if anything
    source, target = RunFolder(run), RunFolder(folder)
    craft, config, training = source.spacecraft(), source.config(), _training(source)
    saved = read_policy(source.policy_file, craft, config.settings)
    network = saved.network
    write_policy(target.policy_file, network.architecture, network.member(0), config.ppo, saved.steps)
    write_json(target.config_file, to_table(config) | {"spacecraft": craft.name})
    write_text(target.spacecraft_file, source.spacecraft_file.read_text("utf-8"))
    evaluations = {protocol: _judged(str(folder), protocol, episodes, seed)
                   for protocol in fitting_protocols(craft)}
    card = {"name": folder.resolve().name, "task": config.task, "spacecraft": craft.name,
            "training": training, "episodes": episodes, "evaluation_seed": seed,
            "evaluation": evaluations, "date": datetime.now(UTC).date().isoformat()}
    write_json(folder / "card.json", card)
    return card


def _judged(spec: str, protocol: ProtocolName, episodes: int, seed: int) -> dict[str, Any]:
    """By the task's name, "" unless there are several: value, 95 % interval and unit of every metric."""
    found = {}
    for one in judged_separately(spec):
        run = contestant(one, protocol)
        rows = measure(flown(run.controller, run.judged, seed, episodes).flight).rows
        found[one.removeprefix(spec).removeprefix("#")] = {
            r.name: [*(float(f"{x:.5g}") for x in (r.value, r.low, r.high)), r.unit] for r in rows}
    return found


def _training(run: RunFolder) -> dict[str, Any]:
    """How the agent came to be."""
    rows, config = run.metrics(), run.config()
    if not rows:
        raise ConfigError(f"{run.path} has no metrics.jsonl, so that a card could not say how the agent was "
                          "trained: export the run itself.")
    about = read_json(run.config_file).get("about", {})
    return {"seed": config.seed, "steps": rows[-1]["steps"], "seconds": rows[-1]["seconds"],
            "device": config.device, "environment": about.get("environment", {})}
