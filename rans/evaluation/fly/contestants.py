"""Contestants by name: the agent of a run folder, an agent that comes with RANS, or a controller."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path

from rans.episode import Setup
from rans.errors import ConfigError, brief, meant
from rans.evaluation.fly.agent import Agent, LoadedRun, load_agent, run_of
from rans.evaluation.fly.controllers import (
    CONTROLLERS,
    controller,
    is_user_policy,
    split_policy,
    user_policy,
)
from rans.evaluation.fly.exported import is_exported, load_exported
from rans.evaluation.fly.lookahead import PREFIX, looking_ahead
from rans.evaluation.fly.protocols import ProtocolName, under_protocol
from rans.files import distinct
from rans.model.spacecraft_file import USUAL, load_spacecraft
from rans.pretrained import (
    missing_agents,
    present_agent,
    pretrained_folder,
    pretrained_names,
)
from rans.registry import allow_current_folder, typed
from rans.tasks import TASKS, Task, registered_name

FORMS = (
    f"a run folder, pretrained:NAME, or either after {PREFIX}:, "
    f"{', '.join(f'{name}:TASK-2d' for name in CONTROLLERS)}, sb3:FILE.zip:TASK-2d, onnx:FILE:TASK-2d, "
    "python:MODULE:FUNCTION:TASK-2d or MODULE:NAME:TASK-2d (or -3d, with @SPACECRAFT if you like)"
)
"""Forms of names that `contestant` accepts, for messages."""

EVALUATIONS = Path("runs") / "evaluations"
"""Folder for the results of contestants without a run folder."""


def contestant(
    spec: str,
    protocol: ProtocolName = "own",
    default_setup: Setup | None = None,
    trust: bool = False,
) -> LoadedRun:
    """Load a contestant by name, with the setup in which it flies.

    Args:
        spec: a run folder; ``pretrained:NAME`` (see `rans.pretrained`), or NAME where no folder has that
            name; ``CONTROLLER:TASK-2d`` or ``-3d`` with a name of `CONTROLLERS` or MODULE:NAME, which fly
            the floating platform or the free flyer, or another spacecraft as in
            ``CONTROLLER:go-to-pose-2d@floating-platform-shared``, with the task's timing unless a protocol
            has its own. ``#TASK`` at the end picks one of the tasks of a multi-task agent, ``#0.3`` a
            position of a trade-off. Policies of other libraries (see `user_policy`) end in the same
            ``:TASK-2d@SPACECRAFT``, or fly ``default_setup``. A folder may also hold an exported agent
            (`rans.evaluation.fly.exported`).
        protocol: see `rans.evaluation.fly.protocols.under_protocol`.
        default_setup: setup of policies of other libraries, and of a controller named by its bare name or
            MODULE:NAME; None: such contestants are refused.
        trust: whether a policy of another library may be a pickle, which runs code when it is opened.
    """
    kind, _, bare = spec.partition(":")
    # Controllers in the setup of the contestants before.
    if default_setup is not None and kind == PREFIX and _is_controller(bare):
        run = contestant(bare, default_setup=default_setup)
        return run._replace(controller=looking_ahead(run))
    if default_setup is not None and _is_controller(spec):
        return LoadedRun(controller(typed(spec), default_setup), *default_setup[:4])
    # Policies of a user's module or of other libraries, which may need a task.
    if is_user_policy(spec):
        policy, tail = split_policy(spec)
        if tail:
            setup = under_protocol(protocol, _named_setup(tail, spec))
        elif default_setup is not None:
            setup = default_setup
        else:
            raise ConfigError(
                f"{spec} has no task: add one, as in {spec}:go-to-pose-2d, or name before it an "
                f"agent that has one, as in rans compare RUN {spec}."
            )
        return LoadedRun(user_policy(policy, setup.craft, setup.task, trust), *setup[:4])
    # Names of RANS: lookahead, controllers with a task, and trained agents.
    kind, name, part = _parse(spec)
    if kind == PREFIX:
        run = contestant(f"{name}#{part}" if part else name, protocol)
        return run._replace(controller=looking_ahead(run))
    if kind not in ("", "pretrained"):
        setup = under_protocol(protocol, _picked(_named_setup(name, spec), part, spec))
        return LoadedRun(controller(typed(kind), setup), *setup[:4])
    # A trained agent flies in its own setup, or in that of the protocol.
    folder = agent_folder(spec)
    run = load_exported(folder) if is_exported(folder) else load_agent(folder)
    own = _picked(Setup(run.craft, run.task, run.timing, run.conditions), part, spec)
    return LoadedRun(run.controller, *under_protocol(protocol, own)[:4])


def text_of(agent: object) -> str:
    """Text of a name or a path.

    Raises:
        ConfigError: it is neither.
    """
    if isinstance(agent, str | Path) and str(agent):
        return str(agent)
    raise ConfigError(
        "an agent is given by its name, its run folder or the result of rans.load_agent, as in "
        f"rans.load_agent('lqr:go-to-pose-2d'), got {brief(agent)}."
    )


def in_protocol(agent: object, protocol: ProtocolName) -> LoadedRun:
    """A contestant, given by its text or as an object, in the setup of a protocol.

    Raises:
        ConfigError: see `contestant`; or the object is a controller for another setup, and must be named.
    """
    run = run_of(agent)
    if run is None:
        return contestant(text_of(agent), protocol)
    own = Setup(*run[1:])
    changed = under_protocol(protocol, own)
    if changed is not own and not isinstance(run.controller, Agent):
        raise ConfigError(
            f"{run.controller.name} was made for its own setup; give its name instead, as in "
            f"rans.evaluate('lqr:go-to-pose-2d', protocol={protocol!r})."
        )
    return LoadedRun(run.controller, *changed)


def agent_folder(spec: str) -> Path:
    """The run folder that a text names.

    Raises:
        ConfigError: it names a controller without training, or an agent that is not in the package.
    """
    kind, name, _ = _parse(spec)
    if kind not in ("", "pretrained"):
        raise ConfigError(
            f"{brief(spec)} is no trained agent: name a run folder, or pretrained:NAME."
        )
    return pretrained_folder(name) if kind else Path(name)


def judged_separately(spec: str) -> list[str]:
    """Names of the evaluations of a contestant: its own, or one for each task of a multi-task agent."""
    if is_user_policy(spec):
        return [spec]
    return [f"{spec}#{name}" if name else spec for name in contestant(spec).task.parts()]


def output_folder(spec: str) -> Path:
    """Folder for the results of a contestant: its run folder, or a folder in `EVALUATIONS`."""
    if is_user_policy(spec):
        policy, tail = split_policy(spec)
        kind, _, name = policy.partition(":")
        stem = Path(name).stem if kind != "python" else name
        return EVALUATIONS / "-".join(
            distinct(part) for part in re.split("[:@]+", f"{kind}:{stem}:{tail}") if part
        )
    kind, name, _ = _parse(spec)
    if not kind:
        return Path(name)
    parts = re.split("[:@]+", f"{kind}:{name}")
    return EVALUATIONS / "-".join(map(distinct, parts))


def controller_name(spec: str) -> str:
    """Name of the controller of `CONTROLLERS` that a text names; "" if it names none."""
    if _is_controller(spec):
        return spec
    kind = "" if is_user_policy(spec) else _parse(spec)[0]
    return "" if kind in ("pretrained", PREFIX) else kind


def picked_task(spec: str) -> str:
    """Name of the task that a text picks from a multi-task agent; "" if it picks none."""
    return "" if is_user_policy(spec) else _parse(spec)[2]


def view_command(
    who: Iterable[str], task: Task, conditions: str | None, episode: int, seed: int
) -> str:
    """Command that shows an episode of contestants again, with ``--trust`` if the task is of a user's module."""
    options = ["--conditions", conditions] if conditions else []
    options += ["--episode", str(episode), "--seed", str(seed)]
    return shlex.join(
        ["rans", "view", *who, *options, *([] if registered_name(task) else ["--trust"])]
    )


def _is_controller(spec: str) -> bool:
    """Whether a text is the bare name of a controller, or MODULE:NAME with a module that exists."""
    if spec in CONTROLLERS:
        return True
    module, _, name = spec.partition(":")
    others = module in ("pretrained", PREFIX, *CONTROLLERS) or is_user_policy(spec) or _exists(spec)
    dotted = all(part.isidentifier() for part in f"{module}.{name}".split("."))
    if others or not dotted:
        return False
    allow_current_folder()
    return find_spec(module.partition(".")[0]) is not None


_LONGEST_NAME = 4096
"""Largest number of characters in a path on Linux."""


def _exists(name: str) -> bool:
    """Whether there is a file or folder of this name; False if no file can have the name."""
    try:
        return Path(name).exists()
    except (OSError, ValueError):
        return False


def _parse(spec: str) -> tuple[str, str, str]:
    """Kind, name and picked task of a contestant's text; the kind of a run folder is ""."""
    if len(spec) > _LONGEST_NAME:
        raise ConfigError(f"there is no contestant {brief(spec)}; known are {FORMS}.")
    spec, _, part = spec.partition("#")
    kind, _, name = spec.partition(":")
    kinds = "pretrained", PREFIX, *CONTROLLERS
    if kind in kinds and name:
        return kind, name, part
    if spec == f"{kind}:":
        raise ConfigError(f"{spec} has no name after its colon; known are {FORMS}.")
    if ":" in spec and not _exists(spec):
        module = kind
        (own, _, name) = name.partition(":")
        if own and name:
            return f"{module}:{own}", name, part
        if _is_controller(spec):
            raise ConfigError(f"{spec} has no task; add one, as in {spec}:go-to-pose-2d.")
        raise ConfigError(
            f"there is no contestant {brief(spec)}{meant(kind, kinds)}; known are {FORMS}."
        )
    agents = (*pretrained_names(), *missing_agents())
    if not _exists(spec) and present_agent(spec) in agents:
        return "pretrained", present_agent(spec), part
    if not _exists(spec) and (near := meant(spec, (*CONTROLLERS, *agents))):
        raise ConfigError(
            f"{spec} has no task; add one, as in {spec}:go-to-pose-2d."
            if spec in CONTROLLERS
            else f"{spec} is not a run folder, and no agent or controller{near}."
        )
    return "", spec, part


def _named_setup(name: str, spec: str) -> Setup:
    """Setup of a controller that "TASK@SPACECRAFT" names, with "-2d" or "-3d" after TASK if both exist.

    Without a spacecraft and a number of dimensions it is the task's own spacecraft, or the floating platform.
    """
    name, _, spacecraft = name.partition("@")
    suffix = name[-2:] if name.endswith(("-2d", "-3d")) else ""
    result = TASKS[typed(name.removesuffix(f"-{suffix}") if suffix else name)]()
    usual = result.spacecraft or USUAL[int(suffix[0]) if suffix else 2]
    craft = load_spacecraft(typed(spacecraft) or usual)
    if suffix and craft.dimension != int(suffix[0]):
        raise ConfigError(
            f"{brief(spec)} asks for {suffix}, but {craft.name} moves in {craft.dimension} dimensions."
        )
    return Setup(craft, result, result.timing)


def _picked(setup: Setup, part: str, spec: str) -> Setup:
    """The setup with one task of its multi-task."""
    parts = setup.task.parts()
    if part and part not in parts:
        raise ConfigError(
            f"{brief(spec)} picks the task {brief(part)}, but there is only "
            f"{', '.join(parts) or 'one task'}."
        )
    return setup._replace(task=parts[part]) if part else setup
