"""The agents for any craft: their training, and their figures on craft that they have never flown.

``python -m campaigns.any_craft train --seed 12 --device cuda`` trains that of the plane and writes it into the
package, ``train --dimension 3 --seed 1 --device cuda`` that of space; ``values`` in its place trains only the
weights of every value from fast to frugal, from those of the agent, which stay;
``craft`` in its place prints the table of the shipped craft, ``frugal`` that of its frugalities, of
docs/any_craft/any_craft_frugal.md, ``layouts`` that of random layouts (with ``--engine
drake`` that of some as spacecraft, in the engine and in Drake), ``dead`` that of a dead thruster, ``mass`` that
of another mass, ``unstated`` that of faults and masses that no file states, all of docs/any_craft/any_craft.md;
``joined`` that of two docked craft, of docs/any_craft/any_craft_training.md; ``picture`` draws layouts.
``--dimension 3`` does the same in space, of docs/any_craft/any_craft_in_space.md.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from functools import cache
from itertools import pairwise, product
from pathlib import Path
from shutil import copytree
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from rans_any_craft.evolution import NODES, SETTINGS, evolve
from rans_any_craft.layout_bodies import layout_spacecraft
from rans_any_craft.layouts import layouts
from rans_any_craft.training import (
    RANGES_OF_LAYOUTS,
    DemandNetwork,
    DemandSettings,
    Law,
    Layers,
    Stage,
    as_policy,
    demanded,
    draw_batch,
    draw_pool,
    fly,
    policy_layers,
    stopping_law,
    train,
    with_weights,
)
from scipy.linalg import solve_discrete_are
from torch import Tensor

from campaigns.craft import CRAFTS, flown
from rans.deploy.export import evaluated
from rans.episode import Setup
from rans.errors import ConfigError
from rans.evaluation.fly.agent import LoadedRun
from rans.evaluation.fly.any_craft import for_spacecraft, frugal
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.fly.make_controller import controller
from rans.evaluation.fly.protocols import fitting_protocols
from rans.evaluation.measure.metrics import impulses, settling_times, solved
from rans.evaluation.measure.statistics import share
from rans.fast.agent_files.agent import AGENT, actor_bytes, read_policy
from rans.fast.learn.config import TrainConfig, to_table
from rans.files import environment, read_json, write_json, write_text
from rans.model.joined import Effectors, joined
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft, to_toml
from rans.model.timing import Timing
from rans.model.twists import authority_margin
from rans.optimal.control.regulator import Weights
from rans.policy.any_craft import COAST, without
from rans.policy.authority import DIMENSIONS, Authority, coasting, columns, rotation_vector
from rans.policy.network import Network
from rans.pretrained import ADAPTIVE, FOLDER, FOR_ANY_CRAFT
from rans.processes import Workers
from rans.randomization.conditions import Conditions, FaultConditions, FaultKind
from rans.randomization.faults import fault_sets
from rans.scenario import EVALUATION_SEED
from rans.tasks import GoToPose

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
        "go-to-pose-3d-spheres",
        "go-to-pose-3d-astrobee-iss",
        "go-to-pose-3d-atmos-orbit-12",
        "atmos-orbit-16",
        "go-to-pose-3d-cubesat-3u",
        "go-to-pose-3d-cubesat-6u",
        "afrl-12kg",
        "apollo-csm",
    ),
}
"""Agents of a single craft each, whose task, starts, conditions and control period are the protocol; real craft
without such an agent have one in `campaigns.craft`."""
_OWN = {2: ("floating-platform", Timing(0.2, 1, 125)), 3: ("free-flyer", Timing(0.2, 1, 125))}
"""Craft and timing of an agent without a craft's name."""
RECIPES = {
    2: DemandSettings(
        stages=(Stage(295.0, 2.4, 0.9, 1.1), Stage(75.0, 2.6, 0.9, 0.6)),
        last=0.3,
        crafts=2048,
        coarse=0.4,
        shared=0.4,
    ),
    3: DemandSettings(
        3,
        (
            Stage(60.0, 1.0, 1.0),
            Stage(70.0, 2.5, 2.5),
            Stage(100.0, 2.0, 2.0, angle=0.05, learning_rate=1e-3),
        ),
        last=0.85,
        layouts=1920,
        crafts=4096,
        channels=3,
    ),
}
"""Trainings of the agents, by dimension, on one H200."""
CONTESTANTS = "specialist", "any-craft", "LQR", "switching", "MPC"
"""Who flies a craft; the specialist only the craft that it was trained on."""
_STATED = CONTESTANTS[1:]
"""Who flies craft that its file describes."""
_MOST = {"switching": 64, "MPC": 64}
"""Largest number of flights of those who take seconds for each."""
_MOST_OF_EACH = {"switching": 8, "MPC": 4}
"""Largest number of flights of each thruster that is dead in turn, by who takes seconds for a flight."""
_LAYOUTS_OF_VALUES = 960
"""Layouts of a training of weights for every value."""
_VALUES = 0.0, 0.15, 0.3, 0.5, 0.75, 1.0
"""Frugalities of the table of frugal flights."""
_MASSES = 0.5, 0.7, 1.5, 2.0
"""Masses and moments of inertia over those of the file that the agent is given."""


_ANY = {"any-craft": "", "adaptive": f"{ADAPTIVE}:"}
"""Contestants that are the agent for any craft, and what stands before its name."""
_FILE = ".toml"
"""How the name of a craft of a file ends."""
_WEAK = 0.5
"""Part of its command that a weak thruster gives."""


class Pair(NamedTuple):
    """Two craft that are docked."""

    first: str
    second: str
    position: tuple[float, ...]
    """Origin of the second craft's frame G in the frame G of the first, m."""
    attitude: Any = 0.0
    """Heading of the second's G, rad, or its quaternion (w, x, y, z)."""


PAIRS = {
    2: (
        Pair("floating-platform", "floating-platform", (0.62, 0.0)),
        Pair("atmos", "atmos", (0.4, 0.0), np.pi),
        Pair("freeflyer2", "roboran-platform", (0.47, 0.0)),
    ),
    3: (
        Pair("spheres", "spheres", (0.23, 0.0, 0.0)),
        Pair("free-flyer", "cubesat-6u", (0.5, 0.0, 0.0)),
    ),
}
"""Docked craft by dimension: they touch along x."""
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

    def flights(self, contest: Contest, first: int, count: int) -> Flights | str:
        """Consecutive flights of a contest, or why the controller refuses the craft."""
        own = _own(contest.name)
        craft = own.craft
        if contest.mass != 1.0:
            inertia = tuple(tuple(contest.mass * x for x in row) for row in craft.inertia)
            craft = replace(craft, mass=contest.mass * craft.mass, inertia=inertia)
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
        except ConfigError as error:
            return str(error)
        run = run._replace(craft=craft, task=own.task, conditions=own.conditions)
        flight = fly_episodes(
            run.controller, run.judged, self.start_seed, count, workers=1, first=first
        ).flight
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
) -> Iterator[Figures | str]:
    """Figures of each contest in order, flown on all processors; some fly fewer (`_MOST`, `_MOST_OF_EACH`)."""
    parts = {contest: list(_parts(contest, episodes)) for contest in contests}
    jobs = [(contest, *part) for contest in contests for part in parts[contest]]
    workers = Workers(_Judge, (start_seed, agent), work="flew craft")
    answers = workers.ordered(_Judge.flights, jobs)
    for contest in contests:
        found = [next(answers) for _ in parts[contest]]
        refused = [one for one in found if isinstance(one, str)]
        flights = [one for one in found if not isinstance(one, str)]
        yield (
            refused[0]
            if refused
            else Flights(*map(np.concatenate, zip(*flights, strict=True))).figures()
        )


def _parts(contest: Contest, episodes: int) -> Iterator[tuple[int, int]]:
    """First flight and number of flights of each part of a contest."""
    most = (_MOST if contest.dead is None else _MOST_OF_EACH).get(contest.by, episodes)
    size = _PART_OF_SLOW if contest.by in _MOST_OF_EACH else _PART
    end = min(most, episodes)
    for first in range(0, end, size):
        yield first, min(size, end - first)


def shipped(
    episodes: int,
    names: Sequence[str],
    start_seed: int = EVALUATION_SEED,
    agent: str | None = None,
    by: Sequence[str] = CONTESTANTS,
) -> Iterator[str]:
    """Rows of the table of shipped craft, as Markdown, from the starts of a seed."""
    yield "| craft | flown by | settled | lower end | settling time, s | impulse, N s |"
    yield "|---|---|---|---|---|---|"
    contests = [Contest(name, who) for name in names for who in by if _may_fly(who, name)]
    judged = _judged(contests, episodes, start_seed, agent)
    for contest, rows in zip(contests, judged, strict=True):
        craft = _own(contest.name).craft
        label = FOR_ANY_CRAFT[craft.dimension] if contest.by == "any-craft" else contest.by
        if isinstance(rows, str):
            yield f"| {craft.name} | {label} | refuses the craft | | | |"
            continue
        yield (
            f"| {craft.name} | {label} | {rows.settled:.1f} % | {rows.low:.1f} % | "
            f"{rows.time:.1f} | {rows.impulse:.1f} |"
        )


def heavier(episodes: int, names: Sequence[str]) -> Iterator[str]:
    """Rows of the table of craft with other masses, which the controller's file has or has not."""
    yield f"| craft | flown by | {' | '.join(f'{mass:g} times' for mass in _MASSES)} |"
    yield f"|---|---|{'---|' * len(_MASSES)}"
    kinds = [(by, is_stated) for by in ("any-craft", "LQR") for is_stated in (True, False)]
    judged = _judged(
        [
            Contest(name, by, mass, is_stated=is_stated)
            for name in names
            for by, is_stated in kinds
            for mass in _MASSES
        ],
        episodes,
    )
    for name in names:
        craft = _own(name).craft
        for by, is_stated in kinds:
            cells = [_settled(next(judged)) for _ in _MASSES]
            yield f"| {craft.name} | {by}{'' if is_stated else ', not in its file'} | {' | '.join(cells)} |"


def dead(episodes: int, names: Sequence[str], by: Sequence[str] = _STATED) -> Iterator[str]:
    """Rows of the table of craft that have lost a thruster.

    The file lacks each thruster in turn; then 1,024 flights with a thruster that is drawn, of which the file says
    nothing. Some fly fewer (`_MOST_OF_EACH`, then `_MOST`).
    """
    who = ", ".join(by)
    yield f"| craft | thrusters that it can spare | in its file: {who} | not in its file: {who} |"
    yield "|---|---|---|---|"
    spare = {name: _spare(_own(name).craft) for name in names}
    each = _judged(
        [Contest(name, one, dead=k) for name in names for one in by for k in spare[name]], episodes
    )
    some = [name for name in names if spare[name]]
    unknown = _judged([Contest(name, one, fault="dead") for name in some for one in by], 1024)
    for name in names:
        craft = _own(name).craft
        numbers = spare[name]
        worst = []
        for _ in by:
            found = [next(each) for _ in numbers]
            settled = [x.settled for x in found if not isinstance(x, str)]
            refused = len(settled) < len(found)
            worst.append("refuses" if refused else f"{min(settled):.1f} %" if settled else "-")
        drawn = [_settled(next(unknown)) if numbers else "-" for _ in by]
        cells = f"{', '.join(worst)} | {', '.join(drawn)}"
        yield f"| {craft.name} | {len(numbers)} of {craft.thruster_count} | {cells} |"


def unstated(
    episodes: int, names: Sequence[str], values: Sequence[float | None] = (None,)
) -> Iterator[str]:
    """Rows of the table of faults and masses that no file states: the agent without and with its estimates.

    Values are frugalities; None: as the agent was trained.
    """
    masses = " | ".join(f"mass {mass:g} times" for mass in _MASSES)
    yield f"| craft | flown by | as in its file | one dead | one weak | {masses} |"
    yield f"|---|---|{'---|' * (3 + len(_MASSES))}"
    kinds: list[dict[str, Any]] = [{}, {"fault": "dead"}, {"fault": "weak"}]
    kinds += [{"mass": mass} for mass in _MASSES]
    spare = {name: _spare(_own(name).craft) for name in names}
    contests = [
        Contest(name, by, is_stated=False, value=value, **kind)
        for name in names
        for by in _ANY
        for value in values
        for kind in kinds
        if spare[name] or "fault" not in kind
    ]
    judged = _judged(contests, episodes)
    for name in names:
        craft = _own(name).craft
        for prefix, value in product(_ANY.values(), values):
            cells = [
                _all_of(next(judged)) if spare[name] or "fault" not in kind else "-"
                for kind in kinds
            ]
            label = f"{prefix}{FOR_ANY_CRAFT[craft.dimension]}"
            if value is not None:
                label += f"#{value:g}"
            yield f"| {craft.name} | {label} | {' | '.join(cells)} |"


def at_values(
    episodes: int, names: Sequence[str], values: Sequence[float], start_seed: int, by: Sequence[str]
) -> Iterator[str]:
    """Rows of the table of the agent without a value and at several, and who of the others it beats.

    It beats a contestant if all flights settle and neither median settling time nor mean impulse is larger.
    """
    yield "| craft | flown by | settled | settling time, s | impulse, N s | not beaten by it |"
    yield "|---|---|---|---|---|---|"
    others = [who for who in by if who not in _ANY]
    kinds = [Contest("", "any-craft", value=value) for value in (None, *values)]
    kinds += [Contest("", who) for who in others]
    flying = {name: [kind for kind in kinds if _may_fly(kind.by, name)] for name in names}
    contests = [kind._replace(name=name) for name in names for kind in flying[name]]
    judged = _judged(contests, episodes, start_seed)
    for name in names:
        craft = _own(name).craft
        spent = {kind: _spent(next(judged)) for kind in flying[name]}
        for kind in flying[name]:
            settled, time, impulse = spent[kind]
            left = [
                one.by
                for one in flying[name]
                if one.by in others
                and not (settled == 100.0 and time <= spent[one][1] and impulse <= spent[one][2])
            ]
            label = FOR_ANY_CRAFT[craft.dimension] if kind.by in _ANY else kind.by
            if kind.value is not None:
                label += f"#{kind.value:g}"
            said = (", ".join(left) or "none") if kind.by in _ANY else ""
            yield f"| {craft.name} | {label} | {settled:.1f} % | {time:.2f} | {impulse:.2f} | {said} |"


def _spent(rows: Figures | str) -> tuple[float, float, float]:
    """Flights that settle, %, median settling time, s, and mean impulse, N s; infinite where it refuses."""
    if isinstance(rows, str):
        return 0.0, np.inf, np.inf
    return rows.settled, rows.time, rows.impulse


class _Docking(NamedTuple):
    """Number of flights of every pair, in the engine or in Drake."""

    episodes: int
    engine: Literal["fast", "drake"]

    def rows(self, pair: Pair, effectors: Effectors, is_stated: bool) -> tuple[Figures | str, ...]:
        """Figures of the agent, with the file of the joined craft or of the first alone; or why it refuses."""
        first, second = load_spacecraft(pair.first), load_spacecraft(pair.second)
        agent = contestant(f"pretrained:{FOR_ANY_CRAFT[first.dimension]}")
        try:
            both = joined(first, second, pair.position, pair.attitude, effectors)
            run = for_spacecraft(agent, both)
            if not is_stated:
                run = for_spacecraft(agent, first, run.timing)._replace(craft=both)
        except ConfigError as error:
            return (str(error),)
        flight = fly_episodes(
            run.controller, run.judged, EVALUATION_SEED, self.episodes, self.engine
        ).flight
        found = Flights(solved(flight), settling_times(flight), impulses(flight))
        return (found.figures(),)


def docked(
    episodes: int, dimension: int, engine: Literal["fast", "drake"] = "fast"
) -> Iterator[str]:
    """Rows of the table of docked craft, with thrusters of both or of the first, which the file has or has not."""
    yield "| first, second | mass, kg | thrusters | file | settled | settling time, s | impulse, N s |"
    yield "|---|---|---|---|---|---|---|"
    kinds: tuple[tuple[Effectors, bool], ...] = (("both", True), ("first", True), ("first", False))
    calls = [(pair, *kind) for pair in PAIRS[dimension] for kind in kinds]
    workers = Workers(_Docking, (episodes, engine), work="flew docked craft")
    for (pair, effectors, is_stated), (rows,) in zip(
        calls, workers.ordered(_Docking.rows, calls), strict=True
    ):
        mass = load_spacecraft(pair.first).mass + load_spacecraft(pair.second).mass
        file = "of both" if is_stated else "of the first alone"
        whose = "of both" if effectors == "both" else "of the first"
        start = f"| {pair.first}, {pair.second} | {mass:.1f} | {whose} | "
        if isinstance(rows, str):
            yield f"{start}{file} | refuses | | |"
            continue
        median = f"{rows.time:.1f}" if np.isfinite(rows.time) else "never"
        yield f"{start}{file} | {rows.settled:.1f} % | {median} | {rows.impulse:.1f} |"


def _spare(craft: Spacecraft) -> list[int]:
    """Numbers of the thrusters without which the others can still push and turn the craft every way."""
    return [found.thrusters[0] for found in fault_sets(craft, 1, "dead") if found.recoverable]


def _all_of(rows: Figures | str) -> str:
    """Flights that settle, median settling time and mean impulse."""
    if isinstance(rows, str):
        return "refuses"
    return f"{rows.settled:.1f} %, {rows.time:.1f} s, {rows.impulse:,.1f} N s"


def _settled(rows: Figures | str) -> str:
    return "refuses" if isinstance(rows, str) else f"{rows.settled:.1f} %"


def random_layouts(count: int, dimension: int) -> Iterator[str]:
    """Rows of the table of random layouts by their authority margin, flown by the agent and by two laws."""
    agent = f"pretrained:{FOR_ANY_CRAFT[dimension]}"
    network = contestant(agent).network
    layers = policy_layers(network)
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
    titles = [f"{'continuous' if continuous else 'on/off'}: {by}" for continuous, by in kinds]
    yield f"| authority margin | layouts | {' | '.join(titles)} |"
    yield f"|---|---|{'---|' * len(kinds)}"
    parts = []
    for continuous, by in kinds:
        # The same craft and starts for all.
        generator = torch.Generator().manual_seed(EVALUATION_SEED)
        batch = draw_batch(pool, settings, generator, continuous, perturbed=False)
        with torch.no_grad():
            outcome = fly(contestants[by](continuous), batch, settings, generator, steps)
        parts.append((batch.pool.margin.numpy(), outcome.settled.numpy()))
    for low, high in pairwise(_BINS):
        cells = []
        for margin, settled in parts:
            inside = (margin >= low) & (margin < high)
            cells.append(f"{100 * settled[inside].mean():.1f} %" if inside.any() else "-")
        number = int(((pool.margin >= low) & (pool.margin < high)).sum())
        bound = f"{low:g} to {high:g}" if np.isfinite(high) else f"above {low:g}"
        yield f"| {bound} | {number} | {' | '.join(cells)} |"


class _Crafts(NamedTuple):
    """Number of flights of every layout as a spacecraft of its own."""

    episodes: int

    def flights(
        self, layout: np.ndarray, engine: Literal["fast", "drake"]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Whether each flight of the agent settles, settling time, s, impulse, N s, and last position, m."""
        craft = layout_spacecraft(load_spacecraft(_OWN[2][0]), layout)
        with warnings.catch_warnings():
            # A layout may be outside of what the agent was trained for.
            warnings.filterwarnings("ignore", message=".*agent for any craft was trained")
            run = for_spacecraft(contestant(f"pretrained:{FOR_ANY_CRAFT[2]}"), craft)
        flight = fly_episodes(
            run.controller, run.judged, EVALUATION_SEED, self.episodes, engine
        ).flight
        last = np.stack([x[-1] for x in flight.states.p.columns()], axis=1)
        return np.asarray(flight.verdict.solved), settling_times(flight), impulses(flight), last


def judged_layouts(count: int, episodes: int) -> Iterator[str]:
    """Rows of the table of random layouts in the engine and in Drake, which builds a plant of each."""
    yield "| engine | layouts | flights | settled | settling time, s | impulse, N s |"
    yield "|---|---|---|---|---|---|"
    drawn = list(layouts(count, _LAYOUT_SEED, RANGES_OF_LAYOUTS[2]))
    workers = Workers(_Crafts, (episodes,), work="flew layouts")
    outcomes = {}
    engines: tuple[Literal["fast", "drake"], ...] = ("fast", "drake")
    for engine in engines:
        parts = workers.ordered(_Crafts.flights, [(layout, engine) for layout in drawn])
        outcomes[engine] = [np.concatenate(x) for x in zip(*parts, strict=True)]
        settled, settles, spent, _ = outcomes[engine]
        name = "Drake" if engine == "drake" else "RANS"
        yield (
            f"| {name} | {count} | {len(settled)} | {100 * settled.mean():.1f} % | "
            f"{np.median(settles):.1f} | {np.median(spent):.1f} |"
        )
    ours, theirs = (outcomes[engine] for engine in engines)
    apart = np.linalg.norm(ours[3] - theirs[3], axis=1)
    yield ""
    yield (
        f"Flights with another verdict in Drake: {int((ours[0] != theirs[0]).sum())}. Largest distance between "
        f"the ends of two flights: {apart.max():.1g} m."
    )


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
        period, _, _, a, alpha = authority
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


def picture(file: Path) -> None:
    """Draw twelve layouts: arrows are forces, and their places those that give the torques."""
    from rans.show.figures.plotting import Figure

    figure = Figure(figsize=(8.0, 6.0))
    for number, layout in enumerate(layouts(12, 0)):
        axes = figure.add_subplot(3, 4, number + 1)
        push = layout[:, :2]
        # The point of the line of action that is nearest to the centre.
        arm = layout[:, 2:] * np.stack([-push[:, 1], push[:, 0]], axis=1)
        arm = -arm / np.square(push).sum(axis=1, keepdims=True)
        axes.quiver(*arm.T, *push.T, angles="xy", scale_units="xy", scale=1.5, width=0.012)
        axes.plot(0.0, 0.0, "o", color="tab:red", markersize=3.0)
        axes.set(xlim=(-2.2, 2.2), ylim=(-2.2, 2.2), aspect="equal", xticks=[], yticks=[])
        axes.set_title(f"{len(layout)} thrusters, {authority_margin(layout):.2f}", fontsize=8)
    figure.tight_layout()
    figure.savefig(file, metadata={"Date": None})


def write_agent(folder: Path, settings: DemandSettings) -> None:
    """Train an agent and write it as a run folder without a critic."""
    begun = time.perf_counter()
    network = train(settings, lambda text, _: print(text, flush=True))  # noqa: T201
    further = _evolved([network], settings.seed, settings.device)
    save(folder, network.state_dict(), settings, time.perf_counter() - begun, further)


def _evolved(begun: Sequence[DemandNetwork], seed: int, device: str) -> list[dict[str, Tensor]]:
    """Weights of every node, see `evolve`, with layouts of a seed that no training of networks has."""
    dimension = begun[0].dimension
    shared = RECIPES[dimension].shared
    pool = draw_pool(_LAYOUTS_OF_VALUES, 6000 + 2 * seed, dimension, None, shared)
    settings = replace(SETTINGS[dimension], seed=seed, device=device)
    return evolve(begun, pool, settings, lambda text: print(text, flush=True))  # noqa: T201


def write_values(source: Path, folder: Path, seed: int, device: str, is_continued: bool) -> None:
    """Train weights of every value from an agent's own weights, which stay, and write the agent with them.

    Args:
        source: run folder of the agent.
        folder: to be written.
        seed: of the training.
        device: of torch.
        is_continued: whether the training begins with the weights that the agent has for values.
    """
    begun = time.perf_counter()
    saved = read_policy(source / AGENT)
    network = saved.network
    architecture = network.architecture
    tensors = [network.member(0)]
    if is_continued:
        tensors += [dict(network.at[value]) for value in NODES]
    dimension = DIMENSIONS[len(architecture.authority) - 1]
    networks = [
        DemandNetwork.of_layers(policy_layers(Network(architecture, own)), dimension)
        for own in tensors
    ]
    further = _evolved(networks, seed, device)
    at: dict[float, dict[str, Tensor]] = {}
    for value, own in zip(NODES, further, strict=True):
        networks[0].load_state_dict(own, strict=False)
        at[value] = with_weights(network, networks[0])
    if folder != source:
        copytree(source, folder, dirs_exist_ok=True)
    (folder / AGENT).write_bytes(actor_bytes(architecture, tensors[0], saved.steps, at))
    card = read_json(folder / "card.json")
    card["training"]["values"] = {
        "nodes": NODES,
        "seed": seed,
        "device": device,
        "begun with those of values": is_continued,
        "seconds": round(time.perf_counter() - begun, 1),
        "settings": asdict(SETTINGS[dimension]),
        "environment": environment(),
    }
    write_json(folder / "card.json", card)


def save(
    folder: Path,
    weights: dict[str, torch.Tensor],
    settings: DemandSettings,
    seconds: float,
    further: Sequence[dict[str, Tensor]] = (),
) -> None:
    """Write trained weights as the agent of one craft, which flies others by `for_spacecraft`.

    ``further`` are those of the frugalities of `NODES`.
    """
    network = DemandNetwork(settings.channels, torch.Generator(), settings.dimension)
    name, timing = _OWN[settings.dimension]
    craft = load_spacecraft(name)
    task = GoToPose()
    policies = []
    for own in (weights, *further):
        network.load_state_dict(own, strict=False)
        policies.append(as_policy(network, craft, task, timing.control_period))
    policy, *others = policies
    at = {value: one.member(0) for value, one in zip(NODES, others, strict=False)}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "agent.safetensors").write_bytes(
        actor_bytes(policy.architecture, policy.member(0), 0, at or None)
    )
    config = TrainConfig("go-to-pose", task, craft.name, timing=timing, seed=settings.seed)
    write_json(folder / "config.json", to_table(config))
    write_text(folder / "spacecraft.toml", to_toml(craft))
    card = {
        "name": folder.name,
        "task": "go-to-pose",
        "spacecraft": craft.name,
        "training": {
            "seed": settings.seed,
            "steps": 0,
            "seconds": round(seconds, 1),
            "device": settings.device,
            "settings": asdict(settings),
            "environment": environment(),
        },
    }
    write_json(folder / "card.json", card)
    episodes = 1024
    card |= evaluated(str(folder), fitting_protocols(craft), episodes, EVALUATION_SEED)
    write_json(folder / "card.json", card)


def main() -> None:
    """Run a part of the campaign."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "part",
        choices=(
            "train",
            "values",
            "craft",
            "frugal",
            "dead",
            "mass",
            "unstated",
            "joined",
            "layouts",
            "picture",
        ),
    )
    parser.add_argument("--dimension", type=int, choices=(2, 3), default=2)
    parser.add_argument("--episodes", type=int, default=256)
    parser.add_argument("--layouts", type=int, default=1024)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cpu", help="of torch, on which train runs")
    parser.add_argument("--output", type=Path, help="folder of the trained agent")
    parser.add_argument(
        "--continued",
        action="store_true",
        help="values begins with the weights that the agent has for values",
    )
    parser.add_argument("--start-seed", type=int, default=EVALUATION_SEED)
    parser.add_argument(
        "--agent",
        help="run folder whose agent craft and frugal fly and values trains; by default the shipped one",
    )
    parser.add_argument(
        "--engine", choices=("fast", "drake"), default="fast", help="of joined and layouts"
    )
    parser.add_argument("--only", nargs="*", help="agents of single craft; by default all")
    parser.add_argument("--values", nargs="*", type=float, help="of frugal and unstated")
    parser.add_argument("--by", nargs="*", choices=CONTESTANTS, help="who flies craft and dead")
    given = parser.parse_args()
    names = given.only or SPECIALISTS[given.dimension]
    if given.part == "train":
        settings = replace(RECIPES[given.dimension], seed=given.seed, device=given.device)
        write_agent(given.output or FOLDER / FOR_ANY_CRAFT[given.dimension], settings)
        return
    if given.part == "values":
        shipped_agent = FOLDER / FOR_ANY_CRAFT[given.dimension]
        source = Path(given.agent) if given.agent else shipped_agent
        output = given.output or shipped_agent
        write_values(source, output, given.seed, given.device, given.continued)
        return
    if given.part == "picture":
        picture(Path("docs/pictures/layouts.svg"))
        return
    rows = {
        "craft": lambda: shipped(
            given.episodes, names, given.start_seed, given.agent, given.by or CONTESTANTS
        ),
        "frugal": lambda: at_values(
            given.episodes, names, given.values or _VALUES, given.start_seed, given.by or _STATED
        ),
        "dead": lambda: dead(given.episodes, names, given.by or _STATED),
        "mass": lambda: heavier(given.episodes, names),
        "unstated": lambda: unstated(given.episodes, names, given.values or (None,)),
        "joined": lambda: docked(given.episodes, given.dimension, given.engine),
        "layouts": lambda: (
            judged_layouts(given.layouts, given.episodes)
            if given.engine == "drake"
            else random_layouts(given.layouts, given.dimension)
        ),
    }
    for row in rows[given.part]():
        print(row, flush=True)  # noqa: T201


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
