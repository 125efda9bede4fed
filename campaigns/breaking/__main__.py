"""``python -m campaigns.breaking``: damaged files and run folders, odd command lines, kills, full disks.

Every case follows from its number. Demanded: no traceback, no hang, no number that is silently none, and
agents that were killed or ran out of disk end bit for bit as those that were not. One case again, with what
it says: ``--only files:137``. Most processes are forks: what those cannot find, `trial` says.
"""

from __future__ import annotations

import importlib
import random
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import torch
import tyro

from campaigns.breaking.cases import (
    Prepare,
    file_case,
    folder_case,
    line_case,
    runs_to_damage,
    under,
)
from campaigns.breaking.steps import Flown, compiled_steps, steps
from campaigns.breaking.training import Left, full_disk, killed, whole
from campaigns.breaking.trial import Outcome, ran
from campaigns.command import ended
from rans.files import environment, write_json
from rans.terminal import Terminal

_MANY = 10
"""More cases than this, and what most commands load is loaded once, before."""
_HEAVY = (
    "pydrake.multibody.plant",
    "rans.evaluation.compare.run",
    "rans.evaluation.fly.episodes",
    "rans.show.pages.report",
    "rans.show.pages.replay",
    "rans.deploy.export",
    "rans.optimal.control.lqr",
    "rans.reference.plant",
    "scipy.optimize",
    "matplotlib.backends.backend_svg",
)
Trial = Callable[[int, Path], tuple[list[Outcome], list[str]]]
"""A case of a number, in an empty folder, to outcomes and what else is wrong."""
_KINDS = "files", "lines", "folders", "kills", "disks"


@dataclass
class Tally:
    """What was tried of one kind, and what came of it."""

    tried: int = 0
    fresh: int = 0
    """Commands whose processes were started from nothing."""
    endings: dict[str, int] = field(default_factory=dict)
    faults: list[dict[str, Any]] = field(default_factory=list)
    seconds: float = 0.0

    def add(self, number: int, outcomes: list[Outcome], more: list[str]) -> None:
        """One case."""
        self.tried += 1
        for one in outcomes:
            self.fresh += one.fresh
            self.endings[one.ended] = self.endings.get(one.ended, 0) + 1
        self.faults += [
            {"case": number, "command": list(one.command), "fault": fault, "said": one.err[-2000:]}
            for one in outcomes
            for fault in one.faults
        ]
        self.faults += [
            {"case": number, "command": [], "fault": fault, "said": ""} for fault in more
        ]


@dataclass(frozen=True)
class Breaking:
    """Try to break every command; exit code 1 where one broke."""

    files: int = 300
    """Damaged files of spacecraft, conditions and trainings."""
    lines: int = 150
    """Command lines."""
    folders: int = 60
    """Damaged run folders."""
    kills: int = 10
    """Trainings that are killed and resumed."""
    disks: int = 5
    """Trainings whose disk is full."""
    steps: float = 1e7
    """Environment steps of extreme craft, one after the other, also under conditions."""
    compiled: float = 0.0
    """The same of 16,384 of them at once, by compiled programs (a minute each, for 268 million steps)."""
    conditions: tuple[str, ...] = ()
    """Names of conditions ("" for none): every case that can flies and trains under one of them."""
    first: int = 0
    """Number of the first case of each kind."""
    fresh: float = 0.2
    """Share of cases whose commands are started from nothing, not forked: of kills and disks all are."""
    only: str = ""
    """KIND:NUMBER of the one case to run, and to tell all about."""
    patience: float = 20.0
    """Time after which a command hears Ctrl-C, s; one that has not ended 90 s later hangs."""
    output: Path | None = None
    """JSON file to write."""

    def run(self) -> int:
        """Print the table; 0 if nothing broke."""
        torch.set_num_threads(1)
        if self.files + self.lines + self.folders > _MANY:
            commands = importlib.import_module("rans.cli").COMMANDS  # from above, as in `cases`
            for name in (*_HEAVY, *(command.__module__ for command in commands.values())):
                importlib.import_module(name)
        kind, _, number = self.only.partition(":")
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            if kind:
                return self._one(kind, int(number), folder)
            tallies: dict[str, Tally] = {}
            for name in _KINDS:
                if getattr(self, name):
                    tallies[name] = self._tally(name, folder)
                    self._write(tallies)
        found = {
            "steps": steps(self.steps, self.first, self.conditions),
            "compiled": compiled_steps(self.compiled, self.first, self.conditions),
        }
        faults = self._write(found | tallies)
        terminal = Terminal(room=110)
        rows = [
            (
                name,
                str(x.tried),
                ", ".join(f"{n} {how}" for how, n in sorted(x.endings.items())),
                str(len(x.faults)),
                f"{x.seconds:.0f}",
            )
            for name, x in tallies.items()
        ]
        rows += [
            (
                name,
                f"{x.steps:,}",
                f"{x.craft:,} craft, {x.refused} refused, {x.lost:,} states lost",
                f"{x.silent:,}",
                f"{x.seconds:.0f}",
            )
            for name, x in found.items()
            if x.steps
        ]
        headings = "kind", "tried", "how commands ended", "faults", "seconds"
        terminal.show("Breaking", headings, rows)
        return 1 if faults else 0

    def _write(self, found: Mapping[str, Tally | Flown]) -> int:
        """Keep what was found so far; how many faults that is."""
        faults = sum(len(x.faults) if isinstance(x, Tally) else x.silent for x in found.values())
        if self.output is not None:
            write_json(
                self.output,
                {
                    "environment": environment(),
                    "faults": faults,
                    "first": self.first,
                    "conditions": self.conditions,
                    **{name: asdict(x) for name, x in found.items()},
                },
            )
        return faults

    def _tally(self, name: str, folder: Path) -> Tally:
        tally = Tally()
        started = time.monotonic()
        trial = self._trial(name, folder)
        for number in range(self.first, self.first + getattr(self, name)):
            with _emptied(folder / "case") as case:
                before = len(tally.faults)
                tally.add(number, *trial(number, case))
            for fault in tally.faults[before:]:
                _say(f"{name}:{number} {fault['fault']}: {' '.join(fault['command'])[:300]}")
        tally.seconds = time.monotonic() - started
        _say(f"{name}: {tally.tried} in {tally.seconds:.0f} s, {len(tally.faults)} faults")
        return tally

    def _trial(self, name: str, folder: Path) -> Trial:
        """Of a kind of case."""
        worlds = self.conditions or ("",)
        if name in ("kills", "disks"):
            return _trainings(name, folder / name, worlds)
        prepares = {
            world: _prepare(name, folder / name / str(k), world) for k, world in enumerate(worlds)
        }

        def commands(number: int, case: Path) -> tuple[list[Outcome], list[str]]:
            world = _world(number, worlds)
            asked = under(world, prepares[world](number, case))
            fresh = "" if random.Random(f"fresh {number}").random() < self.fresh else None
            return [ran(one, case, self.patience, fresh=fresh) for one in asked], []

        return commands

    def _one(self, name: str, number: int, folder: Path) -> int:
        with _emptied(folder / "case") as case:
            outcomes, more = self._trial(name, folder)(number, case)
            for one in outcomes:
                _say(
                    f"$ rans {' '.join(one.command)}\n{one.out}{one.err}-> {one.ended}, {one.seconds:.1f} s"
                )
        return 1 if more or any(one.faults for one in outcomes) else 0


def _prepare(name: str, folder: Path, world: str) -> Prepare:
    """What puts the files of a case in its place, with runs trained in this world."""
    if name == "files":
        return file_case
    runs = runs_to_damage(folder, world)
    return partial(line_case, run=runs[0]) if name == "lines" else partial(folder_case, runs=runs)


def _trainings(name: str, folder: Path, worlds: Sequence[str]) -> Trial:
    """Trainings that are killed or run out of disk."""
    expected: dict[str, tuple[Left, float]] = {}
    for k, world in enumerate(worlds):
        (folder / str(k)).mkdir(parents=True)
        started = time.monotonic()
        expected[world] = whole(folder / str(k), world), time.monotonic() - started

    def disturbed(number: int, case: Path) -> tuple[list[Outcome], list[str]]:
        world = _world(number, worlds)
        left, seconds = expected[world]
        end = (
            killed(number, case, left, world, seconds=seconds)
            if name == "kills"
            else full_disk(number, case, left, world)
        )
        return end.outcomes, [] if end.equal else ["another agent"]

    return disturbed


def _world(number: int, worlds: Sequence[str]) -> str:
    """In which of them a case takes place."""
    return random.Random(f"world {number}").choice(worlds)


def _say(text: str) -> None:
    """On the way, to those who wait."""
    print(text, file=sys.stderr, flush=True)  # noqa: T201


@contextmanager
def _emptied(folder: Path) -> Iterator[Path]:
    """A folder deep in this one that is new within, and gone after; "../.." stays within too."""
    shutil.rmtree(folder, ignore_errors=True)
    case = folder / "a" / "b" / "c"
    case.mkdir(parents=True)
    yield case
    shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(ended("breaking", lambda: tyro.cli(Breaking).run()))
