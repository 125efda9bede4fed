"""Real spacecraft: controllers without training beside the agent of each, from the same starts.

``python -m campaigns craft-rivals`` flies the agent of every craft, LQR and switching at the agent's period and
with its conditions.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from tyro.conf import Positional

from campaigns.craft import CRAFTS, flown
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.fly.make_controller import controller
from rans.evaluation.measure.aggregate import measure
from rans.scenario import EVALUATION_SEED

CONTROLLERS = ("lqr", "switching")


def measured(name: str, episodes: int) -> dict[str, Any]:
    """Settled share with its interval, median time and impulse of a craft's agent and of each controller."""
    run = flown(name)
    controllers = {kind: controller(kind, run.judged) for kind in CONTROLLERS}
    results = {}
    for kind, one in ({"agent": run.controller} | controllers).items():
        flights = fly_episodes(one, run.judged, EVALUATION_SEED, episodes, "fast", workers=1)
        rows = {row.name: row for row in measure(flights).rows}
        settled = rows["solved"]
        time = rows.get("settling time")
        results[kind] = {
            "settled": [settled.value, settled.low],
            "settling time": None if time is None else time.value,
            "impulse": rows["impulse"].value,
        }
    return results | {"episodes": episodes}


@dataclass(frozen=True)
class Rivals:
    """Fly real craft by agents and by controllers."""

    only: Positional[tuple[str, ...]] = ()
    """Names of craft; by default all. The others stay as they are in the evidence."""
    episodes: int = 64
    """Flights of each."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """Every contestant's flights of each craft."""
        for name in self.only or CRAFTS:
            yield {"name": name, **measured(name, self.episodes)}


def cells(evidence: Any) -> Iterator[dict[str, Any]]:
    """Rows of the table: settled share, median time and mean impulse of each contestant."""
    for one in evidence["rows"]:
        texts = zip(*(_cells(one[kind]) for kind in ("agent", *CONTROLLERS)), strict=True)
        settled, time, impulse = (" / ".join(three) for three in texts)
        yield {**one, "settled": settled, "time": time, "impulse": impulse}


def _cells(one: dict[str, Any]) -> tuple[str, str, str]:
    time = one["settling time"]
    return (
        f"{one['settled'][0]:.1f}",
        "none" if time is None else f"{time:.1f}",
        f"{one['impulse']:.3g}" if one["impulse"] < 1000.0 else f"{one['impulse']:,.0f}",
    )
