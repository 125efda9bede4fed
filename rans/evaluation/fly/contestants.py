"""Contestants by name: the agent of a run folder, an agent that comes with RANS, or a controller.

Every command and function resolves names here, so that a text means the same everywhere.
"""

from __future__ import annotations

import contextlib
import shlex
import warnings
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from rans.base.errors import ConfigError, RansWarning, brief
from rans.base.pretrained import FOR_ANY_CRAFT, pretrained_folder
from rans.base.registry import are_files_trusted, typed
from rans.episode.step import Setup
from rans.evaluation.fly.agent import Agent, LoadedRun, load_policy, run_of
from rans.evaluation.fly.contestant_name import ContestantName, Kind
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.evaluation.fly.exported import is_exported, load_exported
from rans.evaluation.fly.policy_text import FLIGHTS
from rans.evaluation.fly.protocols import ProtocolName, under_protocol
from rans.model.spacecraft_file import USUAL, load_spacecraft
from rans.randomization.conditions import Conditions
from rans.tasks import TASKS, Task, registered_name


class Terms(NamedTuple):
    """Under what a contestant is loaded; see `contestant`."""

    protocol: ProtocolName
    setup: Setup | None
    """Of the contestant before it; None: there is none."""
    trust: bool
    period: float | None
    conditions: Conditions | None


def contestant(
    spec: str | ContestantName,
    protocol: ProtocolName = "own",
    default_setup: Setup | None = None,
    trust: bool = False,
    period: float | None = None,
    conditions: Conditions | None = None,
) -> LoadedRun:
    """Load a contestant, with the setup in which it flies.

    Args:
        spec: its name, parsed or as text: a run folder; ``pretrained:NAME`` (`rans.base.pretrained`), or NAME where
            no folder has that name; ``CONTROLLER:TASK-2d`` or ``-3d`` with a name of `CONTROLLERS` or MODULE:NAME,
            which fly the floating platform or the free flyer, or another spacecraft as in
            ``CONTROLLER:go-to-pose-2d@floating-platform-shared``, with the task's timing unless a protocol
            has its own. ``#TASK`` at the end picks one of the tasks of a multi-task agent, ``#0.3`` a
            position of a trade-off. Policies of other libraries (see `user_policy`) end in the same
            ``:TASK-2d@SPACECRAFT``, or fly ``default_setup``. A folder may also hold an exported agent
            (`rans.evaluation.fly.exported`). FILE.csv holds flights, which fly ``default_setup``
            (`FLIGHTS`). An agent for any craft flies another one than its own as
            ``any-craft-2d@SPACECRAFT`` (`rans.evaluation.fly.any_craft`), and estimates in flight what the
            craft's file does not state as ``adaptive:any-craft-2d@SPACECRAFT``. ``any-craft-2d#0.5@SPACECRAFT``
            takes more time to spend less thrust, from 0 (fast) to 1 (frugal); ``#2cm,2deg`` sets tolerances, and
            ``#go-to-position`` leaves the attitude out.
        protocol: see `rans.evaluation.fly.protocols.under_protocol`.
        default_setup: setup of policies of other libraries, and of a controller named by its bare name or
            MODULE:NAME; None: such contestants are refused.
        trust: whether a policy of another library may be a pickle, which runs code when it is opened.
        period: control period, s, of a controller or of an agent for any craft with a named craft; None: theirs.
        conditions: under which flights choose the value of an agent for any craft (`LoadedRun.under` flies it so).

    Raises:
        ConfigError: there is no such contestant, or it has another control period.
    """
    name = ContestantName.parse(spec)
    run = _loaded(name, Terms(protocol, default_setup, trust, period, conditions))
    if period is not None and run.timing.control_period != period:
        raise ConfigError(
            f"{brief(name.text)} acts every {run.timing.control_period:g} s, as in its training: another --period, "
            f"got {period:g} s, is for controllers and for an agent for any craft with a spacecraft, as in "
            f"{FOR_ANY_CRAFT[run.craft.dimension]}@mine.toml."
        )
    return run


def _loaded(name: ContestantName, terms: Terms) -> LoadedRun:
    """Load a contestant by what is of its kind."""
    if terms.setup is None:
        name = name.without_earlier()
    return _LOADERS[name.kind](name, terms)


def _flights(name: ContestantName, terms: Terms) -> LoadedRun:
    """Flights of a file, in the setup of the first contestant."""
    assert terms.setup is not None
    read = FLIGHTS[Path(name.name).suffix.lower()[1:]]
    return LoadedRun(read(name.name, terms.setup), *terms.setup[:4])


def _policy(name: ContestantName, terms: Terms) -> LoadedRun:
    """A policy of another library, in the setup that its text names, or in that of the first contestant."""
    from rans.evaluation.fly.user_policy import user_policy

    if name.setup:
        setup = under_protocol(terms.protocol, _named_setup(name, terms.period))
    elif terms.setup is not None:
        setup = terms.setup
    else:
        raise ConfigError(
            f"{name.text} has no task: add one, as in {name.text}:go-to-pose-2d, or name before it an "
            f"agent that has one, as in rans compare RUN {name.text}."
        )
    policy = user_policy(name.name, setup.craft, setup.task, terms.trust)
    period = setup.timing.control_period
    usual = setup.task.timing.control_period
    if name.setup and terms.period is None and period != usual:
        warnings.warn(
            f"{policy.name} does not say how often it acts: it is flown every {period:g} s, the period chosen for "
            f"{setup.craft.name}, while environments of the task have {usual:g} s. `rans evaluate` and "
            "`rans compare` take the one of its training by --period.",
            RansWarning,
            stacklevel=2,
        )
    return LoadedRun(policy, *setup[:4])


def _controller(name: ContestantName, terms: Terms) -> LoadedRun:
    """A controller without training, in the setup that its text names, or in that of the first contestant."""
    from rans.evaluation.fly.make_controller import controller

    setup = terms.setup
    maker = typed(name.name)
    trade_off = None
    if setup is None or not name.needs_setup:
        setup = _named_setup(name, terms.period)
        has_trade_off = getattr(CONTROLLERS[maker], "has_trade_off", False)
        if any(setup.task.parts()) or not has_trade_off:
            # What a controller may have before the trade-off, such as its folder, is no part of the task.
            source, _, part = name.part.rpartition(",")
            if has_trade_off and source:
                trade_off = name.part
                name = replace(name, part=part)
            setup = _picked(setup, name)
        else:
            trade_off = name.part or None
        setup = under_protocol(terms.protocol, setup)
    return LoadedRun(controller(maker, setup, trade_off), *setup[:4])


def _agent(name: ContestantName, terms: Terms) -> LoadedRun:
    """A trained agent in its own setup, or in that of the protocol; one for any craft with the named one."""
    folder = name.own_folder
    run = load_exported(folder) if is_exported(folder) else load_policy(folder)
    if name.is_for_a_craft:
        run = name.for_craft(run, terms.period, conditions=terms.conditions)
    own = _picked(Setup(run.craft, run.task, run.timing, run.conditions), name)
    return LoadedRun(run.controller, *under_protocol(terms.protocol, own)[:4])


_LOADERS: dict[Kind, Callable[[ContestantName, Terms], LoadedRun]] = {
    "run folder": _agent,
    "pretrained": _agent,
    "controller": _controller,
    "policy": _policy,
    "flights": _flights,
}
"""What loads the contestants of a kind."""


def with_spacecraft(spec: str, spacecraft: str | None) -> str:
    """Name of an agent for any craft together with that of the craft that it is to fly; None: its own."""
    if spacecraft is None:
        return spec
    name, sign, part = spec.partition("#")
    if "@" in name:
        raise ConfigError(
            f"{brief(spec)} names a spacecraft already: leave out --spacecraft {spacecraft}."
        )
    return f"{name}@{spacecraft}{sign}{part}"


def text_of(agent: object) -> str:
    """Text of a name or a path.

    Raises:
        ConfigError: it is neither.
    """
    if isinstance(agent, str | Path) and str(agent):
        return str(agent)
    raise ConfigError(
        "an agent is given by its name, its run folder or the result of rans.load_agent, as in "
        f"rans.load_agent('lqr:go-to-pose-2d'), got {brief(agent)}. A policy of Stable-Baselines3 is given by its "
        "file, 'sb3:mine.zip:go-to-pose-2d', and trust=True."
    )


def in_protocol(
    agent: object,
    protocol: ProtocolName,
    period: float | None = None,
    conditions: Conditions | None = None,
) -> LoadedRun:
    """A contestant, given by its text or as an object, in the setup of a protocol; see `contestant`.

    Raises:
        ConfigError: see `contestant`; or the object is a controller for another setup, and must be named.
    """
    run = run_of(agent)
    if run is None:
        return contestant(text_of(agent), protocol, period=period, conditions=conditions)
    if period not in (None, run.timing.control_period):
        raise ConfigError(
            f"{run.controller.name} acts every {run.timing.control_period:g} s; give its name instead "
            f"of the object for a period of {period:g} s."
        )
    own = Setup(*run[1:])
    changed = under_protocol(protocol, own)
    if changed is not own and not isinstance(run.controller, Agent):
        raise ConfigError(
            f"{run.controller.name} was made for its own setup; give its name instead, as in "
            f"rans.evaluate('lqr:go-to-pose-2d', protocol={protocol!r})."
        )
    return LoadedRun(run.controller, *changed)


def judged_separately(who: str | ContestantName) -> list[ContestantName]:
    """Contestants that are judged in the place of one: itself, or each task of a multi-task agent."""
    name = ContestantName.parse(who)
    if name.kind == "policy":
        return [name]
    parts = contestant(name).task.parts()
    return [ContestantName.parse(f"{name}#{part}") if part else name for part in parts]


def view_command(
    who: Iterable[str], task: Task, conditions: str | None, episode: int, seed: int
) -> str:
    """Command that shows an episode of contestants again.

    It has ``--trust`` if files are trusted, or the task is of a user's module.
    """
    options = ["--conditions", conditions] if conditions else []
    options += ["--episode", str(episode), "--seed", str(seed)]
    if are_files_trusted() or not registered_name(task):
        options += ["--trust"]
    return shlex.join(["rans", "view", *who, *options])


def _named_setup(contestant_name: ContestantName, period: float | None) -> Setup:
    """Setup that the "TASK@SPACECRAFT" of a contestant names, with "-2d" or "-3d" after TASK if both exist.

    Without a spacecraft and a number of dimensions it is the task's own spacecraft, or the floating platform. The
    control period is that of the task, or of the craft of a file (`rans.policy.timing`), if none is given.
    """
    name, _, spacecraft = contestant_name.setup.partition("@")
    suffix = name[-3:] if name.endswith(("-2d", "-3d")) else ""
    result = TASKS[typed(name.removesuffix(suffix))]()
    usual = result.spacecraft or USUAL[int(suffix[1]) if suffix else 2]
    craft = load_spacecraft(typed(spacecraft) or usual)
    if suffix and craft.dimension != int(suffix[1]):
        raise ConfigError(
            f"{brief(contestant_name.text)} asks for {suffix[1:]}, but {craft.name} moves in "
            f"{craft.dimension} dimensions."
        )
    from rans.evaluation.fly.choice import chosen_period
    from rans.policy.timing import flies_to_a_pose, timing_of_file

    if period is None and spacecraft.endswith(".toml") and flies_to_a_pose(result, craft):
        with contextlib.suppress(ConfigError):  # others may fly what the agent for any craft cannot
            agent = load_policy(pretrained_folder(FOR_ANY_CRAFT[craft.dimension]))
            period = chosen_period(agent, craft)
    return Setup(craft, result, timing_of_file(craft, result, spacecraft, period))


def _picked(setup: Setup, name: ContestantName) -> Setup:
    """The setup with the task that the name picks of a multi-task, or itself if it picks none."""
    part = name.part
    parts = setup.task.parts()
    if part and part not in parts:
        names = ", ".join(filter(None, parts))
        known = (
            f"its tasks are {names}" if names else "it has neither several tasks nor a trade-off"
        )
        raise ConfigError(f"{brief(name.text)} picks {brief(part)}, but {known}.")
    return setup._replace(task=parts[part]) if part else setup
