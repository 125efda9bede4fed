"""``rans evaluate``: metrics of an agent or a controller from starts that no training has seen."""

from __future__ import annotations

import shlex
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rans.api.judging import evaluate, flown, own_endpoints
from rans.base.errors import ConfigError, is_installed
from rans.base.files import (
    command_line,
    distinct,
    inside,
    ready_folder,
    write_json,
    writing_at_end,
)
from rans.base.terminal import Terminal, doing
from rans.cli.door import Options, command_of, word
from rans.cli.next_commands import after
from rans.cli.options import Trust

if TYPE_CHECKING:
    from rans.episode.flight import Flight
    from rans.evaluation.fly.agent import LoadedRun
    from rans.randomization.conditions import Conditions

_KEPT = 2**16
"""Largest number of flights whose trajectories are stored."""


@command_of(evaluate, agent=word("RUN"))
class Evaluate(Options):
    """Fly an agent from fixed starts, and print metrics with 95 % intervals.

    Writes evaluation.json and .html, episodes.npz, evaluation.svg and episode.svg into the run folder, or for
    other contestants into runs/evaluations/. With a protocol the names end in it, such as evaluation-paper.json;
    under your own conditions, in a digest of these.
    """

    group = "Judge"
    guide = "docs/agents.md"
    divides_work = True
    examples = (
        "rans evaluate mine.toml",
        "rans evaluate runs/my-agent",
        "rans evaluate runs/my-agent --engine drake --episodes 64",
        "rans evaluate lqr:go-to-pose-2d@mine.toml --full",
        "rans evaluate sb3:policy.zip:go-to-pose-2d --trust",
    )

    full: bool = False
    """Print all metrics, not only the most important ones, and write all states and commands into episodes.npz."""
    trust: Trust = False
    """Whether code that files name may run, by --trust."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return after(self, "evaluate", str(self.agent))

    def run(self) -> int:
        """Print the tables of metrics; a multi-task agent is evaluated on each of its tasks."""
        from rans.evaluation.fly.contestants import judged_separately

        if self.episodes > _KEPT:
            raise ConfigError(
                f"rans evaluate stores every flight, of {_KEPT:,} at most, got {self.episodes:,}: "
                "rans assure judges more while they fly."
            )
        for name in judged_separately(self.agent):
            replace(self, agent=name).judge()
        return 0

    def judge(self) -> None:
        """Evaluate the parsed agent on one task."""
        from rans.api.names import conditions_if_named
        from rans.evaluation.fly.contestants import contestant

        world = conditions_if_named(self.conditions)
        run = contestant(
            self.agent, self.protocol, trust=self.trust, period=self.period, conditions=world
        ).under(world)
        run = run.guarded(self.guard)
        if remark := getattr(run.controller, "remark", ""):
            Terminal().say(remark)
        ready_folder(self.agent.output_folder)
        file = self._file(run)
        own = own_endpoints(self.start, self.goal)
        # After an interrupt the flights that have ended.
        flights: list[Flight] = []

        def end() -> None:
            if flights:
                self._show(file, run, flights[-1])

        with writing_at_end(end, file):
            flights.append(
                flown(
                    run, self.episodes, self.seed, self.engine, endpoints=own, save=flights.append
                )
            )

    def _show(self, file: Path, run: LoadedRun, flight: Flight) -> None:
        """Measure, write and print flights."""
        from rans.evaluation.fly.evidence import about
        from rans.evaluation.measure.aggregate import ROOM, measure, save_episodes
        from rans.show.pages.report import evaluation_page

        metrics = measure(flight)
        # Numbers first, then flights and page beside them, before what cannot be printed; figures take seconds.
        suffix = file.stem.removeprefix("evaluation")
        results = {
            self.engine: metrics.to_json(),
            "conditions": self._conditions(run, flight.commands.shape[1]),
            "seed": self.seed,
            "about": about(str(self.agent), run.judged, "rans.evaluate"),
        }
        write_json(file, results, [f"episodes{suffix}.npz", f"episode{suffix}.svg"])
        save_episodes(flight, file.with_name(f"episodes{suffix}.npz"), self.full)
        page = evaluation_page([metrics], flight, command_line())
        page.write(inside(file.parent, f"evaluation{suffix}.html"))
        console = Terminal(room=ROOM)
        if run.conditions is not None:
            console.print(f"Conditions: {self._named_conditions(run.conditions)}.")
        console.table(metrics.table(console.width, self.full))
        if text := self.agent.shortfall(
            metrics["solved"].value,
            run,
            self.conditions,
            self.changed("guard", "protocol", "period"),
        ):
            Terminal().say(text)
        if is_installed("matplotlib"):
            from rans.show.figures.figures import save_flight_figures

            with doing("drawing the flights", in_log=False):
                save_flight_figures(flight, file.parent, suffix)
        Terminal().say(f"Written to {file.with_suffix('.html')}, {file.name}.")

    def _file(self, run: LoadedRun) -> Path:
        """File of the results, whose name has every option that changes figures; ConfigError if it is a link."""
        from rans.randomization.conditions import Conditions
        from rans.randomization.conditions_file import conditions_label

        conditions = ""
        if self.conditions is not None:
            conditions = conditions_label(self.conditions, run.conditions or Conditions())
        own = self.changed("start", "goal")
        names = (
            distinct(self.agent.part),
            "" if self.protocol == "own" else self.protocol,
            "" if self.period is None else f"period{self.period:g}",
            conditions,
            "guard" if self.guard else "",
            distinct("own", shlex.join(own)) if own else "",
            "drake" if self.engine == "drake" else "",
        )
        stem = "-".join(filter(None, ("evaluation", *names)))
        return inside(self.agent.output_folder, f"{stem}.json")

    def _named_conditions(self, conditions: Conditions) -> str:
        """Conditions as the user named them, or else what they change."""
        from rans.randomization.conditions_file import conditions_text

        lines = conditions_text(conditions).split("\n")
        changes = ", ".join(line for line in lines if line and not line.startswith("#"))
        return conditions.description or self.conditions or changes or "everything as designed"

    def _conditions(self, run: LoadedRun, episodes: int) -> dict[str, Any]:
        """Options that decide the results, for those who read their file."""
        options: dict[str, Any] = {
            "contestant": str(self.agent),
            "protocol": self.protocol,
            "episodes": episodes,
            "seed": self.seed,
        }
        if self.period is not None:
            options["period"] = self.period
        if self.start or self.goal:
            options |= {"start": " ".join(self.start), "goal": " ".join(self.goal)}
        if run.guard is not None:
            options["guard"] = asdict(run.guard)  # pyrefly: ignore[bad-argument-type]
        if run.conditions is None:
            return options
        return options | {"conditions": asdict(run.conditions)}
