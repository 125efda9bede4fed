"""Evaluation of agents and controllers: metrics, comparisons, robustness, failure bounds, checks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from rans.api.agent_data import AgentData
from rans.api.names import (
    conditions_by_name,
    conditions_if_named,
    load_conditions,
    load_spacecraft,
)
from rans.errors import ConfigError, brief, one_of, whole
from rans.model.dynamics import State
from rans.model.spacecraft import Spacecraft
from rans.randomization.conditions import Conditions
from rans.registry import typed
from rans.scenario import ASSURANCE_SEED, EVALUATION_SEED, Endpoints

if TYPE_CHECKING:
    from rans.evaluation.assure.assurance import Assurance
    from rans.evaluation.compare.run import Comparison
    from rans.evaluation.fly.agent import LoadedRun
    from rans.evaluation.fly.episodes import EngineName
    from rans.evaluation.fly.follow import Following
    from rans.evaluation.fly.protocols import ProtocolName
    from rans.evaluation.measure.aggregate import Metrics
    from rans.flight import Flight
    from rans.randomization.conditions import FaultKind
    from rans.randomization.faults import FaultSet
    from rans.show.pages.stress_page import StressReport
    from validation.speed.measurement import Measurement
    from validation.speed.ratios import Ratio
    from validation.study.checks import Study

SpacecraftLike = str | Path | Spacecraft
"""A spacecraft: its name, its TOML file, or a `Spacecraft`."""
ConditionsLike = str | Path | Conditions
"""Conditions of episodes: a name, a TOML file, or a `Conditions`."""
CRAFT = "floating-platform"
"""Spacecraft where none is named."""
STRESSED = ("lab", "roboran", "orbit", "harsh")
"""Conditions of a robustness sweep where none are named."""
_ASSURED = 100_000
"""Flights of an assurance where neither their number nor a bound is given."""


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
        guard: whether to fly behind the safety filter for its spacecraft and task (`rans.guard.safety_filter`).
        guard_slack: least margin that the filter keeps, m or m/s; None: 0.002, and a reserve for
            the conditions' noise.
        guard_coasts: whether the filter also keeps coasts of the next orbit out of the zone around the target
            (`rans.guard.SafeCoasts`).
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


def compare(
    *contestants: object,
    beside: str | Sequence[str] | None = None,
    episodes: int = 128,
    certified: int = 4,
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


def stress(
    *contestants: object,
    conditions: Sequence[str] | None = None,
    only: Sequence[str] = (),
    episodes: int = 256,
    slow_episodes: int = 32,
    seed: int = EVALUATION_SEED,
    worst: int = 3,
    trust: bool = False,
    workers: int | None = None,
    output: str | Path | None = None,
    guard: bool = False,
    guard_slack: float | None = None,
) -> StressReport:
    """Robustness sweep: fly under one disturbance at a time, at increasing magnitude.

    >>> found = rans.stress("go-to-pose-2d", only=["latency"], episodes=8, workers=1)
    >>> found.effect_rows()[0][:2]
    ['latency', 's']

    Args:
        *contestants: as for `compare`; the others are compared with the first.
        conditions: sets of conditions to fly under as well, by name or TOML file; None: lab, roboran, orbit and
            harsh, or with ``only`` none.
        only: names of single disturbances, such as "latency"; by default all, and failed thrusters.
        episodes: number of flights of each contestant at each magnitude and in each set of conditions.
        slow_episodes: the same for slow controllers, such as MPC.
        seed: random seed of starts, goals and disturbances.
        worst: number of worst episodes that the report lists for each contestant.
        trust: see `compare`.
        workers: processes; None: one per processor.
        output: folder to write stress.html and stress.json into; None: nothing is written, see
            `rans.show.pages.stress_page.StressReport.write`.
        guard: see `evaluate`.
        guard_slack: see `evaluate`.

    Raises:
        ConfigError: there is no such contestant or disturbance, or a number is out of its range.
    """
    from rans.evaluation.compare.entrants import contest_of, invitations
    from rans.evaluation.stress.run import prepared
    from rans.files import ready_folder
    from rans.show.pages.stress_page import StressReport
    from rans.show.progress import watched

    first, invited = invitations(contestants)
    contest = contest_of(
        first, whole("episodes", episodes), seed, trust=trust, guard=guard, slack=guard_slack
    )
    sets = conditions_by_name(stress_conditions(conditions, only))
    planned = prepared(contest, invited, sets, only, whole("slow_episodes", slow_episodes), trust)
    folder = Path() if output is None else ready_folder(Path(output))
    report = StressReport(planned, folder, whole("worst", worst, least=0), "rans.stress")
    with watched() as stage:
        planned.fly(stage, workers)
    if output is not None:
        report.write()
    return report


def stress_conditions(given: Sequence[str] | None, only: Sequence[str]) -> Sequence[str]:
    """Sets of conditions that a robustness sweep flies beside single disturbances."""
    if given is not None:
        return given
    return () if only else STRESSED


def assure(
    agent: object,
    *,
    conditions: ConditionsLike | None = None,
    episodes: int | None = None,
    failure_below: float | None = None,
    confidence: float = 0.99,
    worst: int = 4,
    rare: int = 0,
    search: str | None = None,
    seed: int = ASSURANCE_SEED,
    device: str = "auto",
    trust: bool = False,
    output: str | Path | None = None,
) -> Assurance:
    """Bound the failure probability of an agent by Monte Carlo simulation, and fly the failures again.

    >>> found = rans.assure("go-to-pose-2d", episodes=2000, worst=0)
    >>> found.campaign.flights, found.campaign.bound().high < 0.02
    (2000, True)

    Args:
        agent: an `Agent`, or a name as `load_agent` takes it.
        conditions: domain randomization, disturbances, faults and sensors; None: those of the training.
        episodes: number of flights; None: 100,000, or with ``failure_below`` as many as it takes.
        failure_below: failure probability to show or to refute, such as 1e-4; the campaign ends as soon as
            its count decides.
        confidence: confidence of every bound.
        worst: number of failed flights of each kind that are flown again in Drake.
        rare: number of flights, at least 1600, to estimate rarer failures by subset simulation, where every factor
            of ten in the probability takes as many; 0: none.
        search: name of conditions; searches for the smallest disturbance that makes the agent fail, in units of
            these. None: no search.
        seed: random seed of starts, goals and conditions.
        device: "auto" (a GPU if there is one), "cpu" or "cuda".
        trust: see `compare`.
        output: folder to write assurance.html and assurance.json into; None: nothing is written.

    Raises:
        ConfigError: there is no such agent, or a number is out of its range.
    """
    from rans.evaluation.assure.assurance import Assurance, torch_device
    from rans.evaluation.assure.bounds import plan
    from rans.evaluation.assure.campaign import Campaign
    from rans.evaluation.assure.rare import check_rare_count
    from rans.evaluation.assure.search import check_unit
    from rans.evaluation.fly.contestants import contestant
    from rans.files import ready_folder, write_json
    from rans.show.pages.assure_page import assurance_page
    from rans.show.progress import watched

    unit = None
    if search:
        unit = load_conditions(search)
        check_unit(search, unit)  # a wrong name is refused before anything flies
    if rare:
        check_rare_count("rare", whole("rare", rare))
    if episodes is not None or failure_below is None:
        episodes = whole("episodes", _ASSURED if episodes is None else episodes)
    planned = plan(confidence, episodes, failure_below)
    in_memory = agent if isinstance(agent, AgentData) else None
    spec = (in_memory.spec or in_memory.name) if in_memory else str(agent)
    label = None if conditions is None else str(getattr(conditions, "description", conditions))
    assurance = Assurance(spec, label, Campaign(planned, seed), command="rans.assure", trust=trust)
    if in_memory or isinstance(conditions, Conditions):
        run = in_memory.run if in_memory else contestant(spec, trust=trust)
        assurance.given = run.under(conditions_if_named(conditions))
    _ = assurance.run
    assurance.check_follow_ups(rare, search)
    processor = torch_device(device)
    with watched() as stage:
        assurance.fly(processor, stage)
        stage("failed flights again", None)
        assurance.replay(whole("worst", worst, least=0), worst)
        if rare:
            stage("rarer failures", None)
            assurance.sample(rare, processor)
        if search and unit:
            stage("the worst case", None)
            assurance.search(search, unit, processor)
    if output is not None:
        folder = ready_folder(Path(output))
        write_json(folder / "assurance.json", assurance.to_json())
        assurance_page(assurance).write(folder / "assurance.html")
    return assurance


def follow(
    agent: object,
    path: str | Path = "circle",
    *,
    speed: float = 0.25,
    look_ahead: float = 0.25,
    flights: int = 16,
    seed: int = EVALUATION_SEED,
    engine: EngineName = "fast",
) -> Following:
    """Fly an agent that tracks velocities along a path, with the paper's look-ahead planner.

    >>> found = rans.follow("track-velocity-2d", "circle", flights=2)
    >>> found.planner.path.label
    'circle'

    Args:
        agent: an `Agent` for track-velocity, or a name as `load_agent` takes it.
        path: circle, spiral, square, lemniscate, helix (in space), or a CSV file of points x,y[,z] in m.
        speed: speed along the path, m/s.
        look_ahead: look-ahead radius, m: the commanded velocity points to the farthest point of the path
            within it.
        flights: number of flights.
        seed: random seed of the starts.
        engine: what computes the motion, "fast" or "drake".

    Raises:
        ConfigError: the agent is for another task, or there is no such path.
    """
    from rans.evaluation.fly.contestants import in_protocol
    from rans.evaluation.fly.follow import fly_path as follow_path
    from rans.evaluation.fly.paths import LookAhead, find_path

    planner = LookAhead(find_path(str(path)), speed, look_ahead)
    run = in_protocol(agent, "own")
    return follow_path(
        run.craft,
        run.task,
        run.controller,
        planner,
        run.timing,
        seed,
        whole("flights", flights),
        engine,
    )


FAULT_COLUMNS = ("fault", "recoverable", "least margin", "not recoverable")
"""Headings of `Faults.rows`."""


@dataclass(frozen=True)
class Faults:
    """Which thrusters of a spacecraft may fail while every force and torque stays possible."""

    spacecraft: Spacecraft
    sets: dict[tuple[FaultKind, int], list[FaultSet]]
    """Every set of failed thrusters by kind and number, with its margin."""

    def __repr__(self) -> str:
        sentence = ", ".join(f"{row[0]} {row[1]}" for row in self.rows())
        return f"<Faults of {self.spacecraft.name}: recoverable are {sentence}>"

    def _repr_html_(self) -> str:
        from rans.show.pages.notebook import listed

        return listed(f"{self.spacecraft.name}: recoverable faults", FAULT_COLUMNS, self.rows())

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Fault, recoverable sets, least margin, and the sets that cannot be recovered from."""
        numbers = {1: "one", 2: "two"}
        results = []
        for (kind, count), sets in self.sets.items():
            good = [fault_set.margin for fault_set in sets if fault_set.recoverable]
            lost = [
                "+".join(map(str, fault_set.thrusters))
                for fault_set in sets
                if not fault_set.recoverable
            ]
            least = f"{min(good):.1%}" if good else ""
            recoverable = f"{len(good)} of {len(sets)}"
            lost_texts = ", ".join(lost) or "none"
            results.append((f"{numbers[count]} {kind}", recoverable, least, lost_texts))
        return results


def faults(spacecraft: SpacecraftLike = CRAFT) -> Faults:
    """Which thrusters may fail, alone or two at once, while every force and torque stays possible.

    >>> found = rans.faults("floating-platform")
    >>> found.rows()[0][:2]
    ('one dead', '8 of 8')

    Args:
        spacecraft: a name, a TOML file or a `Spacecraft`.

    Raises:
        ConfigError: there is no such spacecraft, or it has one thruster.
    """
    from rans.randomization.faults import fault_sets
    from rans.show.progress import watched

    craft = load_spacecraft(spacecraft)
    count = craft.thruster_count
    if count < 2:
        raise ConfigError(f"{craft.name} has one thruster, which it cannot do without.")
    kinds: tuple[FaultKind, ...] = ("dead", "stuck-open")
    sets: dict[tuple[FaultKind, int], list[FaultSet]] = {}
    with watched() as stage:
        for kind in kinds:
            for failed in (1, 2):
                if failed >= count:
                    continue
                step = stage(f"{failed} {kind}", math.comb(count, failed))
                results: list[FaultSet] = []
                for fault_set in fault_sets(craft, failed, kind):
                    results.append(fault_set)
                    step(1)
                sets[kind, failed] = results
    return Faults(craft, sets)


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
