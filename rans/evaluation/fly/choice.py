"""How an agent for any craft flies a craft: flights of the craft decide its value and control period, once.

The decision is kept in the user's cache, by a hash of everything that it depends on.
"""

from __future__ import annotations

import contextlib
import hashlib
import math
import os
import warnings
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rans.base.errors import ConfigError, RansWarning
from rans.base.files import package_version, read_json, write_json
from rans.episode.scenario import CHOICE_SEED
from rans.episode.step import Setup
from rans.evaluation.fly.agent import LoadedRun
from rans.evaluation.fly.any_craft import for_spacecraft, frugal
from rans.model.pace import misfits
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import to_toml
from rans.policy.backbones import any_craft
from rans.randomization.conditions import Conditions
from rans.tasks.go_to_pose import GoToPose

VALUES = (0.4, 0.3, 0.0, 1.0)
"""Values in the order in which they are tried: 0.4 is quicker and cheaper than LQR on nearly all craft, smaller
values settle craft whose flights are short or whose thrusters are coarse, and 1 strong craft with late valves."""
CHEAPER = (0.5, 0.6)
"""Values that are tried where the chosen one is not as quick and cheap as controllers without training."""
RIVALS = ("lqr", "switching")
"""Controllers without training that fly beside the choice; in space, where they take seconds, the first alone, and
only beside one that loses flights."""
_BESIDE = 16
"""Number of their flights, from the first starts: of crooked craft 64 of LQR take 12 s."""
_AS_GOOD = 1.02
"""Factor up to which times and impulses of so few flights are the same."""
MORE = 0.05
"""Part of the flights by which another has to solve more to be named in place of the choice."""
LARGER = (1.0, 0.8, 0.6)
"""Larger values that are tried afterwards in the plane, until no flight is lost. In space each takes 1 to 3 s."""
FLIGHTS = {2: 256, 3: 128}
"""Number of flights of a candidate, by dimension. They take hardly longer than 32, of which a craft that loses 3 %
of its flights may lose none."""
ENOUGH = 0.95
"""Part of the flights below which a cause is named (`ContestantName.shortfall`)."""
_SURE = 0.99
"""Part of the flights of a choice below which it is doubted."""
_COARSE = 0.2
"""Control period above which a shorter one is tried, s."""
_VERSION = 5
"""Version of the rule of choice; a cached choice of another version is made anew."""


class Rival(NamedTuple):
    """A controller without training, and what its flights from the first starts of a choice gave."""

    name: str
    solved: float
    """Part of the flights."""
    time: float
    """Median settling time, s; infinite if less than half settle."""
    impulse: float
    """Mean impulse, N s."""

    def is_beaten_by(self, other: Rival) -> bool:
        """Whether another solves as many flights, is no slower and no dearer."""
        return (
            other.solved >= self.solved
            and other.time <= _AS_GOOD * self.time
            and other.impulse <= _AS_GOOD * self.impulse
        )

    def told(self, agent: str, craft: str) -> tuple[str, str]:
        """Its name as a contestant with a craft beside an agent, and what its flights gave, in a sentence."""
        name = f"{self.name}:go-to-pose-{agent[-2:]}@{craft}"
        time = f"{self.time:.3g} s" if math.isfinite(self.time) else "no settling time"
        solved = f"solved {round(self.solved * _BESIDE)} of {_BESIDE}"
        return name, f"{name}: {solved}, {time}, {self.impulse:.3g} N s."


class Choice(NamedTuple):
    """A value and a control period, and what flights of the craft gave."""

    value: float
    period: float
    """s."""
    flights: int
    solved: int
    """Number of the flights that were solved."""
    time: float
    """Median settling time, s; infinite if less than half settle."""
    impulse: float
    """Mean impulse, N s."""
    lost: float = 0.0
    """Least of the larger values tried at which flights are lost; 0: none, or none was tried."""
    rival: Rival | None = None
    """The controller without training that solves more flights, or as many quicker and cheaper; None: neither."""

    @property
    def is_enough(self) -> bool:
        """Whether so many flights are solved that nothing is doubted."""
        return self.solved >= _SURE * self.flights

    def text(self, agent: str, craft: str = "") -> str:
        """The choice in a line, with the name of the agent without a value; beside a craft with who is better."""
        time = f"{self.time:.3g} s" if math.isfinite(self.time) else "no settling time"
        line = (
            f"{agent}#{self.value:g}: solved {self.solved} of {self.flights}, {time}, "
            f"{self.impulse:.3g} N s"
        )
        if not self.is_enough:
            return f"{line}, commanded every {self.period:g} s."
        line = f"{line}; at #{self.lost:g} flights are lost." if self.lost else f"{line}."
        if self.rival and craft:
            line += f" Quicker and cheaper: {self.rival.told(agent, craft)[1]}"
        return line

    def doubt(
        self,
        agent: str,
        craft: Spacecraft,
        name: str,
        cause: str = "",
    ) -> str:
        """The line of an agent that is not recommended for a craft, with what may help; empty: it is.

        Args:
            agent: its name without a value.
            craft: what it flies.
            name: name or file of the craft.
            cause: why, in a sentence, where the value, tolerances or conditions are the user's; else it follows
                from the craft.
        """
        if self.is_enough:
            return ""
        if not cause:
            reason = likely_cause(craft, self.period)
            cause = f"None of the values tried solves more{reason and f': {reason}'}."
        if self.rival:
            cause += f" {self.rival.told(agent, name)[1]}"
        elif not misfits(craft):
            cause += " An agent that rans train go-to-pose makes for this craft alone may."
        return f"{self.text(agent)} {cause}"


def chosen(
    own: LoadedRun,
    craft: Spacecraft | None = None,
    period: float | None = None,
    value: float | None = None,
    conditions: Conditions | None = None,
) -> Choice:
    """The value and the control period at which an agent for any craft flies a craft.

    Args:
        own: the agent with its own craft, as it was trained.
        craft: what flies; None: the agent's own.
        period: control period, s; None: chosen, too.
        value: that of the agent; None: chosen, and judged beside `RIVALS`.
        conditions: under which the flights are flown; None: those of the agent.

    Raises:
        ConfigError: the agent cannot fly the craft.
    """
    own = own.under(conditions)
    if period is None and craft is not None:
        usual = any_craft().timing(craft, own.timing, None).control_period
        if craft.dimension == 2 or usual <= _COARSE:
            period = usual  # no other is tried
    file = _folder() / f"{_digest(own, craft, period, value)}.json"
    with contextlib.suppress(ConfigError, OSError, TypeError, ValueError):
        *numbers, rival = read_json(file)
        flown, seconds, flights, solved, *others = map(float, numbers)
        rival = rival and Rival(rival[0], *map(float, rival[1:]))
        return Choice(flown, seconds, int(flights), int(solved), *others, rival=rival)
    with warnings.catch_warnings():
        # What flies in the end says what is outside of its training.
        warnings.simplefilter("ignore", RansWarning)
        runs = _at_periods(own, craft, period, value is None)
        first, *others = VALUES if value is None else (value,)
        results = [_flown(frugal(run, first), first) for run in runs]
        best = max(results, key=lambda one: (one.solved, -one.time * one.impulse))
        run = runs[results.index(best)]
        for other in others:
            # Values beside one that loses half of the flights lose many, too: only the ends are left to try.
            if best.solved == best.flights:
                break
            if best.solved < best.flights / 2 and 0.0 < other < best.value:
                continue
            result = _flown(frugal(run, other), other)
            if result.solved > best.solved:
                best = result
        if value is None:
            best = _beside_others(best, run)
        if value is None and best.is_enough and run.craft.dimension == 2:
            lost = 0.0
            for larger in LARGER:
                if _flown(frugal(run, larger), larger).is_enough:
                    break
                lost = larger
            best = best._replace(lost=lost)
    with contextlib.suppress(ConfigError, OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        write_json(file, list(best))
    return best


def _beside_others(best: Choice, run: LoadedRun) -> Choice:
    """The choice, or a cheaper value that beats controllers without training where it does not, with its rival."""
    rivals: list[Rival] = []
    for name in RIVALS if run.craft.dimension == 2 else RIVALS[: not best.is_enough]:
        with contextlib.suppress(ConfigError):  # which it cannot fly
            rivals.append(_controlled(name, run))

    def beside(value: float) -> Rival:
        """The agent at a value from the same starts."""
        part = _flown(frugal(run, value), value, _BESIDE)
        return Rival("", part.solved / _BESIDE, part.time, part.impulse)

    mine = beside(best.value)
    if best.is_enough and not all(one.is_beaten_by(mine) for one in rivals):
        for value in CHEAPER:
            result, other = _flown(frugal(run, value), value), beside(value)
            if result.solved >= best.solved and all(one.is_beaten_by(other) for one in rivals):
                return result
    better = [
        one
        for one in rivals
        if one.solved > best.solved / best.flights + MORE
        or (mine.is_beaten_by(one) and not one.is_beaten_by(mine))
    ]
    return best._replace(rival=max(better, key=lambda one: one.solved, default=None))


def _controlled(name: str, run: LoadedRun) -> Rival:
    """Flights of a controller without training, with its default settings, in the setup of an agent."""
    from rans.evaluation.fly.episodes import fly_episodes
    from rans.evaluation.fly.make_controller import controller
    from rans.evaluation.measure.metrics import impulses, settling_times

    made = controller(name, Setup(run.craft, run.task, run.timing, run.conditions))
    flight = fly_episodes(made, run.judged, CHOICE_SEED, _BESIDE)
    return Rival(
        name,
        float(flight.verdict.solved.mean()),
        float(np.median(settling_times(flight))),
        float(impulses(flight).mean()),
    )


def chosen_period(own: LoadedRun, craft: Spacecraft) -> float | None:
    """Control period, s, that flights chose for a craft, whatever its value; None: the usual one.

    Only long periods are doubted: others need no flights.

    Raises:
        ConfigError: the agent cannot fly the craft.
    """
    usual = any_craft().timing(craft, own.timing, None).control_period
    if craft.dimension == 2 or usual <= _COARSE:
        return None
    return chosen(own, craft).period


NO_VALUE = "None of the values tried solves more in these conditions."
"""Why flights are lost under conditions of the user's."""
NARROW = "tolerances that are narrower than it can hold"
"""Likely cause where the user has named tolerances."""


def likely_cause(craft: Spacecraft, period: float) -> str:
    """The reason for which a craft loses flights to poses: units, its period (s) or authority; "" if not known."""
    for reason in misfits(craft):
        return reason
    with contextlib.suppress(ConfigError):
        usual = any_craft().timing(craft, GoToPose().timing, None).control_period
        if period > usual:
            return (
                f"it is commanded every {period:g} s, and craft of its authority every {usual:g} s"
            )
        return any_craft().prospect(craft, period).reason
    return ""


def _at_periods(
    own: LoadedRun, craft: Spacecraft | None, period: float | None, is_free: bool
) -> list[LoadedRun]:
    """The agent at the period that is named, or at the usual one and, if it is free, at all shorter ones."""
    usual = _every(period, own, craft)
    if period is not None or craft is None or not is_free:
        return [usual]
    # Pulses that are long for their craft lose flights or thrust.
    seconds = usual.timing.control_period
    shorter = sorted((x for x in any_craft().periods if x < seconds), reverse=True)
    return [usual, *(_every(each, own, craft) for each in shorter)]


def _every(seconds: float | None, own: LoadedRun, craft: Spacecraft | None) -> LoadedRun:
    """The agent with a craft that is commanded at a period; None: its own craft, or the usual period."""
    if craft is None:
        return own
    timing = None if seconds is None else any_craft().timing(craft, own.timing, seconds)
    return for_spacecraft(own, craft, timing)


def _flown(run: LoadedRun, value: float, flights: int | None = None) -> Choice:
    """Flights of a candidate; None: as many as decide."""
    from rans.fast.flights import Flights

    flights = flights or FLIGHTS[run.craft.dimension]
    result = Flights(run.network, run.judged).fly(0, flights, CHOICE_SEED)
    period = run.timing.control_period
    return Choice(
        value,
        period,
        flights,
        flights - result.unsolved,
        period * result.settling_step(),
        result.sums["impulse"].mean,
    )


def _digest(
    own: LoadedRun, craft: Spacecraft | None, period: float | None, value: float | None
) -> str:
    """Hash of what a choice depends on."""
    rule = (
        package_version("rans"),
        _VERSION,
        VALUES,
        CHEAPER,
        RIVALS,
        LARGER,
        FLIGHTS,
        CHOICE_SEED,
        any_craft().periods,
        _COARSE,
    )
    about = own.task, own.timing, own.conditions, own.network.architecture, period, value
    content = hashlib.sha256(repr((rule, about)).encode())
    content.update(to_toml(replace(craft or own.craft, name="craft")).encode())
    for node, weights in own.network.at.items():
        content.update(repr(node).encode())
        for x in weights.values():
            content.update(x.numpy().tobytes())
    return content.hexdigest()


def _folder() -> Path:
    """Where choices lie; any of them may be removed at any time."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rans" / "choices"
