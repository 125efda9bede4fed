"""Replays in three dimensions, reports, and export of agents."""

from __future__ import annotations

import re
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rans.api.agent_data import AgentData
from rans.api.judging import ConditionsLike, flown, own_endpoints
from rans.api.names import conditions_if_named
from rans.base.choices import EngineName
from rans.base.errors import ConfigError, brief, one_of, require, whole
from rans.base.files import ready_folder, write_text
from rans.base.pretrained import pretrained_folder, pretrained_names
from rans.base.settled import settled_alone
from rans.episode.scenario import EVALUATION_SEED
from rans.model.dynamics import State
from rans.show.films import FILMS

if TYPE_CHECKING:
    from rans.episode.flight import Flight
    from rans.evaluation.fly.agent import LoadedRun
    from rans.show.window import Served

_HEIGHT = 480
"""Height of a replay in a notebook, pixels."""


@dataclass
class Replay:
    """A page that replays flights in three dimensions; a notebook shows it under its cell."""

    flights: list[Flight]
    title: str

    def __post_init__(self) -> None:
        self._html: str | None = None
        self._served: Served | None = None

    def __repr__(self) -> str:
        names = ", ".join(flight.controller for flight in self.flights)
        return f"<Replay of {names}: {self.title}>"

    def html(self) -> str:
        """HTML text of the page, complete and offline."""
        if self._html is None:
            from rans.show.pages.replay import replay_page

            self._html = replay_page(self.flights, self.title).html()
        return self._html

    def save(self, file: str | Path) -> Path:
        """Write the flights to a file and return it: a page, a film or a picture, by the ending of its name.

        A page replays offline, a film has all flights side by side, and a picture path, errors and thrusters of the
        first one.

        Raises:
            ConfigError: the name has another ending, a package is missing, or the disk refused.
        """
        file = Path(file)
        kind = checked_kind(file)
        if kind == "page":
            write_text(file, self.html())
        elif kind == "film":
            from rans.show.progress import watched

            with watched() as stage:
                FILMS[file.suffix.lower()[1:]](self.flights, file, stage)
        else:
            from rans.show.figures.figures import episode_figure
            from rans.show.figures.picture_file import save_picture

            save_picture(episode_figure(self.flights[0]), file)
        return file

    def open(self) -> str:
        """Open the page in the browser and return its address; it is served while this Python process runs."""
        from rans.show.window import PORTS, Served, open_browser

        if self._served is None:
            self._served = Served(self.html, PORTS)
        open_browser(self._served.url)
        return self._served.url

    def _repr_html_(self) -> str:
        from rans.show import markup

        return (
            f'<iframe srcdoc="{markup.text(self.html())}" '
            f'style="width:100%;height:{_HEIGHT}px;border:0"></iframe>'
        )


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
    start: State | None = None,
    goal: State | None = None,
) -> Replay:
    """Fly agents and controllers from the same starts, and replay the flights in three dimensions.

    >>> replay = rans.view("go-to-pose-2d", "lqr")
    >>> replay
    <Replay of go-to-pose-2d, LQR: go-to-pose, floating-platform>

    In a notebook the replay shows itself; ``replay.open()`` opens a browser. A contestant may be an `Agent` too.

    Args:
        *contestants: run folders, agents that come with RANS, or any others, such as CONTROLLER:go-to-pose-3d.
            After the first, the name of a controller is enough, such as lqr.
        conditions: see `rans.api.judging.evaluate`.
        episodes: number of flights of each contestant; contestants of the same task have the same starts.
        episode: number of the first episode, as in the list of a stress report.
        seed: see `rans.api.judging.evaluate`.
        engine: see `rans.api.judging.evaluate`.
        trust: see `rans.api.judging.compare`.
        save: file to write the flights to: .html is a page that replays them offline and without RANS, .mp4 or .gif
            a film of all side by side, .png, .svg or .pdf path, errors and thrusters of the first.
        guard: see `rans.api.judging.evaluate`.
        start: see `rans.api.judging.evaluate`.
        goal: see `rans.api.judging.evaluate`.

    Raises:
        ConfigError: there is no such contestant, a number is out of its range, or start or goal is no state of the
            craft's dimension.
    """
    if not contestants:
        raise ConfigError('say who flies, as in rans.view("go-to-pose-2d").')
    if save is not None:
        checked_kind(Path(save))
    # What is wrong is refused before anything flies.
    endpoints = own_endpoints(start, goal)
    count = whole("episodes", episodes)
    first = whole("episode", episode, least=0)
    runs = flyers(contestants, conditions, trust, guard)
    shown = [flown(run, count, seed, engine, first, endpoints) for run in runs]
    label = None if conditions is None else str(getattr(conditions, "description", conditions))
    replay = Replay(shown, title_of(shown, label))
    if save is not None:
        replay.save(save)
    return replay


def checked_kind(file: Path) -> Literal["page", "film", "picture"]:
    """Kind of a file of flights by the ending of its name, before anything flies.

    Raises:
        ConfigError: the ending is of none, the file cannot become a film, or nothing can be written there.
    """
    endings: dict[str, Literal["page", "film", "picture"]] = {
        **dict.fromkeys(FILMS, "film"),
        "html": "page",
        **dict.fromkeys(("png", "svg", "pdf"), "picture"),
    }
    ending = file.suffix.lower()[1:]
    kind = endings.get(ending)
    if kind is None:
        films = " or ".join(f".{name}" for name in FILMS)
        raise ConfigError(
            f"save writes a page (.html), a film ({films}) or a picture (.png, .svg or .pdf), by the ending of "
            f"the file's name, got {str(file)!r}."
        )
    ready_folder(file.parent)
    if kind == "film":
        FILMS[ending]((), file, check=True)
    return kind


def flyers(
    contestants: tuple[object, ...],
    conditions: ConditionsLike | None,
    trust: bool,
    guard: bool = False,
) -> list[LoadedRun]:
    """Runs of contestants, behind the safety filter if asked for; a bare name after the first flies its setup.

    Raises:
        ConfigError: there is no such contestant.
    """
    from rans.evaluation.fly.agent import run_of
    from rans.evaluation.fly.contestants import contestant, text_of

    results: list[LoadedRun] = []
    world = conditions_if_named(conditions)
    for entrant in contestants:
        setup = results[0].judged if results else None
        run = run_of(entrant) or contestant(
            text_of(entrant), default_setup=setup, trust=trust, conditions=world
        )
        results.append(run.under(world).guarded(guard))
    return results


def title_of(flights: list[Flight], conditions: str | None) -> str:
    """What is flown: tasks, spacecraft, conditions."""
    from rans.evaluation.fly.tuned import task_name

    tasks = " and ".join(dict.fromkeys(task_name(flight.task) for flight in flights))
    crafts = " and ".join(dict.fromkeys(flight.craft.name for flight in flights))
    return f"{tasks}, {crafts}" + (f", conditions {conditions}" if conditions else "")


@settled_alone
def report(run_folder: str | Path | AgentData) -> Path:
    """Gather the results in a run folder on one offline page, report.html, and return its path.

    >>> folder = tempfile.mkdtemp()
    >>> agent = rans.train("go-to-pose", total_timesteps=8192, output=f"{folder}/mine")
    >>> rans.report(agent).name
    'report.html'

    Args:
        run_folder: run folder; parts that it does not have yet are left out.

    Raises:
        ConfigError: there is no such folder, or it holds no results.
    """
    from rans.show.pages.report import report_from_run

    if isinstance(run_folder, AgentData):
        if run_folder.folder is None:
            raise ConfigError(f"{run_folder.name} has no run folder to report on.")
        folder = run_folder.folder
    elif isinstance(run_folder, str | PathLike):
        folder = Path(run_folder)
    else:
        raise ConfigError(
            f"a run, unless it is a name or a file, must be a rans.Agent, got {brief(run_folder)}."
        )
    file = folder / "report.html"
    report_from_run(folder).write(file)
    return file


@settled_alone
def export(
    agent: str | Path | AgentData,
    output: str | Path | None = None,
    format: str = "rans",
    *,
    episodes: int = 1024,
    force: bool = False,
    name: str = "",
) -> Path:
    """Export an agent for other software, with a contract, test vectors and a model card; return the folder.

    >>> folder = tempfile.mkdtemp()
    >>> written = rans.export("go-to-pose-2d", f"{folder}/mine", "numpy", episodes=16)
    >>> sorted(file.name for file in written.iterdir())[:3]
    ['agent.npz', 'agent.py', 'card.json']

    Args:
        agent: run folder of the agent, or the name of one that comes with RANS; any-craft-2d@mine.toml is exported
            for that craft. onnx:FILE:TASK-2d@SPACECRAFT is a network of another library, copied by the format onnx.
        output: folder to write, whose name becomes the agent's name; by default runs/exports/ and the name of the
            agent.
        format: format of the agent: rans, onnx, numpy, c, c8 (c with weights of a byte), fmu, basilisk, px4,
            or another package's. None has the safety filter: the contract names it, and `rans fly` on the folder
            applies it (docs/missions/guard.md).
        episodes: number of evaluation flights for the model card.
        force: whether to export an agent that solves less than half of its flights.
        name: prefix of the names of C, so that two agents are linked into one program: approach makes
            approach_act of rans_agent_act.

    Raises:
        ConfigError: this is no trained agent, or the folder is another agent's; or it solves less than half of its
            flights.
    """
    folder, _ = exported(agent, output, format, episodes, force, name)
    return folder


def exported(
    agent: str | Path | AgentData,
    output: str | Path | None,
    format: str,
    episodes: int,
    force: bool = False,
    prefix: str = "",
) -> tuple[Path, dict[str, Any]]:
    """Write an export and return its folder and card; see `export`, whose arguments these are."""
    from rans.deploy.export import EXPORTERS, OWN, write_export
    from rans.deploy.forms import FORMATS
    from rans.evaluation.fly.contestant_name import ContestantName
    from rans.evaluation.fly.exported import is_exported

    count = whole("episodes", episodes)
    one_of("format", format, (OWN, *FORMATS))
    takes_prefix = format != OWN and FORMATS[format].is_prefixed
    if prefix and not (takes_prefix and re.fullmatch(r"[a-zA-Z]\w{0,30}", prefix, re.A)):
        raise ConfigError(
            "name is the prefix of names in C, of at most 31 letters, digits and underscores, and needs the format "
            f"c or c8, got {brief(prefix)} for {format}."
        )
    source: Any = agent.folder if isinstance(agent, AgentData) else agent
    if source is None:
        raise ConfigError(f"{agent!r} is no trained agent with a run folder.")
    name = ContestantName.parse(str(source))
    is_foreign = name.kind == "policy"
    source = name.policy_file if is_foreign else name.folder
    if source is None and name.name.startswith("onnx:"):
        raise ConfigError(f"there is no file {name.name.removeprefix('onnx:')}.")
    if source is None:
        raise ConfigError(
            f"{brief(name.text)} is no ONNX file, and an export needs the operations of one. Let its own "
            "library write ONNX, as examples/trainers do by --save FILE, and export onnx:FILE:TASK-2d."
        )
    if part := name.part:
        raise ConfigError(
            "an agent is exported as a whole, with its trade-off and all its tasks as observations: name "
            f"it without #{part}."
        )
    if not is_foreign and is_exported(source):
        raise ConfigError(f"{source} is an export already: export the run that it was made of.")
    if format == "rans" and not is_foreign and _comes_with_rans(source):
        raise ConfigError(f"{source.name} comes with RANS in this format already, in {source}.")
    # Before minutes of flights.
    write_policy = EXPORTERS[name.kind] if is_foreign else None
    if format == "onnx":
        require("onnx")
    # The folder of an agent for any craft is named after its craft too.
    label = source.stem if is_foreign else source.name
    if name.is_for_a_craft:
        label = name.output_folder.name
    default = Path("runs/exports") / label
    folder = ready_folder(default if output is None else output)
    if write_policy is not None:
        return folder, write_policy(name.text, folder, format, count)
    least = 0.0 if force else _LEAST
    return folder, write_export(
        source, folder, format, count, least=least, prefix=prefix, spec=name.text
    )


_LEAST = 50.0
"""Solved flights, %, below which an agent is exported on demand only."""


def _comes_with_rans(folder: Path) -> bool:
    """Whether a folder is that of a pretrained agent."""
    return folder.name in pretrained_names() and folder == pretrained_folder(folder.name)
