"""What a sloshing liquid costs agents that know nothing of it: ``python -m campaigns slosh``.

Each agent flies its own craft, in which a share of the mass swings. Mass and inertia stay as they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rans_missions.slosh.liquid import Slosh

from rans.episode.flight import Flight
from rans.episode.scenario import EVALUATION_SEED
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.metrics import impulses, settling_times, won
from rans.model.spacecraft import Spacecraft

_CONTESTANTS = (
    "pretrained:go-to-pose-2d",
    "pretrained:go-to-pose-2d-robust",
    "lqr:go-to-pose-2d",
    "pretrained:dock-port-2d",
    "pretrained:dock-port-2d-atmos",
    "pretrained:go-to-pose-3d",
    "pretrained:any-craft-3d#0.5",
    "pretrained:dock-port-3d",
)
SHARES = (0.0, 0.05, 0.2)
"""Mass that swings over the mass of the craft."""
_RADIUS = 0.1
_DEPTH = 0.1
"""Radius of the cylindrical tank and depth of its liquid, m: a tank that is half full at twice its radius."""
_BEHIND = 0.1
"""Distance from the craft's centre of mass back to the middle of the liquid, m."""
_DAMPING_RATIO = 0.005
"""Damping of the pendulum over its critical damping, in a smooth tank without baffles, at the acceleration below
(Dodge 2000, chapter 2)."""
_ACCELERATION = 0.2
"""m/s^2, as of the floating platform with one thruster."""


@dataclass(frozen=True)
class Sloshing:
    """Fly everybody."""

    episodes: int = 256
    """Held-out starts."""
    drake: int = 16
    """Number of starts, the first ones, that fly in Drake too, with the largest share."""
    seed: int = EVALUATION_SEED
    """Seed of the starts."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """A row of each contestant and share."""
        for who in _CONTESTANTS:
            for share in SHARES:
                yield self._flown(who, share)

    def _flown(self, who: str, share: float) -> dict[str, Any]:
        run = contestant(who)
        setup = run.judged._replace(craft=with_slosh(run.craft, share))
        flight = fly_episodes(run.controller, setup, self.seed, self.episodes)
        successes = won(flight)
        times = settling_times(flight)[successes]
        drake = 0 if share < max(SHARES) else min(self.drake, self.episodes)
        there = float("nan")
        if drake:
            other = fly_episodes(run.controller, setup, self.seed, drake, "drake", workers=1)
            there = float(won(other).mean())
        return {
            "who": who.removeprefix("pretrained:"),
            "share": share,
            "starts": self.episodes,
            # Share that was solved, or docked without breaking a limit; and that broke one.
            "won": float(successes.mean()),
            "violated": float(flight.violated().mean()),
            # Median time and mean impulse of those that won, s and N s.
            "time": float(np.median(times)) if len(times) else float("nan"),
            "impulse": float(impulses(flight)[successes].mean())
            if successes.any()
            else float("nan"),
            "swing": _swing(flight),
            # Shares of the first starts that win in Drake, and in RANS.
            "drake": there,
            "drake_starts": drake,
            "drake_here": float(successes[:drake].mean()) if drake else float("nan"),
        }


def with_slosh(craft: Spacecraft, share: float) -> Spacecraft:
    """The craft in which a share of the mass swings, in a half-full tank behind its centre of mass."""
    if share == 0.0:
        return craft
    x, y, z = craft.centre_of_mass
    middle = x - _BEHIND
    tank = (_RADIUS, _DEPTH, (middle - 0.5 * _DEPTH, y, z), (-1.0, 0.0, 0.0))
    of_one = Slosh.in_cylinder(1.0, *tank, _DAMPING_RATIO, _ACCELERATION)
    liquid = share * craft.mass / of_one.mass
    slosh = Slosh.in_cylinder(liquid, *tank, _DAMPING_RATIO, _ACCELERATION)
    return replace(craft, further_effectors=(slosh,))


def _swing(flight: Flight) -> float:
    """Median of the largest angle of the rod, degrees."""
    if not flight.craft.further_effectors:
        return float("nan")
    stores = dict(
        zip((store.name for store in flight.craft.stores), flight.states.stores, strict=True)
    )
    if flight.craft.dimension == 2:
        angles = np.abs(stores["slosh angle"])
    else:
        slosh: Any = flight.craft.further_effectors[0]
        rest = slosh.direction
        along = sum(stores[f"slosh direction {a}"] * e for a, e in zip("xyz", rest, strict=True))
        angles = np.arccos(np.clip(along, -1.0, 1.0))
    return float(np.degrees(np.median(np.nanmax(angles, axis=0))))
