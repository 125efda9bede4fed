"""What no controller can beat, from some of the starts; see docs/certificate.md.

Where on/off thrust lives on a lattice the bounds are those of `rans.optimal.certificate`, elsewhere the
looser ones of `rans.optimal.hull`, which also hold for throttled thrust.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rans.errors import ConfigError, RansError
from rans.evaluation.comparison.protocol import REST_SPEED, REST_SPIN, Protocol
from rans.fields import leaves, map_leaves
from rans.files import read_json, write_json
from rans.optimal import hull
from rans.optimal.arrival import aims
from rans.optimal.certificate import Effort, least_fuel, least_time
from rans.optimal.lattice import GoalSet, Lattice
from rans.processes import submitted
from rans.scenario import Scenario
from rans.spacecraft import Spacecraft

_EFFORT = Effort(seconds=20.0, nozzle_seconds=2.0, levels=4)
"""Most questions take two processor seconds. Less of it, or a busy machine, leaves wider gaps but changes
no bound's truth."""


@dataclass(frozen=True)
class Certified:
    """A bound for every controller from one start, and the best control found."""

    start: int
    horizon: float | None
    """The question was the least thrust-time (N s) with which a controller is in the goal set at this
    time, s; None: the least time, s."""
    lower: float
    """No controller needs less; infinite if none can be there by then."""
    upper: float
    """What ``commands`` need, replayed into the goal set; infinite where none were found."""
    commands: list[list[int]] | None = None
    """(T, thrusters) zeros and ones."""


def goal_set(protocol: Protocol) -> GoalSet:
    """The set of `arrived`; bounds do not look at what the task does not aim at."""
    tolerances = protocol.task.tolerances()
    return GoalSet(tolerances.get("position", 0.0), tolerances.get("velocity", REST_SPEED),
                   tolerances.get("attitude", 0.0), tolerances.get("spin", REST_SPIN))


def no_lattice(protocol: Protocol) -> str:
    """Why the bounds of `rans.optimal.certificate` do not exist here; nothing if they do."""
    if not aims(protocol.task) >= {"position", "attitude"}:
        return "the on/off certificate is for going to a pose only, where the goal fixes the whole state."
    try:
        lattice = Lattice(protocol.craft, protocol.timing.control_period)
        first = map_leaves(lambda x: float(x[0]), protocol.starts)
        goal_set(protocol).net_spins(lattice, first.start, first.goal)  # type: ignore[arg-type]
    except ConfigError as error:
        return str(error)
    return ""


def certify(protocol: Protocol, goals: GoalSet, count: int, horizons: tuple[float, ...],
            cache: Path | None = None, workers: int | None = None,
            progress: Callable[[], object] = lambda: None) -> Iterator[Certified]:
    """Bounds from the first starts, as they are found.

    Args:
        protocol: gives the starts.
        goals: see `goal_set`.
        count: of starts.
        horizons: for the least thrust-time, s.
        cache: JSON file that keeps the bounds for the next time.
        workers: processes, by default one per processor.
        progress: called once per bound.

    Raises:
        RansError: a process died, or the cache is damaged or cannot be written.
    """
    known: dict[str, Any] = read_json(cache) if cache and cache.exists() else {}
    asked = []
    for job in _jobs(protocol, goals, count, horizons):
        key = _key(job)
        if key in known:
            progress()
            yield _revived(job[0], known[key])
        else:
            asked.append((key, job))
    for key, answer in _solved(asked, workers):
        progress()
        known[key] = _plain(answer)
        if cache:
            write_json(cache, known)
        yield answer


_Common = tuple[Spacecraft, tuple[str, ...], float, GoalSet, int, bool]
"""Of all questions: spacecraft, aims, control period (s), goal set, steps, whether there is a lattice."""
_Job = tuple[int, float | None, _Common, Scenario]


def _jobs(protocol: Protocol, goals: GoalSet, count: int, horizons: tuple[float, ...]) -> Iterator[_Job]:
    timing = protocol.timing
    common = (protocol.craft, tuple(sorted(aims(protocol.task))), timing.control_period, goals,
              timing.episode_steps, not no_lattice(protocol))
    for k in range(count):
        one = map_leaves(lambda x, k=k: float(x[k]), protocol.starts)
        yield from ((k, horizon, common, one) for horizon in (None, *horizons))


def _solved(asked: list[tuple[str, _Job]], workers: int | None) -> Iterator[tuple[str, Certified]]:
    if not asked:
        return
    jobs = [job for _, job in asked]
    with submitted(_solve, jobs, workers, leaves, (jobs[0][-1].start,)) as futures:
        keys = {future: key for future, (key, _) in zip(futures, asked, strict=True)}
        try:
            for future in as_completed(futures):
                yield keys[future], future.result()
        except BrokenProcessPool as error:
            raise RansError("a process that searched for bounds died; the usual cause is too little "
                            "memory.") from error


def _solve(start: int, horizon: float | None, common: _Common, scenario: Scenario) -> Certified:
    craft, wanted, period, goals, steps, exact = common
    if not exact:
        return Certified(start, horizon, _loose(craft, wanted, period, goals, horizon, scenario), math.inf)
    ask, lattice = least_time if horizon is None else least_fuel, Lattice(craft, period)
    length = steps if horizon is None else round(horizon / period)
    goals.net_spins(lattice, scenario.start, scenario.goal)  # type: ignore[arg-type]
    try:
        found = ask(lattice, scenario.start, scenario.goal, length, goals, _EFFORT)  # type: ignore[arg-type]
    except ConfigError:  # what is left to refuse: a horizon too short for the goal set
        return Certified(start, horizon, math.inf, math.inf)
    commands = None if found.commands is None else found.commands.astype(int).tolist()
    return Certified(start, horizon, found.lower, found.upper, commands)


def _loose(craft: Spacecraft, wanted: tuple[str, ...], period: float, goals: GoalSet, horizon: float | None,
           scenario: Scenario) -> float:
    """From the most that thrusters can do; time is rounded up to whole periods, after which we look."""
    ends = scenario.start, scenario.goal
    if horizon is not None:
        return hull.least_fuel(craft, wanted, *ends, horizon, goals)
    return math.ceil(hull.least_time(craft, wanted, *ends, goals) / period - 1e-9) * period


def _key(job: _Job) -> str:
    """Of everything that a bound depends on."""
    return hashlib.sha256(repr((*job[1:], _EFFORT)).encode()).hexdigest()[:32]


def _plain(answer: Certified) -> dict[str, Any]:
    """For JSON, which has no infinity: the text that ``float`` reads back."""
    table = asdict(answer)
    return {k: str(v) if isinstance(v, float) and np.isinf(v) else v for k, v in table.items()}


def _revived(start: int, table: dict[str, Any]) -> Certified:
    bounds = {key: float(table[key]) for key in ("lower", "upper")}
    return Certified(start, table["horizon"], **bounds, commands=table["commands"])
