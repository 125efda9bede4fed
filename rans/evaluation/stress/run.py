"""Everybody flown in every world, on all processors; what was flown is kept when somebody interrupts."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

from rans.errors import ConfigError, RansError, meant
from rans.evaluation.compare.contest import Contest, Contestant
from rans.evaluation.compare.entrants import Invited, enlisted
from rans.evaluation.fly.episodes import fly_draws
from rans.evaluation.measure.statistics import Estimate
from rans.evaluation.stress.effects import Effect, Level, effects, failures
from rans.evaluation.stress.outcome import BreakEven, Outcome, break_even
from rans.files import first_line
from rans.flight import Controller
from rans.processes import Workers
from rans.progress import Stages, unseen_stages
from rans.randomization.conditions import Conditions
from rans.randomization.conditions_file import load_conditions
from rans.scenario import draws

_PERFECT = Level("perfect", None, Conditions())
_SHARE = 1024
_SLOW_SHARE = 8
"""Episodes that a process flies at once; of a controller that solves a problem for each."""


@dataclass
class Stress:
    """What is flown, and everything found so far."""

    contest: Contest
    """Plant, task and starts, in a perfect world."""
    named: Sequence[Level]
    """Worlds without a size: a perfect one, conditions by name or file, and failed thrusters."""
    effects: Sequence[Effect]
    slow_episodes: int
    """Number of episodes of controllers that are slow, in place of the contest's."""
    contestants: dict[str, Contestant] = field(default_factory=dict)
    """Contestants by the text that named them; others are compared with the first."""
    outcomes: dict[tuple[str, str], Outcome] = field(default_factory=dict)
    """Outcomes by the names of world and contestant."""
    failures: list[str] = field(default_factory=list)
    """What went wrong, a sentence each."""
    stopped: dict[str, int] = field(default_factory=dict)
    """Times that a contestant's solver found nothing."""

    @cached_property
    def levels(self) -> list[Level]:
        """Every world."""
        return [*self.named, *(level for effect in self.effects for level in effect.levels())]

    @property
    def names(self) -> list[str]:
        """Names of the contestants."""
        return [one.name for one in self.contestants.values()]

    def episodes(self, one: Contestant) -> int:
        """How many somebody flies in each world."""
        few = getattr(one.controller, "slow", False)
        return min(self.slow_episodes, self.contest.episodes) if few else self.contest.episodes

    def curve(self, effect: Effect, name: str) -> tuple[list[float], list[Estimate]]:
        """Sizes that somebody was flown at, the perfect world's first, and the shares held there."""
        sizes = (effect.nominal, *effect.sizes)
        worlds = (_PERFECT, *effect.levels())
        flown = [
            (size, self.outcomes[level.name, name].share)
            for size, level in zip(sizes, worlds, strict=True)
            if (level.name, name) in self.outcomes
        ]
        return [size for size, _ in flown], [found for _, found in flown]

    def break_even(self, effect: Effect, other: str) -> BreakEven | None:
        """Size at which the first contestant and another are equally good; None: both flew too few sizes."""
        (sizes, first), (others, second) = (
            self.curve(effect, name) for name in (self.names[0], other)
        )
        both = [size for size in sizes if size in others]
        if len(both) < 2:
            return None
        return break_even(
            both,
            *(
                [found[have.index(size)] for size in both]
                for have, found in ((sizes, first), (others, second))
            ),
        )

    def fly(self, stages: Stages = unseen_stages, workers: int | None = None) -> None:
        """Fly everyone; a contestant that fails is named in ``failures`` and flies no more.

        An interrupt leaves what was flown.

        Args:
            stages: reports progress.
            workers: processes, by default one per processor; 1: this one.
        """
        total = len(self.levels) * sum(map(self.episodes, self.contestants.values()))
        progress = stages(f"{len(self.levels)} scenarios", total)
        made = list(self.contestants.values())
        jobs = list(_jobs(self))
        given = (
            self.contest,
            [one.controller for one in made],
            [level.conditions.or_none for level in self.levels],
        )
        pool = Workers(_Flyer, given, workers, "flew episodes")
        parts: dict[tuple[int, int], dict[int, _Part]] = {}
        lost: set[int] = set()
        for number, answer in pool.finished(_Flyer.tried, jobs):
            job = jobs[number]
            progress(job.episodes)
            name = made[job.contestant].name
            level = self.levels[job.level]
            if job.contestant in lost:
                continue
            if isinstance(answer, str):
                lost.add(job.contestant)
                self.failures.append(f"{name}, in {level.name}: {answer}")
                continue
            flown = parts.setdefault((job.level, job.contestant), {})
            flown[job.first] = answer
            self.stopped[name] = self.stopped.get(name, 0) + answer.stopped
            if sum(len(part.outcome.excess) for part in flown.values()) == self.episodes(
                made[job.contestant]
            ):
                self.outcomes[level.name, name] = Outcome.joined(
                    [flown[k].outcome for k in sorted(flown)]
                )


def prepared(
    contest: Contest,
    specs: Sequence[Invited],
    conditions: Sequence[str],
    only: Sequence[str],
    slow_episodes: int,
    trust: bool = False,
) -> Stress:
    """What is to be flown.

    Args:
        contest: of the first contestant, see `rans.evaluation.compare.entrants.contest_of`.
        specs: contestants; after the first also controllers by their bare names.
        conditions: by name or file.
        only: names of effects, or nothing for all, and for failed thrusters too.
        slow_episodes: see `Stress`.
        trust: see `enlisted`.

    Raises:
        ConfigError: there is no such contestant, effect or conditions, or they are not for this craft.
    """
    contest = replace(contest, conditions=None)
    known = effects(contest.craft, contest.timing)
    for name in only:
        if name not in [effect.name for effect in known]:
            raise ConfigError(
                f"there is no effect named {name!r}{meant(name, [e.name for e in known])}; "
                f"for {contest.craft.name} there are {', '.join(e.name for e in known)}."
            )
    named = [
        _PERFECT,
        *(
            Level(name, None, load_conditions(name))
            for name in dict.fromkeys(conditions)
            if name != _PERFECT.effect
        ),
        *(() if only else failures()),
    ]
    for level in named:
        level.conditions.check_valves(contest.craft)
    return Stress(
        contest,
        named,
        [e for e in known if not only or e.name in only],
        slow_episodes,
        enlisted(specs, contest, trust),
    )


class _Job(NamedTuple):
    """Consecutive episodes of one contestant in one world."""

    level: int
    contestant: int
    first: int
    episodes: int


class _Part(NamedTuple):
    outcome: Outcome
    stopped: int


def _jobs(stress: Stress) -> Iterator[_Job]:
    """World by world, so that what is flown first can be compared."""
    for level in range(len(stress.levels)):
        for k, one in enumerate(stress.contestants.values()):
            count = stress.episodes(one)
            share = _SLOW_SHARE if getattr(one.controller, "slow", False) else _SHARE
            for first in range(0, count, share):
                yield _Job(level, k, first, min(share, count - first))


class _Flyer(NamedTuple):
    """Contestants and worlds, as each process has them."""

    contest: Contest
    controllers: Sequence[Controller]
    worlds: Sequence[Conditions | None]

    def tried(self, level: int, contestant: int, first: int, count: int) -> _Part | str:
        """Consecutive episodes of one contestant in one world, or what went wrong in a sentence."""
        try:
            with warnings.catch_warnings():
                # A controller that cannot bear a world may well tumble and overflow there.
                warnings.simplefilter("ignore")
                return self.flown(level, contestant, first, count)
        except RansError as error:
            return str(error)
        except Exception as error:  # solvers and other people's code raise anything
            return f"{type(error).__name__}: {first_line(error)}."

    def flown(self, level: int, contestant: int, first: int, count: int) -> _Part:
        """Consecutive episodes of one contestant in one world."""
        controller = self.controllers[contestant]
        setup = self.contest.setup._replace(conditions=self.worlds[level])
        flight = fly_draws(controller, setup, draws(self.contest.seed, count, first))
        return _Part(Outcome.of(flight), getattr(controller, "failures", 0))
