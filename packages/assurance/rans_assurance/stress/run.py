"""Flights of every contestant under all conditions, on all processors; an interrupt keeps what was flown."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

from rans import Conditions, RansError
from rans.base.errors import meant
from rans.episode.flight import informed
from rans.evaluation.compare.contest import Contestant
from rans.evaluation.compare.entrants import Invited, enlisted
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.evaluation.fly.make_controller import controller
from rans.evaluation.fly.tuned import tuned
from rans.extend import (
    ConfigError,
    Contest,
    Controller,
    Estimate,
    Stages,
    Workers,
    counted,
    draws,
    first_line,
    fly_draws,
    unseen_stages,
)
from rans_assurance.stress.effects import Effect, Level, applicable_effects, failure_levels
from rans_assurance.stress.outcome import Limit, StressOutcome, holds_to

_PERFECT = Level("perfect", None, Conditions())
_SHARE = 1024
"""Number of episodes that a process flies at once."""


@dataclass
class Stress:
    """Plan and results of a comparison under disturbances and faults."""

    contest: Contest
    """Spacecraft, task and starts, under nominal conditions."""
    named: Sequence[Level]
    """Conditions without a size: nominal ones, conditions by name or file, and failed thrusters."""
    effects: Sequence[Effect]
    slow_episodes: int
    """Number of episodes of slow controllers, in place of the contest's."""
    contestants: dict[str, Contestant] = field(default_factory=dict)
    """Contestants by the text that named them; others are compared with the first."""
    outcomes: dict[tuple[str, str], StressOutcome] = field(default_factory=dict)
    """Outcomes by the names of level and contestant."""
    failures: list[str] = field(default_factory=list)
    """Failures of contestants, a sentence each."""
    stopped: dict[str, int] = field(default_factory=dict)
    """Number of times that the solver of each contestant found no solution."""
    not_flown: Sequence[str] = ()
    """Names of effects that were not chosen."""

    @cached_property
    def levels(self) -> list[Level]:
        """All levels: named conditions, then the sizes of every effect."""
        return [*self.named, *(level for effect in self.effects for level in effect.levels())]

    @property
    def names(self) -> list[str]:
        """Names of the contestants."""
        return [contestant.name for contestant in self.contestants.values()]

    def episodes(self, contestant: Contestant) -> int:
        """Number of episodes of a contestant at each level."""
        is_slow = getattr(contestant.controller, "slow", False)
        return min(self.slow_episodes, self.contest.episodes) if is_slow else self.contest.episodes

    def tuned_for(self, spec: str, level: Level) -> bool:
        """Whether a controller, by the text that named it, has settings tuned for the conditions of a level."""
        name = self.contestants[spec].registered
        if name not in CONTROLLERS or level.size is not None or level.conditions.or_none is None:
            return False
        setup = self.contest.setup._replace(conditions=level.conditions)
        result = tuned(name, setup)
        return result is not None and bool(result.conditions)

    def _controller(self, spec: str, level: Level) -> Controller:
        """A contestant at a level: it expects its conditions, or has the settings that were tuned for them."""
        if not self.tuned_for(spec, level):
            return informed(self.contestants[spec].controller, level.conditions)
        setup = self.contest.setup._replace(conditions=level.conditions)
        return controller(self.contestants[spec].registered, setup)

    def limit(self, effect: Effect, name: str) -> Limit:
        """Largest size up to which a contestant solves 99 % of its episodes."""
        return holds_to(*zip(*self._rates(effect, name), strict=True))

    def _rates(self, effect: Effect, name: str) -> list[tuple[float, Estimate | None]]:
        """Every size, the nominal one first, and a contestant's share of solved episodes; None: not flown."""
        sizes = (effect.nominal, *effect.sizes)
        outcomes = [self.outcomes.get((level.name, name)) for level in (_PERFECT, *effect.levels())]
        return [
            (size, None if outcome is None else outcome.share)
            for size, outcome in zip(sizes, outcomes, strict=True)
        ]

    def fly(self, stages: Stages = unseen_stages, workers: int | None = None) -> None:
        """Fly all contestants; one that fails is noted in ``failures`` and flies no more.

        After an interrupt the outcomes until then remain. Changes ``outcomes`` and ``failures``.

        Args:
            stages: reports progress.
            workers: processes, by default one per processor; 1: this one.
        """
        total = len(self.levels) * sum(map(self.episodes, self.contestants.values()))
        episodes = counted(self.contest.episodes, "episode")
        progress = stages(
            f"{len(self.levels) * len(self.contestants)} scenarios of {episodes}", total
        )
        contestants = list(self.contestants.values())
        # Level by level, so that the first results are of all contestants.
        jobs = [
            (level, k, self.episodes(contestant))
            for level in range(len(self.levels))
            for k, contestant in enumerate(contestants)
        ]
        # One controller for each contestant and scenario, in every process.
        arguments = (
            self.contest,
            [[self._controller(spec, level) for level in self.levels] for spec in self.contestants],
            [level.conditions.or_none for level in self.levels],
        )
        pool = Workers(_Flyer, arguments, workers, "flew episodes")
        lost: set[int] = set()
        for number, answer in pool.finished(_Flyer.tried, jobs):
            at, flying, count = jobs[number]
            progress(count)
            name = contestants[flying].name
            level = self.levels[at]
            if flying in lost:
                continue
            if isinstance(answer, str):
                lost.add(flying)
                self.failures.append(f"{name}, in {level.name}: {answer}")
                continue
            self.outcomes[level.name, name], stopped = answer
            self.stopped[name] = self.stopped.get(name, 0) + stopped


def prepared(
    contest: Contest,
    specs: Sequence[Invited],
    conditions: Mapping[str, Conditions],
    only: Sequence[str],
    slow_episodes: int,
    trust: bool = False,
) -> Stress:
    """Prepare a comparison under disturbances and faults, before any flight.

    Args:
        contest: contest of the first contestant, see `rans.evaluation.compare.entrants.contest_of`.
        specs: contestants; after the first also controllers by their bare names.
        conditions: conditions by their names, which reports show.
        only: names of effects; empty: all, and failed thrusters.
        slow_episodes: see `Stress`.
        trust: see `enlisted`.

    Raises:
        ConfigError: there is no such contestant, effect or conditions, or they are not for this craft.
    """
    contest = replace(contest, conditions=None)
    # Names of effects are checked before anything flies.
    available = applicable_effects(contest.craft, contest.timing)
    for name in only:
        if name not in [effect.name for effect in available]:
            raise ConfigError(
                f"there is no effect named {name!r}{meant(name, [e.name for e in available])}; "
                f"for {contest.craft.name} there are {', '.join(e.name for e in available)}."
            )
    # Named scenarios: perfect conditions first, those of the user, and failures unless effects were selected.
    named = [
        _PERFECT,
        *(
            Level(name, None, world)
            for name, world in conditions.items()
            if name != _PERFECT.effect
        ),
        *(() if only else failure_levels(contest.craft)),
    ]
    for level in named:
        level.conditions.check_craft(contest.craft)
    return Stress(
        contest,
        named,
        [e for e in available if not only or e.name in only],
        slow_episodes,
        enlisted(specs, contest, trust),
        not_flown=[e.name for e in available if only and e.name not in only],
    )


class _Flyer(NamedTuple):
    """Contestants and conditions, in each process."""

    contest: Contest
    controllers: Sequence[Sequence[Controller]]
    """Controllers by contestant and level."""
    conditions: Sequence[Conditions | None]

    def tried(self, level: int, contestant: int, count: int) -> tuple[StressOutcome, int] | str:
        """Outcomes of a contestant at a level and how often its solver stopped, or a sentence about its failure.

        A contestant with a sentence is left out of the rest.
        """
        try:
            with warnings.catch_warnings():
                # A craft whose controller fails under the conditions may tumble until numbers overflow.
                warnings.simplefilter("ignore")
                return self.flown(level, contestant, count)
        except RansError as error:
            return str(error)
        except Exception as error:  # solvers and other people's code raise anything
            return f"{type(error).__name__}: {first_line(error)}."

    def flown(self, level: int, contestant: int, count: int) -> tuple[StressOutcome, int]:
        """Outcomes of the first episodes of one contestant at one level, in shares that memory has room for."""
        flying = self.controllers[contestant][level]
        setup = self.contest.setup._replace(conditions=self.conditions[level])
        parts = []
        stopped = 0
        for first in range(0, count, _SHARE):
            own = draws(self.contest.seed, min(_SHARE, count - first), first)
            parts.append(StressOutcome.of(fly_draws(flying, setup, own)))
            stopped += getattr(flying, "failures", 0)
        return StressOutcome.joined(parts), stopped
