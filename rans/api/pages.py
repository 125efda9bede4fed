"""Replays in three dimensions, reports, and export of agents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rans.api.agent_data import AgentData
from rans.api.judging import ConditionsLike, flown, own_endpoints
from rans.api.names import conditions_if_named
from rans.errors import ConfigError, brief, one_of, text_of_name, whole
from rans.scenario import EVALUATION_SEED
from rans.settled import settled_alone

if TYPE_CHECKING:
    from rans.evaluation.fly.agent import LoadedRun
    from rans.evaluation.fly.episodes import EngineName
    from rans.flight import Flight
    from rans.model.dynamics import State
    from rans.show.scene.view import View
    from rans.window import Served

_HEIGHT = 480
"""Height of a replay in a notebook, pixels."""


@dataclass
class Replay:
    """A page that replays flights in three dimensions; a notebook shows it under its cell."""

    flights: list[Flight]
    title: str

    def __post_init__(self) -> None:
        self._page: View | None = None
        self._served: Served | None = None

    def __repr__(self) -> str:
        names = ", ".join(flight.controller for flight in self.flights)
        return f"<Replay of {names}: {self.title}>"

    def html(self) -> str:
        """HTML text of the page, complete and offline."""
        return self._made().html()

    def save(self, file: str | Path) -> Path:
        """Write the page to an HTML file that replays offline, and return the file.

        Raises:
            ConfigError: the name has another ending, or the disk refused.
        """
        file = Path(file)
        if file.suffix != ".html":
            raise ConfigError(
                f"a replay is a page, whose name must end in .html, got {str(file)!r}."
            )
        self._made().save(file)
        return file

    def film(self, file: str | Path) -> Path:
        """Write all flights, side by side, as a film (.mp4 or .gif).

        Raises:
            ConfigError: FFmpeg is not installed, or the name has another ending.
        """
        from rans.show.progress import watched
        from rans.show.scene.video import check_video, save_video

        file = Path(file)
        check_video(file)
        with watched() as stage:
            save_video(self.flights, file, stage)
        return file

    def open(self) -> str:
        """Open the page in the browser and return its address; it is served while this Python process runs."""
        from rans.window import open_browser

        if self._served is None:
            self._served = self._made().serve()
        open_browser(self._served.url)
        return self._served.url

    def _repr_html_(self) -> str:
        from rans.show import markup

        return (
            f'<iframe srcdoc="{markup.text(self.html())}" '
            f'style="width:100%;height:{_HEIGHT}px;border:0"></iframe>'
        )

    def _made(self) -> View:
        if self._page is None:
            from rans.show.scene.view import View

            self._page = View()
            self._page.show(self.flights, self.title)
        return self._page


@settled_alone
def view(
    *contestants: object,
    conditions: ConditionsLike | None = None,
    episodes: int = 1,
    episode: int = 0,
    seed: int = EVALUATION_SEED,
    engine: EngineName = "fast",
    trust: bool = False,
    save: str | Path | None = None,
    guard: bool = False,
    guard_slack: float | None = None,
    start: State | None = None,
    goal: State | None = None,
    zones: Sequence[Sequence[float]] = (),
) -> Replay:
    """Fly agents and controllers from the same starts, and replay the flights in three dimensions.

    >>> replay = rans.view("go-to-pose-2d", "lqr")
    >>> replay
    <Replay of go-to-pose-2d, LQR: go-to-pose, floating-platform>

    In a notebook the replay shows itself; ``replay.open()`` opens a browser.

    Args:
        *contestants: agents, or names as `load_agent` takes them; after the first, the name of a controller is
            enough.
        conditions: domain randomization, disturbances, faults and sensors; None: those of the trainings.
        episodes: number of flights of each.
        episode: number of the first episode.
        seed: random seed of starts and goals.
        engine: what computes the motion: "fast" (RANS's own equations), or "drake".
        trust: whether ``sb3:`` files that RANS did not write may be opened; they are pickles, which can run code.
        save: HTML file to write the page to; None: none.
        guard: whether all fly behind the safety filter for their spacecraft and task.
        guard_slack: least margin that the filter keeps, m or m/s; None: 0.002, and a reserve for
            the conditions' noise.
        start: start of all flights, as `rans.state` makes it; None: sampled.
        goal: goal of all flights, as `rans.state` makes it; None: sampled.
        zones: keep-out zones that stand still, for tasks that have some: coordinates of the centre, then the
            radius, of each, m; empty: sampled.

    Raises:
        ConfigError: there is no such contestant, a number is out of its range, or start or goal is no state of the
            craft's dimension.
    """
    if not contestants:
        raise ConfigError('say who flies, as in rans.view("go-to-pose-2d").')
    count = whole("episodes", episodes)
    first = whole("episode", episode, least=0)
    runs = flyers(contestants, conditions, trust, guard, guard_slack)
    endpoints = own_endpoints(start, goal, zones)
    flights = [flown(run, count, seed, engine, first, endpoints) for run in runs]
    label = None if conditions is None else str(getattr(conditions, "description", conditions))
    replay = Replay(flights, title_of(flights, label))
    if save is not None:
        replay.save(save)
    return replay


def flyers(
    contestants: tuple[object, ...],
    conditions: ConditionsLike | None,
    trust: bool,
    guard: bool = False,
    guard_slack: float | None = None,
) -> list[LoadedRun]:
    """Runs of contestants, behind the safety filter if asked for; a bare name after the first flies its setup.

    Raises:
        ConfigError: there is no such contestant.
    """
    from rans.evaluation.fly.agent import run_of
    from rans.evaluation.fly.contestants import contestant, text_of

    results: list[LoadedRun] = []
    for entrant in contestants:
        setup = results[0].judged if results else None
        run = run_of(entrant) or contestant(text_of(entrant), default_setup=setup, trust=trust)
        results.append(run.under(conditions_if_named(conditions)).guarded(guard, guard_slack))
    return results


def title_of(flights: list[Flight], conditions: str | None) -> str:
    """What is flown: tasks, spacecraft, conditions."""
    from rans.evaluation.fly.tuned import task_name

    tasks = " and ".join(dict.fromkeys(task_name(flight.task) for flight in flights))
    crafts = " and ".join(dict.fromkeys(flight.craft.name for flight in flights))
    return f"{tasks}, {crafts}" + (f", conditions {conditions}" if conditions else "")


@settled_alone
def report(run: str | Path | AgentData) -> Path:
    """Gather the results in a run folder on one offline page, report.html, and return its path.

    >>> folder = tempfile.mkdtemp()
    >>> agent = rans.train("go-to-pose", total_timesteps=8192, run=f"{folder}/mine")
    >>> rans.report(agent).name
    'report.html'

    Args:
        run: run folder, or the agent of one.

    Raises:
        ConfigError: there is no such folder, or it holds no results.
    """
    from rans.show.pages.report import report_from_run

    if isinstance(run, AgentData):
        if run.folder is None:
            raise ConfigError(f"{run.name} has no run folder to report on.")
        folder = run.folder
    elif isinstance(run, str | PathLike):
        folder = Path(run)
    else:
        raise ConfigError(
            f"a run, unless it is a name or a file, must be a rans.Agent, got {brief(run)}."
        )
    file = folder / "report.html"
    report_from_run(folder).write(file)
    return file


@settled_alone
def export(
    agent: str | Path | AgentData,
    output: str | Path,
    form: str = "onnx",
    *,
    episodes: int = 1024,
) -> Path:
    """Export an agent for other software, with a contract, test vectors and a model card; return the folder.

    >>> folder = tempfile.mkdtemp()
    >>> written = rans.export("go-to-pose-2d", f"{folder}/mine", "numpy", episodes=16)
    >>> sorted(file.name for file in written.iterdir())[:3]
    ['agent.npz', 'agent.py', 'card.json']

    Args:
        agent: a trained agent: an `Agent`, its run folder, or the name of one that comes with RANS; or
            "onnx:FILE:TASK-2d@SPACECRAFT", a network of another library, as "c", "numpy" or "onnx".
        output: folder to write; its name becomes the agent's name.
        form: "onnx" for any ONNX runtime, "numpy" for NumPy alone, "c" for C99, "sb3" for Stable-Baselines3 and
            RANS, "rans" for RANS alone, or "fmu" for simulators that read FMI 2.0.
        episodes: number of evaluation flights for the model card.

    Raises:
        ConfigError: this is no trained agent, or the folder is another agent's.
    """
    from rans.deploy.export import EXPORTERS
    from rans.deploy.export import write_export as write
    from rans.deploy.forms import forms
    from rans.evaluation.fly.contestant_name import ContestantName

    one_of("form", form, forms())
    source: Any = agent.folder if isinstance(agent, AgentData) else agent
    if source is None:
        raise ConfigError(f"{agent!r} is no trained agent with a run folder.")
    name = ContestantName.parse(str(source))
    if part := name.part:
        raise ConfigError(
            "an agent is exported whole, with its trade-off input and all its tasks as observations: "
            f"name it without #{part}."
        )
    folder = Path(text_of_name("output", output, Path))
    if name.kind == "policy":
        EXPORTERS[name.kind](name.text, folder, form, whole("episodes", episodes))
        return folder
    write(name.folder, folder, form, whole("episodes", episodes))
    return folder
