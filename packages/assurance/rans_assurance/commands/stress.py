"""``rans stress``: a robustness sweep over disturbances of increasing size."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

from rans.extend import (
    ConfigError,
    Options,
    Terminal,
    are_files_trusted,
    check_count,
    command_of,
    word,
)
from rans_assurance.functions import stress

if TYPE_CHECKING:
    from rans_assurance.pages.stress_page import StressReport

_SHOWN = 5
"""Number of commands that the terminal lists."""


@command_of(
    stress,
    without=("slow_episodes", "seed", "worst", "workers", "show", "guard_slack"),
    contestants=word("RUN...", tuple[str, ...]),
)
class Stress(Options):
    """Fly under one disturbance at a time, at increasing magnitude, to measure robustness.

    The sweep also flies under whole sets of conditions. Writes stress.html, stress.json and a folder stress
    of conditions, with which `rans view` shows the worst episodes. If a contestant fails, the others are
    still flown, and the exit code is 1.
    """

    group = "Judge"
    guide = "docs/assurance/stress.md"
    divides_work = True
    examples = (
        "rans stress runs/first lqr",
        'rans stress runs/first --only latency "noise of position"',
    )

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return (shlex.join(["rans", "assure", next(iter(self.contestants))]),)

    def run(self) -> int:
        """Print the largest tolerated size of each disturbance; 1 if a contestant could not fly on."""
        from rans.extend import ContestantName

        if not self.contestants:
            raise ConfigError("name at least one contestant, for example a run folder.")
        check_count("--episodes", self.episodes)
        folder = self.output or ContestantName.parse(self.contestants[0]).output_folder
        report = self.call(output=folder, show=_show)
        return 1 if report.stress.failures else 0


def _show(report: StressReport) -> None:
    """Print tables, worst flights and files of a stress report, at most `_SHOWN` of the worst."""
    console = Terminal()
    stress = report.stress
    if stress.outcomes:
        console.show(
            report.title(),
            ("solved, %", *stress.names),
            [[cell or "-" for cell in row] for row in report.named_rows()],
        )
        if stress.effects:
            console.show(
                report.limit_title(),
                report.effect_columns(),
                report.effect_rows(),
            )
        for conditions, contestant, episode, errors, command in [*report.worst_rows()][:_SHOWN]:
            console.say(f"{contestant}, {conditions}, episode {episode} ({errors}):")
            console.command(command)
    for sentence in (*report.notes(), *stress.failures):
        console.say(sentence)
    if stress.outcomes:
        console.say(
            f"Written to {report.folder / 'stress.html'}, stress.json and the folder stress."
        )
        if not report.is_partial:
            trust = ["--trust"] if are_files_trusted() else []
            console.suggest(shlex.join(["rans", "assure", next(iter(stress.contestants)), *trust]))
