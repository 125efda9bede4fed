"""``rans improve``: cheaper flights of a mission by local search."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from rans.cli.door import Options, command_of, word
from rans.extend import (
    EVALUATION_SEED,
    ConfigError,
    Terminal,
    check_count,
    counted,
    load_spacecraft,
    progress,
    ready_folder,
)
from rans.terminal import stages

if TYPE_CHECKING:
    from rans_missions.improve.search import Improved


def improve(
    task: str,
    *contestants: str,
    spacecraft: str | Path | None = None,
    episodes: int = 4,
    seed: int = EVALUATION_SEED,
    rounds: int = 200,
    output: str | Path = Path("least.csv"),
) -> Improved:
    """Search for cheaper flights of a mission, from flights that solve it, and write them.

    Args:
        task: mission, such as inspect, hold, dock, rendezvous or avoid, of a craft with thrusters alone.
        *contestants: what the search begins from: FILE.csv with flights, names of controllers, run folders or
            pretrained:NAME. For each start the cheapest flight that solves the task counts.
        spacecraft: name of a spacecraft that comes with RANS, or your own TOML file; by default that of the task.
        episodes: number of starts.
        seed: seed of the starts.
        rounds: rounds of the search, with 256 flights of each start: some seconds of processor time each.
        output: file of the flights.

    Raises:
        ConfigError: one of these does not exist, or no contestant solves the task from any start.
    """
    from rans.extend import TASKS, Setup, contestant, scenarios
    from rans.registry import typed
    from rans_missions.improve import search

    check_count("--episodes", episodes)
    check_count("--rounds", rounds)
    file = Path(output)
    if file.suffix != ".csv":
        raise ConfigError(f"--output must end in .csv, got {str(file)!r}.")
    if not contestants:
        raise ConfigError(
            f"rans improve {task} begins from flights: name a controller such as mission, or FILE.csv."
        )
    mission = TASKS[typed(task)]().for_evaluation()
    name = spacecraft or mission.spacecraft
    if name is None:
        raise ConfigError(f"{task} has no spacecraft of its own: add --spacecraft NAME.")
    setup = Setup(load_spacecraft(name), mission, mission.timing)
    ready_folder(file.parent)
    seeds = [contestant(text, default_setup=setup).controller for text in contestants]
    starts = scenarios(mission, setup.craft, seed, episodes)
    with progress() as bars:
        step = stages(bars)("search", rounds)
        found = search.improve(setup, starts, seeds, rounds, report=lambda *_: step(1))
    found.write(file)
    return found


@command_of(
    improve,
    task=word("TASK"),
    contestants=word("FLIGHT...", tuple[str, ...]),
    output=Annotated[Path, arg(metavar="FILE.csv")],
)
class Improve(Options):
    """Search for cheaper flights of a mission, from flights that solve it, judged by the engine's own checks.

    Writes a file of flights, which `rans compare` takes as a contestant and this command as a beginning.
    """

    group = "Limits"
    guide = "docs/missions/improve.md"
    examples = (
        "rans improve inspect circumnavigation --episodes 4",
        "rans improve dock least.csv mission convex --rounds 400",
    )

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        from rans.extend import TASKS
        from rans.registry import typed

        first = self.contestants[0]
        if ":" not in first:
            mission = TASKS[typed(self.task)]()
            name = self.spacecraft or mission.spacecraft
            dimension = load_spacecraft(name).dimension if name is not None else 3
            who = "mission" if first.endswith(".csv") else first
            first = f"{who}:{self.task}-{dimension}d"
        words = ["rans", "compare", first, str(self.output), "--episodes", str(self.episodes)]
        return (shlex.join(words),)

    def run(self) -> int:
        """Print what each flight costs before and after."""
        found: Improved = self.call()
        console = Terminal()
        console.show(
            f"Impulse from {counted(self.episodes, 'start')} of {self.task}",
            ("start", "before, N s", "after, N s", "ratio"),
            [
                (str(k), f"{a:.4f}", f"{b:.4f}", f"{b / a:.3f}")
                for k, (a, b) in enumerate(zip(found.before, found.after, strict=True))
            ],
        )
        console.print(f"{found.flown:,} flights were judged. Written to {self.output}.")
        return 0
