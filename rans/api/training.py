"""Training of agents, and tuning of controllers.

Commands and Python share these functions, so that a config made by either is equal (`tests/api/test_training.py`).
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import shlex
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from rans.api.agent import Agent
from rans.api.judging import CRAFT, ConditionsLike, SpacecraftLike
from rans.api.names import load_conditions, load_spacecraft, load_task
from rans.base.choices import Quality
from rans.base.errors import ConfigError, checked, whole
from rans.base.files import inside, made_by, ready_folder
from rans.base.registry import typed
from rans.base.settled import settled_alone
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import USUAL, load_spacecraft as stored_spacecraft, to_toml
from rans.model.timing import Timing
from rans.randomization.conditions_file import conditions_label
from rans.tasks import Task, registered_name

if TYPE_CHECKING:
    from rans.evaluation.fly.tuned import Tuned
    from rans.fast.learn.config import PPOSettings, TrainConfig
    from rans.fast.learn.trainer import Trainer


@settled_alone
def train(
    task: str | Task = "go-to-pose",
    spacecraft: SpacecraftLike | None = None,
    *,
    conditions: ConditionsLike | None = None,
    quality: Quality | None = None,
    total_timesteps: int | None = None,
    seed: int | None = None,
    device: str | None = None,
    output: str | Path | None = None,
    ppo: PPOSettings | None = None,
    algorithm: str | None = None,
    guard: bool = False,
    plain: bool = False,
    progress: bool | None = None,
    report: Callable[[dict[str, Any]], object] | None = None,
    **settings: Any,
) -> Agent:
    """Train an agent until it has solved its task, and return it.

    On a CPU it sets torch to one thread for the whole process.

    >>> folder = tempfile.mkdtemp()
    >>> agent = rans.train("go-to-pose", "floating-platform-shared", total_timesteps=8192,
    ...                    learning_rate=2e-3, output=f"{folder}/mine")
    >>> agent
    <mine: GoToPose for floating-platform-shared>

    Args:
        task: task to learn (see `rans list TASKS`); the name of an agent that comes with RANS, such as
            go-to-pose-2d, to repeat its whole training; a recipe of your own, a .toml file (docs/training.md); or
            the config.json of another run.
        spacecraft: name of a spacecraft that comes with RANS, or your own TOML file; by default that of the task or
            of the recipe, or floating-platform.
        conditions: domain randomization, disturbances, faults and sensors: a name (see `rans list CONDITIONS`), or
            your own TOML file; by default everything is nominal, or as in the recipe.
        quality: length of the training: quick (the default; seconds, until the task is solved), good (minutes on
            two cores; less impulse and smaller errors) or best (a GPU, or hours); also for your own spacecraft and
            conditions.
        total_timesteps: environment steps after which training ends, such as 5e6, solved or not; by default the
            preset's.
        seed: random seed; on a CPU the same seed gives the same agent, bit for bit. By default 0.
        device: device to train on: cpu or cuda; by default a GPU if there is one.
        ppo: settings of PPO; by default the preset's.
        algorithm: learner: ppo, or one of an installed package (docs/learners.md); by default PPO, or the recipe's.
        guard: whether the agent learns behind the safety filter for its spacecraft and task
            (docs/missions/guard.md), on a CPU.
        plain: whether to run a task's code without compiling it, so that a breakpoint in it stops; many times
            slower.
        output: folder for the run; by default a new one under runs/.
        progress: whether to show progress; by default on a terminal and in a notebook.
        report: function that is called with every row of metrics, such as ``print``.
        **settings: any other entry of the config by its name, such as ``learning_rate=1e-3`` or
            ``thrust_weight=0.05``; where a name stands for several, use the dotted name, as in
            ``**{"ppo.gamma": 0.99}``.

    Raises:
        ConfigError: one of these does not exist, or they are not compatible.
        NonFiniteState: a value became NaN or infinite.
    """
    from rans.evaluation.fly.agent import load_policy
    from rans.show.progress import watched_training

    # The config decides everything; all of it is checked before the run folder is made.
    config = config_of(
        task,
        spacecraft,
        device,
        conditions,
        quality,
        algorithm,
        ppo,
        settings,
        seed=seed,
        total_timesteps=total_timesteps,
    )
    config = replace(config, guard=guard or config.guard, plain=plain or config.plain)
    craft = (
        stored_spacecraft(config.spacecraft) if spacecraft is None else load_spacecraft(spacecraft)
    )
    config = as_it_comes(
        config, craft, task, quality, settings, total_timesteps, conditions, ppo, algorithm
    )
    trainer = ready_trainer(config, craft, output, is_own=isinstance(spacecraft, Spacecraft))
    with watched_training(config.total_timesteps, progress) as show:
        shows = [show] if report is None else [show, report]
        # Of torchrun's processes the others only train.
        shows = shows if trainer.processes.is_first else []
        trainer.train(lambda row: [each(row) for each in shows])
    return Agent(load_policy(trainer.run.path), str(trainer.run.path))


def ready_trainer(
    config: TrainConfig, craft: Spacecraft, output: str | Path | None, is_own: bool = False
) -> Trainer:
    """Trainer that is ready to train, whose run folder has been made.

    Args:
        config: config of the training.
        craft: its spacecraft.
        output: the run folder; None: a new one.
        is_own: whether the craft is an object without a name, whose file the run folder has.

    Raises:
        ConfigError: the folder has another training.
    """
    from rans.evaluation.fly.make_controller import guard_of
    from rans.fast.distributed import join
    from rans.fast.learn.run_folder import RunFolder, run_path
    from rans.fast.learn.trainer import Trainer

    world = join(config.device)
    folder = Path()
    if world.is_first:
        folder = run_path(config) if output is None else ready_folder(output)
    folder = world.from_first(folder)
    try:
        if is_own:
            config = replace(config, spacecraft=str(folder / "spacecraft.toml"))
        run_folder = RunFolder(folder)
        trainer = Trainer(config, craft, run_folder, world, guard=guard_of(config, craft))
        if world.is_first:
            run_folder.begin(config, made_by("rans.train"), to_toml(craft) if is_own else "")
        return trainer
    except BaseException:
        if (
            output is None and world.is_first
        ):  # its folder was made, so that no other training takes the name
            with contextlib.suppress(OSError):
                folder.rmdir()
                folder.parent.rmdir()
        raise


@settled_alone
def tune(
    controller: str,
    task: str | Task = "go-to-pose",
    spacecraft: SpacecraftLike = CRAFT,
    *,
    candidates: int = 300,
    starts: int = 256,
    price: float = 0.01,
    seconds: float = math.inf,
    conditions: ConditionsLike | None = None,
    output: str | Path | None = None,
) -> Tuned:
    """Search the settings of a controller by random sampling, first anywhere, then near the best.

    >>> folder = tempfile.mkdtemp()
    >>> found = rans.tune("lqr", candidates=2, starts=4, output=f"{folder}/lqr.json")
    >>> found.costs["tuned"] <= found.costs["default"]
    True

    Args:
        controller: name of the controller (see `rans list`), or MODULE:NAME.
        task: task to tune it for: a name or a `Task`.
        spacecraft: a name, a TOML file or a `Spacecraft`.
        candidates: number of settings to try, the default ones included.
        starts: number of flights of each candidate, of a seed that no evaluation uses.
        price: price of impulse, s per N s: the cost of a candidate is the mean of settling time and time of first
            rest, plus the impulse of the episode times this price.
        seconds: processor time after which no further candidate is flown; use the same for every controller to
            give all an equal budget.
        conditions: conditions to tune in: a name (see `rans list CONDITIONS`) or your own TOML file; by default
            none.
        output: file to write the settings to (.json); None: under runs/controllers, where every command looks
            for them, unless the ones there were found on more starts or cost less.

    Raises:
        ConfigError: the controller has nothing to tune, or a number is out of its range.
    """
    from rans.policy.timing import timing_of_file

    craft = load_spacecraft(spacecraft)
    base = load_task(task)
    named = "" if isinstance(spacecraft, Spacecraft) else str(spacecraft)
    timing = timing_of_file(craft, base, named)  # at which every contestant flies it
    numbers = whole("candidates", candidates), whole("starts", starts), price, seconds
    return searched(controller, base, craft, timing, conditions, numbers, output).result


class Search(NamedTuple):
    """Settings that a search found."""

    result: Tuned
    file: Path
    staying: Tuned | None
    """Settings in use that are better founded, so that the file was not written; None: it was."""


def searched(
    controller: str,
    task: Task,
    craft: Spacecraft,
    timing: Timing,
    conditions: ConditionsLike | None,
    numbers: tuple[int, int, float, float],
    output: str | Path | None = None,
) -> Search:
    """Search settings with these candidates, starts, price and seconds, and write them; see `tune`."""
    from rans.episode.step import Setup
    from rans.evaluation.compare.tuning import ranges, tuned_settings
    from rans.evaluation.fly.tuned import OWN, file_name, tuned
    from rans.show.progress import watched

    ranges(typed(controller))
    world = None if conditions is None else load_conditions(conditions, craft).or_none
    label = ""
    if world is not None:
        name = conditions if isinstance(conditions, str) else "own.toml"
        label = conditions_label(name, world)
    setup = Setup(craft, task.for_evaluation(), timing, world)
    file = Path(output) if output is not None else OWN / file_name(controller, craft, task, label)
    ready_folder(file.parent)
    in_use = None if output is not None else tuned(controller, setup)  # refuses a damaged file
    candidates, starts, price, seconds = numbers
    with watched() as stage:
        step = stage(f"tuning {controller}", candidates)
        result = tuned_settings(
            controller, setup, candidates, starts, price, made_by("rans.tune"), step, seconds
        )
    staying = in_use if in_use and in_use.outlasts(result) else None
    if staying is None:
        result.write(file)
    return Search(result, file, staying)


def config_of(
    task: str | Task,
    spacecraft: SpacecraftLike | None = None,
    device: str | None = None,
    conditions: ConditionsLike | None = None,
    quality: Quality | None = None,
    algorithm: str | None = None,
    ppo: PPOSettings | None = None,
    changes: Mapping[str, Any] = MappingProxyType({}),
    **numbers: int | None,
) -> TrainConfig:
    """Config of a training by the arguments of `train`, or of another run by its config.json.

    ``changes`` are other entries by their names or dotted names, ``numbers`` seed and total_timesteps.

    Raises:
        ConfigError: one of these does not exist, or they are not compatible.
    """
    from rans.fast.learn.algorithms import with_algorithm
    from rans.fast.learn.config import (
        change_entry,
        from_table,
        to_table,
        training,
        training_of_quality,
    )
    from rans.fast.learn.learners import LEARNERS
    from rans.fast.learn.run_folder import read_config

    craft = None if spacecraft is None else load_spacecraft(spacecraft)
    named: str | None = None
    if isinstance(spacecraft, str | Path):
        named = str(spacecraft)
    elif craft is not None:  # its own file is written with the run folder
        named = USUAL[craft.dimension]
    file = Path(task) if isinstance(task, str) and task.endswith(".json") else None
    if file is not None:
        if quality is not None:
            raise ConfigError(f"{file} says how long to train: leave out --quality.")
        begun = read_config(file)
    elif quality is None:
        begun = training(_name(task), named, device)
    else:
        begun = training_of_quality(
            _name(task), named, quality, device, conditions is not None, algorithm
        )
    # First, as an algorithm has settings and hyper-parameters of its own, which others change.
    if algorithm is not None:
        begun = with_algorithm(begun, typed(algorithm))
    settings: Any = begun.settings
    if isinstance(task, Task):
        # The best agent of a task may be one for all of its trade-offs.
        same = type(task) is type(settings)
        settings = task if same else replace(settings, **vars(task))
    options: dict[str, Any] = {
        **numbers,
        "spacecraft": named,
        "device": device,
        "settings": settings,
        "ppo": None if ppo is None else checked("ppo", ppo, type(begun.ppo)),
        "conditions": None if conditions is None else load_conditions(conditions),
    }
    config = replace(begun, **{key: value for key, value in options.items() if value is not None})
    if changes:
        table = json.loads(json.dumps(to_table(config)))
        for name, value in changes.items():
            change_entry(table, name, value)
        config = from_table(table)
    # How long an algorithm trains follows from its own settings too, unless the user or a file says so.
    length = LEARNERS[begun.algorithm].started
    asked = {**numbers, **changes}.get("total_timesteps")
    if asked is None and begun.total_timesteps == length(begun).total_timesteps:
        total = length(replace(begun, learner=config.learner)).total_timesteps
        config = replace(config, total_timesteps=total)
    if file is not None and spacecraft is None and config.spacecraft == begun.spacecraft:
        _check_unchanged(config.spacecraft, file)
    return config


def as_it_comes(
    config: TrainConfig,
    craft: Spacecraft,
    task: str | Task | None,
    quality: Quality | None,
    *otherwise: object,
) -> TrainConfig:
    """The config, beginning from the agent for any craft if it is short and nothing was set otherwise."""
    is_named = task == config.task and ":" not in config.task  # no recipe, and no task of one's own
    is_short = quality in (None, "quick") and is_named
    is_alone = os.environ.get("WORLD_SIZE", "1") == "1"
    return from_any_craft(config, craft) if is_short and is_alone and not any(otherwise) else config


def from_any_craft(config: TrainConfig, craft: Spacecraft) -> TrainConfig:
    """The config of a short training that begins from the agent for any craft, if that flies its task and craft.

    It imitates the agent at the value that flights of the craft choose, and ends as soon as it solves the task. By
    reinforcement learning alone the agent of the same seconds spends 1.8 to 2.5 times the thrust
    (docs/decisions/learning.md). In space, under conditions, for other tasks and where the agent loses flights the
    config is as it was.
    """
    from rans.base.pretrained import FOR_ANY_CRAFT, pretrained_folder
    from rans.evaluation.fly.agent import load_policy
    from rans.evaluation.fly.choice import VALUES, chosen
    from rans.policy.timing import flies_to_a_pose

    plain = config.conditions.or_none is None and not config.guard and not config.plain
    if craft.dimension != 2 or not plain or not flies_to_a_pose(config.settings, craft):
        return config
    agent = FOR_ANY_CRAFT[2]
    try:
        choice = chosen(load_policy(pretrained_folder(agent)), craft, config.timing.control_period)
    except ConfigError:
        return config
    if not choice.is_enough:
        return config
    ppo = replace(config.ppo, n_envs=_IMITATING_ENVS, n_steps=_IMITATING_STEPS)
    if craft.thrust_sharing == "split" and not craft.is_continuous:
        # Valves that are chosen one by one take each other's thrust.
        ppo = replace(ppo, backbone="allocated")
    # Networks without allocation imitate the agent at this one value, or as it was trained.
    if ppo.backbone == "allocated" or choice.value == VALUES[0]:
        agent += f"#{choice.value:g}"
    return replace(config, ppo=ppo, begin_from=f"pretrained:{agent}")


_IMITATING_ENVS, _IMITATING_STEPS = 256, 32
"""Environments and steps of a rollout, as many transitions as the preset's in half of the processor time."""


def _check_unchanged(spacecraft: str, config: Path) -> None:
    """Reject a spacecraft that has changed since the run whose config names it."""
    flown = inside(config.parent, "spacecraft.toml")
    if not flown.exists():
        return
    then = f"--spacecraft {shlex.quote(str(flown))} uses that of the run"
    try:
        now = stored_spacecraft(spacecraft)
    except ConfigError as error:
        raise ConfigError(f"{error} {config} names it; {then}.") from error
    if now != stored_spacecraft(flown):
        raise ConfigError(
            f"{spacecraft} has changed since {config} was used: {then}, "
            f"--spacecraft {shlex.quote(spacecraft)} the present one."
        )


def _name(task: str | Task) -> str:
    """The name of a task's class, or of a recipe; `ConfigError` where it is neither a name nor a task."""
    if isinstance(task, str):
        return typed(task)
    task = load_task(task)
    kind = type(task)
    return registered_name(task) or typed(f"{kind.__module__}:{kind.__qualname__}")
