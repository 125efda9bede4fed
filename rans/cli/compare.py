"""``rans compare``: agents and controllers from the same starts, with the bounds of what is possible."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from rans.api.judging import check_beside, compare, starts_of
from rans.cli import check_count
from rans.cli.door import Options, command_of, word
from rans.cli.states import written_endpoints
from rans.errors import ConfigError, RansError, counted
from rans.evaluation.fly.controllers import default_opponents
from rans.files import command_line, inside, ready_folder, write_json
from rans.table import Table
from rans.terminal import Terminal, doing, progress, rendered, stages, writing_at_end

if TYPE_CHECKING:
    from rich.progress import Progress

    from rans.evaluation.compare.contest import Contest
    from rans.evaluation.compare.run import Comparison
    from rans.evaluation.fly.contestant_name import ContestantName
    from rans.evaluation.measure.statistics import Estimate
    from rans.progress import Progress as StageProgress
    from rans.tasks import Task


_POSITIONS = 9
"""Positions of a trade-off, with both ends, on the curve of an agent."""
_SLOW = ("mpc", "mpc-observer", "mppi", "convex", "optimal")
"""Controllers that solve an optimal control problem at every step, and the bounds."""


@command_of(
    compare,
    without=("workers",),
    contestants=word("RUN...", tuple[str, ...]),
    beside=Annotated[tuple[str, ...] | None, arg(name="with", metavar="[NAME|optimal ...]")],
)
class Compare(Options):
    """Fly agents, policies and controllers from the same starts, and compare them with what is possible.

    Writes compare.html and compare.json. The file of a spacecraft alone, mine.toml, is any-craft-2d or any-craft-3d
    at three values, fast to frugal. Bounds are kept for the next run. --full prints all scores and the certified
    gaps too; the page always has all scores that were computed. All contestants are checked before any flies. If
    one fails in flight, the others are still compared, and the exit code is 1. docs/protocol.md defines the scores.
    """

    group = "Judge"
    guide = "docs/comparison.md"
    divides_work = True
    examples = (
        "rans compare mine.toml",
        "rans compare runs/first",
        "rans compare runs/first pretrained:go-to-pose-2d --episodes 16 --certified 2",
    )

    front: bool = False
    """Also plot time against impulse: the curve of an agent with a trade-off, all others, and the certified Pareto
    front."""
    front_seconds: float = 300.0
    """With --front: processor time for the bounds, s. They are kept for the next run."""
    output: Path | None = None
    """Folder of the results; by default that of the first contestant."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return (shlex.join(["rans", "view", *self.contestants]),)

    def run(self) -> int:
        """Print the table of scores."""
        from rans.api.names import conditions_if_named
        from rans.evaluation.compare.entrants import contest_of, enlisted, trade_off_positions
        from rans.evaluation.compare.run import Comparison
        from rans.evaluation.fly.contestant_name import ContestantName

        self._check()
        episodes, certified = starts_of(self.episodes, self.certified, self.full)
        contestants = [*map(ContestantName.parse, self.contestants)]
        named = [
            trade_off_positions(name, _POSITIONS) if self.front else [name]
            for contestant in contestants
            for name in at_values(contestant)
        ]
        # The first contestant sets task, craft, starts and conditions for all.
        contest = contest_of(
            named[0][0],
            episodes,
            self.seed,
            self.engine,
            conditions_if_named(self.conditions),
            self.trust,
            self.guard,
            self.guard_slack,
            self.period,
        )
        contest = contest.between(
            written_endpoints(
                self.start, self.goal, contest.task, contest.craft.dimension, self.seed, self.zones
            )
        )
        comparison = Comparison(contest)
        flying = enlisted([name for line in named for name in line], contest, self.trust)
        inner = [name.text for line in named for name in line[1:-1]]
        between = {text: flying.pop(text) for text in inner if text in flying}
        folder = ready_folder(self.output or contestants[0].output_folder)
        cache = inside(folder, "compare-bounds.json")
        show = partial(_write, comparison, folder, self.full)
        begun: list[str] = []

        def stage(name: str, total: int | None, /) -> StageProgress:
            begun.append(name)
            return shown(name, total)

        # Quick opponents first; results so far are written even after an interrupt.
        with writing_at_end(show), progress() as bars:
            shown = stages(bars)
            try:
                quick, rest = self._quick(contest)
                comparison.fly(flying, quick, certified, cache, stage, returns=self.full)
                if rest:
                    _say_so_far(comparison, bars, rest)
                    comparison.fly({}, rest, certified, cache, stage, returns=self.full)
                if self.front:
                    comparison.trace(between, self.front_seconds, cache, stage)
            except KeyboardInterrupt:
                bars.console.print(
                    "Interrupted: what there is is written, the page last. Ctrl-C again leaves the page out.",
                    soft_wrap=True,
                )
                comparison.notes.insert(0, self._interrupted(comparison, begun, certified))
                raise
        if line := _without_training(contestants, contest):
            Terminal().say(line)
        self._suggest(contest.task)
        return 1 if comparison.failures else 0

    def _suggest(self, task: Task) -> None:
        """Print commands that a user may want to run next, with the options of this one."""
        run = self.contestants[0]
        controllers = self._controllers(task)
        guard = self.changed("guard", "guard_slack")
        same = [*guard, *self.changed("start", "goal", "zones", "conditions", "seed", "engine")]
        trust = ["--trust"] if self.trust else []
        same += trust
        view = shlex.join(["rans", "view", run, *controllers, *same])
        stress = shlex.join(["rans", "stress", run, *controllers, *guard, *trust])
        # Only a comparison has opponents, certified bounds and a front.
        again = self.changed("episodes", "certified", "period", "output", "beside")
        again += ["--front", "--front-seconds", f"{self.front_seconds:g}"] if self.front else []
        full = shlex.join(["rans", "compare", *self.contestants, *same, *again, "--full"])
        Terminal().suggest(*([] if self.full else [full]), view, stress)

    def _quick(self, contest: Contest) -> tuple[list[str], list[str]]:
        """Opponents that answer in seconds, which fly first, and the slow ones after them."""
        from rans.evaluation.problems import bounded

        names = [*(default_opponents(contest.task) if self.beside is None else self.beside)]
        slow = next((k for k, name in enumerate(names) if name in _SLOW), len(names))
        if bounded(contest):  # a mission's bound is computed between them
            slow = len(names)
        return names[:slow], names[slow:]

    def _interrupted(self, comparison: Comparison, begun: Sequence[str], certified: int) -> str:
        """Sentence about the progress of an interrupted comparison, whose last stage is the interrupted one.

        Without a bound it says that none was computed: certification may have been far from its turn.
        """
        stage = f' in the stage "{begun[-1]}"' if begun else ""
        flown = counted(len(comparison.entries), "contestant")
        bounded = len(comparison.certified_starts())
        if comparison.mission is not None:
            bounded = len(comparison.mission.lower)
        asked = min(certified, comparison.contest.episodes)
        bounds = f"bounds were computed from {bounded} of {asked} starts"
        if not bounded:
            bounds = "no bound had been computed"
        return f"Interrupted{stage}: {flown} had flown, and {bounds}."

    def _controllers(self, task: Task) -> list[str]:
        """First further controller, to view beside the first contestant."""
        opponents = default_opponents(task) if self.beside is None else self.beside
        return [name for name in opponents if name != "optimal"][:1]

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
        check_beside(self.beside)
        check_count("--episodes", self.episodes)
        if self.certified is not None and self.certified < 0:
            raise ConfigError(f"--certified must be >= 0, got {self.certified}.")
        if not self.front_seconds >= 0:
            raise ConfigError(f"--front-seconds must be >= 0, got {self.front_seconds}.")
        if not self.front and self.front_seconds != Compare.front_seconds:
            raise ConfigError("--front-seconds needs --front.")


_VALUES = 0.0, 0.5, 1.0
"""Values from fast to frugal at which the agent for any craft flies the file of a user's spacecraft."""


def at_values(name: ContestantName) -> list[ContestantName]:
    """The agent for any craft at several values, where a name is the file of a spacecraft alone."""
    if not name.in_full or name.frugality is not None:
        return [name]
    before, at, craft = name.in_full.rpartition("@")
    texts = [f"{before}#{value:g}{at}{craft}" for value in _VALUES]
    return [*map(type(name).parse, texts)]


def _without_training(contestants: Sequence[ContestantName], contest: Contest) -> str:
    """How to have the agent for any craft beside the others; "" if it flies already, or cannot."""
    from rans.evaluation.compare.entrants import enlisted
    from rans.pretrained import FOR_ANY_CRAFT

    agent = FOR_ANY_CRAFT[contest.craft.dimension]
    if any(agent in name.text or name.in_full for name in contestants):
        return ""
    name = contestants[0]
    craft = name.craft or name.setup.partition("@")[2] or contest.craft.name
    if name.kind == "run folder":
        craft = str(Path(name.name) / "spacecraft.toml")
    try:
        enlisted([f"{agent}@{craft}"], contest)
    except RansError:  # another task or rate, or a craft that it cannot fly
        return ""
    command = shlex.join(["rans", "compare", name.text, f"{agent}@{craft}"])
    return f"{agent} flies this craft without training: {command}"


def _say_so_far(comparison: Comparison, bars: Progress, rest: Sequence[str]) -> None:
    """Print the most important scores before the slow contestants and the bounds."""
    from rans.evaluation.measure.statistics import figure
    from rans.show.tables.comparison_tables import DETAILS, scoreboard

    if not (board := scoreboard(comparison)):
        return
    keys = list(dict.fromkeys(key for row in board.values() for key in row))
    rows = [
        (key, *(figure(row[key].value) if key in row else "" for row in board.values()))
        for key in keys
        if not key.startswith(DETAILS)
    ]
    so_far = Table(("", *board), rows, f"{comparison.contest.title()}, so far")
    bars.console.print(rendered(so_far))
    more = " and ".join("certified bounds" if name == "optimal" else name.upper() for name in rest)
    bars.console.print(
        f"Now {more}, which take longer. Ctrl-C ends here and writes what there is.", soft_wrap=True
    )


def _write(comparison: Comparison, folder: Path, full: bool = True) -> None:
    """Write a comparison into a folder, and print its scores; without ``full`` only the most important ones."""
    from rans.show.figures.chart_figure import save_chart
    from rans.show.pages.comparison_page import TEXT, page, time_and_impulse
    from rans.show.pages.screen import Screen
    from rans.show.tables import front_tables
    from rans.show.tables.comparison_tables import (
        DETAILS,
        gap_names,
        gap_rows,
        gaps,
        scoreboard,
        to_json,
        verdict,
    )

    console = Terminal()
    if not (comparison.entries or comparison.failures):
        console.say("Interrupted before the first contestant had flown: nothing was written.")
        return
    write_json(folder / "compare.json", to_json(comparison, TEXT))
    # Tables: scores, multiples of bounds, the bound of a mission, and the front.
    board = scoreboard(comparison)
    if sentence := verdict(comparison):
        console.say(sentence)
    if board:
        shown = [
            key
            for key in dict.fromkeys(key for row in board.values() for key in row)
            if full or not key.startswith(DETAILS)
        ]
        _show_scores(console, comparison.contest.title(), board, shown)
    if full and (ratios := gaps(comparison)):
        starts = counted(len(comparison.certified_starts()), "start")
        console.show(
            f"Median multiple of the bound of the same event, {starts}",
            ("event", *gap_names(ratios)),
            gap_rows(ratios),
        )
    if full and comparison.mission is not None:
        console.show(
            f"Over the certified least {comparison.mission.spending}, start by start",
            *comparison.mission.table(comparison.entries),
        )
    if board and (front := comparison.front):
        bounds = counted(len(front.starts()), "start")
        console.show(
            "Front of time and impulse" + (f", bounds of {bounds}" if front.starts() else ""),
            *front_tables.front_table(front),
        )
        for sentence in front_tables.sentences(front):
            console.say(sentence)
    for sentence in (*comparison.notes, *comparison.failures):
        console.say(sentence)
    # The page, its chart for papers, and what the page of a screen needs: last, as figures take seconds.
    written = ["compare.html", "compare.json"]
    with doing("drawing the page", in_log=False):
        result = page(comparison, command_line())
        result.write(folder / "compare.html")
        write_json(folder / "screen-compare.json", Screen.of(result).to_json())
        if chart := time_and_impulse(comparison):
            written += [file.name for file in save_chart(chart, folder / "compare")]
    console.say(f"Written to {folder / written[0]}, {', '.join(written[1:])}.")


def _show_scores(
    console: Terminal, title: str, board: Mapping[str, Mapping[str, Estimate]], keys: Sequence[str]
) -> None:
    """Print the scores of all contestants, a column each, with intervals where the terminal is wide enough."""
    from rans.evaluation.measure.statistics import figure

    def cells(text: Callable[[Estimate], str]) -> list[tuple[str, ...]]:
        return [(key, *(text(row[key]) for row in board.values())) for key in keys]

    console.show(
        title,
        ("", *board),
        cells(lambda estimate: estimate.text()),
        cells(lambda estimate: figure(estimate.value)),
        "A wider terminal shows intervals too.",
    )
