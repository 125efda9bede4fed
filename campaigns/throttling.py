"""What a lander gains by throttling its engines one by one: ``python -m campaigns throttling``.

With all engines and without the first, it finds lower bounds of the propellant from held-out starts of land, with
engines that are throttled alike, and one by one. The craft turns at once. From starts without a landing it finds
the bound again for a craft of the same mass, of which twice as much is propellant.
Where it is more than the real craft has, nothing lands.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rans_missions.convex.landing import Descent, Lander, best_landing, thrust_offset
from rans_missions.tasks.land import Land

from rans.files import number
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import EVALUATION_SEED, each, scenarios

_ENGINES: dict[str, tuple[int, ...]] = {"all": (), "without the first": (0,)}
"""Dead engines, by what the table calls it."""


def shown(evidence: Any) -> Iterator[dict[str, Any]]:
    """Rows of the table, of the evidence: numbers of starts with a landing, and means over those with both."""
    for row in evidence["rows"]:
        alike, apart = (np.array(list(map(number, row[key]))) for key in ("alike", "apart"))
        both = np.isfinite(alike) & np.isfinite(apart)
        every = [*map(number, row["needed"])]
        needed = [kg for kg in every if math.isfinite(kg)]
        others = []
        if needed:
            others.append(f"{len(needed)}: {min(needed):.0f} to {max(needed):.0f} kg")
        if weak := len(every) - len(needed):
            others.append(f"{weak}: too little thrust")
        yield {
            "engines": row["engines"],
            "starts": len(alike),
            "landings alike": int(np.isfinite(alike).sum()),
            "landings apart": int(np.isfinite(apart).sum()),
            "alike": alike[both].mean(),
            "apart": apart[both].mean(),
            "others": "; ".join(others) or "-",
        }


@dataclass(frozen=True)
class Throttling:
    """Find the bounds."""

    episodes: int = 32
    """Held-out starts."""
    seed: int = EVALUATION_SEED
    """Seed of the held-out starts."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """Bounds of all starts with the same engines, kg; infinite where there is no landing."""
        task = Land()
        assert task.spacecraft is not None
        return _rows(load_spacecraft(task.spacecraft), task, self.episodes, self.seed)


def _rows(craft: Spacecraft, task: Land, count: int, seed: int) -> Iterator[dict[str, Any]]:
    period = task.timing.control_period
    longest = period * task.timing.episode_steps
    descent = Descent.of(task)
    starts = [
        (np.array(one.start.p.columns()), np.array(one.start.v.columns()))
        for one in each(scenarios(task, craft, seed, count))
    ]
    for engines, dead in _ENGINES.items():
        # Thrust that is off the craft's axis may be tilted by so much more than the craft.
        offset = thrust_offset(craft, dead) if dead else 0.0
        alike = Lander.of(craft, dead), replace(descent, tilt=descent.tilt + offset)
        apart = Lander.of(craft, dead, apart=True), descent
        found = []
        for lander, limits in (alike, apart):
            best = [
                best_landing(lander, limits, start, period, "bound", (2.0, longest))
                for start in starts
            ]
            found.append(tuple(math.inf if one is None else one.dual for one in best))
        lander = replace(apart[0], propellant=2.0 * apart[0].propellant)
        needed = []
        for start, least in zip(starts, found[1], strict=True):
            if math.isinf(least):
                one = best_landing(lander, descent, start, period, "bound", (2.0, longest))
                needed.append(math.inf if one is None else one.dual)
        # Throttled alike, one by one, and with twice as much propellant where there is no landing.
        yield {"engines": engines, "alike": found[0], "apart": found[1], "needed": needed}
