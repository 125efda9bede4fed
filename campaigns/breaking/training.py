"""Trainings that are killed, or whose disk is full: resumed, they must end as if nothing had been."""

from __future__ import annotations

import json
import random
import resource
import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from campaigns.breaking.cases import tiny
from campaigns.breaking.trial import Limit, Outcome, ran
from rans.fast.agent_files.agent import AGENT
from rans.fast.learn.run_folder import RunFolder

_STEPS = 64 * 128
"""Long enough for many moments, short enough for many trainings."""
_PATIENCE = 120.0
_OFTEN = "from rans.fast.learn import trainer; trainer._CHECKPOINT_SECONDS = 0.0"
"""Checkpoints after every iteration, so that there is much to be killed in."""


@dataclass(frozen=True)
class Ended:
    """A training that was disturbed, and how it went on."""

    outcomes: list[Outcome]
    equal: bool
    """Whether agent and rows are those of the training that nothing happened to."""


class Left(NamedTuple):
    """What a training leaves that must not depend on what happened to it."""

    header: dict[str, Any]
    """Of the agent's file: settings, shapes, checksum."""
    numbers: bytes
    rows: list[dict[str, Any]]
    """Of metrics."""


def whole(folder: Path, conditions: str = "") -> Left:
    """What a training that nothing happens to leaves."""
    outcome = _train(folder, "whole", conditions)
    assert outcome.ended == "done", outcome.err
    return left(folder / "whole")


def _train(
    folder: Path,
    name: str,
    conditions: str = "",
    limit: Limit = lambda: None,
    kill_after: float | None = None,
) -> Outcome:
    """One go at the training in a run folder, begun or continued."""
    if not (folder / name / "config.json").exists():
        RunFolder(folder / name).begin(
            replace(tiny(conditions), total_timesteps=_STEPS), "rans train"
        )
    return ran(("train", "--resume", name), folder, _PATIENCE, limit, kill_after, _OFTEN)


def left(run: Path) -> Left:
    """The agent, bit by bit, and all rows of metrics but their times."""
    with zipfile.ZipFile(run / "policy.zip") as archive:
        agent = archive.read(AGENT)
    end = 8 + int.from_bytes(
        agent[:8], "little"
    )  # of the header, in which the order of keys is by chance
    rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    return Left(
        json.loads(agent[8:end]),
        agent[end:],
        [
            {key: x for key, x in row.items() if key not in ("seconds", "steps_per_s")}
            for row in rows
        ],
    )


def killed(
    number: int, folder: Path, expected: Left, conditions: str = "", *, seconds: float
) -> Ended:
    """SIGKILL once to three times, at any moment of the seconds that a training takes; then to its end."""
    chance = random.Random(f"kill {number}")
    moments = [chance.uniform(0.0, seconds) for _ in range(chance.choice((1, 2, 3)))]
    outcomes = [_train(folder, "cut", conditions, kill_after=moment) for moment in moments]
    outcomes = [one for one in outcomes if one.ended != "died"]  # as they were meant to
    outcomes.append(_train(folder, "cut", conditions))
    return _ended(folder / "cut", outcomes, expected)


def _ended(run: Path, outcomes: list[Outcome], expected: Left) -> Ended:
    try:
        return Ended(outcomes, left(run) == expected)
    except (OSError, KeyError, ValueError, zipfile.BadZipFile):
        return Ended(outcomes, False)


def full_disk(number: int, folder: Path, expected: Left, conditions: str = "") -> Ended:
    """A training on a file system with too little room, which is told; then it has room, and goes on."""
    chance = random.Random(f"disk {number}")
    with _small(folder / "small", chance.randrange(0, 120)) as (small, limit):
        try:
            outcomes = [_train(small, "cut", conditions, limit)]
        except Exception as error:  # there was no room to begin
            outcomes = (
                []
                if "cannot write" in str(error)
                else [Outcome(("train",), "traceback", 0.0, "", str(error))]
            )
        if (small / "cut").exists():
            shutil.copytree(small / "cut", folder / "cut")
    outcomes.append(_train(folder, "cut", conditions))
    return _ended(folder / "cut", outcomes, expected)


@contextmanager
def _small(folder: Path, kilobytes: int) -> Iterator[tuple[Path, Limit]]:
    """A folder with so little room: a file system of its own, or, where none may be mounted, a bound."""
    folder.mkdir()
    size = f"size={max(1, kilobytes)}k"
    mounted = (
        subprocess.run(
            ["mount", "-t", "tmpfs", "-o", size, "tmpfs", str(folder)],
            capture_output=True,
            check=False,
        ).returncode
        == 0
    )
    try:
        yield folder, (lambda: None) if mounted else lambda: _bounded(1024 * kilobytes)
    finally:
        if mounted:
            # Lazily: what was killed a moment ago may still be leaving.
            subprocess.run(["umount", "--lazy", str(folder)], check=True)


def _bounded(most: int) -> None:
    """No file longer than that; what asks for more fails as on a full disk."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
