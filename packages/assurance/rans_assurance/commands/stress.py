"""``rans stress``: a robustness sweep over disturbances of increasing size."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rans.extend import (
    ConfigError,
    Options,
    Terminal,
    command_of,
    say,
    word,
)
from rans_assurance.functions import stress
from rans_assurance.sections.stress import WORST

if TYPE_CHECKING:
    from rans_assurance.stress.report import StressReport


@command_of(
    stress,
    without=("slow_episodes", "seed", "worst", "workers", "show"),
    contestants=word("RUN...", tuple[str, ...]),
)
class Stress(Options):
    """Fly under one disturbance at a time, at increasing magnitude, to measure robustness.

    The sweep also flies under whole sets of conditions. Writes stress.json, of which `rans dossier` makes a page,
    and a folder stress of conditions, with which `rans view` shows the worst episodes. An agent and lqr take a
    minute of one core, in space 2.5, mpc much longer. If a contestant fails, the others are still flown, and the
    exit code is 1.
    """

    group = "Judge"
    guide = "docs/assurance/stress.md"
    divides_work = True
    examples = (
        "rans stress runs/my-agent lqr",
        'rans stress runs/my-agent --only latency "noise of position"',
    )
    following = ("rans assure {contestants}",)

    def run(self) -> int:
        """Print the largest tolerated size of each disturbance; 1 if a contestant could not fly on."""
        from rans.extend import ContestantName

        if not self.contestants:
            raise ConfigError("name at least one contestant, for example a run folder.")
        folder = self.output or ContestantName.parse(self.contestants[0]).output_folder
        report = self.call(output=folder, show=_show)
        return 1 if report.stress.failures else 0


def _show(report: StressReport) -> None:
    """Print what a sweep says, and its files."""
    console = Terminal()
    stress = report.stress
    section = report.section
    say(section, console)
    if stress.outcomes:
        console.say(f"Written to {report.folder / 'stress.json'} and the folder stress.")
        for table in section.details:
            if table.title == WORST:
                console.say(f"The first of the worst episodes: {table.rows[0][-1]}")
