"""``rans stress``: a robustness sweep over disturbances of increasing size."""

from __future__ import annotations

import shlex
from functools import partial
from typing import TYPE_CHECKING

from rans.cli.door import Options, command_of, word
from rans.extend import (
    EVALUATION_SEED,
    ConfigError,
    Terminal,
    are_files_trusted,
    check_count,
    doing,
    inside,
    progress,
    ready_folder,
    stages,
)
from rans.files import command_line
from rans.terminal import writing_at_end
from rans_assurance.functions import stress, stress_conditions

if TYPE_CHECKING:
    from rans_assurance.pages.stress_page import StressReport

_SHOWN = 5
"""Number of commands that the terminal lists."""
_WORST = 3
"""Number of worst episodes that the page lists for each contestant."""


@command_of(
    stress,
    without=("slow_episodes", "seed", "worst", "workers"),
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
        """Print the largest tolerated size of each disturbance."""
        from rans.api.names import conditions_by_name
        from rans.evaluation.compare.entrants import contest_of
        from rans.extend import ContestantName
        from rans_assurance.pages.stress_page import StressReport
        from rans_assurance.stress.run import prepared

        if not self.contestants:
            raise ConfigError("name at least one contestant, for example a run folder.")
        check_count("--episodes", self.episodes)
        # Slow controllers fly 32 of 256 starts: their interval is then about three times as wide
        slow = max(1, self.episodes // 8)
        contest = contest_of(
            self.contestants[0],
            self.episodes,
            EVALUATION_SEED,
            trust=self.trust,
            guard=self.guard,
            slack=self.guard_slack,
        )
        sets = stress_conditions(self.conditions, self.only)
        stress = prepared(
            contest,
            self.contestants,
            conditions_by_name(sets),
            self.only,
            slow,
            self.trust,
        )
        folder = ready_folder(
            self.output or ContestantName.parse(self.contestants[0]).output_folder
        )
        inside(
            folder, "stress"
        )  # folder of the conditions: reject a symbolic link before the flights
        report = StressReport(stress, folder, _WORST, command_line())
        with writing_at_end(partial(_show, report)), progress() as bars:
            stress.fly(stages(bars))
        return 1 if stress.failures else 0


def _show(report: StressReport) -> None:
    console = Terminal()
    stress = report.stress
    if stress.outcomes:
        with doing("drawing the page", in_log=False):
            report.write()
        console.show(
            report.title(),
            ("solved, %", *stress.names),
            [[cell or "-" for cell in row] for row in report.named_rows()],
        )
        if stress.effects:
            console.show(
                "Size of a disturbance up to which 99 % are solved",
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
