"""Figures of the agents for any craft, on craft that they have never flown.

``python -m campaigns.any_craft craft`` prints the table of the shipped craft, ``frugal`` that of its frugalities,
``layouts`` that of random layouts, ``dead`` that of a dead thruster, ``mass`` that of another mass and ``unstated``
that of faults and masses that no file states, in space with ``--dimension 3``. They stand on the pages of
packages/any_craft/docs.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
import torch
from rans_any_craft.training import (
    DemandSettings,
    Law,
    Layers,
    demanded,
    draw_batch,
    draw_pool,
    fly,
    policy_layers,
    stopping_law,
)
from scipy.linalg import solve_discrete_are
from torch import Tensor

from campaigns.craft import CRAFTS, flown
from campaigns.markdown import lines
from rans.episode import Setup
from rans.errors import ConfigError
from rans.evaluation.fly.agent import LoadedRun
from rans.evaluation.fly.any_craft import for_spacecraft, frugal
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.fly.make_controller import controller
from rans.evaluation.measure.metrics import impulses, settling_times, solved
from rans.evaluation.measure.statistics import share
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.control.regulator import Weights
from rans.policy.any_craft import COAST, without
from rans.policy.authority import Authority, coasting, columns, rotation_vector
from rans.pretrained import ADAPTIVE, FOR_ANY_CRAFT
from rans.processes import Workers
from rans.randomization.conditions import Conditions, FaultConditions, FaultKind
from rans.randomization.faults import fault_sets
from rans.scenario import EVALUATION_SEED

SPECIALISTS = {
    2: (
        "go-to-pose-2d",
        "go-to-pose-2d-shared",
        "atmos",
        "pingu",
        "freeflyer2",
        "astrobee-granite",
        "roboran-platform",
    ),
    3: (
        "go-to-pose-3d",
        "spheres",
        "astrobee-iss",
        "atmos-orbit-12",
        "atmos-orbit-16",
        "cubesat-3u",
        "cubesat-6u",
        "afrl-12kg",
        "apollo-csm",
    ),
}
"""Agents of a single craft each, whose task, starts, conditions and control period are the protocol; real craft
without such an agent have one in `campaigns.craft`."""
CONTESTANTS = "specialist", "any-craft", "LQR", "switching", "MPC"
"""Who flies a craft; the specialist only the craft that it was trained on."""
_STATED = CONTESTANTS[1:]
"""Who flies craft that its file describes."""
_MOST = {"switching": 64, "MPC": 64}
"""Largest number of flights of those who take seconds for each."""
_MOST_OF_EACH = {"switching": 8, "MPC": 4}
"""Largest number of flights of each thruster that is dead in turn, by who takes seconds for a flight."""
_VALUES = 0.0, 0.15, 0.3, 0.5, 0.75, 1.0
"""Frugalities of the table of frugal flights."""
_OF_MASS: dict[str, dict[str, Any]] = {
    f"mass {x:g} times": {"mass": x} for x in (0.5, 0.7, 1.5, 2.0)
}
"""Masses and moments of inertia over those of the file that the agent is given, by heading."""
_HEAVY = "any-craft", "LQR"
"""Who flies craft of another mass."""
_ANY = {"any-craft": "", "adaptive": f"{ADAPTIVE}:"}
"""Contestants that are the agent for any craft, and what stands before its name."""
_FILE = ".toml"
"""How the name of a craft of a file ends."""
_WEAK = 0.5
"""Part of its command that a weak thruster gives."""


_LAYOUT_SEED = 1_000_003
"""Seed of layouts that no training has drawn: trainings draw from even seeds below."""
_PART = 64
"""Flights that a process flies at once, of which a contest of 1,024 has 16: they are the same however divided."""
_PART_OF_SLOW = 4
"""Number of flights that a job of a process has, where the contestant takes seconds for each."""
_BINS = 0.25, 0.35, 0.5, 0.75, 1.0, 1.5, np.inf
"""Bounds of the authority margin, by which random layouts are listed."""


class Figures(NamedTuple):
    """What the flights of a contest have come to."""

    settled: float
    """Flights that settle, %."""
    low: float
    """Lower end of its 95 % interval, %."""
    time: float
    """Median settling time, s; infinite where most flights never settle."""
    impulse: float
    """Mean impulse, N s."""


_REFUSED = Figures(0.0, 0.0, np.inf, np.inf)
"""Figures of a controller that refuses the craft: no flight settles."""


class Contest(NamedTuple):
    """Who flies a craft, in the setup of the agent of that craft alone."""

    name: str
    """Agent of a single craft, whose task, starts, conditions and control period are the setup; or a file of a
    craft, which flies as `rans evaluate FILE` flies it."""
    by: str
    """A name of `CONTESTANTS`, or "adaptive"."""
    mass: float = 1.0
    """Mass and moments of inertia that the craft flies with, over those of its file."""
    dead: int | None = None
    """Number of the thruster that the craft has lost."""
    is_stated: bool = True
    """Whether the controller's file has the other mass, or lacks the thruster."""
    value: float | None = None
    """Frugality of the agent for any craft, see `rans.policy.any_craft.frugal`; None: as it was trained."""
    fault: FaultKind | None = None
    """Fault of a thruster in every flight, drawn among those that the craft can spare."""


def _own(name: str) -> LoadedRun:
    """The setup of a contest, with the agent of that craft alone where there is one."""
    if name.endswith(_FILE):
        craft = load_spacecraft(name)
        return for_spacecraft(contestant(f"pretrained:{FOR_ANY_CRAFT[craft.dimension]}"), craft)
    return flown(name) if name in CRAFTS else contestant(f"pretrained:{name}")


def _may_fly(by: str, name: str) -> bool:
    """Whether there is such a contestant: a real craft, or one of a file, may have no agent of its own."""
    return by != "specialist" or not (name in CRAFTS or name.endswith(_FILE))


class _Judge(NamedTuple):
    """Seed of the flights of every contest, and the agent for any craft."""

    start_seed: int
    agent: str | None
    """Run folder of an agent for any craft; None: the one that comes with RANS."""

    def flights(self, contest: Contest, first: int, count: int) -> Flights | None:
        """Consecutive flights of a contest; None: the controller refuses the craft."""
        own = _own(contest.name)
        craft = own.craft
        if contest.mass != 1.0:
            inertia = tuple(tuple(contest.mass * x for x in row) for row in craft.inertia)
            craft = replace(craft, mass=contest.mass * craft.mass, inertia=inertia)  # pyrefly: ignore[bad-argument-type]
        if contest.dead is not None:
            craft = without(craft, contest.dead)
        stated = craft if contest.is_stated else own.craft
        if contest.fault is not None:
            faults = FaultConditions(
                count=1.0, kinds=(contest.fault,), share=_WEAK, among="recoverable"
            )
            conditions = replace(own.conditions or Conditions(), faults=faults)
            own = own._replace(conditions=conditions)
        run = own
        try:
            if contest.by in _ANY:
                name = self.agent or f"pretrained:{FOR_ANY_CRAFT[craft.dimension]}"
                agent = contestant(f"{_ANY[contest.by]}{name}")
                run = for_spacecraft(agent, stated, own.timing)
                if contest.value is not None:
                    run = frugal(run._replace(task=own.task), contest.value)
            elif contest.by != "specialist":
                setup = Setup(stated, own.task, own.timing, own.conditions)
                run = own._replace(controller=controller(contest.by.lower(), setup))
        except ConfigError:
            return None
        run = run._replace(craft=craft, task=own.task, conditions=own.conditions)
        flight = fly_episodes(
            run.controller, run.judged, self.start_seed, count, workers=1, first=first
        )
        return Flights(solved(flight), settling_times(flight), impulses(flight))


class Flights(NamedTuple):
    """N flights."""

    settled: np.ndarray
    """Whether each settles, (N,)."""
    times: np.ndarray
    """Settling times, (N,) s."""
    impulses: np.ndarray
    """Impulses, (N,) N s."""

    def figures(self) -> Figures:
        """What they have come to."""
        settled = share(self.settled).scaled(100.0)
        time, impulse = np.median(self.times), np.mean(self.impulses)
        return Figures(settled.value, settled.low, float(time), float(impulse))


def _judged(
    contests: Sequence[Contest],
    episodes: int,
    start_seed: int = EVALUATION_SEED,
    agent: str | None = None,
) -> Iterator[Figures]:
    """Figures of each contest in order, flown on all processors; some fly fewer (`_MOST`, `_MOST_OF_EACH`)."""
    parts = {contest: list(_parts(contest, episodes)) for contest in contests}
    jobs = [(contest, *part) for contest in contests for part in parts[contest]]
    workers = Workers(_Judge, (start_seed, agent), work="flew craft")
    answers = workers.ordered(_Judge.flights, jobs)
    for contest in contests:
        found = [next(answers) for _ in parts[contest]]
        if None in found:
            yield _REFUSED
        else:
            yield Flights(*map(np.concatenate, zip(*found, strict=True))).figures()


def _parts(contest: Contest, episodes: int) -> Iterator[tuple[int, int]]:
    """First flight and number of flights of each part of a contest."""
    most = (_MOST if contest.dead is None else _MOST_OF_EACH).get(contest.by, episodes)
    size = _PART_OF_SLOW if contest.by in _MOST_OF_EACH else _PART
    end = min(most, episodes)
    for first in range(0, end, size):
        yield first, min(size, end - first)


def _cell(found: Figures, text: str) -> str:
    """Text with figures in braces."""
    return "refuses" if found is _REFUSED else text.format(**found._asdict())


_SETTLED = "{settled:.1f} %"
_ALL = "{settled:.1f} %, {time:.1f} s, {impulse:,.1f} N s"


def _label(contest: Contest) -> str:
    """Craft and contestant of a row."""
    craft = _own(contest.name).craft
    value = "" if contest.value is None else f"#{contest.value:g}"
    who = f"{_ANY.get(contest.by, contest.by)}{FOR_ANY_CRAFT[craft.dimension] * (contest.by in _ANY)}{value}"
    return f"{craft.name} | {who}"


def shipped(
    episodes: int,
    names: Sequence[str],
    start_seed: int = EVALUATION_SEED,
    agent: str | None = None,
    by: Sequence[str] = CONTESTANTS,
) -> Iterator[str]:
    """Rows of the table of shipped craft, as Markdown, from the starts of a seed."""
    contests = [Contest(name, who) for name in names for who in by if _may_fly(who, name)]
    texts = _SETTLED, "{low:.1f} %", "{time:.1f}", "{impulse:.1f}"
    return lines(
        ("craft", "flown by", "settled", "lower end", "settling time, s", "impulse, N s"),
        (
            (_label(contest), *(_cell(found, text) for text in texts))
            for contest, found in zip(
                contests, _judged(contests, episodes, start_seed, agent), strict=True
            )
        ),
    )


def crossed(
    episodes: int,
    names: Sequence[str],
    rows: Sequence[Contest],
    columns: Mapping[str, Mapping[str, Any]],
    text: str,
) -> Iterator[str]:
    """Rows of a table of every craft and contest with every change, such as another mass, by heading."""
    spare = {name: _spare(_own(name).craft) for name in names}
    contests = {
        row._replace(name=name): [
            row._replace(name=name, **change) if spare[name] or "fault" not in change else None
            for change in columns.values()
        ]
        for name in names
        for row in rows
    }
    judged = _judged([one for row in contests.values() for one in row if one], episodes)
    return lines(
        ("craft", "flown by", *columns),
        (
            (
                f"{_label(row)}{', in its file' * row.is_stated}",
                *("-" if one is None else _cell(next(judged), text) for one in changed),
            )
            for row, changed in contests.items()
        ),
    )


def heavier(episodes: int, names: Sequence[str]) -> Iterator[str]:
    """Rows of the table of craft with other masses, which the controller's file has or has not."""
    rows = [
        Contest("", by, is_stated=is_stated) for by, is_stated in product(_HEAVY, (True, False))
    ]
    return crossed(episodes, names, rows, _OF_MASS, _SETTLED)


def unstated(
    episodes: int, names: Sequence[str], values: Sequence[float | None] = (None,)
) -> Iterator[str]:
    """Rows of the table of faults and masses that no file states: the agent without and with its estimates.

    Values are frugalities; None: as the agent was trained.
    """
    rows = [Contest("", by, is_stated=False, value=value) for by, value in product(_ANY, values)]
    faults: dict[str, dict[str, Any]] = {
        f"one {kind}": {"fault": kind} for kind in ("dead", "weak")
    }
    return crossed(episodes, names, rows, {"as in its file": {}, **faults, **_OF_MASS}, _ALL)


def dead(episodes: int, names: Sequence[str], by: Sequence[str] = _STATED) -> Iterator[str]:
    """Rows of the table of craft that have lost a thruster.

    The file lacks each thruster in turn; then 1,024 flights with a thruster that is drawn, of which the file says
    nothing. Some fly fewer (`_MOST_OF_EACH`, then `_MOST`).
    """
    spare = {name: _spare(_own(name).craft) for name in names}
    each = _judged(
        [Contest(name, one, dead=k) for name in names for one in by for k in spare[name]], episodes
    )
    some = [name for name in names if spare[name]]
    unknown = _judged([Contest(name, one, fault="dead") for name in some for one in by], 1024)

    def row(name: str) -> Sequence[str]:
        craft = _own(name).craft
        numbers = spare[name]
        # A controller that refuses one of the craft settles none of its flights.
        worst = [min((next(each) for _ in numbers), default=None) for _ in by]
        drawn = [next(unknown) if numbers else None for _ in by]
        cells = (
            ", ".join("-" if one is None else _cell(one, _SETTLED) for one in found)
            for found in (worst, drawn)
        )
        return craft.name, f"{len(numbers)} of {craft.thruster_count}", *cells

    who = ", ".join(by)
    headings = f"in its file: {who}", f"not in its file: {who}"
    return lines(("craft", "thrusters that it can spare", *headings), map(row, names))


def at_values(
    episodes: int, names: Sequence[str], values: Sequence[float], start_seed: int, by: Sequence[str]
) -> Iterator[str]:
    """Rows of the table of the agent without a value and at several, and who of the others it beats.

    It beats a contestant if all flights settle and neither median settling time nor mean impulse is larger.
    """
    kinds = [Contest("", "any-craft", value=value) for value in (None, *values)]
    kinds += [Contest("", who) for who in by if who not in _ANY]
    contests = {
        name: [kind._replace(name=name) for kind in kinds if _may_fly(kind.by, name)]
        for name in names
    }
    judged = _judged([one for row in contests.values() for one in row], episodes, start_seed)

    def rows() -> Iterator[Sequence[str]]:
        for own in contests.values():
            found = {one: next(judged) for one in own}
            others = {one.by: spent for one, spent in found.items() if one.by not in _ANY}
            for one, (settled, _, time, impulse) in found.items():
                left = [
                    who
                    for who, its in others.items()
                    if not (settled == 100.0 and time <= its.time and impulse <= its.impulse)
                ]
                said = (", ".join(left) or "none") if one.by in _ANY else ""
                yield _label(one), f"{settled:.1f} %", f"{time:.2f}", f"{impulse:.2f}", said

    headings = "settled", "settling time, s", "impulse, N s", "not beaten by it"
    return lines(("craft", "flown by", *headings), rows())


def _spare(craft: Spacecraft) -> list[int]:
    """Numbers of the thrusters without which the others can still push and turn the craft every way."""
    return [found.thrusters[0] for found in fault_sets(craft, 1, "dead") if found.recoverable]


def random_layouts(count: int, dimension: int) -> Iterator[str]:
    """Rows of the table of random layouts by their authority margin, flown by the agent and by two laws."""
    layers = policy_layers(contestant(f"pretrained:{FOR_ANY_CRAFT[dimension]}").network)
    settings = DemandSettings(dimension, crafts=count, steps=320)
    # Starts are as far away as the training's; a regulator needs longer from there.
    steps = 2 * settings.steps
    pool = draw_pool(count, _LAYOUT_SEED, dimension, workers=None)
    contestants: dict[str, Callable[[bool], Law]] = {
        "any-craft": lambda continuous: _law(layers, 0.0 if continuous else COAST),
        "LQR": lambda _: LinearLaw(),
        "braking": lambda _: stopping_law,
    }
    kinds = [(continuous, by) for continuous in (False, True) for by in contestants]
    parts = []
    for continuous, by in kinds:
        # The same craft and starts for all.
        generator = torch.Generator().manual_seed(EVALUATION_SEED)
        batch = draw_batch(pool, settings, generator, continuous, perturbed=False)
        with torch.no_grad():
            outcome = fly(contestants[by](continuous), batch, settings, generator, steps)
        parts.append((batch.pool.margin.numpy(), outcome.settled.numpy()))
    rows = []
    for low, high in pairwise(_BINS):
        inside = [(settled, (margin >= low) & (margin < high)) for margin, settled in parts]
        number = int(((pool.margin >= low) & (pool.margin < high)).sum())
        bound = f"{low:g} to {high:g}" if np.isfinite(high) else f"above {low:g}"
        cells = (f"{100 * x[own].mean():.1f} %" if own.any() else "-" for x, own in inside)
        rows.append((bound, number, *cells))
    titles = [f"{'continuous' if continuous else 'on/off'}: {by}" for continuous, by in kinds]
    return lines(("authority margin", "layouts", *titles), rows)


def _law(layers: Layers, periods: float) -> Law:
    """Demands of a network that coasts for some control periods near the goal, or for 0 never."""

    def demand(
        error: Sequence[Tensor],
        turn: tuple[Tensor, Sequence[Tensor]],
        velocity: Sequence[Tensor],
        spin: Sequence[Tensor],
        own: Authority,
        before: Tensor,
    ) -> Tensor:
        state = error, turn, velocity, spin
        if periods:
            state = coasting(*state, own, periods)
        return demanded(layers, torch.stack(columns(*state, own), dim=1))

    return demand


class LinearLaw:
    """Demands (N, d) of a linear-quadratic regulator with the weights of `rans.LQR`, of a batch of craft.

    Every axis is a double integrator whose input, a change of speed u times the authority in a period T, costs as
    much at 1 as the deviation of the weights. Gains are the discrete-time optimum. What the thrusters did not give
    is demanded in the next period (sigma-delta), at most a unit of each axis.
    """

    def __init__(self) -> None:
        self.demanded: Tensor | None = None
        self._gains: list[Tensor] = []

    def __call__(
        self,
        error: Sequence[Tensor],
        turn: tuple[Tensor, Sequence[Tensor]],
        velocity: Sequence[Tensor],
        spin: Sequence[Tensor],
        authority: Authority,
        before: Tensor,
    ) -> Tensor:
        """See `rans_any_craft.training.Law`."""
        period, _, _, a, alpha, _ = authority
        weights = Weights()
        axes = (
            (error, velocity, a, weights.position),
            (rotation_vector(*turn), spin, alpha, weights.attitude),
        )
        if not self._gains:
            # In units of the deviation s and of the authority a T: x' = x + p (v + u / 2), v' = v + u, with
            # p = a T^2 / s; the speed that costs as much is sqrt(a s), which is 1 / sqrt(p) of a T.
            sizes = [most * period.square() / deviation for _, _, most, deviation in axes]
            self._gains = [torch.tensor([gains(float(p)) for p in size]).T for size in sizes]
        demand = []
        for (way, speed, most, deviation), (near, fast) in zip(axes, self._gains, strict=True):
            push = most * period
            demand += [
                near * x / deviation - fast * v / push for x, v in zip(way, speed, strict=True)
            ]
        fed_back = torch.stack(demand, dim=1).clamp(-2.5, 2.5)
        if self.demanded is not None:
            fed_back = fed_back + (self.demanded - before).clamp(-1.0, 1.0)
        self.demanded = fed_back
        return fed_back


@cache
def gains(p: float) -> tuple[float, float]:
    """Gains of position and speed of a double integrator that a unit moves by p / 2; see `linear_law`."""
    motion = np.array([[1.0, p], [0.0, 1.0]])
    input_ = np.array([[0.5 * p], [1.0]])
    cost = solve_discrete_are(motion, input_, np.diag([1.0, p]), np.eye(1))
    gain = np.linalg.solve(1.0 + input_.T @ cost @ input_, input_.T @ cost @ motion)
    return float(gain[0, 0]), float(gain[0, 1])


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add("part", choices=("craft", "frugal", "dead", "mass", "unstated", "layouts"))
    add("--dimension", type=int, choices=(2, 3), default=2)
    add("--episodes", type=int, default=256)
    add("--layouts", type=int, default=1024)
    add("--start-seed", type=int, default=EVALUATION_SEED)
    add("--agent", help="run folder whose agent craft flies; by default the shipped one")
    add("--only", nargs="*", help="agents of single craft; by default all")
    add("--values", nargs="*", type=float, help="of frugal and unstated")
    add("--by", nargs="*", choices=CONTESTANTS, help="who flies craft and dead")
    given = parser.parse_args()
    flown = given.episodes, given.only or SPECIALISTS[given.dimension]
    rows = {
        "craft": lambda: shipped(*flown, given.start_seed, given.agent, given.by or CONTESTANTS),
        "frugal": lambda: at_values(
            *flown, given.values or _VALUES, given.start_seed, given.by or _STATED
        ),
        "dead": lambda: dead(*flown, given.by or _STATED),
        "mass": lambda: heavier(*flown),
        "unstated": lambda: unstated(*flown, given.values or (None,)),
        "layouts": lambda: random_layouts(given.layouts, given.dimension),
    }
    for row in rows[given.part]():
        print(row, flush=True)  # noqa: T201


if __name__ == "__main__":
    # Other processes know the classes of this module, and not those of __main__.
    from campaigns import any_craft

    torch.set_num_threads(1)
    any_craft.main()
