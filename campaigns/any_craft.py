"""The agents for any craft: their training, and their figures on craft that they have never flown.

``python -m campaigns.any_craft train --seconds 1500`` trains that of the plane and writes it into the package;
``craft`` in its place prints the table of the shipped craft, ``layouts`` that of random layouts, ``dead`` that of
a dead thruster, ``mass`` that of a mass that the agent is not given, all of docs/any_craft.md; ``picture`` draws
layouts. ``--dimension 3`` does the same in space.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch

from rans.deploy.export import evaluated
from rans.episode import Setup
from rans.errors import ConfigError
from rans.evaluation.fly.agent import LoadedRun
from rans.evaluation.fly.any_craft import for_spacecraft
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.controllers import controller
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.fly.protocols import fitting_protocols
from rans.evaluation.measure.aggregate import measure
from rans.fast.agent_files.agent import actor_bytes
from rans.fast.learn.config import TrainConfig, to_table
from rans.fast.learn.demands import (
    DemandNetwork,
    DemandSettings,
    as_policy,
    draw_batch,
    draw_pool,
    fly,
    policy_layers,
    train,
)
from rans.files import environment, write_json, write_text
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft, to_toml
from rans.model.timing import Timing
from rans.policy.any_craft import AGENTS
from rans.pretrained import FOLDER
from rans.randomization.layouts import authority_margin, layouts
from rans.scenario import EVALUATION_SEED
from rans.tasks import GoToPose

SPECIALISTS = {
    2: (
        "go-to-pose-2d",
        "go-to-pose-2d-shared",
        "go-to-pose-2d-atmos",
        "go-to-pose-2d-pingu",
        "go-to-pose-2d-freeflyer2",
        "go-to-pose-2d-astrobee-granite",
        "go-to-pose-2d-roboran-platform",
    ),
    3: (
        "go-to-pose-3d",
        "go-to-pose-3d-spheres",
        "go-to-pose-3d-astrobee-iss",
        "go-to-pose-3d-atmos-orbit-12",
        "go-to-pose-3d-atmos-orbit-16",
        "go-to-pose-3d-cubesat-3u",
        "go-to-pose-3d-cubesat-6u",
        "go-to-pose-3d-afrl-12kg",
        "go-to-pose-3d-apollo-csm",
    ),
}
"""Agents of a single craft each, whose task, starts, conditions and control period are the protocol."""
_OWN = {2: ("floating-platform", Timing(0.2, 1, 125)), 3: ("free-flyer", Timing(0.2, 1, 125))}
"""Craft and timing of an agent without a craft's name."""
_MASSES = 0.5, 0.7, 1.5, 2.0
"""Masses and moments of inertia over those of the file that the agent is given."""
_LAYOUT_SEED = 1_000_003
"""Seed of layouts that no training has drawn: trainings draw from even seeds below."""
_BINS = 0.25, 0.35, 0.5, 0.75, 1.0, 1.5, np.inf
"""Bounds of the authority margin, by which random layouts are listed."""


def shipped(
    episodes: int, names: Sequence[str], start_seed: int = EVALUATION_SEED
) -> Iterator[str]:
    """Rows of the table of shipped craft, as Markdown, from the starts of a seed."""
    yield "| craft | flown by | settled | lower end | settling time, s | impulse, N s |"
    yield "|---|---|---|---|---|---|"
    for name in names:
        own = contestant(f"pretrained:{name}")
        for label, run in (
            ("specialist", own),
            (AGENTS[own.craft.dimension], _in_setup_of(own)),
            ("LQR", _classical("lqr", own)),
        ):
            yield f"| {own.craft.name} | {label} | {_figures(run, episodes, start_seed)} |"


def heavier(episodes: int, names: Sequence[str]) -> Iterator[str]:
    """Rows of the table of craft whose mass and inertia are not those of the file that the agent is given."""
    yield f"| craft | {' | '.join(f'{mass:g} times' for mass in _MASSES)} |"
    yield f"|---|{'---|' * len(_MASSES)}"
    for name in names:
        run = _in_setup_of(contestant(f"pretrained:{name}"))
        cells = []
        for mass in _MASSES:
            inertia = tuple(tuple(mass * x for x in row) for row in run.craft.inertia)
            craft = replace(run.craft, mass=mass * run.craft.mass, inertia=inertia)
            solved = _rows(run._replace(craft=craft), episodes)["solved"]
            cells.append(f"{solved.value:.1f} %")
        yield f"| {run.craft.name} | {' | '.join(cells)} |"


def dead(episodes: int, names: Sequence[str]) -> Iterator[str]:
    """Rows of the table of craft that have lost one thruster, each in turn, and know it."""
    yield "| craft | dead thrusters that leave every axis | settled, the worst | flights of each |"
    yield "|---|---|---|---|"
    for name in names:
        own = contestant(f"pretrained:{name}")
        worst = 100.0
        count = 0
        for number in range(len(own.craft.thrusters)):
            try:
                run = _in_setup_of(own, _without(own.craft, number))
            except ConfigError:
                continue
            count += 1
            worst = min(worst, _rows(run, episodes)["solved"].value)
        result = f"{worst:.1f} %" if count else "-"
        yield f"| {own.craft.name} | {count} of {len(own.craft.thrusters)} | {result} | {episodes} |"


def random_layouts(count: int, dimension: int) -> Iterator[str]:
    """Rows of the table of random layouts, by their authority margin."""
    agent = f"pretrained:{AGENTS[dimension]}"
    network = contestant(agent).controller.network  # type: ignore[attr-defined]
    settings = DemandSettings(dimension, crafts=count, steps=320)
    pool = draw_pool(count, _LAYOUT_SEED, dimension)
    generator = torch.Generator().manual_seed(EVALUATION_SEED)
    yield "| authority margin | layouts | on/off: settled | continuous: settled |"
    yield "|---|---|---|---|"
    shares = []
    for continuous in (False, True):
        batch = draw_batch(pool, settings, generator, continuous, perturbed=False)
        with torch.no_grad():
            outcome = fly(policy_layers(network), batch, settings, generator)
        shares.append((batch.pool.margin.numpy(), outcome.settled.numpy()))
    for low, high in pairwise(_BINS):
        cells = []
        for margin, settled in shares:
            inside = (margin >= low) & (margin < high)
            cells.append(f"{100 * settled[inside].mean():.1f} %" if inside.any() else "-")
        number = int(((shares[0][0] >= low) & (shares[0][0] < high)).sum())
        bound = f"{low:g} to {high:g}" if np.isfinite(high) else f"above {low:g}"
        yield f"| {bound} | {number} | {' | '.join(cells)} |"


def picture(file: Path) -> None:
    """Draw twelve layouts: arrows are forces, and their places those that give the torques."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 6.0))
    for number, columns in enumerate(layouts(12, 0)):
        axes = figure.add_subplot(3, 4, number + 1)
        push = columns[:, :2]
        # The point of the line of action that is nearest to the centre.
        arm = columns[:, 2:] * np.stack([-push[:, 1], push[:, 0]], axis=1)
        arm = -arm / np.square(push).sum(axis=1, keepdims=True)
        axes.quiver(*arm.T, *push.T, angles="xy", scale_units="xy", scale=1.5, width=0.012)
        axes.plot(0.0, 0.0, "o", color="tab:red", markersize=3.0)
        axes.set(xlim=(-2.2, 2.2), ylim=(-2.2, 2.2), aspect="equal", xticks=[], yticks=[])
        axes.set_title(f"{len(columns)} thrusters, {authority_margin(columns):.2f}", fontsize=8)
    figure.tight_layout()
    figure.savefig(file, metadata={"Date": None})


def write_agent(folder: Path, settings: DemandSettings) -> None:
    """Train an agent and write it as a run folder without a critic."""
    begun = time.perf_counter()
    network = train(settings, lambda text, _: print(text, flush=True))  # noqa: T201
    save(folder, network.state_dict(), settings, time.perf_counter() - begun)


def save(
    folder: Path, weights: dict[str, torch.Tensor], settings: DemandSettings, seconds: float
) -> None:
    """Write trained weights as the agent of one craft, which flies others by `for_spacecraft`."""
    network = DemandNetwork(settings.channels, torch.Generator(), settings.dimension)
    network.load_state_dict(weights)
    name, timing = _OWN[settings.dimension]
    craft = load_spacecraft(name)
    task = GoToPose()
    policy = as_policy(network, craft, task, timing.control_period)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "agent.safetensors").write_bytes(
        actor_bytes(policy.architecture, policy.member(0), 0)
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


def _in_setup_of(own: LoadedRun, craft: Spacecraft | None = None) -> LoadedRun:
    """The agent for any craft in the setup of a specialist, or with another craft in its place."""
    agent = contestant(f"pretrained:{AGENTS[own.craft.dimension]}")
    run = for_spacecraft(agent, craft or own.craft, own.timing)
    return run._replace(task=own.task, conditions=own.conditions)


def _classical(name: str, own: LoadedRun) -> LoadedRun | str:
    """A controller without training in the same setup, or why there is none."""
    setup = Setup(own.craft, own.task, own.timing, own.conditions)
    try:
        return own._replace(controller=controller(name, setup))
    except ConfigError as error:
        return str(error)


def _figures(run: LoadedRun | str, episodes: int, start_seed: int) -> str:
    if isinstance(run, str):
        return "refuses the craft | | | "
    rows = _rows(run, episodes, start_seed)
    settled, settling, impulse = (rows[key] for key in ("solved", "settling time", "impulse"))
    return (
        f"{settled.value:.1f} % | {settled.low:.1f} % | {settling.value:.1f} | {impulse.value:.1f}"
    )


def _rows(  # noqa: ANN202 (rows of `rans.evaluation.measure.aggregate`)
    run: LoadedRun, episodes: int, start_seed: int = EVALUATION_SEED
):
    flight = fly_episodes(run.controller, run.judged, start_seed, episodes).flight
    return {row.name: row for row in measure(flight).rows}


def _without(craft: Spacecraft, number: int) -> Spacecraft:
    """The craft without one thruster; its commands are those of the others."""
    left = tuple(one for k, one in enumerate(craft.thrusters) if k != number)
    return replace(craft, name=f"{craft.name}-{number}-dead", thrusters=left)


def main() -> None:
    """Run a part of the campaign."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("train", "craft", "dead", "mass", "layouts", "picture"))
    parser.add_argument("--dimension", type=int, choices=(2, 3), default=2)
    parser.add_argument("--episodes", type=int, default=256)
    parser.add_argument("--layouts", type=int, default=1024)
    parser.add_argument("--seconds", type=float, default=1500.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--start-seed", type=int, default=EVALUATION_SEED)
    parser.add_argument("--only", nargs="*", help="agents of single craft; by default all")
    given = parser.parse_args()
    names = given.only or SPECIALISTS[given.dimension]
    if given.part == "train":
        settings = DemandSettings(given.dimension, seconds=given.seconds, seed=given.seed)
        write_agent(FOLDER / AGENTS[given.dimension], settings)
        return
    if given.part == "picture":
        picture(Path("docs/pictures/layouts.svg"))
        return
    rows = {
        "craft": lambda: shipped(given.episodes, names, given.start_seed),
        "dead": lambda: dead(given.episodes, names),
        "mass": lambda: heavier(given.episodes, names),
        "layouts": lambda: random_layouts(given.layouts, given.dimension),
    }
    for row in rows[given.part]():
        print(row, flush=True)  # noqa: T201


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
