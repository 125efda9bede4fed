"""How surely the agents that come with RANS do not fail: each flown a million times.

``python -m campaigns.assurances`` runs what `rans assure` runs for every one of them, on a GPU if there is
one, writes docs/validation/assurance/NAME.json and the table of docs/assurance/assurances.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from rans_assurance.assure.assurance import Assurance
from rans_assurance.assure.bounds import plan
from rans_assurance.assure.campaign import Campaign
from tyro.conf import Positional

from campaigns.table import table
from rans.base.files import read_json, write_json
from rans.base.pretrained import pretrained_names
from rans.base.table import Table
from rans.base.terminal import Terminal
from rans.episode.scenario import ASSURANCE_SEED
from rans.episode.verdict import Failure
from rans.evaluation.fly.contestant_name import ContestantName
from rans.evaluation.fly.contestants import judged_separately
from rans.evaluation.fly.evidence import sha256
from rans.fast.agent_files.agent import AGENT
from rans.randomization.conditions_file import load_conditions

_HEADINGS = (
    "agent",
    "conditions",
    "flights",
    "failed",
    "probability of failure, 99 %",
    "how they fail",
)
_CONFIDENCE = 0.99
_WORST = 2
"""Failures of each kind that Drake flies, of the worst and of the first."""
_SHORT = {
    Failure.NOT_FINITE: "not finite",
    Failure.TERMINATED: "declared failed",
    Failure.LEFT: "left",
    Failure.UNSETTLED: "never there",
    Failure.LATE: "late",
    Failure.VIOLATED: "violated",
    Failure.UNFINISHED: "unfinished",
}


@dataclass(frozen=True)
class Assurances:
    """Assure agents; write the table."""

    agents: Positional[tuple[str, ...]] = ()
    """Names of agents that come with RANS; none: all of them."""
    flights: int = 1_000_000
    """Of each."""
    seed: int = ASSURANCE_SEED
    replay: bool = True
    """Whether to fly failed flights again in NumPy and, where it is installed, in Drake."""
    docs: Path = Path("docs")
    """Where assurances.md and validation/assurance are."""

    def run(self) -> int:
        """Write and print it.

        Raises:
            ConfigError: there is no such agent, or no place for the table.
        """
        for one in _campaigns(self.agents or pretrained_names()):
            self._assure(*one)
        found = table(self.docs, "assurances")
        found.write(self.docs)
        Terminal(room=120).table(Table(_HEADINGS, found.rows, "Assurances"))
        return 0

    def _assure(self, spec: str, conditions: str) -> None:
        assurance = Assurance(
            spec,
            conditions,
            Campaign(plan(_CONFIDENCE, self.flights, None), self.seed),
            command=f"rans assure '{spec}' --conditions {conditions} --episodes {self.flights}",
            world=load_conditions(conditions),
        )
        file = _file(self.docs, spec, conditions)
        file.parent.mkdir(parents=True, exist_ok=True)
        assurance.fly("cuda" if torch.cuda.is_available() else "cpu")
        if self.replay:
            assurance.replay(_WORST)
        write_json(file, assurance.to_json())


def in_document(docs: Path) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """The table of assurances.md, from the files of all campaigns that there are."""
    rows = [
        _cells(*one, read_json(file))
        for one in _campaigns(pretrained_names())
        if (file := _file(docs, *one)).exists()
    ]
    return _HEADINGS, rows


def _file(docs: Path, spec: str, conditions: str) -> Path:
    name = f"{spec.removeprefix('pretrained:').replace('#', '-')}-{conditions}"
    return docs / "validation" / "assurance" / f"{name.removesuffix('-perfect')}.json"


def _campaigns(names: tuple[str, ...] | list[str]) -> Iterator[tuple[str, str]]:
    """Who, in which conditions: those made for another world fly in it too."""
    for name in names:
        for part in judged_separately(f"pretrained:{name}"):
            yield str(part), "perfect"
        if name.endswith("-robust"):
            yield f"pretrained:{name}", "lab"


def _cells(spec: str, conditions: str, told: dict[str, Any]) -> tuple[str, ...]:
    bound = told["bounds"]["any"]
    low = ""
    name = spec.removeprefix("pretrained:")
    if bound["failures"]:
        low = f"{bound['at least']:.2g} to "
    kinds = ", ".join(
        f"{count:,} {_SHORT[Failure[kind]]}"
        for kind, count in told["campaign"]["failures"].items()
        if count
    )
    weights = sha256([(ContestantName.parse(spec).folder / AGENT).read_bytes()])
    is_same = weights == told["about"]["hashes"].get(f"weights ({AGENT})")
    earlier = "" if is_same else " (earlier weights)"
    return (
        f"`{name}`{earlier}",
        conditions,
        f"{bound['flights']:,}",
        f"{bound['failures']:,}",
        f"{low or 'at most '}{bound['at most']:.2g}",
        kinds or "–",  # noqa: RUF001
    )


if __name__ == "__main__":
    import sys

    import tyro

    from campaigns.command import ended

    sys.exit(ended("python -m campaigns.assurances", tyro.cli(Assurances).run))
