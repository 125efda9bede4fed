"""What a mission's agents and opponents are worth: ``python -m campaigns MISSION``.

MISSION is one of dock, hold, rendezvous, land, avoid, dock-port, final-approach. All contestants fly from the same
held-out starts.
Proven bounds of the first of these starts stand beside them, ratio by ratio.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Any, Literal, cast

import numpy as np
import tyro
from rans_missions.bounds.first_starts import mission_bounds
from rans_missions.bounds.transfers import least_of_approaches
from rans_missions.control.convex_guidance import ConvexGuidance
from rans_missions.control.corridor import Corridor
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.tasks import FinalApproach
from rans_missions.tasks.orbital import OrbitalMission

from rans.base.pretrained import pretrained_names
from rans.control.lqr import LQR
from rans.episode.flight import Controller, Flight, fly
from rans.episode.scenario import EVALUATION_SEED, Scenario, scenarios
from rans.episode.step import Setup
from rans.evaluation.compare.contest import Contest
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.measure.metrics import impulses, won
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.flight import fly_in_drake
from rans.tasks import TASKS

Mission = Literal["dock", "hold", "rendezvous", "land", "avoid", "dock-port", "final-approach"]

_DEADLINES = {
    "dock": (600.0, 1000.0, 2000.0),
    "hold": (600.0, 1000.0, 1900.0),
    "rendezvous": (4000.0, 5000.0, 7000.0),
}
"""By which missions on an orbit are to be won, s."""
_VARIED: dict[str, dict[str, dict[str, Any]]] = {
    "avoid": {
        "default zones": {},
        "fixed zones": {"zone_speed": (0.0, 0.0)},
        "all at 0.04 m/s": {"zone_speed": (0.04, 0.04)},
    },
    "dock-port": {
        "default rates": {},
        "at rest": {"port_rate": (0.0, 0.0)},
        **{f"{rate} deg/s": {"port_rate": (math.radians(rate),) * 2} for rate in (1, 2, 3)},
    },
    "land": {"": {}},
}
"""Settings of the task by what the table calls them."""

_WITHOUT_TRAINING = "avoid", "dock-port"
"""Missions that controllers without training fly too."""
_PREDICTED = 8
"""Number of starts of MPC, which solves an optimal control problem in every period."""


@dataclass(frozen=True)
class Missions:
    """Fly everybody."""

    mission: Annotated[Mission, tyro.conf.Positional]
    """Which mission."""
    agents: tuple[str, ...] = ()
    """Run folders or pretrained:NAME that fly too, beside those that come with RANS."""
    episodes: int = 1024
    """Held-out starts of agents and of guidance that needs no program."""
    bounded: int = 32
    """The first of them, whose bounds are found and which LQR flies."""
    planned: int | None = None
    """The first of them that convex guidance flies by the latest deadline; by others it flies `bounded`."""
    drake: int = 0
    """The first of them that agents fly in Drake too."""
    deadlines: tuple[float, ...] = ()
    """Deadlines of a mission on an orbit, s; by default all of the page."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """Rows of all conditions."""
        if self.mission == "final-approach":
            return self._approaches()
        return self._orbital() if self.mission in _DEADLINES else self._others()

    def _specs(self) -> list[str]:
        """Agents of this mission that come with RANS, and those that are named."""
        ours = [name for name in pretrained_names() if _mission_of(name) == self.mission]
        return [*(f"pretrained:{name}" for name in ours), *self.agents]

    def _orbital(self) -> Iterator[dict[str, Any]]:
        """Missions on an orbit: every deadline, everybody."""
        mission = TASKS[self.mission]().for_evaluation()
        assert isinstance(mission, OrbitalMission)
        assert mission.spacecraft is not None
        craft = load_spacecraft(mission.spacecraft)
        agents = {spec: contestant(spec).controller for spec in self._specs()}
        deadlines = self.deadlines or _DEADLINES[self.mission]
        for deadline in deadlines:
            planned = self.planned if deadline == max(deadlines) else None
            task = replace(mission, deadline=(deadline, deadline))
            condition = f"{deadline:,.0f} s"
            starts = scenarios(task, craft, self.seed, self.episodes)
            few = scenarios(task, craft, self.seed, self.bounded)
            setup = Setup(craft, task, task.timing)
            lower = of_first(least(setup, self.seed, self.bounded), self.episodes)
            with warnings.catch_warnings():
                # That they do not know the limits is what the table shows.
                warnings.filterwarnings("ignore", message=".* does not know the constraints .*")
                for who, agent in agents.items():
                    yield from self._flown(condition, who, setup, agent, lower)
                fewer = scenarios(task, craft, self.seed, planned or self.bounded)
                makers: dict[str, tuple[Callable[..., Controller], Scenario]] = {
                    "mission guidance": (MissionGuidance, starts),
                    "convex guidance": (ConvexGuidance, fewer),
                    "LQR": (LQR, few),
                }
                if not MissionGuidance.keeps_limits(task):
                    del makers["mission guidance"]
                for who, (made, flown) in makers.items():
                    flight = fly(craft, task, made(craft, task, task.timing), flown, task.timing)
                    yield row_of(condition, who, flight, impulses(flight), lower)

    def _approaches(self) -> Iterator[dict[str, Any]]:
        """Guidance of final approaches, and the cheapest flights found from the first starts."""
        task: Any = FinalApproach().for_evaluation()
        craft = load_spacecraft(task.spacecraft)
        starts = scenarios(task, craft, self.seed, self.bounded)
        found = least_of_approaches(craft, task, starts)
        lower = of_first(found.lower, self.episodes)
        yield from self._flown(
            "", "corridor", Setup(craft, task, task.timing), Corridor(craft, task), lower
        )
        both = np.isfinite(found.upper)
        ratios = (found.upper / found.lower)[both]
        yield row("", "cheapest found", both, found.flight.violated(), found.upper, ratios)

    def _flown(
        self, condition: str, who: str, setup: Setup, agent: Controller, lower: np.ndarray
    ) -> Iterator[dict[str, Any]]:
        """An agent in our engine, and in Drake where that is asked for."""
        craft, task, timing = setup[:3]
        for name, flying, count in (
            (who, fly, self.episodes),
            (f"{who}, in Drake", fly_in_drake, self.drake),
        ):
            if count:
                starts = scenarios(task, craft, self.seed, count)
                flight = flying(craft, task, agent, starts, timing)
                yield row_of(condition, name, flight, _spent(flight), lower)

    def _others(self) -> Iterator[dict[str, Any]]:
        """Missions without a deadline: every variant of the task, every agent."""
        for spec in self._specs():
            run = contestant(spec)
            controller, craft, timing = run.controller, run.craft, run.timing
            task = run.task.for_evaluation()
            for condition, settings in _VARIED[self.mission].items():
                varied: Any = replace(cast(Any, task), **settings)
                setup = Setup(craft, varied, timing)
                lower = of_first(least(setup, self.seed, self.bounded), self.episodes)
                yield from self._flown(condition, spec, setup, controller, lower)
        if self.mission in _WITHOUT_TRAINING:
            yield from self._without_training()

    def _without_training(self) -> Iterator[dict[str, Any]]:
        """Controllers of the plane that keep the limits of a mission, apart from agents."""
        condition = next(iter(_VARIED[self.mission]))
        plane = f"{self.mission}-2d"
        flying = [
            ("MPC", f"mpc:{plane}", False, min(_PREDICTED, self.bounded)),
            ("LQR, filtered", f"lqr:{plane}", True, self.bounded),
        ]
        if self.mission == "dock-port":  # whose values come with RANS
            name = f"value:{plane}@floating-platform#0.5"
            flying.append((name, name, False, self.bounded))
        for who, spec, filtered, count in flying:
            run = contestant(spec).guarded(filtered)
            craft, task, timing = run.craft, run.task.for_evaluation(), run.timing
            starts = scenarios(task, craft, self.seed, count)
            with warnings.catch_warnings():
                # The filter knows the limits that LQR does not.
                warnings.filterwarnings("ignore", message=".* does not know the constraints .*")
                flight = fly(craft, task, run.controller, starts, timing, guard=run.guard)
            lower = least(Setup(craft, task, timing), self.seed, self.bounded)
            yield row_of(condition, who, flight, _spent(flight), lower)


def _mission_of(name: str) -> str:
    """The mission of an agent that comes with RANS, from its name such as dock-port-2d-atmos."""
    return name.partition("-2d")[0].partition("-3d")[0]


def of_first(values: Any, count: int) -> np.ndarray:
    """(count,) values that are known of the first starts alone; NaN: not known."""
    return np.pad(values, (0, count - len(values)), constant_values=np.nan)


@cache
def least(setup: Setup, seed: int, count: int) -> np.ndarray:
    """(count,) what no success spends less of, from each of the first starts: N s, of landings kg of propellant."""
    contest = Contest(setup.craft, setup.task, setup.timing, seed, count)
    return list(mission_bounds(contest, count))[-1].lower


def _spent(flight: Flight) -> np.ndarray:
    """(N,) propellant, kg, of craft that have some and lose it; else impulse, N s."""
    if not flight.craft.propellant:
        return impulses(flight)
    left = np.asarray(flight.states.stores[0])
    lengths = flight.lengths
    assert lengths is not None
    return left[0] - left[lengths, np.arange(left.shape[1])]


def row_of(
    condition: str, who: str, flight: Flight, spent: np.ndarray, lower: np.ndarray
) -> dict[str, Any]:
    """A flight's row, beside the bounds that are known of its starts.

    Numbers that are not known, such as a ratio without a bound, are NaN.
    """
    successes = won(flight)
    ratios = (spent / lower[: len(spent)])[successes]
    return row(condition, who, successes, flight.violated(), spent, ratios)


def row(
    condition: str,
    who: str,
    won: np.ndarray,
    violated: np.ndarray,
    spent: np.ndarray,
    ratios: np.ndarray,
) -> dict[str, Any]:
    """What one contestant is worth under one condition, of N starts.

    Args:
        condition: what varies, by the name that the table has for it.
        who: the contestant.
        won: (N,)
        violated: (N,) which broke a limit before the end.
        spent: (N,) N s, of landings kg.
        ratios: what those that won spent over the bound of the same start; NaN: no bound is known.
    """
    ratios = ratios[np.isfinite(ratios)]
    return {
        "condition": condition,
        "who": who,
        "starts": len(won),
        "won": float(won.mean()),
        "violated": float(violated.mean()),
        "ratio": float(ratios.mean()) if len(ratios) else math.nan,
        "worst": float(ratios.max()) if len(ratios) else math.nan,
        "spent": float(spent[won].mean()) if won.any() else math.nan,
        # Number of starts of these ratios.
        "compared": len(ratios),
    }
