"""``rans view``: three-dimensional views of flights of agents and controllers."""

from __future__ import annotations

import contextlib
import shlex
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from rans.cli import check_count
from rans.cli.options import Trust
from rans.cli.states import OwnState, OwnZones, written_endpoints
from rans.errors import ConfigError
from rans.scenario import EVALUATION_SEED
from rans.terminal import Terminal, doing, progress, stages

if TYPE_CHECKING:
    from rans.evaluation.fly.agent import LoadedRun
    from rans.flight import Flight
    from rans.scenario import Endpoints


@dataclass(frozen=True)
class View:
    """Replay flights in three dimensions in the browser, in real time; Ctrl-C ends it.

    Every contestant has a row and every episode a tile. Open thrusters have orange plumes; the goal is green.
    A bar has pause, time and speed.
    """

    group = "Show"
    guide = "docs/viewing.md"
    examples = (
        "rans view runs/first lqr",
        "rans view pretrained:go-to-pose-3d --episodes 4 --save flights.html",
        "rans view pretrained:go-to-pose-2d --play --save fly.html",
    )

    contestants: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN...")]
    """Run folders or any other contestants, such as CONTROLLER:go-to-pose-3d. After the first, the name of a
    controller is enough, such as lqr. Folders of `rans optimal` show their trajectories, in Drake."""
    conditions: str | None = None
    """Domain randomization, disturbances, faults and sensors: a name (see `rans list CONDITIONS`), perfect, or
    your own TOML file; by default those of their training."""
    episodes: int = 1
    """Number of flights of each contestant; contestants of the same task have the same starts."""
    episode: int = 0
    """Number of the first episode, as in the list of a stress report."""
    seed: int = EVALUATION_SEED
    """Seed of starts and goals."""
    start: OwnState = ()
    """Your own start in place of scenarios: x, y (m) and heading, such as 3 1 40deg, in space x, y, z and perhaps
    roll, pitch, yaw; angles are in degrees, or with a unit. Velocities follow by name: v.x=0.1 (m/s), w=0.1
    (rad/s). Episodes then differ in conditions only; without conditions there is one."""
    goal: OwnState = ()
    """Your own goal, in the same form; by default that of the scenario, or with --start the origin."""
    zones: OwnZones = ()
    """Your own keep-out zones, for tasks that have some, such as avoid-2d: centre and radius of each, such as
    1.5,0.2,0.4, in space x,y,z,r, in m; a radius includes that of the spacecraft. They stand still."""
    engine: Literal["fast", "drake"] = "fast"
    """What computes the motion: RANS's own equations (fast), or Drake."""
    guard: bool = False
    """Fly behind a safety filter, which replaces commands that would violate a constraint
    (docs/missions/guard.md)."""
    guard_slack: float | None = None
    """With --guard: least margin that it keeps, in the unit of each constraint (m or m/s); by default 0.002, and a
    reserve for the conditions' noise."""
    save: Path | None = None
    """Write the flights to a file, and return: .html is a page that replays them offline and without RANS, .mp4 or
    .gif a film of all side by side, .png or .jpg one picture of ten instants of the first. With --play it is a page
    (.html) in which the agent flies, offline."""
    play: bool = False
    """Fly the first contestant in real time with controls: move the goal, make a thruster dead or stuck, add
    delay and noise, switch to the next contestant, pause, step, go back."""
    trust: Trust = False
    """Whether code that files name may run, by --trust."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        first = self.contestants[
            0
        ]  # others may fly another task or craft, which a comparison refuses
        return (shlex.join(["rans", "compare", first]),)

    def run(self) -> int:
        """Serve the page, or write the requested files."""
        from rans.api.judging import flown
        from rans.api.pages import flyers

        if not self.contestants:
            raise ConfigError("name at least one contestant, as in `rans view runs/first`.")
        check_count("--episodes", self.episodes)
        if not 0 <= self.episode < 2**31 - self.episodes:
            raise ConfigError(
                f"--episode must be >= 0 and < 2^31 with all that follow, got {self.episode}."
            )
        # The ending of the file decides what is written.
        kind = None if self.save is None or self.play else _kind(self.save)
        video = self.save if kind == "film" else None
        frames = self.save if kind == "picture" else None
        page = self.save if self.play else None
        if page is not None and page.suffix != ".html":
            raise ConfigError(
                f"--play --save writes a page, whose name must end in .html, got {str(page)!r}."
            )
        if self.play:
            self._refuse_unused()
        if video is not None:
            from rans.show.scene.video import check_video

            check_video(video)
        folders = [
            contestant
            for contestant in self.contestants
            if (Path(contestant) / "optimal.npz").is_file()
        ]
        others = tuple(contestant for contestant in self.contestants if contestant not in folders)
        # Fly, and show or write the flights.
        runs = flyers(others, self.conditions, self.trust, self.guard, self.guard_slack)
        if folders and (self.start or self.goal or self.zones):
            raise ConfigError(
                "--start, --goal and --zones are for flights, and an optimum has its own: leave them out."
            )
        if page is not None:
            return self._write_page(runs, page)
        if self.play:
            return self._play(runs)
        flights = [
            flown(run, self.episodes, self.seed, self.engine, self.episode, self._endpoints(run))
            for run in runs
        ]
        flights += [flight for folder in folders for flight in self._optima(Path(folder))]
        if frames is not None:
            from rans.show.scene.frames import save_frames

            save_frames(flights[0], 0, frames)
            Terminal().say(f"Ten frames of {flights[0].controller} are in {frames}.")
        if video is not None:
            self._film(flights, video)
        if kind == "page" or frames is video is None:
            self._show(flights)
        return 0

    def _refuse_unused(self) -> None:
        """Refuse options that change nothing where a person flies: everything is nominal there."""
        options = ("conditions", "episodes", "start", "goal", "zones", "engine")
        unused = [f"--{name}" for name in options if getattr(self, name) != getattr(View, name)]
        if unused:
            raise ConfigError(
                f"{', '.join(unused)} would change nothing with --play, whose controls set the goal, delay, "
                "noise and faults: leave it out."
            )

    def _write_page(self, runs: list[LoadedRun], file: Path) -> int:
        """Write the page of one agent."""
        from rans.show.pages.playground import playground

        if len(runs) != 1:
            raise ConfigError(
                f"the page that --play --save writes is of one agent, got {len(runs)}."
            )
        with doing("printing the step and the policy as JavaScript", in_log=False):
            playground(runs[0], self.seed, self.episode).write(file)
        size = file.stat().st_size / 1e3
        Terminal().say(
            f"{file} ({size:.0f} kB) flies {runs[0].controller.name} in any browser, offline."
        )
        return 0

    def _play(self, runs: list[LoadedRun]) -> int:
        """Serve a flight with controls until Ctrl-C."""
        from rich.live import Live
        from rich.text import Text

        from rans.show.scene.play import LivePlayground
        from rans.window import open_browser

        with contextlib.suppress(KeyboardInterrupt), Live(Text(""), transient=True) as line:
            playground = LivePlayground(
                runs, self.seed, self.episode, lambda text: line.update(Text(text))
            )
            line.console.print(f"Fly along at {playground.url} until Ctrl-C.", highlight=False)
            open_browser(playground.url)
            playground.run()
        return 0

    def _endpoints(self, run: LoadedRun) -> Endpoints | None:
        """The start and goal of the options."""
        return written_endpoints(
            self.start, self.goal, run.judged.task, run.craft.dimension, self.seed, self.zones
        )

    def _optima(self, folder: Path) -> list[Flight]:
        """Optimal trajectories of the requested starts."""
        from rans.evaluation.compare.optima import flights

        last = self.episode + self.episodes
        every = flights(folder)
        results = [flight for start, flight in every if self.episode <= start < last]
        if not results:
            numbers = ", ".join(str(start) for start, _ in every) or "none"
            raise ConfigError(
                f"{folder} has no trajectory of start {self.episode}; it has those of: {numbers}."
            )
        return results

    def _show(self, flights: list[Flight]) -> None:
        from rans.api.pages import title_of
        from rans.show.scene.view import View as Page
        from rans.window import open_browser

        page = Page()
        colours = page.show(flights, title_of(flights, self.conditions))
        names = [flight.controller for flight in flights]
        legend = ", ".join(
            f"{name} ({colour})" for name, colour in zip(names, colours, strict=True)
        )
        if self.save is not None:
            page.save(self.save)
            Terminal().say(f"{self.save} replays {legend} in any browser.")
            return
        with contextlib.suppress(
            KeyboardInterrupt
        ):  # Ctrl-C is expected from the first printed sentence on
            url = page.serve().url
            Terminal().say(f"{legend}: shown at {url} until Ctrl-C.")
            open_browser(url)
            while True:
                time.sleep(3600.0)

    def _film(self, flights: list[Flight], file: Path) -> None:
        from rans.show.scene.video import save_video

        with progress() as bars:
            save_video(flights, file, stages(bars))
        names = dict.fromkeys(flight.controller for flight in flights)
        Terminal().say(f"{file} is a video of {', '.join(names)}.")


def _kind(file: Path) -> Literal["page", "film", "picture"]:
    """Kind of a file of flights by the ending of its name.

    Raises:
        ConfigError: the ending is of none.
    """
    endings: dict[str, Literal["page", "film", "picture"]] = {
        ".html": "page",
        ".mp4": "film",
        ".gif": "film",
        ".png": "picture",
        ".jpg": "picture",
        ".jpeg": "picture",
        ".webp": "picture",
    }
    kind = endings.get(file.suffix.lower())
    if kind is None:
        raise ConfigError(
            "--save writes a page (.html), a film (.mp4 or .gif) or a picture (.png or .jpg), by the ending of "
            f"the file's name, got {str(file)!r}."
        )
    return kind
