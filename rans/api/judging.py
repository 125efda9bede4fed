"""Evaluation of agents and controllers: metrics, comparisons, robustness, failure bounds, checks."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, get_args

from rans.api.agent_data import AgentData
from rans.api.names import (
    conditions_if_named,
)
from rans.api.states import WrittenEndpoints, is_written
from rans.base.choices import EngineName, ProtocolName
from rans.base.errors import ConfigError, RansWarning, brief, one_of, whole
from rans.base.files import inside, ready_folder, writing_at_end
from rans.base.registry import typed
from rans.base.settled import settled_alone
from rans.episode.scenario import EVALUATION_SEED, Endpoints
from rans.model.dynamics import State
from rans.model.spacecraft import Spacecraft
from rans.randomization.conditions import Conditions

if TYPE_CHECKING:
    from rans.episode.flight import Flight
    from rans.evaluation.compare.run import Comparison
    from rans.evaluation.fly.agent import LoadedRun
    from rans.evaluation.fly.contestant_name import ContestantName
    from rans.evaluation.measure.aggregate import Metrics

SpacecraftLike = str | Path | Spacecraft
"""A spacecraft: its name, its TOML file, or a `Spacecraft`."""
ConditionsLike = str | Path | Conditions
"""Conditions of episodes: a name, a TOML file, or a `Conditions`."""
CRAFT = "floating-platform"
"""Spacecraft where none is named."""


@settled_alone
def flown(
    run: LoadedRun,
    episodes: int,
    seed: int,
    engine: EngineName,
    first: int = 0,
    endpoints: Endpoints | None = None,
    save: Callable[[Flight], object] = lambda flight: None,
) -> Flight:
    """Fly consecutive episodes of a seed, with progress.

    With a start among the endpoints, and without conditions, one episode flies: all would be the same. After an
    interrupt or an error ``save`` is given the first episodes, as many as have ended.

    Raises:
        ConfigError: the engine does not exist, a number is out of its range, or start or goal is no state of the
            craft's dimension.
    """
    from rans.evaluation.fly.episodes import fly_episodes, so_far
    from rans.show.progress import watched

    one_of("engine", engine, get_args(EngineName))
    count = whole("episodes", episodes)
    first = whole("first", first, least=0)
    if endpoints is not None:
        count = endpoints.episodes(count, run.conditions)
    parts: dict[int, Flight] = {}

    try:
        with watched() as stage:
            flight = fly_episodes(
                run.controller,
                run.judged,
                seed,
                count,
                engine,
                progress=stage(f"{run.controller.name}, {engine} engine", count),
                first=first,
                endpoints=endpoints,
                parts=parts,
            )
    except BaseException:
        if 0 in parts:
            save(so_far(parts))
        raise
    if flight.stopped:
        warnings.warn(
            f"{run.controller.name}'s solver stopped {flight.stopped} times; the previous plan was continued.",
            RansWarning,
            stacklevel=2,
        )
    return flight


def own_endpoints(
    start: State | Sequence[str] | None,
    goal: State | Sequence[str] | None,
) -> Endpoints | None:
    """A user's start and goal, as states or as words; None where both are sampled."""
    begin: Any = None if start is None or start == () else start
    end: Any = None if goal is None or goal == () else goal
    if begin is end is None:
        return None
    written = is_written(begin) or is_written(end)
    return (WrittenEndpoints if written else Endpoints)(begin, end)


@settled_alone
def evaluate(
    agent: object,
    *,
    episodes: int = 1024,
    seed: int = EVALUATION_SEED,
    engine: EngineName = "fast",
    conditions: ConditionsLike | None = None,
    protocol: ProtocolName = "own",
    guard: bool = False,
    start: State | None = None,
    goal: State | None = None,
    period: float | None = None,
) -> Metrics:
    """Fly an agent or a controller from fixed starts, and return metrics with 95 % intervals.

    >>> found = rans.evaluate("go-to-pose-2d", episodes=16)
    >>> found["solved"].value, found["solved"].unit
    (100.0, '%')

    Args:
        agent: a run folder, an agent that comes with RANS, or CONTROLLER:TASK-2d or -3d, with @SPACECRAFT if you
            like. The file of your own spacecraft alone, mine.toml, is any-craft-2d@mine.toml or
            any-craft-3d@mine.toml: it flies without training.
        episodes: number of flights.
        seed: random seed of starts and goals; the default is in no training.
        engine: what computes the motion: RANS's own equations (fast), or Drake as an independent check.
        conditions: domain randomization, disturbances, faults and sensors: a name (see `rans list CONDITIONS`),
            perfect (none), or your own TOML file; by default those of the training.
        protocol: setup of the flights. own: the conditions of the training and the task's evaluation starts.
            paper: the paper's floating platform, 250 steps, starts 3 to 4 m away, 1 N for each thruster. original:
            the same with a total of 1 N.
        guard: whether to fly behind a safety filter, which replaces commands that would violate a constraint
            (docs/missions/guard.md).
        start: your own start in place of sampled ones. Episodes then differ in conditions only; without conditions
            there is one.
        goal: your own goal, in the same form; by default that of the scenario.
        period: control period, s, of a controller or of any-craft with a spacecraft; by default the task's, or one
            for the spacecraft of your file.

    Raises:
        ConfigError: one of these does not exist, or a multi-task agent is named without a task: name it
            NAME#TASK.
    """
    from rans.evaluation.fly.contestants import in_protocol
    from rans.evaluation.measure.aggregate import measure

    one_of("engine", engine, get_args(EngineName))
    world = conditions_if_named(conditions)
    run = in_protocol(agent, protocol, period, world)
    if first := next(iter(run.task.parts())):
        raise ConfigError(
            f"{run.controller.name} has several tasks: pick one, as in "
            f"{run.controller.name}#{first}."
        )
    count = whole("episodes", episodes)
    flying = run.under(world).guarded(guard)
    return measure(flown(flying, count, seed, engine, endpoints=own_endpoints(start, goal)))


@settled_alone
def compare(
    *contestants: object,
    beside: str | Sequence[str] | None = None,
    conditions: ConditionsLike | None = None,
    episodes: int | None = None,
    certified: int | None = None,
    seed: int = EVALUATION_SEED,
    engine: EngineName = "fast",
    guard: bool = False,
    period: float | None = None,
    full: bool = False,
    trust: bool = False,
    output: str | Path | None = None,
    workers: int | None = None,
    show: Callable[[Comparison], object] | None = None,
) -> Comparison:
    """Fly agents, policies and controllers from the same starts, and compare them with what is possible.

    >>> found = rans.compare("go-to-pose-2d", beside=["lqr"], episodes=4, certified=0)
    >>> [entry.name for entry in found.entries]
    ['go-to-pose-2d', 'LQR']

    A contestant may be an `Agent` too, and after the first a Stable-Baselines3 model, a controller (`Controller`),
    or a class or function that makes a controller from spacecraft, task and timing.

    Args:
        *contestants: run folders, agents that come with RANS, CONTROLLER:TASK-2d (see `rans list`), sb3:FILE.zip,
            onnx:FILE or python:MODULE:FUNCTION, or FILE.csv with flights that were computed elsewhere
            (docs/comparison.md). The first sets task, spacecraft and control rate for the others.
        beside: controllers that join, and optimal: optimal trajectories and certified bounds. By default lqr
            switching mpc optimal, for landings optimal, for inspections circumnavigation optimal.
        conditions: see `evaluate`.
        episodes: number of starts; by default 16, of a full comparison 128, and no fewer than those with bounds.
        certified: starts whose bounds are certified, if optimal joins, which at 0 it does only by name. By default
            1, of a full comparison 4; if named, or of a full comparison, the least impulse has six times in place
            of one. Each takes half a minute of processor time in the plane, minutes in space with its package,
            else hull and tube bounds (docs/bounds/certificate.md).
        seed: see `evaluate`.
        engine: see `evaluate`.
        guard: see `evaluate`.
        period: control period, s, of controllers and of any-craft with a spacecraft; by default the first
            contestant's.
        full: whether to compare from more starts, in minutes, with the largest return of the task's reward too.
        trust: whether ``sb3:`` files may be opened, which are pickles, which can run code.
        output: folder of the results; by default that of the first contestant, and in Python none is written.
        workers: number of processes; by default one per processor.
        show: function that is called with the comparison before slow contestants fly (its ``waiting``), and at the
            end, also after an interrupt or an error.

    Raises:
        ConfigError: a contestant does not exist, or is not for the same task, spacecraft and rate.
    """
    from rans.evaluation.compare.entrants import (
        at_values,
        contest_of,
        enlisted,
        invitations,
        ready_opponents,
    )
    from rans.evaluation.compare.run import TYPICAL, Comparison
    from rans.evaluation.fly.agent import LoadedRun
    from rans.show.progress import watched

    # What needs no flights is refused before an agent for any craft chooses its value by some.
    count, bounded = starts_of(episodes, certified, full)
    one_of("engine", engine, get_args(EngineName))
    first, invited = invitations(contestants)
    beside = (beside,) if isinstance(beside, str) else beside
    check_beside(beside)
    if certified and beside is not None and "optimal" not in beside:
        raise ConfigError(
            f"certified asks for bounds from {bounded:,} of the starts, which join as optimal, a task's own too: "
            "name it with the controllers that join (--with lqr optimal), or leave certified out."
        )
    # The first contestant sets task, craft, starts and conditions for all.
    entrants = [entrant for one in invited for entrant in at_values(one)]
    contest = contest_of(
        first if isinstance(first, LoadedRun) else cast("ContestantName", entrants[0]),
        count,
        seed,
        engine,
        conditions_if_named(_conditions(contestants[0], conditions)),
        trust,
        guard,
        period,
    )
    is_whole = full or certified is not None
    result = Comparison(contest) if is_whole else Comparison(contest, multiples=TYPICAL)
    flying = enlisted(entrants, contest, trust, period)
    folder = None if output is None else ready_folder(output)
    cache = None if folder is None else inside(folder, "compare-bounds.json")

    able = ready_opponents(contest.task, beside)
    opponents = [name for name in able if bounded or beside or name != "optimal"]
    asked = beside is not None
    fly = partial(
        result.fly, certified=bounded, cache=cache, workers=workers, returns=full, asked=asked
    )

    def save(is_over: bool = False) -> None:
        if folder is not None and (result.entries or result.failures):
            from rans.evaluation.fly.evidence import about
            from rans.show.pages.comparison_page import write

            made = about(str(entrants[0]), contest.setup, "rans.compare")
            write(result, folder, made, is_over)

    def end() -> None:
        result.waiting = ()
        try:
            save(is_over=True)
        finally:
            if show is not None:
                show(result)

    # Quick opponents first; results so far are written even after an interrupt.
    quick, slow = result.quick_and_slow(opponents)
    # The first table of a craft needs a single value of its agent.
    soon = 1 if slow and len(invited) == 1 else None
    now = dict([*flying.items()][:soon])
    later = {text: flying[text] for text in flying if text not in now}
    with writing_at_end(end, folder and folder / "compare.json"):
        try:
            with watched() as shown:
                fly(now, quick, stages=shown)
            if slow:
                result.waiting = [*(["other values"] if later else []), *slow]
                save()
                if show is not None:
                    show(result)
                with watched(save) as shown:
                    fly(later, slow, stages=shown)
        except KeyboardInterrupt:
            result.note_interrupt(bounded)
            raise
    return result


def check_beside(names: object) -> None:
    """Refuse (`ConfigError`) what names no controllers and no optima, before anybody flies."""
    from rans.evaluation.fly.controllers import CONTROLLERS

    if names is None:
        return
    if not isinstance(names, Sequence) or not all(isinstance(name, str) for name in names):
        raise ConfigError(f'beside takes names of controllers and "optimal", got {brief(names)}.')
    for name in {*names} - {"optimal"}:
        CONTROLLERS[typed(name)]


STARTS = 16, 1
"""Starts by default, and those of them with certified bounds: with MPC and optima one to three minutes of processor
time, most of it on all cores."""
_ALL_STARTS = 128, 4
"""Starts of a full comparison, and those of them with certified bounds; it takes minutes."""


def starts_of(episodes: int | None, certified: int | None, full: bool) -> tuple[int, int]:
    """Number of starts of a comparison, and of those with certified bounds.

    Raises:
        ConfigError: a number is out of its range.
    """
    usual = _ALL_STARTS if full else STARTS
    bounded = whole("certified", usual[1] if certified is None else certified, least=0)
    return whole("episodes", max(usual[0], bounded) if episodes is None else episodes), bounded


def _conditions(first: object, conditions: ConditionsLike | None) -> ConditionsLike | None:
    """What is flown under: as asked for, otherwise what the first contestant is judged under."""
    if conditions is None and isinstance(first, AgentData):
        return first.conditions or Conditions()
    return conditions
