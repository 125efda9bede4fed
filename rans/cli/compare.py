"""``rans compare``: agents between what no controller can beat and what simple ones reach."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from rans.cli import check_count
from rans.errors import ConfigError
from rans.evaluation.fly.controllers import BESIDE, CONTROLLERS
from rans.files import ready_folder, write_json
from rans.scenario import EVALUATION_SEED
from rans.terminal import Terminal, progress, table

if TYPE_CHECKING:
    from rans.evaluation.compare.run import Comparison


@dataclass(frozen=True)
class Compare:
    """Fly agents, your own policies and simple controllers from the same starts, beside what is possible.

    Writes compare.html and compare.json. A contestant that fails is named, the rest is still compared,
    and the exit code is 1. docs/comparison.md explains how it is judged.
    """

    contestants: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN...")]
    """Run folders, pretrained:NAME, CONTROLLER:TASK-2d (see `rans list`), sb3:FILE.zip, onnx:FILE or
    python:MODULE:FUNCTION. The first gives task, spacecraft and rate; others are compared with it."""
    beside: Annotated[tuple[str, ...], tyro.conf.arg(name="with", metavar="[NAME|optimal ...]")] = BESIDE
    """Who joins them: simple controllers, and the best that is possible."""
    conditions: str | None = None
    """What episodes do not promise: a name (see `rans list CONDITIONS`), perfect, or your own TOML file; by
    default those that the first contestant was trained in."""
    episodes: int = 128
    """Number of starts."""
    engine: Literal["fast", "drake"] = "fast"
    """What computes the motion: the shared equations, or Drake as an independent judge."""
    certified: int = 4
    """Starts whose bounds are certified, about 25 processor seconds each; kept for the next time."""
    seed: int = EVALUATION_SEED
    """Of the starts."""
    output: Path | None = None
    """Folder of the results; by default that of the first contestant."""
    trust: bool = False
    """Open sb3: files that RANS did not write. They are pickles, which run whatever code is in them."""

    def run(self) -> int:
        """Print the table of scores."""
        from rans.evaluation.compare.roster import contest_of
        from rans.evaluation.compare.run import Comparison, fill
        from rans.evaluation.fly.contestants import output_folder

        if not self.contestants:
            raise ConfigError("name at least one contestant, for example a run folder.")
        for name in set(self.beside) - {"optimal"}:
            CONTROLLERS[name]  # a wrong name is told before anybody flies
        if self.certified < 0:
            raise ConfigError(f"--certified must be >= 0, got {self.certified}.")
        check_count("--episodes", self.episodes)
        comparison = Comparison(contest_of(self.contestants[0], self.episodes, self.seed, self.engine,
                                             self.conditions))
        folder = ready_folder(self.output or output_folder(self.contestants[0]))
        try:
            with progress() as bars:
                fill(comparison, self.contestants, self.beside, self.certified,
                     folder / "compare-bounds.json",
                     lambda what, count: partial(bars.advance, bars.add_task(what, total=count)),
                     trust=self.trust)
        finally:  # also after Ctrl-C: what is finished is kept
            _write(comparison, folder)
        return 1 if comparison.failures else 0


def _write(comparison: Comparison, folder: Path) -> None:
    from rans.show.comparison_page import TEXT, page
    from rans.show.comparison_tables import gap_names, gap_rows, gaps, scoreboard, to_json

    console, board = Terminal(), scoreboard(comparison)
    write_json(folder / "compare.json", to_json(comparison, TEXT))
    page(comparison).write(folder / "compare.html")
    if board:
        keys = dict.fromkeys(key for row in board.values() for key in row)
        console.print(table(comparison.contest.title(), ("", *board),
                            [(key, *(row[key].text() for row in board.values())) for key in keys]))
    if found := gaps(comparison):
        starts = len(comparison.certified_starts())
        console.print(table(f"Median multiple of the bound of the same event, {starts} starts",
                            ("event", *gap_names(found)), gap_rows(found)))
    for sentence in (*comparison.notes, *comparison.failures):
        console.print(sentence, soft_wrap=True)
    console.print(f"Written to {folder / 'compare.html'} and compare.json.")
