"""``rans report``: one page of all results in a run folder."""

from __future__ import annotations

import shlex
from pathlib import Path

from rans.api.pages import report
from rans.cli.door import Options, command_of, word
from rans.terminal import Terminal, doing


@command_of(report, run_folder=word("RUN", Path))
class Report(Options):
    """Gather checks, training, evaluation, comparison and assurances of a run on one offline page."""

    group = "Show"
    guide = "docs/viewing.md"
    examples = ("rans report runs/first",)

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        from rans.fast.learn.run_folder import RunFolder

        for folder in (self.run_folder, self.run_folder / "best"):  # of a training, of a sweep
            if RunFolder(folder).agent_file.exists():
                return (shlex.join(["rans", "export", str(folder), "--format", "c"]),)
        return ("rans list AGENTS",)

    def run(self) -> int:
        """Write report.html into the run folder and print a summary; the exit code is 0."""
        from rans.show.pages.report import report_from_run

        file = self.run_folder / "report.html"
        with doing(f"writing {file}"):
            page = report_from_run(self.run_folder)
            page.write(file)
        Terminal().table(page.summary())
        Terminal().say(page.hero)
        Terminal().say(f"The report is {file}.")
        return 0
