"""How surely the agents that come with RANS do not fail: each flown a million times.

``python -m validation.assurances`` runs what `rans assure` runs for every one of them, on a GPU if there is
one, keeps docs/validation/assurance/NAME.json and writes the table of docs/assurance.md. Campaigns that are
there already, of the same code, are not flown again, but their failures are: on a machine with Drake by it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
from tyro.conf import Positional

from rans.evaluation.assure.assurance import Assurance, made
from rans.evaluation.assure.bounds import plan
from rans.evaluation.fly.contestants import judged_separately
from rans.fast.verdicts import Failure
from rans.files import write_json, write_text
from rans.pretrained import pretrained_names
from rans.scenario import ASSURANCE_SEED
from rans.terminal import Terminal, table
from validation.markdown import with_table

_COMMAND = "python -m validation.assurances"
_HEADINGS = ("agent", "conditions", "flights", "failed", "probability of failure, 99 %", "how they fail",
             "flown again: fail again in NumPy, Drake")
_SOURCE = "Everything about each is in [validation/assurance](validation/assurance)."
_CONFIDENCE = 0.99
_WORST = 2
"""Failures of each kind that Drake flies, of the worst and of the first."""
_SHORT = {Failure.NOT_FINITE: "not finite", Failure.TERMINATED: "declared failed", Failure.LEFT: "left",
          Failure.UNSETTLED: "never there", Failure.LATE: "late"}


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
    """Where assurance.md and validation/assurance are."""

    def run(self) -> int:
        """Write and print it.

        Raises:
            ConfigError: there is no such agent, or no place for the table.
        """
        rows = [_cells(self._assured(*one)) for one in _campaigns(self.agents or pretrained_names())]
        page = self.docs / "assurance.md"
        write_text(page, with_table(page.read_text("utf-8"), _COMMAND, _HEADINGS, rows, _SOURCE))
        Terminal(room=120).print(table("Assurances", _HEADINGS, rows))
        return 0

    def _assured(self, spec: str, conditions: str) -> Assurance:
        assurance = made(spec, conditions, plan(_CONFIDENCE, self.flights, None), self.seed,
                         f"rans assure '{spec}' --conditions {conditions} --episodes {self.flights}")
        name = f"{spec.removeprefix('pretrained:').replace('#', '-')}-{conditions}"
        file = self.docs / "validation" / "assurance" / f"{name.removesuffix('-perfect')}.json"
        file.parent.mkdir(parents=True, exist_ok=True)
        assurance.go_on(file)
        assurance.fly("cuda" if torch.cuda.is_available() else "cpu", lambda _: None,
                      lambda: write_json(file, assurance.to_json()))
        if self.replay:
            assurance.replay(_WORST, _WORST)
        write_json(file, assurance.to_json())
        return assurance


def _campaigns(names: tuple[str, ...] | list[str]) -> Iterator[tuple[str, str]]:
    """Who, in which conditions: those made for another world fly in it too."""
    for name in names:
        for spec in judged_separately(f"pretrained:{name}"):
            yield spec, "perfect"
        if name.endswith("-robust"):
            yield f"pretrained:{name}", "lab"


def _cells(assurance: Assurance) -> tuple[str, ...]:
    campaign, replays = assurance.campaign, assurance.replays
    bound = campaign.bound()
    range_ = f"at most {bound.high:.2g}" if not bound.events else f"{bound.low:.2g} to {bound.high:.2g}"
    kinds = ", ".join(f"{count:,} {_SHORT[kind]}" for kind, count in campaign.events.items() if count)
    again = "–"  # noqa: RUF001
    if replays and replays.tried:
        judged = [one for one in replays.found if "drake" in one.again]
        drake = sum(one.again["drake"] is not None for one in judged)
        again = f"{replays.failed} of {replays.tried}, {drake} of {len(judged)}"
    return (f"`{assurance.spec.removeprefix('pretrained:')}`", str(assurance.conditions),
            f"{campaign.flights:,}", f"{bound.events:,}", range_, kinds or "–", again)  # noqa: RUF001


if __name__ == "__main__":
    import sys

    import tyro

    from validation.command import ended

    sys.exit(ended("python -m validation.assurances", tyro.cli(Assurances).run))
