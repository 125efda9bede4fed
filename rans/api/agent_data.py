"""What an agent is: a controller with its setup and its name, which functions of `rans` take."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.tasks import Task

if TYPE_CHECKING:
    from rans.episode.flight import Controller
    from rans.evaluation.fly.agent import LoadedRun


@dataclass(eq=False, repr=False)
class AgentData:
    """The controller of an agent with the spacecraft, the task and the conditions that it flies.

    `rans.Agent` adds what it does. Functions that take an agent ask for this class alone, so that they need not
    know the methods that call them.
    """

    run: LoadedRun
    """The controller, with its spacecraft, task, timing and conditions."""
    spec: str = ""
    """Its name in commands: a run folder, or pretrained:NAME; empty if it has none."""

    def __repr__(self) -> str:
        return repr(self.run)

    def _repr_html_(self) -> str:
        """Table of the notebook: task, spacecraft, conditions, control period and run folder."""
        from rans.base.table import Table
        from rans.show.pages.notebook import html_of

        conditions = self.conditions
        rows = [
            ("task", repr(self.task)),
            ("spacecraft", self.craft.name),
            ("conditions", "nominal" if conditions is None else conditions.description or "own"),
            ("control period", f"{self.timing.control_period:g} s"),
            ("run folder", str(self.folder or "none")),
        ]
        return html_of(Table(("", ""), rows, self.name))

    @property
    def name(self) -> str:
        """Name of the agent in tables."""
        return self.run.controller.name

    @property
    def controller(self) -> Controller:
        """The controller that gives the commands, as `rans.fly` takes it."""
        return self.run.controller

    @property
    def craft(self) -> Spacecraft:
        """The spacecraft that it commands."""
        return self.run.craft

    @property
    def task(self) -> Task:
        """The task of the agent, with the settings of its training."""
        return self.run.task

    @property
    def timing(self) -> Timing:
        """Control period and length of its episodes."""
        return self.run.timing

    @property
    def conditions(self) -> Conditions | None:
        """Domain randomization, disturbances, faults and sensors of its episodes; None: everything nominal."""
        return self.run.conditions

    @property
    def folder(self) -> Path | None:
        """Run folder of the agent; None if it has none."""
        from rans.evaluation.fly.agent import Agent as Network
        from rans.evaluation.fly.contestant_name import ContestantName

        if not self.spec or not isinstance(self.run.controller, Network):
            return None
        return ContestantName.parse(self.spec).folder
