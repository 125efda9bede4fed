"""Nineteen craft of random layouts that nobody has flown: what flights choose, and other starts beside LQR."""

from __future__ import annotations

import sys
import warnings
from dataclasses import replace

import numpy as np
from rans_any_craft.layouts import LayoutRanges, sample_layout

from rans.errors import RansWarning
from rans.evaluation.fly.agent import load_policy
from rans.evaluation.fly.any_craft import for_spacecraft, frugal
from rans.evaluation.fly.choice import chosen
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.fly.make_controller import controller
from rans.evaluation.measure.aggregate import measure
from rans.model.spacecraft import Spacecraft, Thruster
from rans.model.spacecraft_file import load_spacecraft
from rans.policy.timing import timing_for
from rans.pretrained import pretrained_folder


def fresh(number: int, dimension: int) -> Spacecraft:
    """A craft of 5 to 30 kg and 5 to 12 thrusters (8 to 12 in space), of 0.02 to 0.2 m/s^2 each."""
    random = np.random.default_rng((91, dimension, number))
    base = load_spacecraft("floating-platform" if dimension == 2 else "free-flyer")
    ranges = LayoutRanges(
        dimension=dimension,
        fewest=5 if dimension == 2 else 8,
        most=12,
        least_authority=0.4 if dimension == 2 else 0.3,
        moments=0.0,
    )
    layout = sample_layout(random, ranges)
    mass = float(np.exp(random.uniform(np.log(5), np.log(30))))
    moment = base.inertia[2][2] if dimension == 2 else np.trace(np.array(base.inertia))
    gyration = float(random.uniform(0.6, 1.4)) * np.sqrt(moment / base.mass)
    force = float(np.exp(random.uniform(np.log(0.02), np.log(0.2)))) * mass
    inertia = mass * gyration * gyration / (1 if dimension == 2 else 3)
    # A thruster stands where the line of its force is nearest to the centre: the arm is d x t / F.
    rows = np.zeros((len(layout), 6))
    rows[:, :dimension] = layout[:, :dimension]
    rows[:, -1 if dimension == 2 else 3 :] = layout[:, dimension:]
    centre = np.array(base.centre_of_mass)
    arms = np.array([one.position for one in base.thrusters]) - centre
    distance = float(np.sqrt(np.square(arms[:, :dimension]).sum(axis=1).mean()))
    sizes = np.linalg.norm(rows[:, :3], axis=1)
    ways = rows[:, :3] / sizes[:, None]
    places = centre + np.cross(ways, rows[:, 3:] / sizes[:, None]) * distance
    thrusters = tuple(
        Thruster(tuple(place), tuple(way), force * size)
        for place, way, size in zip(places.tolist(), ways.tolist(), sizes.tolist(), strict=True)
    )
    return replace(
        base,
        thrusters=thrusters,
        name=f"fresh-{dimension}d-{number}",
        mass=mass,
        inertia=tuple(tuple(row) for row in (inertia * np.eye(3)).tolist()),
        wheels=(),
    )


def main() -> None:
    """Print a row of each craft: what is chosen, then solved flights, settling time and impulse beside LQR's."""
    warnings.simplefilter("ignore", RansWarning)
    for dimension, count, starts in ((2, 13, 256), (3, 6, 64)):
        own = load_policy(pretrained_folder(f"any-craft-{dimension}d"))
        for number in range(count):
            craft = fresh(number, dimension)
            choice = chosen(own, craft)
            run = for_spacecraft(own, craft, timing_for(craft, own.timing, choice.period))
            run = frugal(run, choice.value)
            row = [f"{craft.name}, {craft.thruster_count} thrusters", f"{choice.value:g}"]
            for who in (run.controller, controller("lqr", run.judged)):
                found = measure(fly_episodes(who, run.judged, 6161, starts, workers=1))
                names = "solved", "settling time", "impulse"
                row.append(", ".join(f"{found[name].value:.3g}" for name in names))
            sys.stdout.write(f"| {' | '.join(row)} |\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
