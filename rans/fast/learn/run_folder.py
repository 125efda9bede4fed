"""Run folder of a training on disk; its files are complete at every moment."""

from __future__ import annotations

import hashlib
import json
import warnings
from pathlib import Path
from typing import Any

from rans.base import files
from rans.base.errors import ConfigError, RansWarning, brief, is_finite, meant_file, one_line, whole
from rans.base.pretrained import FOR_ANY_CRAFT
from rans.fast.agent_files.agent import AGENT
from rans.fast.agent_files.tensors import pack_tensors, unpack_tensors
from rans.fast.learn.config import TrainConfig, from_table, to_table
from rans.model.foreign import is_foreign
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import read_spacecraft, spacecraft_text

CHECKPOINT = "checkpoint.safetensors"
"""File from which a training resumes."""
FLY = "fly.html"
"""Page in which the agent flies in a browser."""
EVENTS = "tensorboard"
"""Folder of events for TensorBoard."""
_LARGEST_CHECKPOINT = 2**33
"""Size limit, bytes: several times that of a million environments."""
_COUNTS = "steps", "seconds", "success"
"""Keys in every row of metrics, besides those of the task."""


class RunFolder:
    """Names and formats of the files of one training.

    ``config.json`` repeats it, ``spacecraft.toml`` is the spacecraft at its start, ``metrics.jsonl`` has one
    row per report, ``checkpoint.safetensors`` resumes it, ``agent.safetensors`` is the agent with its critic,
    ``nonfinite.safetensors`` what a training was in which a number became NaN;
    that of an exported agent has no critic. Opening these files executes no code from them
    (docs/decisions/software.md).

    Args:
        path: the folder; need not exist.

    Raises:
        ConfigError: one of these files is a symbolic link, see `rans.base.files.inside`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.config_file = files.inside(path, "config.json")
        self.spacecraft_file = files.inside(path, "spacecraft.toml")
        self.metrics_file = files.inside(path, "metrics.jsonl")
        self.checkpoint_file = files.inside(path, CHECKPOINT)
        self.agent_file = files.inside(path, AGENT)
        self.nonfinite_file = files.inside(path, "nonfinite.safetensors")
        self.card_file = files.inside(path, "card.json")
        self._files = (
            self.config_file,
            self.spacecraft_file,
            self.metrics_file,
            self.checkpoint_file,
            self.agent_file,
        )
        self._lock = files.Lock(files.inside(path, files.LOCK))

    def begin(self, config: TrainConfig, command: str, craft: str = "") -> None:
        """Write config and spacecraft before training.

        If two processes begin at once, one writes all files and the other raises.

        Args:
            config: training config.
            command: recorded in ``config.json``.
            craft: TOML text of the spacecraft; empty: the spacecraft that the config names.

        Raises:
            ConfigError: the folder contains another training.
        """
        text = craft or spacecraft_text(config.spacecraft)
        self._check_new(text)  # a folder that is refused stays as it is, without a lock file
        held_before = self._lock.is_held
        self.lock()
        try:
            self._check_new(text)  # another process may have begun in between
            files.write_text(self.spacecraft_file, text)
            about: dict[str, Any] = {"command": command, "environment": files.environment()}
            about["spacecraft"] = self._craft_hash()
            agent = (config.begin_from or "").removeprefix("pretrained:")
            if agent.startswith(tuple(FOR_ANY_CRAFT.values())):
                about["method"] = f"imitation of {agent}, then {config.algorithm}"
            files.write_json(self.config_file, to_table(config) | {"about": about})
        finally:
            if not held_before:
                self.release()

    def check_unused(self) -> None:
        """Refuse (`ConfigError`) a folder in which a training has begun, or with a file that it would write."""
        if self.config_file.exists():
            raise ConfigError(
                f"{self.path} holds a training already; continue it with --resume {self.path}, or "
                "choose another folder with --output."
            )
        written = (
            *self._files,
            self.nonfinite_file,
            files.inside(self.path, FLY),
            self.path / EVENTS,
        )
        if there := [
            file.name for file in written if file.exists() and file != self.spacecraft_file
        ]:
            raise ConfigError(
                f"{self.path} has {', '.join(there)} already, which the training would write: choose another "
                "folder with --output."
            )

    def _check_new(self, spacecraft: str) -> None:
        self.check_unused()
        if self.spacecraft_file.exists() and files.read_text(self.spacecraft_file) != spacecraft:
            raise ConfigError(
                f"{self.spacecraft_file} is a file already, and of another spacecraft than the "
                "one to be trained; choose another folder with --output."
            )

    def lock(self) -> None:
        """Lock the folder until `release`; ConfigError if another process trains in it.

        Drafts of files that a training killed before has left are removed, as nobody else writes these.
        """
        self._lock.take(
            f"{self.path} is being trained by another process; wait for its end, or stop it."
        )
        for file in self._files:
            files.clear_drafts(file, abandoned=0.0)

    def release(self) -> None:
        """Unlock the folder."""
        self._lock.release()

    def config(self) -> TrainConfig:
        """Training config; ConfigError if the folder has none, or one of another version."""
        if not self.config_file.exists():
            why = f"there is nothing of that name{meant_file(self.path)}"
            if self.path.is_file() and (self.path.parent / "config.json").exists():
                why = f"it is a file of one; name its folder, {self.path.parent}"
            elif self.path.suffix in (".zip", ".onnx"):
                kind = "sb3" if self.path.suffix == ".zip" else "onnx"
                why = f"a policy of another library has a task in its name, {kind}:{self.path}:TASK-2d"
            elif self.path.is_file() and is_foreign(self.path):
                toml = self.path.with_suffix(".toml").name
                why = f"`rans init {toml} --from {self.path}` makes a spacecraft of the file"
            elif self.path.exists():
                within = files.folders_with(self.path, ("config.json",))
                why = f"it has no config.json{within}"
            raise ConfigError(f"{self.path} is not a run folder: {why}.")
        return read_config(self.config_file)

    def extend(self, config: TrainConfig, command: str) -> None:
        """Replace the config of a training that goes on for longer; its ``about`` names the command too."""
        with files.reading(self.config_file) as table:
            about = table.get("about", {})
            about["continued"] = [*about.get("continued", []), command]
        files.write_json(self.config_file, to_table(config) | {"about": about})

    def spacecraft(self) -> Spacecraft:
        """Spacecraft at the start of training, independent of later changes to its file."""
        if not self.spacecraft_file.exists():
            raise ConfigError(
                f"{self.path} lacks its spacecraft.toml: copy the whole folder again."
            )
        craft = read_spacecraft(self.spacecraft_file)
        if self.config_file.exists():
            with files.reading(self.config_file) as table:
                before = table.get("about", {}).get("spacecraft", "")
            if before and before != self._craft_hash():
                warnings.warn(
                    f"{self.spacecraft_file} is not the file of the training: figures are those of the agent on "
                    "another spacecraft.",
                    RansWarning,
                    stacklevel=2,
                )
        return craft

    def _craft_hash(self) -> str:
        return hashlib.sha256(files.read_text(self.spacecraft_file).encode()).hexdigest()

    def append_metrics(self, row: dict[str, Any]) -> None:
        """Add one row to ``metrics.jsonl``; ConfigError if it cannot be written."""
        files.append_text(self.metrics_file, json.dumps(row) + "\n")

    def metrics(self) -> list[dict[str, Any]]:
        """Rows of metrics so far, without an incompletely written last row.

        Raises:
            ConfigError: a row lacks one of its numbers.
        """
        rows = files.read_json_lines(self.metrics_file) if self.metrics_file.exists() else []
        for line, row in enumerate(rows, 1):
            wrong = [key for key in (*_COUNTS, *row) if not isinstance(row.get(key), int | float)]
            if wrong:
                raise ConfigError(
                    f"{self.metrics_file} is damaged: line {line} has no number of "
                    f"{brief(wrong[0])}."
                )
        return rows

    def card(self) -> dict[str, Any]:
        """Card of an agent that was exported (`rans.deploy.export`); empty: it has none.

        Raises:
            ConfigError: it is damaged.
        """
        if not self.card_file.exists():
            return {}
        with files.reading(self.card_file) as card:
            one_line(f"name in {self.card_file}", card.get("name", self.path.name))
            if (training := card["training"]) is not None:
                one_line(f"device in {self.card_file}", training["device"])
                if not (is_finite(training["steps"]) and is_finite(training["seconds"])):
                    raise ConfigError(f"{self.card_file} has no numbers of steps and seconds.")
            if "evaluation" in card:
                whole(f"episodes in {self.card_file}", card["episodes"])
                solved_percent(card)
            return card

    def training(self) -> dict[str, Any]:
        """Training of an agent, as its card has it: seed, steps, time, device and versions; empty: not known.

        Keys are those of cards, which exports of exports take over.
        """
        if not (rows := self.metrics()):
            return self.card().get("training") or {}  # null: of another library
        config = self.config()
        with files.reading(self.config_file) as table:
            versions = table.get("about", {}).get("environment", {})
        return {
            "seed": config.seed,
            "steps": rows[-1]["steps"],
            "seconds": rows[-1]["seconds"],
            "device": config.device,
            "environment": versions,
        }

    def forget_after(self, steps: int) -> None:
        """Delete metrics after this step, which a resumed training will repeat."""
        rows = [row for row in self.metrics() if row["steps"] <= steps]
        files.write_text(self.metrics_file, "".join(json.dumps(row) + "\n" for row in rows))

    def save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Write a checkpoint; on failure the previous one is kept."""
        content = pack_tensors(checkpoint)
        files.replace_file(self.checkpoint_file, lambda draft: draft.write_bytes(content))

    @property
    def has_checkpoint(self) -> bool:
        """Whether a checkpoint exists."""
        return self.checkpoint_file.exists()

    def load_checkpoint(self, device: str) -> dict[str, Any]:
        """Latest checkpoint; ConfigError if it cannot be read or is damaged."""
        content = files.read_bytes(self.checkpoint_file, _LARGEST_CHECKPOINT)
        return unpack_tensors(content, self.checkpoint_file, device)


def solved_percent(card: dict[str, Any]) -> float:
    """Solved flights of a card, %, of the worst of an agent's tasks in its own conditions."""
    by_task = card.get("evaluation", {}).get("own", {})
    return min((float(figures["solved"][0]) for figures in by_task.values()), default=100.0)


def read_config(file: Path) -> TrainConfig:
    """Training config in a JSON file, such as ``config.json`` of a run.

    Raises:
        ConfigError: the file has no valid config, or names a task that is not trusted (`Registry`).
    """
    with files.reading(file) as table:
        if isinstance(table, dict):
            table = {key: x for key, x in table.items() if key not in ("about", "rans")}
        return from_table(table, is_written=True)


def run_path(config: TrainConfig) -> Path:
    """First unused folder under runs/ for a training of this config, made so that no other process takes it."""
    stem = f"{config.task}-{Path(config.spacecraft).stem}-seed{config.seed}"
    for n in range(1, 1_000_000):
        path = Path("runs") / (stem if n == 1 else f"{stem}-{n}")
        if files.new_folder(path):
            return path
    raise ConfigError(
        f"runs/{stem} and a million further names are taken: name a folder with --output."
    )
