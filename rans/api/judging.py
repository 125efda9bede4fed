"""Evaluation of agents and controllers: metrics, comparisons, robustness, failure bounds, checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from rans.api.agent_data import AgentData
from rans.api.names import (
    conditions_if_named,
    load_conditions,
    load_spacecraft,
)
from rans.errors import ConfigError, brief, one_of, whole
from rans.model.dynamics import State
from rans.model.spacecraft import Spacecraft
from rans.randomization.conditions import Conditions
from rans.registry import typed
from rans.scenario import EVALUATION_SEED, Endpoints
from rans.settled import settled_alone

if TYPE_CHECKING:
    from rans.evaluation.compare.run import Comparison
    from rans.evaluation.fly.agent import LoadedRun
    from rans.evaluation.fly.episodes import EngineName
    from rans.evaluation.fly.protocols import ProtocolName
    from rans.evaluation.measure.aggregate import Metrics
    from rans.flight import Flight
    from validation.speed.measurement import Measurement
    from validation.speed.ratios import Ratio
    from validation.study.checks import Study

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
) -> Flight:
    """Fly consecutive episodes of a seed, with progress.

    With a start among the endpoints, and without conditions, one episode flies: all would be the same.

    Raises:
        ConfigError: the engine does not exist, a number is out of its range, or start or goal is no state of the
            craft's dimension.
    """
    from rans.evaluation.fly.episodes import EngineName, fly_episodes
    from rans.show.progress import watched

    one_of("engine", engine, get_args(EngineName))
    count = whole("episodes", episodes)
    first = whole("first", first, least=0)
    if endpoints is not None:
        count = endpoints.episodes(count, run.conditions)
    with watched() as stage:
        step = stage(f"{run.controller.name}, {engine} engine", count)
        return fly_episodes(
            run.controller,
            run.judged,
            seed,
            count,
            engine,
            progress=step,
            first=first,
            endpoints=endpoints,
        ).flight


def own_endpoints(
    start: State | None, goal: State | None, zones: Sequence[Sequence[float]]
) -> Endpoints | None:
    """A user's start, goal and zones; None where all are sampled."""
    if start is goal is None and not len(zones):
        return None
    return Endpoints(start, goal, zones)


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
    guard_slack: float | None = None,
    guard_coasts: bool = False,
    start: State | None = None,
    goal: State | None = None,
    zones: Sequence[Sequence[float]] = (),
) -> Metrics:
    """Fly an agent or a controller from fixed starts, and return metrics with 95 % intervals.

    >>> found = rans.evaluate("go-to-pose-2d", episodes=16)
    >>> found["solved"].value, found["solved"].unit
    (100.0, '%')

    Args:
        agent: an `Agent`, a `Lookahead`, or a name as `load_agent` takes it.
        episodes: number of flights.
        seed: random seed of starts and goals; the default is in no training.
        engine: what computes the motion: "fast" (RANS's own equations), or "drake" as an independent check.
        conditions: domain randomization, disturbances, faults and sensors: a name, a TOML file or a
            `Conditions`; None: those of the training.
        protocol: "own", "paper" or "original", see `rans.evaluation.fly.protocols.under_protocol`.
        guard: whether to fly behind the safety filter for its spacecraft and task (`rans.safety_filters`).
        guard_slack: least margin that the filter keeps, m or m/s; None: 0.002, and a reserve for
            the conditions' noise.
        guard_coasts: whether the filter also keeps coasts of the next orbit out of the zone around the target
            (docs/missions/passive_safety.md).
        start: start of all episodes, as `rans.state` makes it; None: sampled. Without conditions one episode
            flies from it, because all would be the same.
        goal: goal of all episodes, as `rans.state` makes it; None: sampled.
        zones: keep-out zones that stand still, for tasks that have some: coordinates of the centre, then the
            radius, of each, m; empty: sampled.

    Raises:
        ConfigError: one of these does not exist, or a multi-task agent is named without a task: name it
            NAME#TASK.
    """
    from rans.evaluation.fly.contestants import in_protocol
    from rans.evaluation.fly.episodes import EngineName
    from rans.evaluation.measure.aggregate import measure

    one_of("engine", engine, get_args(EngineName))
    run = in_protocol(agent, protocol)
    if first := next(iter(run.task.parts())):
        raise ConfigError(
            f"{run.controller.name} has several tasks: pick one, as in "
            f"{run.controller.name}#{first}."
        )
    count = whole("episodes", episodes)
    flying = run.under(conditions_if_named(conditions)).guarded(guard, guard_slack, guard_coasts)
    return measure(flown(flying, count, seed, engine, endpoints=own_endpoints(start, goal, zones)))


@settled_alone
def compare(
    *contestants: object,
    beside: str | Sequence[str] | None = None,
    episodes: int = 16,
    certified: int = 1,
    seed: int = EVALUATION_SEED,
    engine: EngineName = "fast",
    conditions: ConditionsLike | None = None,
    trust: bool = False,
    workers: int | None = None,
    guard: bool = False,
    guard_slack: float | None = None,
    start: State | None = None,
    goal: State | None = None,
    zones: Sequence[Sequence[float]] = (),
) -> Comparison:
    """Fly agents, policies and controllers from the same starts, and compare them with what is possible.

    >>> found = rans.compare("go-to-pose-2d", beside=["lqr"], episodes=4, certified=0)
    >>> [entry.name for entry in found.entries]
    ['go-to-pose-2d', 'LQR']

    Args:
        *contestants: agents, or names as for `rans compare`; the first sets task, spacecraft and control rate.
            Others may also be Stable-Baselines3 models, controllers (`Controller`), or a class or function that
            makes a controller from spacecraft, task and timing.
        beside: names of controllers that join, and "optimal" for optimal trajectories and certified bounds; a
            name, or several. None: "lqr", "switching", "mpc" and "optimal", for landings "landing" and "optimal".
        episodes: number of starts.
        certified: number of starts whose bounds are certified, half a minute of processor time each.
        seed: random seed of the starts.
        engine: what computes the motion, "fast" or "drake".
        conditions: as for `evaluate`; None: those of the first contestant.
        trust: whether ``sb3:`` files that RANS did not write may be opened; they are pickles, which can run code.
        workers: number of processes; None: one per processor.
        guard: see `evaluate`.
        guard_slack: see `evaluate`.
        start: see `evaluate`; bounds and optimal trajectories are of this start too.
        goal: see `evaluate`.
        zones: see `evaluate`.

    Raises:
        ConfigError: a contestant does not exist, or is not for the same task, spacecraft and rate.
    """
    from rans.evaluation.compare.entrants import contest_of, enlisted, invitations
    from rans.evaluation.compare.run import Comparison
    from rans.evaluation.fly.controllers import CONTROLLERS
    from rans.evaluation.fly.episodes import EngineName
    from rans.show.progress import watched

    first, invited = invitations(contestants)
    one_of("engine", engine, get_args(EngineName))
    beside = (beside,) if isinstance(beside, str) else beside
    if beside is not None and (
        not isinstance(beside, Sequence) or not all(isinstance(name, str) for name in beside)
    ):
        raise ConfigError(f'beside takes names of controllers and "optimal", got {brief(beside)}.')
    for name in {*(beside or ())} - {"optimal"}:
        CONTROLLERS[typed(name)]  # a wrong name is refused before anybody flies
    whole("certified", certified, least=0)
    contest = contest_of(
        first,
        whole("episodes", episodes),
        seed,
        engine,
        conditions_if_named(_conditions(contestants[0], conditions)),
        trust,
        guard,
        guard_slack,
    ).between(own_endpoints(start, goal, zones))
    result = Comparison(contest)
    entrants = enlisted(invited, contest, trust)
    with watched() as stage:
        result.fly(entrants, beside, certified, stages=stage, workers=workers)
    return result


def _conditions(first: object, conditions: ConditionsLike | None) -> ConditionsLike | None:
    """What is flown under: as asked for, otherwise what the first contestant is judged under."""
    if conditions is None and isinstance(first, AgentData):
        return first.conditions or Conditions()
    return conditions


@settled_alone
def validate(
    spacecraft: SpacecraftLike = CRAFT,
    *,
    quick: bool = False,
    layer: str | None = None,
    conditions: ConditionsLike | None = None,
    seed: int = 0,
) -> Study:
    """Check a spacecraft's motion against Drake and the laws of mechanics, layer by layer.

    >>> found = rans.validate("floating-platform", quick=True, layer="thrusters")
    >>> found.passed, len(found.checks)
    (True, 2)

    Args:
        spacecraft: a name, a TOML file or a `Spacecraft`.
        quick: fewer states and flights and no compiler: some seconds instead of some minutes.
        layer: check this layer only: thrusters, commands, accelerations, period, flights, engine, ...; None: all.
        conditions: conditions to check under too, each effect alone and all together.
        seed: random seed of states and commands.

    Raises:
        ConfigError: Drake refuses the mass properties, or one of these does not exist.
    """
    from rans.api import laboratory
    from rans.show.progress import watched

    laboratory.enter()
    from validation.study.study import study

    met = None if conditions is None else load_conditions(conditions)
    craft = load_spacecraft(spacecraft)
    with watched() as stage:
        return study(craft, seed, quick, layer, stage, met)


@dataclass(frozen=True)
class Speed:
    """Speeds measured on this machine."""

    device: str
    measurements: list[Measurement]
    ratios: list[Ratio]
    """Measured speeds as shares of the bound that the memory bandwidth sets."""

    def __repr__(self) -> str:
        sentence = "; ".join(
            f"{measurement.kind}, {measurement.name}: {measurement.value:,.4g} {measurement.unit}"
            for measurement in self.measurements
            if measurement.value is not None
        )
        return f"<Speed on {self.device}: {sentence}>"

    def __getitem__(self, name: str) -> Measurement:
        return {measurement.name: measurement for measurement in self.measurements}[name]


@settled_alone
def benchmark(
    spacecraft: SpacecraftLike | Sequence[SpacecraftLike] = ("floating-platform", "free-flyer"),
    task: str = "go-to-pose",
    *,
    device: str | None = None,
    num_envs: int | Sequence[int] = (),
    quick: bool = False,
) -> Speed:
    """Measure the speed of engine, trainer, optimizer and agents on this machine.

    >>> found = rans.benchmark("floating-platform", num_envs=[16], quick=True)
    >>> len(found.measurements) > 3
    True

    Args:
        spacecraft: names, TOML files or objects.
        task: task to step and to train.
        device: "cpu" or "cuda"; None: a GPU if there is one.
        num_envs: batch size, or several; empty: the usual ones for the device.
        quick: rough figures in seconds.

    Raises:
        ConfigError: there is no such spacecraft, task or device, or the compiler is missing.
    """
    from rans.api import laboratory
    from rans.api.speed import chosen_device, measured
    from rans.show.progress import watched

    laboratory.enter()
    from validation.speed.ratios import bounds

    device = chosen_device(device, quick)
    several = isinstance(spacecraft, Sequence) and not isinstance(spacecraft, str)
    crafts: Any = spacecraft if several else [spacecraft]
    sizes = [num_envs] if isinstance(num_envs, int) else num_envs
    results: list[Measurement] = []
    with watched() as stage:
        step = stage("measuring", None)
        for measurement in measured(map(load_spacecraft, crafts), task, sizes, device, quick):
            results.append(measurement)
            step(1)
    return Speed(device, results, list(bounds(results)))
