"""A stress report: rows for the terminal, the JSON file and one HTML page.

Terminal, JSON and page take the same rows from it; keys of the JSON are read back by `report_sections`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Any

from rans.evaluation.fly.contestants import view_command
from rans.evaluation.stress.effects import Effect, Level
from rans.evaluation.stress.outcome import WANTED, too_few, wanted
from rans.extend import (
    QUANTITIES,
    Finding,
    Section,
    Table,
    conditions_text,
    counted,
    environment,
    inside,
    write_json,
    write_text,
)
from rans.show.pages.notebook import listed
from rans.show.pages.page import Page, Picture, header
from rans_assurance.figures import stress_figures as figures
from rans_assurance.scope import Scope, conditions_texts, scope
from rans_assurance.stress.run import Stress

TEXT = (
    "An episode is solved if it is within all tolerances of the task at every step of its last fifth, by the "
    "true state; a mission if it is won and no limit is broken. All contestants fly the same episodes of one "
    "craft. A disturbance comes alone, of the same size in every episode; its direction and position are drawn "
    "anew and hidden from the contestants. Shares have Wilson's 95 % intervals. A contestant is ahead where two "
    "intervals share no point."
)
"""How it is judged."""


@dataclass(frozen=True)
class StressReport:
    """Report of a stress test, in the folder that it is written to."""

    stress: Stress
    folder: Path
    worst: int
    """Episodes that are listed of each contestant in each scenario."""
    made_by: str = ""
    """The command."""

    def __repr__(self) -> str:
        shares = ", ".join(
            f"{row[0]} {'/'.join(cell or '-' for cell in row[1:])} %" for row in self.named_rows()
        )
        return f"<StressReport of {self.title()}: solved in {shares}>"

    def _repr_html_(self) -> str:
        """Tables of the notebook: shares solved by scenario, and the sizes up to which contestants hold."""
        shares = listed(
            f"Solved, %: {self.title()}",
            ("scenario", *self.stress.names),
            [tuple(cell or "-" for cell in row) for row in self.named_rows()],
        )
        borne = listed(
            self.limit_title(),
            self.effect_columns(),
            self.effect_rows(),
        )
        return shares + (borne if self.stress.effects else "")

    def write(self) -> None:
        """Write stress.html, stress.json and a file of conditions for every scenario."""
        for level in self.stress.levels:
            if self._file(level):
                text = f"# {level.name}: see stress.html\n{conditions_text(level.conditions)}"
                write_text(inside(self.folder, "stress") / f"{level.name}.toml", text)
        write_json(self.folder / "stress.json", self.to_json())
        self.page().write(self.folder / "stress.html")

    def title(self) -> str:
        """Title of the report: tasks, spacecraft and contestants."""
        contest = self.stress.contest
        episodes = counted(contest.episodes, "episode")
        return (
            f"{', '.join(self.stress.names)}: {episodes} of seed {contest.seed}, "
            f"{contest.craft.name}, {contest.duration:g} s at {1.0 / contest.timing.control_period:g} Hz"
        )

    def limit_title(self) -> str:
        """Title of `effect_rows`."""
        return f"Size of a disturbance up to which {wanted(max(self._counts()))} are solved"

    def _counts(self) -> list[int]:
        """Episodes of each contestant in a scenario."""
        return [*map(self.stress.episodes, self.stress.contestants.values())]

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
                f"Interrupted after {self.flown()} of {self._planned()} scenarios: the others are left out."
            )
        least = min(self._counts())
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

    def named_rows(self) -> list[list[str | None]]:
        """Rows of named scenarios: name, then the rate of success of each contestant."""
        return [[level.effect, *rates] for level, rates in self._known(self.stress.named)]

    def _known(self, levels: Iterable[Level]) -> Iterator[tuple[Level, list[str | None]]]:
        """Scenarios in which somebody flew, and the share that each contestant solved."""
        for level in levels:
            rates = self._shares(level)
            if any(rates):
                yield level, rates

    def effect_columns(self) -> list[str]:
        """Headings of `effect_rows`."""
        return [
            "disturbance",
            "unit",
            *self.stress.names,
            *(f"{self.stress.names[0]} or {rival}" for rival in self.stress.names[1:]),
        ]

    def effect_rows(self) -> list[list[str]]:
        """Row of every flown effect.

        Up to which size each contestant solves 99 %, and by how much the first leads.
        """
        stress = self.stress
        return [
            [
                effect.name,
                effect.unit,
                *(_reach(stress, effect, name) for name in stress.names),
                *(_lead(stress, effect, rival) for rival in stress.names[1:]),
            ]
            for effect in self._flown_effects()
        ]

    def _flown_effects(self) -> list[Effect]:
        """Effects of which at least one size was flown, by any contestant, in their own order."""
        outcomes = self.stress.outcomes
        return [
            effect
            for effect in self.stress.effects
            if any(
                (level.name, name) in outcomes
                for level in effect.levels()
                for name in self.stress.names
            )
        ]

    def command(self, level: Level, spec: str, episode: int) -> str:
        """Command that replays an episode of a contestant beside the first that knows the task."""
        who = dict.fromkeys((next(iter(self.stress.contestants)), spec))
        world = (
            str(self.folder / "stress" / f"{level.name}.toml")
            if self._file(level)
            else level.effect
        )
        return view_command(who, self.stress.contest.task, world, episode, self.stress.contest.seed)

    def worst_rows(self) -> Iterator[list[str]]:
        """The worst episodes in each named scenario, and at the smallest size that was too much."""
        for level in self._telling():
            for spec, contestant in self.stress.contestants.items():
                result = self.stress.outcomes.get((level.name, contestant.name))
                for k in result.worst(self.worst) if result else ():
                    yield [
                        level.name,
                        contestant.name,
                        str(k),
                        self._errors(level, contestant.name, k),
                        self.command(level, spec, k),
                    ]

    def to_json(self) -> dict[str, Any]:
        """Content of stress.json, which `rans_assurance.pages.report_sections` reads back."""
        stress = self.stress
        return {
            "title": self.title(),
            "text": TEXT,
            "scope": {"sentence": self._scope.asked, "rows": self._asked()},
            "seed": stress.contest.seed,
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
            "environment": environment(),
        }

    def page(self) -> Page:
        """Page of everything, the same rows as `to_json`; sections of sizes are there if any size was flown."""
        stress = self.stress
        contest = self.stress.contest
        sections = [
            Section("What was asked", "", [Table(("", "it is"), self._asked())]),
            Section(
                "Conditions and failed thrusters",
                " ".join([TEXT, *self.notes()]),
                [Table(("solved, %", *stress.names), self.named_rows())],
                [Picture.of(figures.named_figure(stress), "Solved episodes, %.")],
                [
                    *(Finding(text, False) for text in stress.failures),
                    *map(Finding, self.successes()),
                ],
            ),
        ]
        if self._flown_effects():
            text = (
                f"The size up to which {wanted(max(self._counts()))} are solved, of the sizes flown, and "
                "that to which two are equally good; where the lead changes hands, between two sizes."
            )
            table = Table(self.effect_columns(), self.effect_rows())
            sections.append(Section("Largest disturbance tolerated", text, [table]))
        sections += [
            self._group(group, [*some])
            for group, some in groupby(self._flown_effects(), key=lambda effect: effect.group)
        ]
        if self.worst:
            text = (
                "By number, the farthest from their goals first, with the largest errors of their last "
                "fifth: of the named scenarios, and of the smallest size that was too much. The "
                "command shows that very episode."
            )
            columns = (
                "scenario",
                "contestant",
                "episode",
                "largest errors",
                "command that shows it",
            )
            sections.append(Section("Worst episodes", text, [Table(columns, [*self.worst_rows()])]))
        about = {
            "command": self.made_by,
            "task": type(contest.task).__name__,
            "spacecraft": contest.craft.name,
            "environment": environment(),
        }
        return Page(f"Stress: {self.title()}", sections, header(about), self._verdict())

    @cached_property
    def _scope(self) -> Scope:
        return scope(self.stress.contest.setup, self.stress.contest.starts)

    def _asked(self) -> list[tuple[str, str]]:
        """Requirement, length and starts, and the content of every scenario that has a name."""
        contents = [
            (f"scenario {level.name}", "; ".join(conditions_texts(level.conditions)))
            for level in self.stress.named
        ]
        return [*(row for row in self._scope.rows if row[0] != "conditions"), *contents]

    def _verdict(self) -> str:
        """The page's first sentences: the result, and what was asked."""
        if result := self._result():
            return f"{result} {self._scope.asked}"
        return ""

    def _result(self) -> str:
        if self.stress.failures:
            return ""
        if self.is_partial:
            return next(iter(self.notes()))
        return next(self.successes(), "")

    def successes(self) -> Iterator[str]:
        """In how many named scenarios each contestant solves enough episodes, in a sentence."""
        for contestant in self.stress.contestants.values():
            name = contestant.name
            rates = [
                result.share.value
                for level in self.stress.named
                if (result := self.stress.outcomes.get((level.name, name)))
            ]
            enough = sum(rate >= WANTED for rate in rates)
            count = counted(len(rates), "named scenario")
            episodes = self.stress.episodes(contestant)
            yield f"{name} solves {wanted(episodes)} in {enough} of {count}."

    def _group(self, group: str, some: list[Effect]) -> Section:
        """Section of the effects of one group, with a row for every flown size and a picture an effect."""
        rows = [
            [level.effect, f"{level.size:g} {effect.unit}", *rates]
            for effect in some
            for level, rates in self._known(effect.levels())
        ]
        pictures = [
            Picture.of(
                figures.effect_figure(self.stress, effect),
                f"Solved episodes over {effect.name}, {effect.unit}.",
            )
            for effect in some
        ]
        return Section(
            group, "", [Table(("solved, %", "size", *self.stress.names), rows)], pictures
        )

    def _shares(self, level: Level) -> list[str | None]:
        outcomes = (self.stress.outcomes.get((level.name, name)) for name in self.stress.names)
        return [
            outcome.share.scaled(100.0).text(".1f") if outcome else None for outcome in outcomes
        ]

    def _file(self, level: Level) -> bool:
        """Whether a scenario has no name, or file, by which `rans view` knows it."""
        return level.size is not None or level.effect.startswith("one thruster")

    def _telling(self) -> Iterator[Level]:
        """Named scenarios, and of each effect the smallest size that somebody did not solve."""
        yield from self.stress.named
        for effect in self.stress.effects:
            lost = (
                level
                for level in effect.levels()
                for name in self.stress.names
                if (result := self.stress.outcomes.get((level.name, name)))
                and not result.solved.all()
            )
            yield from [level for level in [next(lost, None)] if level]

    def _errors(self, level: Level, name: str, episode: int) -> str:
        """The largest errors of the last fifth of an episode, in units for people."""
        errors = self.stress.outcomes[level.name, name].errors
        largest = (
            (factor * errors[q][episode], unit)
            for q in errors
            for factor, unit in [QUANTITIES[q].display]
        )
        return ", ".join(
            # From 999.5 on three digits would be a power of ten.
            f"{x:,.0f} {unit}" if x >= 999.5 else f"{x:.3g} {unit}"
            for x, unit in largest
        )

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

        Its sizes, up to where each holds, and where the first and another break even.
        """
        stress = self.stress
        pairs = {rival: stress.break_even(effect, rival) for rival in stress.names[1:]}
        limits = {name: stress.limit(effect, name) for name in stress.names}
        return {
            "unit": effect.unit,
            "nominal": effect.nominal,
            "sizes": effect.sizes,
            "holds_to": {
                name: limit.size if limit.is_known else None for name, limit in limits.items()
            },
            "not_finished": [name for name, limit in limits.items() if not limit.is_known],
            "break_even_of_first": {
                name: pair and {**pair._asdict(), "text": _lead(stress, effect, name)}
                for name, pair in pairs.items()
            },
        }


def _reach(stress: Stress, effect: Effect, name: str) -> str:
    """To which size somebody holds 99 %; "none" where no size that was flown is small enough."""
    size, is_known = stress.limit(effect, name)
    if not is_known:
        if size is None or size == effect.nominal:
            return "not finished"
        return f"{size:g} or {'more' if size > effect.nominal else 'less'}, not finished"
    if size is None or size == effect.nominal:
        return "none"
    return f"all to {size:g}" if size == effect.sizes[-1] else f"{size:g}"


def _lead(stress: Stress, effect: Effect, rival: str) -> str:
    result = stress.break_even(effect, rival)
    first = stress.names[0]
    if result is not None and result.size == effect.nominal:
        return f"{first if result.after == 1 else rival} from {effect.sizes[0]:g} {effect.unit} on"
    return "-" if result is None else result.text(first, rival, effect.unit)
