"""``rans report``: one page of all results in a run folder."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from rans.terminal import Terminal, doing


@dataclass(frozen=True)
class Report:
    """Gather checks, training, evaluation, comparison and assurances of a run on one offline page."""

    group = "Show"
    guide = "docs/viewing.md"
    examples = ("rans report runs/first",)

    run_folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """Run folder; parts that it does not have yet are left out."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return (shlex.join(["rans", "export", str(self.run_folder), "--format", "c"]),)

    def run(self) -> int:
        """Write report.html into the run folder and print a summary."""
        from rans.show.pages.report import report_from_run

        file = self.run_folder / "report.html"
        with doing(f"writing {file}"):
            report = report_from_run(self.run_folder)
            report.write(file)
        Terminal().table(report.summary())
        Terminal().say(report.hero)
        Terminal().say(f"The report is {file}.")
        return 0
