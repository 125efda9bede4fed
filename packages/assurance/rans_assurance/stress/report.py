"""A robustness sweep as data: stress.json, which `rans_assurance.sections.stress` says in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rans.evaluation.fly.evidence import about
from rans.evaluation.measure.statistics import too_few
from rans.extend import (
    QUANTITIES,
    WANTED,
    Section,
    conditions_text,
    counted,
    inside,
    view_command,
    write_json,
    write_text,
)
from rans_assurance.scope import conditions_texts, scope
from rans_assurance.sections.stress import stress_section
from rans_assurance.stress.effects import Effect, Level
from rans_assurance.stress.run import Stress

TEXT = (
    "An episode is solved if it is within all tolerances of the task at every step of its last fifth, by the "
    "true state; a mission if it is won and no limit is broken. All contestants fly the same episodes of one "
    "craft. A disturbance comes alone, of the same size in every episode; its direction and position are drawn "
    "anew and hidden from the contestants. Shares have Wilson's 95 % intervals."
)
"""How it is judged."""


@dataclass(frozen=True)
class StressReport:
    """Report of a stress test, in the folder that it is written to."""

    stress: Stress
    folder: Path
    worst: int
    """Episodes that are listed of each contestant in each scenario."""
    made_by: str = "rans.stress"
    """The function, for files that Python has written."""

    def __repr__(self) -> str:
        rows = self.section.tables[0].rows
        shares = ", ".join(f"{row[0]} {'/'.join(row[1:])}" for row in rows)
        return f"<StressReport of {self.title()}: solved in {shares}>"

    def _repr_html_(self) -> str:
        from rans.extend import html_of

        return html_of(self.section)

    @property
    def section(self) -> Section:
        """What it says, as its file says it."""
        return stress_section(self.folder / "stress.json", self.to_json())

    def write(self) -> None:
        """Write stress.json and a file of conditions for every scenario."""
        write_json(self.folder / "stress.json", self.to_json(), beside=["stress"])
        for level in self.stress.levels:
            if self._file(level):
                text = f"# {level.name}: see stress.json\n{conditions_text(level.conditions)}"
                write_text(inside(self.folder, "stress") / f"{level.name}.toml", text)

    def title(self) -> str:
        """Title of the report: tasks, spacecraft and contestants."""
        contest = self.stress.contest
        episodes = counted(contest.episodes, "episode")
        return (
            f"{', '.join(self.stress.names)}: {episodes} of seed {contest.seed}, "
            f"{contest.craft.name}, {contest.duration:g} s at {1.0 / contest.timing.control_period:g} Hz"
        )

    @property
    def is_partial(self) -> bool:
        """Whether the sweep was interrupted: some contestant has not flown some scenario."""
        return self.flown() < self._planned() and not self.stress.failures

    def flown(self) -> int:
        """Number of scenarios that were flown, each contestant's counted by itself."""
        return len(self.stress.outcomes)

    def _planned(self) -> int:
        return len(self.stress.levels) * len(self.stress.contestants)

    def notes(self) -> Iterator[str]:
        """Notes on the contestants: tuned settings, fewer episodes, stopped solvers."""
        if self.is_partial:
            yield (
                f"Interrupted after {self.flown()} of {self._planned()} scenarios: the others, and those that "
                "were not flown to the end, are left out."
            )
        least = min(map(self.stress.episodes, self.stress.contestants.values()))
        if 1.0 / least > 1.0 - WANTED:  # one episode alone is more than may be lost
            yield too_few(least)
        for spec, contestant in self.stress.contestants.items():
            tuned = [
                level.effect for level in self.stress.named if self.stress.tuned_for(spec, level)
            ]
            if tuned:
                yield f"{contestant.name} flies {', '.join(tuned)} with settings that were tuned for it."
            count = self.stress.episodes(contestant)
            stopped = self.stress.stopped.get(contestant.name, 0)
            if count < self.stress.contest.episodes:
                yield f"{contestant.name} is slow and flew {counted(count, 'episode')} in each scenario."
            if stopped:
                yield (
                    f"{contestant.name}'s solver stopped {counted(stopped, 'time')}; the plan before was flown on."
                )

    def command(self, level: Level, spec: str, episode: int) -> str:
        """Command that replays an episode of a contestant beside the first that knows the task."""
        who = dict.fromkeys((next(iter(self.stress.contestants)), spec))
        world = (
            str(self.folder / "stress" / f"{level.name}.toml")
            if self._file(level)
            else level.effect
        )
        return view_command(who, self.stress.contest.task, world, episode, self.stress.contest.seed)

    def to_json(self) -> dict[str, Any]:
        """Content of stress.json."""
        stress = self.stress
        contest = stress.contest
        asked = scope(contest.setup, contest.starts)
        contents = [
            (f"scenario {level.name}", "; ".join(conditions_texts(level.conditions)))
            for level in stress.named
        ]
        rows = [row for row in asked if row[0] != "conditions"]
        return {
            "title": self.title(),
            "text": TEXT,
            "is_partial": self.is_partial,
            "scope": {"rows": [*rows, *contents]},
            "seed": contest.seed,
            "not flown": stress.not_flown,
            "contestants": {
                contestant.name: {
                    "spec": spec,
                    "knows": contestant.knows,
                    "tuning": contestant.tuning,
                    "episodes": stress.episodes(contestant),
                }
                for spec, contestant in stress.contestants.items()
            },
            "conditions": {level.name: self._level(level) for level in stress.levels},
            "effects": {effect.name: self._effect(effect) for effect in stress.effects},
            "notes": [*self.notes()],
            "failures": stress.failures,
            **about(next(iter(stress.contestants), ""), contest.setup, self.made_by),
        }

    def _file(self, level: Level) -> bool:
        """Whether a scenario has no name, or file, by which `rans view` knows it."""
        return level.size is not None or level.effect.startswith("one thruster")

    def _level(self, level: Level) -> dict[str, Any]:
        """Row of a level in stress.json: its conditions as text, and outcomes by contestant."""
        return {
            "effect": level.effect,
            "size": level.size,
            "conditions": conditions_text(level.conditions),
            "contestants": {
                contestant.name: self._outcome(level, spec, contestant.name)
                for spec, contestant in self.stress.contestants.items()
                if (level.name, contestant.name) in self.stress.outcomes
            },
        }

    def _outcome(self, level: Level, spec: str, name: str) -> dict[str, Any]:
        """Data of one contestant under one level: how many held, and its worst episodes.

        Its keys are those of stress.json, which later runs and campaigns read.
        """
        result = self.stress.outcomes[level.name, name]
        errors = {
            f"{quantity}, {QUANTITIES[quantity].unit}": error
            for quantity, error in result.errors.items()
        }
        return {
            "episodes": len(result.excess),
            "held": asdict(result.share),
            "worst": [
                {
                    "episode": k,
                    "see": self.command(level, spec, k),
                    "errors": {what: float(error[k]) for what, error in errors.items()},
                }
                for k in result.worst(self.worst)
            ],
        }

    def _effect(self, effect: Effect) -> dict[str, Any]:
        """Row of an effect in stress.json.

        Its sizes, and up to where each holds.
        """
        stress = self.stress
        limits = {name: stress.limit(effect, name) for name in stress.names}
        return {
            "unit": effect.unit,
            "nominal": effect.nominal,
            "sizes": effect.sizes,
            "holds_to": {
                name: limit.size if limit.is_known else None for name, limit in limits.items()
            },
            "not_finished": {
                name: limit.size for name, limit in limits.items() if not limit.is_known
            },
        }
