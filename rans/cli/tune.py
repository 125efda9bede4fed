"""``rans tune``: settings of a controller without training."""

from __future__ import annotations

import inspect
import shlex

from rans.api.training import searched, tune
from rans.base.errors import ConfigError, brief
from rans.base.registry import typed
from rans.base.table import Table
from rans.base.terminal import Terminal
from rans.cli.door import Options, command_of, word
from rans.model.spacecraft_file import USUAL

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
    following = ("rans list CONTROLLERS",)

    def run(self) -> int:
        """Search, then print and write default and tuned settings with their costs; the exit code is 0."""
        from rans.evaluation.compare.tuning import ranges
        from rans.evaluation.fly.contestants import contestant
        from rans.evaluation.fly.controllers import CONTROLLERS
        from rans.evaluation.fly.tuned import defaults, task_name

        name, setup_text = _parts(self.controller)
        within = ranges(typed(name))
        text = self.controller
        if not setup_text:
            text = f"{name}:go-to-pose-2d@{USUAL[2]}"
        run = contestant(typed(text))
        task, craft, timing = run.task, run.craft, run.timing
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
        Terminal().suggest(shlex.join(["rans", "evaluate", text]))
        return 0


def _parts(text: str) -> tuple[str, str]:
    """Name of a controller, and the TASK-2d@SPACECRAFT after it; empty if there is none.

    Raises:
        ConfigError: no controller has this form.
    """
    from rans.evaluation.fly.contestant_name import ContestantName
    from rans.evaluation.fly.controllers import CONTROLLERS

    first, _, setup = text.partition(":")
    if first == "pretrained":
        raise ConfigError(
            f"rans tune searches settings of a controller, and {brief(text)} is an agent, which has none: name a "
            "controller, as in lqr:go-to-pose-2d@mine.toml."
        )
    if not setup or first in CONTROLLERS:
        return first, setup
    # MODULE:NAME, and MODULE:NAME:TASK-2d of a class of the user's
    if setup.count(":") == 0:
        return text, ""
    name = ContestantName.parse(text)
    return name.name, name.setup
