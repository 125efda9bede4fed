"""``rans compare``: agents and controllers from the same starts, with the bounds of what is possible."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from rans.api.judging import compare
from rans.base.errors import ConfigError, RansError, counted
from rans.base.table import Table
from rans.base.terminal import Terminal
from rans.cli.door import Options, command_of, word
from rans.cli.next_commands import after

if TYPE_CHECKING:
    from rans.evaluation.compare.contest import Contest
    from rans.evaluation.compare.run import Comparison
    from rans.evaluation.fly.contestant_name import ContestantName


@command_of(
    compare,
    without=("workers", "show"),
    contestants=word("RUN...", tuple[str, ...]),
    beside=Annotated[tuple[str, ...] | None, arg(name="with", metavar="[NAME|optimal ...]")],
)
class Compare(Options):
    """Fly agents, policies and controllers from the same starts, and compare them with what is possible.

    Writes compare.html and compare.json. The file of a spacecraft alone, mine.toml, is any-craft-2d or any-craft-3d
    at five values, fast to frugal. Bounds are kept for the next run. --full prints all scores, and beside
    optima the certified gaps; the page always has all that were computed. All contestants are checked before any
    flies. If one fails in flight, the others are still compared, and the exit code is 1. docs/protocol.md defines
    the scores.
    """

    group = "Judge"
    guide = "docs/comparison.md"
    divides_work = True
    examples = (
        "rans compare mine.toml",
        "rans compare runs/my-agent",
        "rans compare runs/my-agent pretrained:go-to-pose-2d --episodes 16 --certified 2",
    )

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return after(self, "compare", *self.contestants)

    def run(self) -> int:
        """Print the table of scores, and write page and numbers; 1 if a contestant could not fly."""
        from rans.evaluation.fly.contestant_name import ContestantName

        self._check()
        contestants = [*map(ContestantName.parse, self.contestants)]
        folder = self.output or contestants[0].output_folder
        show = partial(_show, full=self.full)
        comparison = self.call(contestants=tuple(contestants), output=folder, show=show)
        if untrained := without_training(contestants, comparison.contest):
            command = shlex.join(["rans", "compare", contestants[0].text, untrained])
            agent = untrained.partition("@")[0]
            Terminal().say(f"{agent} flies this craft without training: {command}")
        return 1 if comparison.failures else 0

    def _check(self) -> None:
        """Reject (`ConfigError`) wrong options before anything is loaded."""
        if not self.contestants:
            raise ConfigError("name at least one contestant, for example a run folder.")
        for name in self.beside or ():
            if "," in name:
                spaced = " ".join(filter(None, name.split(",")))
                raise ConfigError(
                    f"--with takes names with spaces between them: write --with {spaced}."
                )


def without_training(contestants: Sequence[ContestantName], contest: Contest) -> str:
    """The agent for any craft with the craft of a contest, by name; "" if it flies already, or cannot."""
    from rans.base.pretrained import FOR_ANY_CRAFT
    from rans.evaluation.compare.entrants import enlisted

    agent = FOR_ANY_CRAFT[contest.craft.dimension]
    if any(agent in name.text or name.in_full for name in contestants):
        return ""
    name = contestants[0]
    craft = name.craft or name.setup.partition("@")[2] or contest.craft.name
    if name.kind == "run folder":
        craft = str(Path(name.name) / "spacecraft.toml")
    untrained = f"{agent}@{craft}"
    try:
        enlisted([untrained], contest)
    except RansError:  # another task or rate, or a craft that it cannot fly
        return ""
    return untrained


def _show(comparison: Comparison, full: bool) -> None:
    """Print the scores so far, or at the end those and all else; without ``full`` only the most important ones."""
    from rans.show.tables import comparison_tables as tables

    so_far = bool(comparison.waiting)
    console = Terminal(stderr=so_far)
    if not (so_far or comparison.entries or comparison.failures):
        console.say("Interrupted before the first contestant had flown: there is no comparison.")
        return
    for sentence in tables.verdict(comparison):
        console.say(f"So far: {sentence}" if so_far else sentence)
    if comparison.entries:
        table = tables.score_table if full and not so_far else tables.short_table
        console.table(replace(table(comparison), title=comparison.contest.title()))
    if so_far:
        said = {"optimal": "certified bounds", "mpc": "MPC"}
        more = ", ".join(said.get(name, name) for name in comparison.waiting)
        console.print(
            f"Still to come: {more}. Ctrl-C ends here and writes what there is.", soft_wrap=True
        )
        return
    # Relaxed optima, multiples of bounds, and the bound of a mission.
    further = [tables.relaxed_table(comparison)] if full else []
    starts = counted(len(comparison.certified_starts()), "start")
    title = f"Times what is certified as least, median of {starts}"
    further.append(tables.gap_table(tables.gaps(comparison), title))
    if full and (mission := comparison.mission) is not None:
        title = f"Over the certified least {mission.spending}, start by start"
        further.append(Table(*mission.table(comparison.entries), title))
    for table in further:
        if table.rows:
            console.table(table)
    for sentence in (*comparison.notes, *comparison.failures):
        console.say(sentence)
    if comparison.files:
        first, *others = comparison.files
        console.say(f"Written to {', '.join([str(first), *(file.name for file in others)])}.")
