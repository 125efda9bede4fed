"""What agents hold when thrusters fail, by class of fault, and how far they drift where no controller could.

``python -m campaigns faults`` flies run folders and ``pretrained:NAME``, on a GPU if there is one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from rans_bounds import hull
from rans_bounds.certificate import certified_least_time
from rans_bounds.hull import Health, settling_set
from rans_bounds.plane.bounder import PlanarBounder
from rans_bounds.plane.lattice import Lattice
from rans_bounds.problem import Problem, SearchEffort
from tyro.conf import Positional

from campaigns.batch import Rows, flown, study
from rans.base.files import read_json
from rans.base.processes import Workers, nothing
from rans.episode.scenario import EVALUATION_SEED, Scenario, draws, each, scenarios
from rans.episode.step import Episode, Setup, World
from rans.model.dynamics import PlanarState
from rans.model.spacecraft import Spacecraft
from rans.policy.network import Network
from rans.randomization.conditions import Conditions, FaultChoice, FaultConditions, FaultKind
from rans.randomization.faults import fault_sets

_HELD_OUT = 0.3, 1.0
"""Share of its force that a weak thruster has, which no training knows."""
_EFFORT = SearchEffort(work=2.0, nozzle_work=0.3, levels=1)
"""Nearly all certificates are then exact."""

_CELLS = "by 15 s", "any moment", "over the hull's"
_HEADINGS = (
    "recoverable fault (how many; in space)",
    "plane: from the start",
    *_CELLS,
    "over the certified",
    "space: from the start",
    *_CELLS,
)


class Row(NamedTuple):
    """One class of fault, and when it comes."""

    name: str
    faults: FaultConditions

    @property
    def at_start(self) -> bool:
        """Whether the spacecraft is never sound."""
        return self.faults.time == 0.0


def rows(craft: Spacecraft, duration: float) -> Iterator[Row]:
    """Every class that this spacecraft has, from the start on and from a moment of the flight (s) on.

    A fault of the last fifth throws even the best off for a moment, and one shortly before it too; so moments
    are also drawn from the first three fifths.
    """
    yield Row("none", FaultConditions())
    kinds: tuple[FaultKind, ...] = ("dead", "stuck-open", "weak")
    choices: tuple[FaultChoice, ...] = ("recoverable", "unrecoverable")
    for among, count, kind in product(choices, (1, 2), kinds):
        shares = _HELD_OUT if kind == "weak" else (1.0, 1.0)
        sets = fault_sets(craft, count, kind, shares)
        found = sum(one.recoverable == (among == "recoverable") for one in sets)
        early = 0.6 * duration
        for moment, time in (
            (("", 0.0), (f", by {early:g} s", (0.0, early)), (", any moment", (0.0, duration)))
            if found
            else ()
        ):
            yield Row(
                f"{('one', 'two')[count - 1]} {kind}, {among} ({found}){moment}",
                FaultConditions(float(count), (kind,), shares, time, among),
            )


def met(
    setup: Setup, faults: FaultConditions, episodes: int, seed: int
) -> Iterator[tuple[Any, Health]]:
    """Start and goal of each of these episodes, and what is left of its thrusters from the start on."""
    task = setup.task
    own = draws(seed, episodes)
    world = World(Setup(setup.craft, task, setup.timing, Conditions(faults=faults).or_none))
    case = world.recalled(Episode(None, None), own).parameters
    health = [Health.sound(setup.craft)] * episodes
    if case is not None:
        left = [
            np.array([np.broadcast_to(x, episodes) for x in part]).T.tolist()
            for part in (case.body_at(0.0).gain, case.body_at(0.0).leak)
        ]
        health = [Health(tuple(gain), tuple(leak)) for gain, leak in zip(*left, strict=True)]
    return zip(each(scenarios(task, setup.craft, seed, episodes)), health, strict=True)


def bounds(setup: Setup, faults: FaultConditions, episodes: int, seed: int) -> np.ndarray:
    """(N,) least times to settle with what each of these episodes has from the start on, s."""
    craft = setup.craft
    near = setup.task.tolerances()
    period = setup.timing.control_period
    aimed = "position", "velocity", "attitude"
    times = []
    for one, health in met(setup, faults, episodes, seed):
        settled = settling_set(craft, near["position"], near["attitude"], period, health)
        times.append(hull.least_time(craft, aimed, one.start, one.goal, settled, health))
    return np.array(times)


def certified(setup: Setup, faults: FaultConditions, episodes: int, seed: int) -> np.ndarray:
    """The same in the plane, closer: no on/off controller settles sooner, though it knows what fails.

    Of thrusters that are dead or stuck open; ConfigError where there is no certificate.
    """
    jobs = [(setup, one, health) for one, health in met(setup, faults, episodes, seed)]
    return np.array([*Workers(nothing, work="certified flights").ordered(_certified, jobs)])


def _certified(_: None, setup: Setup, scenario: Scenario, health: Health) -> float:
    """Of one episode."""
    near = setup.task.tolerances()
    timing = setup.timing
    dead = [i for i, pair in enumerate(zip(*health, strict=True)) if pair == (0.0, 0.0)]
    stuck = [i for i, leak in enumerate(health.leak) if leak == 1.0]
    within = settling_set(
        setup.craft, near["position"], near["attitude"], timing.control_period, health
    )
    start, goal = cast("tuple[PlanarState, PlanarState]", (scenario.start, scenario.goal))
    lattice = Lattice(setup.craft, timing.control_period, dead, stuck)
    problem = Problem(start, goal, within)
    return certified_least_time(
        PlanarBounder(lattice), problem, timing.episode_steps, _EFFORT
    ).lower


@dataclass(frozen=True)
class Faults:
    """Fly agents with every class of fault."""

    agents: Positional[tuple[str, ...]]
    """Run folders, or pretrained:NAME; all of one spacecraft, and going to a pose."""
    episodes: int = 10_000
    bounded: int = 1000
    """Of so many first episodes of each class the hull's least time."""
    certified: int = 0
    """Of so many first episodes of each class the certified least time, ten seconds each, in the plane."""
    seed: int = EVALUATION_SEED

    def measured(self) -> dict[str, Any]:
        """By agent and row.

        Raises:
            ConfigError: there is no such agent.
        """

        def measure(network: Network, setup: Setup, device: str) -> Rows:
            duration = setup.timing.episode_steps * setup.timing.control_period
            return {
                row.name: self._said(network, setup, row, device)
                for row in rows(setup.craft, duration)
            }

        return {"agents": study(self.agents, measure)}

    def _said(self, network: Network, setup: Setup, row: Row, device: str) -> dict[str, Any]:
        found = flown(
            network, setup, Conditions(faults=row.faults), self.episodes, self.seed, device
        )
        median = lambda x: float(np.median(x))  # noqa: E731
        said = {
            **found.said(),
            "lost": 100.0 * float(found.lost.mean()),
            **{
                name: [float(x) for x in np.quantile(getattr(found, name), (0.5, 0.95))]
                for name in ("distance", "speed", "spin")
            },
        }
        if row.at_start and row.faults.among != "unrecoverable":
            first = min(self.episodes, self.bounded)
            least = bounds(setup, row.faults, first, self.seed)
            said |= {
                "least time": median(least),
                "over least": median(found.settled[:first] / least),
            }
            if self.certified and row.faults.kinds != ("weak",):
                least = certified(setup, row.faults, self.certified, self.seed)
                said |= {
                    "certified": median(least),
                    "over certified": median(found.settled[: self.certified] / least),
                }
        return said


def in_document(docs: Path) -> tuple[tuple[str, ...], Sequence[tuple[str, ...]]]:
    """The table of robustness.md: of one agent in the plane, one in space, what may be recovered from."""
    plane, space = (
        next(iter(read_json(docs / "validation" / f"{name}.json")["agents"].values()))
        for name in ("faults", "faults-space")
    )
    names = ([name for name in found if "over least" in found[name]] for found in (plane, space))
    rows = [
        (
            _both(here, there),
            *_cells(plane, here),
            _number(plane[here].get("over certified")),
            *_cells(space, there),
        )
        for here, there in zip(*names, strict=True)
    ]
    return _HEADINGS, rows


def _both(plane: str, space: str) -> str:
    """A class of faults, and of how many, such as (8; 16), in the plane and in space."""
    kind, _, count = (
        plane.replace(", recoverable", "").replace("stuck-open", "stuck open").partition(" (")
    )
    unknown = f", {_HELD_OUT[0]:g} to {_HELD_OUT[1]:g}, in no training" if "weak" in kind else ""
    return f"{kind} ({count[:-1]}; {space.partition(' (')[2]}{unknown}" if count else kind


def _cells(found: Rows, name: str) -> tuple[str, ...]:
    moments = [f"{name}, by 15 s", f"{name}, any moment"]
    held = [
        _number(found[one]["held"]["value"] if one in found else None) for one in (name, *moments)
    ]
    return (*held, _number(found[name]["over least"]))


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"
