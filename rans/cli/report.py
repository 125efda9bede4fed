"""``rans report``: one page of all results in a run folder."""

from __future__ import annotations

import contextlib
import shlex
from pathlib import Path

from rans.api.pages import report
from rans.base.errors import ConfigError
from rans.base.terminal import Terminal, doing
from rans.cli.door import Options, command_of, word

_WORTH_EXPORTING = 0.5
"""Share of solved episodes below which an agent is rather trained on."""


@command_of(report, run_folder=word("RUN", Path))
class Report(Options):
    """Gather checks, training, evaluation, comparison and assurances of a run on one offline page."""

    group = "Show"
    guide = "docs/viewing.md"
    examples = ("rans report runs/my-agent",)

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        from rans.cli.train import command_to_train_on, trust_option
        from rans.fast.learn.run_folder import RunFolder
        from rans.show.pages.report import solved_share

        run = RunFolder(self.run_folder)
        if not run.agent_file.exists():
            return ("rans list AGENTS",)
        share = solved_share(self.run_folder)
        if share is not None and share < _WORTH_EXPORTING and run.has_checkpoint:
            trust = trust_option(run.config(), run.spacecraft())
            return (command_to_train_on(self.run_folder, int(run.metrics()[-1]["steps"]), trust),)
        return (shlex.join(["rans", "export", str(self.run_folder), "--format", "c"]),)

    def run(self) -> int:
        """Write report.html into the run folder and print a summary; the exit code is 0."""
        from rans.evaluation.fly.agent import load_policy
        from rans.evaluation.fly.contestant_name import ContestantName
        from rans.fast.learn.run_folder import RunFolder
        from rans.show.pages.report import report_from_run, solved_share

        file = self.run_folder / "report.html"
        with doing(f"writing {file}"):
            page = report_from_run(self.run_folder)
            page.write(file)
        Terminal().table(page.summary())
        Terminal().say(page.hero)
        share = solved_share(self.run_folder)
        if share is not None and RunFolder(self.run_folder).agent_file.exists():
            name = ContestantName.parse(str(self.run_folder))
            with contextlib.suppress(ConfigError):  # a task of one's own is opened by --trust alone
                if text := name.shortfall(100.0 * share, load_policy(self.run_folder)):
                    Terminal().say(text)
        Terminal().say(f"The report is {file}.")
        return 0
