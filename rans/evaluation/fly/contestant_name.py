"""Names of contestants: the text of a user, parsed once into a value.

The command line, Python, files and pages name contestants by its text, so that old texts must stay readable.
"""

from __future__ import annotations

import contextlib
import re
import shlex
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rans.base.errors import ConfigError, RansWarning, brief, meant_file
from rans.base.files import distinct
from rans.base.pretrained import (
    ADAPTIVE,
    FOR_ANY_CRAFT,
    missing_agents,
    pretrained_folder,
    pretrained_names,
)
from rans.base.registry import allow_current_folder, typed
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.evaluation.fly.policy_text import is_flights_file, is_user_policy, split_policy
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions import Conditions
from rans.tasks import TASKS, registered_name

if TYPE_CHECKING:
    from rans.evaluation.fly.agent import LoadedRun
    from rans.model.spacecraft import Spacecraft

FORMS = (
    f"a run folder, pretrained:NAME, or, for any craft, either after {ADAPTIVE}:, "
    f"{', '.join(f'{name}:TASK-2d' for name in CONTROLLERS)}, sb3:FILE.zip:TASK-2d, onnx:FILE:TASK-2d, "
    "python:MODULE:FUNCTION:TASK-2d or MODULE:NAME:TASK-2d (or -3d, with @SPACECRAFT if you like)"
)
"""Forms of names, for messages."""

_POSE = "go-to-pose"
"""Task of the agents for any craft."""
_POSITION = "go-to-position"
"""Word after "#" with which an agent for any craft flies to a position at any attitude."""

EVALUATIONS = Path("runs") / "evaluations"
"""Folder for the results of contestants without a run folder."""

_LONGEST_NAME = 4096
"""Largest number of characters in a path on Linux."""

_FOREIGN_FILES = (".pt", ".pth", ".onnx", ".zip")
"""Ends of the names of files of other libraries, which alone name no task."""

Kind = Literal["run folder", "pretrained", "controller", "policy", "flights"]
"""A folder of a training or an export, an agent that comes with RANS, a controller without training, a policy of
another library, or a file of flights."""


@dataclass(frozen=True)
class ContestantName:
    """The parts of a contestant's text; see `rans.evaluation.fly.contestants.contestant` for its forms.

    >>> from rans.evaluation.fly.contestant_name import ContestantName
    >>> name = ContestantName.parse("lqr:go-to-pose-2d@atmos")
    >>> name.kind, name.name, name.setup
    ('controller', 'lqr', 'go-to-pose-2d@atmos')
    """

    text: str
    """All of it."""
    kind: Kind
    name: str
    """Path of the run folder, name of the agent or of the controller (a name of `CONTROLLERS` or MODULE:NAME), or
    the policy's text without its task."""
    setup: str = ""
    """TASK-2d@SPACECRAFT of a controller or a policy; empty: that of the first contestant."""
    craft: str = ""
    """Spacecraft that an agent for any craft flies, after "@"; empty: the agent's own."""
    part: str = ""
    """Task of a multi-task agent, or position of a trade-off input, after "#"; empty: none."""
    frugality: float | None = None
    """How much time an agent for any craft takes to save thrust, from 0 to 1, after "#"; None: flights of the
    craft decide (`rans.evaluation.fly.choice`)."""
    asked: tuple[str, ...] = ()
    """What else stands after "#" of an agent for any craft: tolerances such as 2cm and 2deg, and go-to-position."""
    adapts: bool = False
    """Whether an agent for any craft estimates in flight what its file does not state ("adaptive:" before it)."""
    is_one_of_several: bool = False
    """Whether an agent for any craft flies beside itself at other values, so that the choice of this one is not
    doubted."""

    def __str__(self) -> str:
        """The text, as sentences have it."""
        return self.text

    @classmethod
    def parse(cls, text: str | ContestantName) -> ContestantName:
        """The parts of a text; of what was parsed, itself.

        Raises:
            ConfigError: no contestant has this form, and no agent or controller this name.
        """
        if isinstance(text, ContestantName):
            return text
        if not text.partition("#")[0]:
            raise ConfigError(f"{brief(text)} names no contestant; known are {FORMS}.")
        if len(text) > _LONGEST_NAME:
            raise ConfigError(f"there is no contestant {brief(text)}; known are {FORMS}.")
        # Forms whose names may hold any letter: files of policies and flights, and an agent that adapts.
        if is_user_policy(text):
            policy, setup = split_policy(text)
            return cls(text, "policy", policy, setup)
        if is_flights_file(text):
            return cls(text, "flights", text)
        if _is_bare_controller(text):
            return cls(text, "controller", text)
        if text.startswith(f"{ADAPTIVE}:") and text != f"{ADAPTIVE}:":
            return cls._adapting(text)
        # Forms with a colon, after what follows # and @.
        whole, part = _divided(text)
        first, colon, rest = whole.partition(":")
        agent, _, craft = (rest if first == "pretrained" else whole).partition("@")
        if first == "pretrained" and rest:
            return cls(text, "pretrained", agent, craft=craft, part=part)._with_frugality()
        if first in CONTROLLERS and rest:
            return cls(text, "controller", first, rest, part=part)
        if colon and not _exists(whole):
            own, _, setup = rest.partition(":")
            if own and setup:
                return cls(text, "controller", f"{first}:{own}", setup, part=part)
            near = CONTROLLERS.meant(first, ("pretrained", ADAPTIVE))
            raise ConfigError(f"there is no contestant {brief(whole)}{near}; known are {FORMS}.")
        # Names alone: an agent, the file of a spacecraft, or a folder.
        agents = (*pretrained_names(), *missing_agents())
        if not _exists(agent) and agent in agents:
            return cls(text, "pretrained", agent, craft=craft, part=part)._with_frugality()
        if whole.endswith(".toml") and Path(whole).is_file():
            agent = FOR_ANY_CRAFT[load_spacecraft(typed(whole)).dimension]
            return cls(text, "pretrained", agent, craft=whole, part=part)._with_frugality()
        if Path(whole).suffix.lower() in _FOREIGN_FILES and not Path(whole).is_dir():
            raise ConfigError(
                f"{brief(whole)} is no run folder; a network of torch is exported as ONNX first. Known are {FORMS}."
            )
        if _exists(whole):
            return cls(text, "run folder", whole, part=part)._with_frugality()
        # Mistakes, each with what to type.
        if whole.endswith(".toml") and not craft:
            raise ConfigError(
                f"there is no spacecraft file {brief(whole)}{meant_file(whole)}; `rans init {whole}` writes it."
            )
        if (task := agent.removesuffix("-2d").removesuffix("-3d")) in TASKS:
            file = craft if craft.endswith(".toml") else "mine.toml"
            own = {_POSE: f"{file}, ", _POSITION: f"{file}#{_POSITION}, "}.get(task, "")
            raise ConfigError(
                f"{whole} is a task: name who flies it, {own}a controller ({', '.join(CONTROLLERS)}) as in "
                f"lqr:{whole}, or an agent of `rans list AGENTS`; `rans train {task}` makes one."
            )
        if agent == Path(agent).name:
            near = CONTROLLERS.meant(agent, agents) or meant_file(agent)
            raise ConfigError(
                f"there is no run folder {brief(agent)}, and no controller or agent of this name{near}; "
                f"controllers are {', '.join(CONTROLLERS)}; `rans list AGENTS` prints the agents."
            )
        return cls(text, "run folder", agent, craft=craft, part=part)._with_frugality()

    @classmethod
    def _adapting(cls, text: str) -> ContestantName:
        """The parts of an agent for any craft that adapts in flight."""
        inner = cls.parse(text.removeprefix(f"{ADAPTIVE}:"))
        if inner.adapts:
            raise ConfigError(f"{brief(text)} has {ADAPTIVE}: twice; write {inner.text}.")
        if inner.kind not in ("run folder", "pretrained"):
            raise ConfigError(
                f"{brief(inner.text)} is no agent for any craft, and no other adapts in flight: name "
                f"{ADAPTIVE}:any-craft-2d or {ADAPTIVE}:any-craft-3d."
            )
        return replace(inner, text=text, adapts=True)

    def _with_frugality(self) -> ContestantName:
        """Name of an agent for any craft with value, tolerances and task read from the words after "#".

        Raises:
            ConfigError: the value is not from 0 to 1.
        """
        if not self.part or not _flies_any_craft(self):
            return self
        words = self.part.split(",")
        value = None
        with contextlib.suppress(ValueError):
            value = float(words[0])
            words = words[1:]
        if value is not None and not 0.0 <= value <= 1.0:
            raise ConfigError(
                f"{brief(self.text)} asks an agent for any craft for {brief(self.part)}: after # stands a number "
                f"from 0 (fast) to 1 (frugal), as in {FOR_ANY_CRAFT[2]}#0.5@mine.toml."
            )
        return replace(self, part="", frugality=value, asked=tuple(words))

    @property
    def in_full(self) -> str:
        """Text with the agent for any craft, where the user's has the file of a spacecraft alone; else ""."""
        return self._at(self.frugality) if self.craft and "@" not in self.text else ""

    def at(self, value: float) -> ContestantName:
        """The agent for any craft at another value."""
        return replace(self, text=self._at(value), frugality=value, is_one_of_several=True)

    def _at(self, value: float | None) -> str:
        """Text of the agent for any craft at another value."""
        words = [] if value is None else [f"{value:g}"]
        own = ",".join([*words, *self.asked])
        craft = f"@{self.craft}" if self.craft else ""
        return f"{ADAPTIVE}:" * self.adapts + self.name + (f"#{own}" if own else "") + craft

    @property
    def is_for_a_craft(self) -> bool:
        """Whether it asks an agent for any craft for more than what its folder has."""
        is_shipped = self.kind == "pretrained" and self.name in FOR_ANY_CRAFT.values()
        is_other = self.frugality is not None or self.asked
        return bool(self.craft or self.adapts or is_other or is_shipped)

    @property
    def needs_setup(self) -> bool:
        """Whether it flies only in the setup of an earlier contestant: a controller's name alone, or a file."""
        return self.kind == "flights" or (self.kind == "controller" and not self.setup)

    def without_earlier(self) -> ContestantName:
        """This contestant where there is no earlier one: a controller's name alone may be that of a run folder.

        Raises:
            ConfigError: it needs the setup of an earlier contestant.
        """
        if not self.needs_setup:
            return self
        if self.kind == "flights":
            raise ConfigError(
                f"{brief(self.text)} names no mission: name one before it, as in rans compare mission:dock-3d "
                f"{brief(self.text)}."
            )
        if _exists(self.text):
            return replace(self, kind="run folder", name=self.text)
        raise ConfigError(f"{self.text} has no task; add one, as in {self.text}:go-to-pose-2d.")

    @property
    def controller(self) -> str:
        """Name of the controller without training; empty for other contestants."""
        return self.name if self.kind == "controller" else ""

    def for_craft(
        self,
        run: LoadedRun,
        period: float | None = None,
        craft: Spacecraft | None = None,
        conditions: Conditions | None = None,
    ) -> LoadedRun:
        """The run of an agent for any craft as this name says: adapting, for a craft, at a value.

        Without a craft in its name it flies ``craft``; None: its own. The order counts: constants of the craft are
        computed for the network as it adapts, and frugality for the craft. A value that the user names is flown as
        it is, with a warning if it loses flights; not at a ``period`` (s) of others, beside whom it is judged.
        Without a number flights under the ``conditions`` decide it.
        """
        from rans.evaluation.fly.agent import Agent
        from rans.evaluation.fly.any_craft import (
            adapting,
            for_spacecraft,
            frugal,
            to_a_position,
            to_tolerances,
        )
        from rans.evaluation.fly.choice import NARROW, NO_VALUE, chosen, chosen_period
        from rans.policy.backbones import any_craft

        if self.craft:
            craft = load_spacecraft(typed(self.craft))
        run = to_tolerances(run, (x for x in self.asked if x != _POSITION))
        value = self.frugality
        choice = None
        if run.network.at:
            is_judged_beside = period is not None
            if value is not None and craft is not None and not is_judged_beside:
                period = chosen_period(run, craft)
            if value is None or not is_judged_beside:
                choice = chosen(run, craft, period, value, conditions)
                value, period = choice.value, choice.period
        if self.adapts:
            run = adapting(run)
        if craft is not None:
            timing = None if period is None else any_craft().timing(craft, run.timing, period)
            run = for_spacecraft(run, craft, timing)
        if value is not None:
            run = frugal(run, value)
        if choice is not None and isinstance(run.controller, Agent):
            flown = self.craft or run.craft.name
            run.controller.remark = choice.text(self.name, flown)
            cause = ""
            if self._is_narrow:
                cause = f"The likely cause: {NARROW}."
            elif self.frugality is not None:
                cause = f"{self.name} without a number is flown at the value that its own flights choose."
            elif conditions is not None:
                cause = NO_VALUE
            if not self.is_one_of_several and (
                doubt := choice.doubt(self.name, run.craft, flown, cause)
            ):
                warnings.warn(doubt, RansWarning, stacklevel=2)
        if self.asked and isinstance(run.controller, Agent):
            sign = "," if "#" in run.controller.name else "#"
            run.controller.name += sign + ",".join(self.asked)
        return to_a_position(run) if _POSITION in self.asked else run

    @property
    def _is_narrow(self) -> bool:
        """Whether it asks an agent for any craft for tolerances of its own."""
        return any(word != _POSITION for word in self.asked)

    def shortfall(
        self,
        percent: float,
        run: LoadedRun,
        conditions: object | None = None,
        options: Sequence[str] = (),
    ) -> str:
        """Who solves more where few flights of the contestant are solved, or why they are lost, and what to run.

        Empty if enough are (`choice.ENOUGH`). An agent for any craft and controllers fly before one is named.

        Args:
            percent: solved flights, %.
            run: what flew.
            conditions: what the user has named; None: it flew under its own.
            options: further words of the command, with which the flights are repeated.
        """
        from rans.evaluation.fly.choice import ENOUGH, NARROW, likely_cause
        from rans.policy.timing import flies_to_a_pose
        from rans.randomization.plausible import implausible

        if percent >= 100.0 * ENOUGH:
            return ""
        craft = self.craft or self.setup.partition("@")[2] or run.craft.name
        if self.kind == "run folder":
            craft = str(Path(self.name) / "spacecraft.toml")
        task = registered_name(run.task)
        is_to_a_pose = flies_to_a_pose(run.task, run.craft)
        is_free = self.kind == "controller" or self.is_for_a_craft
        under = [] if conditions is None else ["--conditions", str(conditions)]
        said = ""
        again = ["rans", "view", self.text, *(word for word in options if word == "--guard")]
        better = None
        doubts = [] if run.conditions is None else implausible(run.conditions, run.craft)
        if not doubts and is_to_a_pose and not self.asked and (is_free or under):
            better = _better(run, craft, percent)
        if doubts:
            said = f"The likely cause: {doubts[0]}."
            again = ["rans", "list", str(conditions or "CONDITIONS")]
        elif better:
            name, said = better
            again = ["rans", "evaluate", name, *under, *options]
        elif self._is_narrow:
            said = f"The likely cause: {NARROW}."
            again = ["rans", "list", craft]
        elif is_free and not is_to_a_pose and run.task.constraints and "--guard" not in options:
            said = f"{run.controller.name} knows no limits of {task}, which a safety filter keeps."
            again = ["rans", "evaluate", self.text, *under, *options, "--guard"]
        elif task and (under or (is_free and not is_to_a_pose)):
            again = ["rans", "train", task, "--spacecraft", craft, *under, "--quality", "good"]
        elif is_free:
            cause = likely_cause(run.craft, run.timing.control_period)
            said = cause and f"The likely cause: {cause}."
            again = ["rans", "list", craft]
        elif task is None:  # a class of the user
            again.append("--trust")
        first = f"{percent:.3g} % of the flights are solved."
        return " ".join(filter(None, [first, said, f"Next: {shlex.join(again)}"]))

    @property
    def folder(self) -> Path:
        """The run folder of a trained agent; that of an agent for any craft is written for craft and prefix.

        Raises:
            ConfigError: it is no trained agent, or one that is not in the package, or cannot fly the craft.
        """
        source = self.own_folder
        if not self.is_for_a_craft:
            return source
        if _POSITION in self.asked:
            raise ConfigError(
                f"{brief(self.text)} flies to positions by a law round the agent for any craft, which has no file: "
                f"leave {_POSITION} out, or rans train {_POSITION} makes an agent."
            )
        from rans.evaluation.fly.agent import load_policy
        from rans.evaluation.fly.any_craft import write_for_spacecraft

        run = self.for_craft(load_policy(source))
        return write_for_spacecraft(source, run, self.output_folder / "agent")

    @property
    def own_folder(self) -> Path:
        """The run folder of a trained agent, with the spacecraft that it was trained on.

        Raises:
            ConfigError: it is no trained agent, or one that is not in the package.
        """
        name = self.without_earlier()
        if name.kind not in ("run folder", "pretrained"):
            raise ConfigError(
                f"{brief(self.text)} is no trained agent: name a run folder, or pretrained:NAME."
            )
        return pretrained_folder(name.name) if name.kind == "pretrained" else Path(name.name)

    @property
    def policy_file(self) -> Path | None:
        """File of a policy of another library; None: there is none."""
        library, _, file = self.name.partition(":")
        is_file = self.kind == "policy" and library in ("sb3", "onnx") and Path(file).is_file()
        return Path(file) if is_file else None

    @property
    def output_folder(self) -> Path:
        """Folder for its results: its run folder, or a folder in `EVALUATIONS`.

        Raises:
            ConfigError: it needs the setup of an earlier contestant.
        """
        name = self.without_earlier()
        if name.kind == "run folder" and not name.is_for_a_craft:
            return Path(name.name)
        elif name.craft:
            text = f"{name.name}:{name.craft}"
        elif name.kind == "policy":
            library, _, file = name.name.partition(":")
            stem = file if library == "python" else Path(file).stem
            text = f"{library}:{stem}:{name.setup}"
        elif name.kind == "pretrained":
            text = f"pretrained:{name.name}"
        else:
            text = f"{name.name}:{name.setup}"
        if name.frugality is not None:
            text = f"{text}:{name.frugality:g}"
        text = ":".join([text, *name.asked])
        if name.adapts:
            text = f"{ADAPTIVE}:{text}"
        return EVALUATIONS / "-".join(distinct(part) for part in re.split("[:@]+", text) if part)


def _better(run: LoadedRun, craft: str, percent: float) -> tuple[str, str] | None:
    """Who solves more flights to a pose than ``percent``, and a sentence about them; None: nobody who was tried.

    An agent for any craft flies at the value that flights in this setup choose, and controllers beside it.
    """
    from rans.evaluation.fly.agent import load_policy
    from rans.evaluation.fly.choice import MORE, chosen

    agent = FOR_ANY_CRAFT[run.craft.dimension]
    own = load_policy(pretrained_folder(agent))
    try:
        period = run.timing.control_period
        choice = chosen(own, run.craft, period, None, run.conditions or Conditions())
    except ConfigError:  # which it cannot fly
        return None
    least = 0.01 * percent + MORE
    if choice.rival is not None and choice.rival.solved >= least:
        return choice.rival.told(agent, craft)
    if choice.solved < least * choice.flights:
        return None
    return f"{agent}#{choice.value:g}@{craft}", choice.text(agent)


def _flies_any_craft(name: ContestantName) -> bool:
    """Whether a name is that of an agent for any craft; False where it has no agent that can be read."""
    from rans.evaluation.fly.any_craft import flies_any_craft

    try:
        return flies_any_craft(name.own_folder)
    except (ConfigError, OSError):
        return False


def _is_bare_controller(text: str) -> bool:
    """Whether a text is the name of a controller alone, or MODULE:NAME with a module that exists."""
    if text in CONTROLLERS:
        return True
    module, _, name = text.partition(":")
    if module in ("pretrained", ADAPTIVE, *CONTROLLERS) or _exists(text):
        return False
    if not all(part.isidentifier() for part in f"{module}.{name}".split(".")):
        return False
    allow_current_folder()
    return find_spec(module.partition(".")[0]) is not None


def _divided(text: str) -> tuple[str, str]:
    """A name with its spacecraft after "@", and the part after "#", which the longest name that exists has not."""
    longest, _, last = text.rpartition("#")
    if _exists(text):
        return text, ""
    if longest and _exists(longest):
        return longest, last
    whole, _, part = text.partition("#")
    part, at, craft = part.partition("@")
    return whole + at + craft, part


def _exists(name: str) -> bool:
    """Whether there is a file or folder of this name; False if no file can have the name."""
    try:
        return Path(name).exists()
    except (OSError, ValueError):
        return False
