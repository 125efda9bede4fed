"""``rans tune``: settings of a controller without training."""

from __future__ import annotations

import inspect
import shlex
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from rans.api.training import searched, tune
from rans.cli.door import Options, command_of, word
from rans.errors import ConfigError
from rans.registry import typed
from rans.table import Table
from rans.terminal import Terminal

if TYPE_CHECKING:
    from rans.model.spacecraft import Spacecraft
    from rans.model.timing import Timing
    from rans.tasks import Task

_CANDIDATES, _STARTS, _PRICE = (
    inspect.signature(tune).parameters[name].default for name in ("candidates", "starts", "price")
)


@command_of(
    tune,
    without=("task", "spacecraft", "candidates", "starts", "price", "output"),
    controller=word("CONTROLLER[:TASK-2d@SPACECRAFT]"),
)
class Tune(Options):
    """Search the settings of a controller by random sampling, first anywhere, then near the best.

    All candidates fly from the same starts, of a seed that no evaluation uses. Every command in this folder
    then uses the result for this controller, spacecraft, task and control rate. Ctrl-C ends the search and
    keeps the best so far. After the controller may stand task and spacecraft to tune it for, such as
    lqr:track-velocity-2d@mine.toml; by default go-to-pose and its spacecraft, floating-platform.
    """

    group = "Train"
    guide = "docs/controllers.md"
    examples = ("rans tune lqr:go-to-pose-2d@mine.toml",)

    contestant: Annotated[str | None, Positional, arg(metavar="[CONTESTANT]")] = None
    """Take task, starts, spacecraft and control period from this contestant, such as
    any-craft-2d@pingu."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return ("rans list CONTROLLERS",)

    def run(self) -> int:
        """Search, then print and write default and tuned settings with their costs; the exit code is 0."""
        from rans.api.names import load_spacecraft
        from rans.evaluation.compare.tuning import ranges
        from rans.evaluation.fly.controllers import CONTROLLERS
        from rans.evaluation.fly.tuned import defaults, task_name
        from rans.tasks import TASKS

        # Task, spacecraft and control period: of the name, or of a contestant.
        name, setup_text = _parts(self.controller)
        _check_is_controller(name)
        within = ranges(typed(name))
        like = self.contestant
        if like is not None and setup_text:
            raise ConfigError(
                f"{like} has a task and a spacecraft of its own: name the controller alone, {name}."
            )
        if setup_text:
            task, craft, timing = _of_contestant(self.controller)
            again = ["rans", "evaluate", self.controller]
        elif like is None:
            named = "go-to-pose"
            task = TASKS[named]()
            spacecraft = task.spacecraft or "floating-platform"
            craft = load_spacecraft(spacecraft)
            timing = task.timing
            again = [
                "rans",
                "evaluate",
                f"{name}:{named}-{craft.dimension}d@{spacecraft}",
            ]
        else:
            task, craft, timing = _of_contestant(like)
            again = ["rans", "compare", like, "--with", name]
        numbers = _CANDIDATES, _STARTS, _PRICE, self.seconds
        result, file, staying = searched(name, task, craft, timing, self.conditions, numbers)
        # Result, and how to use it.
        before = defaults(CONTROLLERS[name], within)
        rows: list[tuple[str, ...]] = [
            (key, f"{before[key]:.3g}", f"{value:.3g}") for key, value in result.settings.items()
        ]
        rows.append(("cost, s", *(f"{value:.3f}" for value in result.costs.values())))
        title = f"{name}, {task_name(task)}, {craft.name}: {result.budget()}"
        Terminal().table(Table(("setting", "default", "tuned"), rows, title))
        Terminal().say(
            f"Written to {file}."
            if staying is None
            else f"Not written: the settings in use, {staying.budget()}, were found on more starts, or "
            "cost no more on the same starts."
        )
        if result.candidates < _CANDIDATES and result.seconds < self.seconds:
            raise KeyboardInterrupt
        Terminal().suggest(shlex.join(again))
        return 0


def _check_is_controller(name: str) -> None:
    """Raise ConfigError with what to type for an agent or a task in place of a controller."""
    from rans.pretrained import missing_agents, pretrained_names
    from rans.tasks import TASKS

    if name.startswith("pretrained:") or name in (*pretrained_names(), *missing_agents()):
        raise ConfigError(
            "`rans tune` searches settings of a controller without training, and an agent has none: tune one for "
            "the agent's task, as in `rans tune lqr pretrained:NAME`; `rans sweep` searches settings of trainings."
        )
    if name.removesuffix("-2d").removesuffix("-3d") in TASKS:
        raise ConfigError(f"{name} is a task: name a controller before it, as in lqr:{name}.")


def _of_contestant(name: str) -> tuple[Task, Spacecraft, Timing]:
    """Task, spacecraft and control period of a contestant."""
    from rans.evaluation.fly.contestants import contestant

    run = contestant(typed(name))
    return run.task, run.craft, run.timing


def _parts(text: str) -> tuple[str, str]:
    """Name of a controller, and the TASK-2d@SPACECRAFT after it; empty if there is none.

    Raises:
        ConfigError: no controller has this form.
    """
    from rans.evaluation.fly.contestant_name import ContestantName
    from rans.evaluation.fly.controllers import CONTROLLERS

    first, _, setup = text.partition(":")
    if not setup or first in CONTROLLERS:
        return first, setup
    # MODULE:NAME, and MODULE:NAME:TASK-2d of a class of the user's
    if setup.count(":") == 0:
        return text, ""
    name = ContestantName.parse(text)
    return name.name, name.setup
