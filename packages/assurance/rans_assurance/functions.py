"""Functions behind the commands of this package, which `rans` has as public names.

Arguments and their texts are those of the commands (`rans.cli.door`); a new one needs its line in "Args:".
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rans import load_conditions, load_spacecraft
from rans.api.agent_data import AgentData
from rans.api.judging import CRAFT, ConditionsLike
from rans.api.names import conditions_if_named
from rans.base.files import made_by, writing_at_end
from rans.episode.scenario import ASSURANCE_SEED
from rans.extend import (
    EVALUATION_SEED,
    ConfigError,
    Spacecraft,
    SpacecraftLike,
    whole,
)

if TYPE_CHECKING:
    from rans.extend import Metrics
    from rans.randomization.conditions import FaultKind
    from rans.randomization.faults import FaultSet
    from rans_assurance.assure.assurance import Assurance
    from rans_assurance.stress.report import StressReport

STRESSED = ("lab", "roboran", "orbit", "harsh")
"""Conditions of a robustness sweep where none are named."""
ASSURED = 100_000
"""Flights of an assurance where neither their number nor a bound is given."""


def stress(
    *contestants: object,
    conditions: Sequence[str] | None = None,
    only: Sequence[str] = (),
    episodes: int = 256,
    slow_episodes: int | None = None,
    seed: int = EVALUATION_SEED,
    worst: int = 3,
    trust: bool = False,
    workers: int | None = None,
    output: str | Path | None = None,
    guard: bool = False,
    show: Callable[[StressReport], object] | None = None,
) -> StressReport:
    """Robustness sweep: fly under one disturbance at a time, at increasing magnitude.

    >>> found = rans.stress("go-to-pose-2d", only=["latency"], episodes=8, workers=1)
    >>> found.section.tables[1].rows[0][:2]
    ('latency', 's')

    Args:
        *contestants: see `rans.api.judging.compare`; after it, the name of a controller is enough, such as lqr.
        conditions: sets of conditions to fly under, by name (see `rans list CONDITIONS`) or TOML file; by default
            lab, roboran, orbit and harsh, with `only` none.
        only: fly under these disturbances only, such as latency "noise of position"; by default under all, and with
            failed thrusters.
        episodes: number of flights at each magnitude and in each set of conditions; an eighth of it for slow
            controllers such as mpc.
        slow_episodes: the same for slow controllers; by default the eighth.
        seed: random seed of starts, goals and disturbances.
        worst: number of worst episodes that the report lists for each contestant.
        trust: see `rans.api.judging.compare`.
        workers: number of processes; by default one per processor.
        output: folder of the results; by default that of the first contestant, and in Python none is written.
        guard: see `rans.api.judging.evaluate`.
        show: function that is called with the report at the end, also after an interrupt or an error.

    Raises:
        ConfigError: there is no such contestant or disturbance, or a number is out of its range.
    """
    from rans.evaluation.compare.entrants import contest_of, invitations
    from rans.extend import inside, ready_folder, watched
    from rans_assurance.stress.report import StressReport
    from rans_assurance.stress.run import prepared

    # Names and options, refused before anything flies.
    first, invited = invitations(contestants)
    contest = contest_of(first, whole("episodes", episodes), seed, trust=trust, guard=guard)
    names = conditions
    if names is None:
        names = () if only else STRESSED
    sets = {name: load_conditions(name, contest.craft) for name in names}
    # Slow controllers fly 32 of 256 starts: their interval is then about three times as wide.
    slow = max(1, episodes // 8) if slow_episodes is None else whole("slow_episodes", slow_episodes)
    planned = prepared(contest, invited, sets, only, slow, trust)
    folder = Path()
    if output is not None:
        folder = ready_folder(output)
        inside(folder, "stress")  # a symbolic link is rejected before the flights
    # The report exists before the flights, so that an interrupt has what was flown.
    report = StressReport(planned, folder, whole("worst", worst, least=0))

    def save() -> None:
        if output is not None and planned.outcomes:
            report.write()

    def end() -> None:
        save()
        if show is not None:
            show(report)

    with (
        writing_at_end(end, None if output is None else folder / "stress.json"),
        watched(save) as stage,
    ):
        planned.fly(stage, workers)
    return report


def assure(
    agent: object,
    *,
    conditions: ConditionsLike | None = None,
    episodes: int | None = None,
    failure_below: float | None = None,
    confidence: float = 0.99,
    worst: int = 4,
    seed: int = ASSURANCE_SEED,
    device: str = "auto",
    trust: bool = False,
    output: str | Path | None = None,
    show: Callable[[Assurance], object] | None = None,
) -> Assurance:
    """Bound the failure probability of an agent by Monte Carlo simulation, and fly the failures again.

    >>> found = rans.assure("go-to-pose-2d", episodes=2000, worst=0)
    >>> found.campaign.flights, found.campaign.bound().high < 0.02
    (2000, True)

    Args:
        agent: run folder, agent that comes with RANS, or any other contestant, such as CONTROLLER:TASK-2d or
            sb3:FILE.zip:TASK-2d; these fly more slowly.
        conditions: see `rans.api.judging.evaluate`.
        episodes: number of flights, by default 100,000; where a probability is to be shown, the largest number.
        failure_below: failure probability to show or to refute, such as 1e-4; the campaign ends as soon as
            its count decides.
        confidence: confidence of every bound.
        worst: number of failed flights of each kind that are flown again in Drake.
        seed: random seed of starts, goals and conditions.
        device: "auto" (a GPU if there is one), "cpu" or "cuda".
        trust: see `rans.api.judging.compare`.
        output: folder of the results; by default that of the agent, and in Python none is written.
        show: function that is called with the assurance at the end, also after an interrupt or an error.

    Raises:
        ConfigError: there is no such agent, or a number is out of its range.
    """
    from rans.extend import ready_folder, torch_device, watched, write_json
    from rans_assurance.assure.assurance import Assurance
    from rans_assurance.assure.bounds import plan
    from rans_assurance.assure.campaign import Campaign

    # What is wrong is refused before anything flies.
    if os.environ.get("WORLD_SIZE", "1") != "1":
        raise ConfigError("an assurance flies in one process: leave out torchrun.")
    again = whole("worst", worst, least=0)
    if episodes is not None or failure_below is None:
        episodes = whole("episodes", ASSURED if episodes is None else episodes)
    in_memory = agent if isinstance(agent, AgentData) else None
    assurance = Assurance(
        (in_memory.spec or in_memory.name) if in_memory else str(agent),
        None if conditions is None else str(getattr(conditions, "description", conditions)),
        Campaign(plan(confidence, episodes, failure_below), seed),
        command=made_by("rans.assure"),
        trust=trust,
        world=conditions_if_named(conditions),
        given=in_memory.run if in_memory else None,
    )
    _ = assurance.run  # refuses a wrong name before a folder is made
    if output is not None:
        assurance.write_into(ready_folder(output))
    processor = torch_device(device)
    file = assurance.file

    def save() -> None:
        if file is not None and assurance.campaign.flights:
            write_json(file, assurance.to_json(), beside=())

    def end() -> None:
        """Write and show what was flown so far, also after an interrupt."""
        save()
        if show is not None and assurance.campaign.flights:
            show(assurance)

    with writing_at_end(end, file), watched(save) as stage:
        assurance.fly(processor, stage)
        stage("failed flights again", None)
        assurance.replay(again)
    return assurance


def follow(
    agent: object,
    *,
    episodes: int = 16,
    seed: int = EVALUATION_SEED,
) -> Metrics:
    """Fly an agent that tracks velocities around a circle of 1.5 m, with the paper's look-ahead planner.

    >>> found = rans.follow("track-velocity-2d", episodes=2)
    >>> found["cross-track RMS"].value < 10.0
    True

    Args:
        agent: run folder of an agent for track-velocity, pretrained:NAME, or CONTROLLER:track-velocity-2d or -3d,
            with @SPACECRAFT if you like.
        episodes: number of flights; each starts at rest near the first point of the circle, with another attitude.
        seed: random seed of the starts.

    Raises:
        ConfigError: the agent is for another task, or a number is out of its range.
    """
    from rans.evaluation.fly.contestants import in_protocol
    from rans_assurance.circle import LookAhead, fly_circle, tracked

    planner = LookAhead()
    run = in_protocol(agent, "own")
    return tracked(fly_circle(run, planner, seed, whole("episodes", episodes)), planner)


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
        from rans.extend import Table, html_of

        title = f"{self.spacecraft.name}: recoverable faults"
        return html_of(Table(FAULT_COLUMNS, self.rows(), title))

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
        spacecraft: name of a spacecraft that comes with RANS, or your own TOML file.

    Raises:
        ConfigError: there is no such spacecraft, or it has one thruster.
    """
    from rans.extend import watched
    from rans.randomization.faults import fault_sets

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
