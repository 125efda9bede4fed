"""Contestants of a comparison: agents and controllers by name, and the effort of their tuning.

Names and efforts that it gives stand in every table; the first contestant decides task, craft and timing.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from typing import Any, cast

from rans.base.errors import (
    EXTRAS,
    ConfigError,
    RansError,
    RansWarning,
    brief,
    installing,
    is_installed,
    require,
)
from rans.episode.flight import Controller
from rans.episode.scenario import EVALUATION_SEED
from rans.episode.step import Setup
from rans.evaluation.compare.contest import Contest, Contestant
from rans.evaluation.fly.agent import Agent, LoadedRun, run_of
from rans.evaluation.fly.contestant_name import ContestantName
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.controllers import MODULES, Maker, default_opponents
from rans.evaluation.fly.episodes import EngineName
from rans.evaluation.fly.make_controller import CheckedController, controller
from rans.evaluation.fly.object_policy import ObjectPolicy
from rans.evaluation.fly.trade_off import FixedTradeOff
from rans.evaluation.fly.tuned import tuned
from rans.evaluation.fly.user_policy import UserPolicy
from rans.fast.learn.run_folder import RunFolder
from rans.model.random import seed_words
from rans.randomization.conditions import Conditions
from rans.tasks import Task
from rans.tasks.derived import check_dimension

Guest = Controller | Maker
"""A controller that was made for the contest's setup, or a function that makes one for a setup."""

_OBSERVATION = "observation"
_MODEL = "state, exact model"
_NOTHING = "nothing: flown from a file"
_UNTUNED = "none: default settings"
_UNKNOWN = "not known"


Named = str | ContestantName
Invited = Named | LoadedRun | Guest
"""A contestant as `enlisted` takes it: by name, with its own setup, or for the contest's setup."""


def invitations(contestants: Sequence[object]) -> tuple[Named | LoadedRun, list[Invited]]:
    """The first contestant, and all of them in the forms that `enlisted` takes.

    Raises:
        ConfigError: there is none, the first one has no task, or one is neither a name nor a controller.
    """
    if not contestants:
        raise ConfigError("name at least one contestant, for example the folder of a run.")
    invited: list[Any] = [_invited(guest) for guest in contestants]
    for guest in invited:
        if not (
            isinstance(guest, Named | LoadedRun)
            or callable(guest)
            or hasattr(guest, "act")
            or hasattr(guest, "predict")
        ):
            raise ConfigError(
                "a contestant is a name, a run folder, a controller or a function that makes one of "
                f"spacecraft, task and timing, got {brief(guest)}."
            )
    if not isinstance(first := invited[0], Named | LoadedRun):
        raise ConfigError(
            "the first contestant gives task, spacecraft and rate, which a controller does not "
            f"have: name one before it, as in 'lqr:go-to-pose-2d', got {brief(first)}."
        )
    return first, invited


def _invited(entrant: object) -> object:
    """A path as text, and an agent as its name or its run."""
    if isinstance(entrant, PathLike):
        return str(entrant)
    run = run_of(entrant)
    if run is None or run.controller is entrant:  # a wrapper, which knows its setup
        return entrant
    return getattr(entrant, "spec", "") or run


def contest_of(
    who: Named | LoadedRun,
    episodes: int,
    seed: int = EVALUATION_SEED,
    engine: EngineName = "fast",
    conditions: Conditions | None = None,
    trust: bool = False,
    guard: bool = False,
    period: float | None = None,
) -> Contest:
    """Contest in the setup of its first contestant.

    Conditions replace those of the setup. With ``guard`` all contestants fly
    with the safety filter for spacecraft and task (`rans.safety_filters`). For the control
    period, s, see `rans.evaluation.fly.contestants.contestant`.

    Raises:
        ConfigError: the contestant has no task, or one for the other dimension only.
    """
    if episodes < 1:
        raise ConfigError(f"--episodes must be at least 1, got {episodes}.")
    if isinstance(who, LoadedRun):
        run = _single(who.controller.name, "", who).under(conditions)
    else:
        name = ContestantName.parse(who)
        loaded = contestant(name, trust=trust, period=period, conditions=conditions)
        run = _single(name.text, name.controller, loaded).under(conditions)
    craft, task, timing, world, guarded = run.guarded(guard).judged
    seed_words(seed)  # A wrong seed is reported once, and not for every contestant.
    check_dimension(task, craft.dimension)
    return Contest(craft, task, timing, seed, episodes, engine, world, guarded)


def _single(text: str, without_training: str, run: LoadedRun) -> LoadedRun:
    """Refuse (`ConfigError`) an agent with several tasks or with a trade-off that is not fixed.

    Args:
        text: of its name, for messages.
        without_training: name of its controller without training; empty: it is none.
        run: what flies.
    """
    if run.task.draws_trade_off:
        name = text.rstrip("#")
        raise ConfigError(f"{name} has a trade-off: fix it, as in {name}#0.5.")
    if first := next(iter(run.task.parts())):
        raise ConfigError(f"{text} has several tasks: pick one, as in {text}#{first}.")
    trade_off = run.task.held_trade_off
    if trade_off is None:
        return run
    # The task without one, for agents that do not observe it.
    plain = run.task.plain()
    flown: Controller = FixedTradeOff(run.controller, trade_off)
    if without_training:
        flown = controller(without_training, Setup(run.craft, plain, run.timing), trade_off)
    return run._replace(controller=flown, task=plain)


def enlisted(
    specs: Sequence[Invited],
    contest: Contest,
    trust: bool = False,
    period: float | None = None,
) -> dict[str, Contestant]:
    """Contestants by their texts, before any flight; see `enlist`.

    A contestant with the name of an earlier one is called by its text, a guest by its name and position.

    Raises:
        ConfigError: contestants are wrong; the message names all of them.
    """
    result: dict[str, Contestant] = {}
    wrong: list[str] = []
    for position, spec in enumerate(specs, 1):
        if isinstance(spec, Named) and str(spec) in result:
            continue
        try:
            if isinstance(spec, Named):
                entrant = enlist(spec, contest, trust, period)
            elif isinstance(spec, LoadedRun):
                entrant = _with_setup(spec, contest)
            else:
                entrant = _guest(spec, contest)
        except RansError as error:
            wrong.append(str(error))
            continue
        text = str(spec) if isinstance(spec, Named) else f"{entrant.name} ({position})"
        taken = [earlier.name for earlier in result.values()]
        result[text] = replace(entrant, name=text) if entrant.name in taken else entrant
    if wrong:
        raise ConfigError(" ".join(dict.fromkeys(wrong)))
    return result


def _with_setup(run: LoadedRun, contest: Contest) -> Contestant:
    """A contestant from an object with its own setup, which must be the contest's."""
    name = run.controller.name
    _check_same(name, run, contest)
    run = run.under(contest.conditions or Conditions())
    sees = _OBSERVATION if isinstance(run.controller, Agent | UserPolicy) else _MODEL
    return Contestant(name, run.controller, sees, _UNKNOWN)


def _guest(guest: Guest, contest: Contest) -> Contestant:
    """A user's controller as a contestant; its commands are checked, see `CheckedController`.

    Its class is made once for all starts, with the contest's own spacecraft, task and timing.
    """
    if hasattr(guest, "predict") and not hasattr(guest, "act"):  # A model of Stable-Baselines3
        policy = ObjectPolicy(guest, contest.craft, contest.task)
        return Contestant(policy.name, policy, _OBSERVATION, _UNKNOWN)
    makes = isinstance(guest, type) or not hasattr(guest, "act")
    who = getattr(guest, "__name__", type(guest).__name__)
    guest_controller = CheckedController(
        who, contest.setup, cast(Maker, guest) if makes else lambda *_: cast(Controller, guest)
    )
    return Contestant(guest_controller.name, guest_controller, _MODEL, _UNKNOWN)


_VALUES = 0.4, 0.0, 0.3, 0.5, 1.0
"""Values from fast to frugal at which the agent for any craft flies the file of a user's spacecraft."""


def at_values(invited: Invited) -> Sequence[Invited]:
    """The agent for any craft at several values where a name is a spacecraft's file alone; others as they are."""
    if not isinstance(invited, Named):
        return [invited]
    name = ContestantName.parse(invited)
    if not name.in_full or name.frugality is not None:
        return [name]
    return [name.at(value) for value in _VALUES]


def enlist(
    who: Named, contest: Contest, trust: bool = False, period: float | None = None
) -> Contestant:
    """Make a contestant by name.

    For ``trust`` see `rans.evaluation.fly.contestants.contestant`. A policy of another library flies at the
    ``period``, s, that the user asks for; None: at that of its name, which must be the contest's.

    Raises:
        ConfigError: there is none of this name, or it is for another task, craft or control rate.
    """
    named = ContestantName.parse(who)
    # Whoever can act at another rate acts at the contest's.
    is_free = named.kind == "controller" or bool(named.craft)
    if is_free:
        period = contest.timing.control_period
    elif named.kind != "policy":
        period = None
    run = contestant(
        named,
        default_setup=contest.setup,
        trust=trust,
        period=period,
        conditions=contest.conditions,
    )
    run = _single(named.text, named.controller, run)
    _check_same(named.text, run, contest)
    run = run.under(contest.conditions or Conditions())
    if named.kind == "flights":
        run.controller.reset(contest.episodes)  # refuses a file without so many
        return Contestant(run.controller.name, run.controller, _NOTHING, _UNKNOWN)
    effort = _budget(named.controller, contest) if named.controller else _tuning(named)
    # An agent for any craft is given mass, inertia and thrusters of the craft that it flies.
    is_given_all = named.controller or named.is_for_a_craft
    sees = _MODEL if is_given_all else _OBSERVATION
    return Contestant(
        run.controller.name, run.controller, sees, effort, registered=named.controller
    )


def _check_same(spec: str, run: LoadedRun, contest: Contest) -> None:
    """Refuse (`ConfigError`) a contestant for another task, craft or control period."""
    if type(run.task) is not type(contest.task):
        raise ConfigError(
            f"{spec} is for the task {type(run.task).__name__}, but the first contestant for "
            f"{type(contest.task).__name__}; compare them separately."
        )
    if run.craft != contest.craft:
        raise ConfigError(
            f"{spec} is for the spacecraft {run.craft.name}, but the first contestant for "
            f"{contest.craft.name}, or for other values of it; end a controller's name with @ and that one, or "
            "compare them separately."
        )
    periods = run.timing.control_period, contest.timing.control_period
    if periods[0] != periods[1]:
        raise ConfigError(
            f"{spec} acts every {periods[0]:g} s, but the first contestant every "
            f"{periods[1]:g} s; compare them separately."
        )


def _tuning(name: ContestantName) -> str:
    """Effort of the training of an agent or a policy, from its files."""
    training = {} if name.kind == "policy" else RunFolder(name.own_folder).training()
    if not training:
        return _UNKNOWN
    device = "a GPU" if training["device"].startswith("cuda") else "a CPU"
    # Agents of any craft are trained by gradients through the flights, which nobody counts as steps.
    steps = f"{training['steps'] / 1e6:,.1f} M steps, " if training["steps"] else ""
    return f"training: {steps}{training['seconds']:.3g} s on {device}"


def _budget(name: str, contest: Contest) -> str:
    """Effort of the tuning of a controller."""
    result = tuned(name, contest.setup)
    return result.budget() if result else _UNTUNED


def ready_opponents(task: Task, names: Sequence[str] | None) -> list[str]:
    """Opponents whose modules are installed; a warning names those of `default_opponents` that are left out.

    Args:
        task: what is flown.
        names: of controllers, and "optimal", that the user asks for; None: those of `default_opponents`.

    Raises:
        MissingPackage: one that the user asks for needs a module that is not installed.
    """
    if names is not None:
        for module in dict.fromkeys(m for name in names for m in MODULES.get(name, ())):
            require(module)
        return [*names]
    opponents = default_opponents(task)
    lacking = {
        name: [m for m in MODULES.get(name, ()) if not is_installed(m)] for name in opponents
    }
    if absent := {m: EXTRAS[m] for modules in lacking.values() for m in modules}:
        left_out = [name.replace("mpc", "MPC") for name in opponents if lacking[name]]
        who = " and ".join(left_out).replace("optimal", "certified bounds")
        warnings.warn(
            f"{who} are left out, without {' and '.join(absent)}: "
            f"{' and '.join(installing(extra) for extra in dict.fromkeys(absent.values()))}",
            RansWarning,
            stacklevel=2,
        )
    return [name for name in opponents if not lacking[name]]


def simple_controller(name: str, contest: Contest) -> Contestant:
    """Contestant with a controller of `CONTROLLERS`; see `controller`.

    Raises:
        ConfigError: the controller cannot fly this craft.
    """
    model_controller = controller(name, contest.setup)
    return Contestant(model_controller.name, model_controller, _MODEL, _budget(name, contest))
