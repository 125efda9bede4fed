"""Real spacecraft: controllers without training beside the agent of each, from the same starts.

``python -m campaigns.craft_rivals`` flies the agent of every craft, LQR and switching at the agent's period and
with its conditions, and writes docs/validation/craft_rivals.json and the table of docs/craft.md. Names after it
measure those craft anew and keep the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tyro.conf import Positional

from campaigns.craft import CRAFTS
from campaigns.markdown import Table
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.fly.make_controller import controller
from rans.evaluation.measure.aggregate import measure
from rans.files import read_json, write_json
from rans.scenario import EVALUATION_SEED

COMMAND = "python -m campaigns.craft_rivals"
CONTROLLERS = ("lqr", "switching")
_FILE = "validation/craft_rivals.json"


def measured(name: str, episodes: int) -> dict[str, Any]:
    """Settled share with its interval, median time and impulse of a craft's agent and of each controller."""
    run = contestant(f"pretrained:go-to-pose-{CRAFTS[name]}-{name}")
    flown = {"agent": run.controller} | {kind: controller(kind, run.judged) for kind in CONTROLLERS}
    results = {}
    for kind, one in flown.items():
        flights = fly_episodes(one, run.judged, EVALUATION_SEED, episodes, "fast", workers=1)
        rows = {row.name: row for row in measure(flights.flight).rows}
        settled = rows["settled"]
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

    names: Positional[tuple[str, ...]] = ()
    """Names of craft; by default all."""
    episodes: int = 64
    """Flights of each."""

    def run(self) -> int:
        """Write the file and the table."""
        docs = Path("docs")
        file = docs / _FILE
        for name in self.names or CRAFTS:
            result = measured(name, self.episodes)
            # Read after the flights: another process may have measured other craft meanwhile.
            found = read_json(file) if file.exists() else {}
            found[name] = result
            write_json(file, {one: found[one] for one in CRAFTS if one in found})
            table(docs).write(docs)
        return 0


def table(docs: Path) -> Table:
    """Settled share, median time and mean impulse of each contestant."""
    kinds = ("agent", *CONTROLLERS)
    rows = []
    for name, one in read_json(docs / _FILE).items():
        cells = [_cells(one[kind]) for kind in kinds]
        rows.append(
            (f"`{name}`", str(one["episodes"]), *(" / ".join(x) for x in zip(*cells, strict=True)))
        )
    order = ", ".join(kinds)
    headings = ("spacecraft", "flights", f"settled, %: {order}", "median time, s", "impulse, N s")
    return Table("craft.md", COMMAND, headings, rows, "")


def _cells(one: dict[str, Any]) -> tuple[str, str, str]:
    time = one["settling time"]
    return (
        f"{one['settled'][0]:.1f}",
        "none" if time is None else f"{time:.1f}",
        f"{one['impulse']:.3g}" if one["impulse"] < 1000.0 else f"{one['impulse']:,.0f}",
    )


def main(arguments: list[str] | None = None) -> int:
    """Parse and run."""
    import tyro

    return tyro.cli(Rivals, args=arguments).run()


if __name__ == "__main__":
    from campaigns.command import ended

    raise SystemExit(ended(COMMAND, main))
