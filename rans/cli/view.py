"""``rans view``: three-dimensional views of flights of agents and controllers."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from rans.api.pages import flyers, view
from rans.base.errors import ConfigError, whole
from rans.base.terminal import Terminal, doing
from rans.cli.door import Options, command_of, word
from rans.cli.next_commands import after

if TYPE_CHECKING:
    from rans.episode.flight import Flight


@command_of(view, contestants=word("RUN...", tuple[str, ...]))
class View(Options):
    """Replay flights in three dimensions in the browser, in real time; Ctrl-C ends it.

    All from the same starts fly in one picture. Open thrusters have orange plumes; the goal is green.
    A bar has pause, time and speed.
    """

    group = "Show"
    guide = "docs/viewing.md"
    examples = (
        "rans view runs/my-agent lqr",
        "rans view pretrained:go-to-pose-3d --episodes 4 --save flights.html",
        "rans view pretrained:go-to-pose-2d --play --save fly.html",
    )

    play: bool = False
    """Fly an agent or mission guidance in real time with controls: move the goal, make a thruster dead or stuck,
    add delay and noise, pause, step, go back. The page flies alone; --save FILE.html writes it."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        # Others may fly another task or craft, which a comparison refuses.
        return after(self, "view", self.contestants[0])

    def run(self) -> int:
        """Serve the page until an interrupt, or write the requested files; the exit code is 0."""
        if not self.contestants:
            raise ConfigError("name at least one contestant, as in `rans view runs/my-agent`.")
        whole("episodes", self.episodes)
        if not 0 <= self.episode < 2**31 - self.episodes:
            raise ConfigError(
                f"--episode must be >= 0 and < 2^31 with all that follow, got {self.episode}."
            )
        if self.play:
            self._refuse_unused()
            if self.save is not None and self.save.suffix != ".html":
                raise ConfigError(
                    f"--play --save writes a page, whose name must end in .html, got {str(self.save)!r}."
                )
            return self._play()
        replay = self.call()
        self._say_of_losses(replay.flights[0])
        names = ", ".join(dict.fromkeys(flight.controller for flight in replay.flights))
        if self.save is not None:
            Terminal().say(f"{self.save} shows {names}.")
            return 0
        _serve(replay.html, f"{names}: shown at")
        return 0

    def _say_of_losses(self, flight: Flight) -> None:
        """Name the cause where the first contestant loses a flight."""
        from rans.evaluation.fly.contestant_name import ContestantName

        solved = flight.verdict.solved
        if solved.all():
            return
        name = ContestantName.parse(self.contestants[0])
        (run, *_) = flyers((name.text,), None, self.trust)
        text = name.shortfall(
            100.0 * float(solved.mean()), run, self.conditions, self.changed("guard")
        )
        if "rans view" not in text:  # which it is
            Terminal().say(text)

    def _refuse_unused(self) -> None:
        """Refuse options that change nothing where a person flies: everything is nominal there."""
        options = ("conditions", "episodes", "start", "goal", "engine")
        unused = [each for each in self.changed(*options) if each.startswith("--")]
        if unused:
            raise ConfigError(
                f"{', '.join(unused)} would change nothing with --play, whose controls set the goal, delay, "
                "noise and faults: leave it out."
            )

    def _play(self) -> int:
        """Write the page in which one contestant flies, or serve it until Ctrl-C; the exit code is 0."""
        from rans.show.pages.playground import playground

        if len(self.contestants) != 1:
            raise ConfigError(f"one contestant flies with --play, got {len(self.contestants)}.")
        (run,) = flyers(self.contestants, self.conditions, self.trust, self.guard)
        with doing("printing the step and the policy as JavaScript", in_log=False):
            page = playground(run, self.seed, self.episode)
        if self.save is None:
            _serve(page.html, "Fly along at")
            return 0
        page.write(self.save)
        size = self.save.stat().st_size / 1e3
        Terminal().say(
            f"{self.save} ({size:.0f} kB) flies {run.controller.name} in any browser, offline."
        )
        return 0


def _serve(page: Callable[[], str], words: str) -> None:
    """Serve a page until Ctrl-C, and say its address after the words; see `rans.show.window.Served`."""
    from rans.show.window import PORTS, Served, open_browser

    # Ctrl-C is expected from the first printed sentence on.
    with contextlib.suppress(KeyboardInterrupt):
        url = Served(page, PORTS).url
        Terminal().say(f"{words} {url} until Ctrl-C.")
        open_browser(url)
        while True:
            time.sleep(3600.0)
