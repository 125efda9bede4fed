"""``rans improve``: cheaper flights of a mission by local search."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from rans import load_spacecraft
from rans.base.files import set_aside
from rans.extend import (
    EVALUATION_SEED,
    ConfigError,
    Options,
    Table,
    Terminal,
    command_of,
    counted,
    progress,
    ready_folder,
    stages,
    whole,
    word,
)

if TYPE_CHECKING:
    from rans_missions.improve.search import Improved


def improve(
    task: str,
    *contestants: str,
    spacecraft: str | Path | None = None,
    episodes: int = 4,
    rounds: int = 200,
    output: str | Path = Path("least.csv"),
) -> Improved:
    """Search for cheaper flights of a mission, from flights that solve it, and write them.

    Args:
        task: task, such as avoid or dock-port, of a craft with on/off thrusters alone.
        *contestants: what the search begins from: FILE.csv with flights, names of controllers, run folders or
            pretrained:NAME. For each start the cheapest flight that solves the task counts.
        spacecraft: name of a spacecraft that comes with RANS, or your own TOML file; by default that of the task,
            or of the agent.
        episodes: number of starts.
        rounds: rounds of the search, with 256 flights of each start: some seconds of processor time each.
        output: file of the flights.

    Raises:
        ConfigError: one of these does not exist, the craft has other thrusters, or no flight solves the task from
            any start.
    """
    from rans import TASKS, scenarios
    from rans.extend import Setup, Throttle, contestant, typed
    from rans.policy.timing import timing_of_file
    from rans_missions.improve import search

    whole("--episodes", episodes)
    whole("--rounds", rounds)
    file = Path(output)
    if file.suffix != ".csv":
        raise ConfigError(f"--output must end in .csv, got {str(file)!r}.")
    mission = TASKS[typed(task)]().for_evaluation()
    if not contestants:
        raise ConfigError(
            "the search begins from flights: name a controller, an agent or FILE.csv, as in rans improve "
            f"{task} lqr."
        )
    name = spacecraft or mission.spacecraft
    if name is not None:
        craft = load_spacecraft(name)
        setup = Setup(craft, mission, timing_of_file(craft, mission, str(name)))
    elif (agent := _agent_of(contestants)) is not None:
        run = contestant(agent)
        craft = run.craft
        setup = Setup(craft, mission, run.timing)
    else:
        raise ConfigError(f"{task} has no spacecraft of its own: add --spacecraft NAME.")
    if craft.is_continuous:
        raise ConfigError(
            f"improve searches the pulses of on/off thrusters, and {craft.name} has other thrusters or effectors: "
            "for throttled ones convex guidance plans the cheapest flights known."
        )
    ready_folder(file.parent)
    # Flights of throttled thrusters, such as optimal trajectories, become pulses of thrusters that are on or off.
    throttled = setup._replace(craft=replace(craft, actuators=Throttle()))
    seeds = [
        contestant(text, default_setup=throttled if text.endswith(".csv") else setup).controller
        for text in contestants
    ]
    starts = scenarios(mission, setup.craft, EVALUATION_SEED, episodes)
    with progress() as bars:
        step = stages(bars)("search", rounds)
        found = search.improve(setup, starts, seeds, rounds, report=lambda *_: step(1))
    if file.exists() and str(output) not in contestants:
        set_aside(file)
    found.write(file)
    return found


def _agent_of(contestants: Sequence[str]) -> str | None:
    """The first trained agent among contestants, which says what it flies; None: there is none."""
    from rans.extend import ContestantName

    agents = ("pretrained", "run folder")
    return next((text for text in contestants if ContestantName.parse(text).kind in agents), None)


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
    guide = "docs/missions/flights.md"
    examples = (
        "rans improve avoid pretrained:avoid-2d --episodes 4",
        "rans improve avoid pretrained:avoid-2d optimal.csv --rounds 400",
    )

    def following(self) -> tuple[str, ...]:
        """The command that compares the first contestant with the flights found."""
        from rans import TASKS
        from rans.extend import typed

        # An agent says what it flies, and so does a controller with its task.
        first = next((text for text in self.contestants if ":" in text), self.contestants[0])
        first = _agent_of(self.contestants) or first
        if _agent_of((first,)) is None and ":" not in first:
            mission = TASKS[typed(self.task)]()
            name = self.spacecraft or mission.spacecraft
            dimension = load_spacecraft(name).dimension if name is not None else 3
            who = "lqr" if first.endswith(".csv") else first
            craft = f"@{self.spacecraft}" if self.spacecraft else ""
            first = f"{who}:{self.task}-{dimension}d{craft}"
        words = ["rans", "compare", first, str(self.output), "--episodes", str(self.episodes)]
        return (shlex.join(words),)

    def run(self) -> int:
        """Print what each flight costs before and after (N s), and the exit code 0.

        An interrupt is raised after it.
        """
        found: Improved = self.call()
        console = Terminal()
        rows = [
            (str(k), *(_cell(x, 4) for x in (a, b, b / a if a != 0.0 else 1.0)))
            for k, (a, b) in enumerate(zip(found.before, found.after, strict=True))
        ]
        title = f"Impulse from {counted(self.episodes, 'start')} of {self.task}"
        console.table(Table(("start", "before, N s", "after, N s", "ratio"), rows, title))
        console.print(f"{found.flown:,} flights were judged. Written to {self.output}.")
        if found.rounds < self.rounds:
            raise KeyboardInterrupt
        return 0


def _cell(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"
