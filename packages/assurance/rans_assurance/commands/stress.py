"""``rans stress``: a robustness sweep over disturbances of increasing size."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from rans.cli import check_count
from rans.cli.options import Trust
from rans.errors import ConfigError
from rans.files import command_line, inside, ready_folder
from rans.registry import are_files_trusted
from rans.scenario import EVALUATION_SEED
from rans.terminal import Terminal, doing, progress, stages, writing_at_end

if TYPE_CHECKING:
    from rans_assurance.pages.stress_page import StressReport

_SHOWN = 5
"""Number of commands that the terminal lists."""
_WORST = 3
"""Number of worst episodes that the page lists for each contestant."""
_SHIPPED = ("lab", "roboran", "orbit", "harsh")


@dataclass(frozen=True)
class Stress:
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

    contestants: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN...")]
    """Contestants as for `rans compare`. The first sets task, spacecraft and control rate; the others are
    compared with it. After it, the name of a controller is enough, such as lqr."""
    conditions: tuple[str, ...] | None = None
    """Sets of conditions to fly under, by name (see `rans list CONDITIONS`) or TOML file; by default lab,
    roboran, orbit and harsh, with --only none."""
    only: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME...")] = ()
    """Fly under these disturbances only, such as latency "noise of position"; by default under all, and with
    failed thrusters."""
    episodes: int = 256
    """Number of flights at each magnitude and in each set of conditions; an eighth of it for slow controllers such
    as mpc."""
    guard: bool = False
    """Fly behind a safety filter, which replaces commands that would violate a constraint
    (docs/missions/guard.md)."""
    guard_slack: float | None = None
    """With --guard: least margin that it keeps, in the unit of each constraint (m or m/s); by default 0.002, and a
    reserve for the conditions' noise."""
    output: Path | None = None
    """Folder of the results; by default that of the first contestant."""
    trust: Trust = False
    """Whether code that files name may run, by --trust."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return (shlex.join(["rans", "assure", next(iter(self.contestants))]),)

    def run(self) -> int:
        """Print the largest tolerated size of each disturbance."""
        from rans.api.names import conditions_by_name
        from rans.evaluation.compare.entrants import contest_of
        from rans.evaluation.fly.contestant_name import ContestantName
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
        sets = self.conditions if self.conditions is not None else () if self.only else _SHIPPED
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
