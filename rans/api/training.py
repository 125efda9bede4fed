"""Training: one agent, many side by side, and the settings of controllers that need none."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rans.api.agent import Agent
from rans.api.judging import CRAFT, ConditionsLike, SpacecraftLike
from rans.errors import ConfigError, checked, one_of, whole
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import USUAL, load_spacecraft, to_toml
from rans.randomization.conditions_file import conditions_label, load_conditions
from rans.tasks import Task, load_task, registered_name

if TYPE_CHECKING:
    from rans.evaluation.fly.tuned import Tuned
    from rans.fast.learn.config import Algorithm, PPOSettings, TrainConfig
    from rans.fast.learn.loggers import LoggerName
    from rans.fast.learn.recipes import Quality
    from rans.fast.learn.sweep import Sweep


def train(
    task: str | Task = "go-to-pose",
    spacecraft: SpacecraftLike | None = None,
    *,
    seed: int = 0,
    device: str | None = None,
    total_timesteps: int | None = None,
    conditions: ConditionsLike | None = None,
    ppo: PPOSettings | None = None,
    algorithm: Algorithm | None = None,
    quality: Quality | None = None,
    guard: bool = False,
    plain: bool = False,
    run: str | Path | None = None,
    log: Sequence[LoggerName] = (),
    progress: bool | None = None,
    report: Callable[[dict[str, Any]], object] | None = None,
    **settings: Any,
) -> Agent:
    """Train an agent until it has solved its task, as `rans train`; on a CPU with one of torch's threads.

    >>> folder = tempfile.mkdtemp()
    >>> agent = rans.train("go-to-pose", "floating-platform-shared", total_timesteps=8192,
    ...                    learning_rate=2e-3, run=f"{folder}/mine")
    >>> agent
    <mine: GoToPose for floating-platform-shared>

    Args:
        task: by name or with settings, or the name of an agent that comes with RANS, to train it as it was, or
            the TOML file of a recipe.
        spacecraft: what flies, by name, TOML file or as such; None: the floating platform, or the agent's.
        seed: of starts, goals, weights and actions.
        device: "cpu" or "cuda"; None: a GPU if there is one.
        total_timesteps: environment steps after which training ends, solved or not; None: as usual.
        conditions: domain randomization, disturbances, faults and sensors; None: everything nominal, or the
            agent's.
        ppo: settings of the training; None: those known to work.
        algorithm: "ppo"; "gradient": down the gradient of the return through the motion, for throttled
            thrusters; or "imitation" of an expert (docs/learners.md). None: PPO, or the agent's.
        quality: how long: "quick" (until it is solved), "good" (minutes on two cores) or "best" (a GPU, or
            long); also with your own spacecraft and conditions. None: quick, or a recipe's own length.
        guard: whether the agent learns behind the safety filter for its spacecraft and task
            (docs/missions/guard.md), on a CPU.
        plain: whether everything is computed as it is written, so that a breakpoint in a task stops.
        run: a new folder for what it leaves; None: one under runs/.
        log: loggers that rows of metrics also go to: "hparams", "wandb" or "mlflow".
        progress: whether to show a line of progress; None: on a terminal and in a notebook.
        report: called with every row of metrics, such as ``print``.
        **settings: any other entry of the config by its name, such as ``learning_rate=1e-3`` or
            ``thrust_weight=0.05``; where a name stands for several, by the dotted one, as in
            ``**{"ppo.gamma": 0.99}``.

    Raises:
        ConfigError: one of these does not exist, or they do not go together.
        NonFiniteState: a value became NaN or infinite.
    """
    from rans.evaluation.fly.agent import load_agent as trained
    from rans.evaluation.fly.controllers import expert_of, guard_of
    from rans.fast.learn.loggers import check, loggers
    from rans.fast.learn.run_folder import RunFolder, run_path
    from rans.fast.learn.trainer import Trainer
    from rans.show.progress import watched_training

    config = _config(
        task,
        spacecraft,
        device,
        ppo,
        conditions,
        algorithm,
        quality,
        seed=seed,
        total_timesteps=total_timesteps,
    )
    config = replace(config, guard=guard or config.guard, plain=plain or config.plain)
    config = changed(config, settings)
    check_loggers(log)
    check(log)
    craft = load_spacecraft(config.spacecraft if spacecraft is None else spacecraft)
    folder = Path(run) if run is not None else run_path(config)
    if isinstance(spacecraft, Spacecraft):
        config = replace(config, spacecraft=str(folder / "spacecraft.toml"))
    kept = RunFolder(folder)
    trainer = Trainer(
        [config], craft, kept, expert=expert_of(config, craft), guard=guard_of(config, craft)
    )
    kept.begin(config, "rans.train", to_toml(craft) if isinstance(spacecraft, Spacecraft) else "")
    others = loggers(log, config, folder)
    with watched_training(config.total_timesteps, progress) as show:

        def tell(members: Sequence[Any]) -> None:
            row = members[0].rows[-1]
            show(row)
            for other in others:
                other.write(row)
            if report:
                report(row)

        trainer.train(tell)
    for other in others:
        other.close()
    return Agent(trained(folder), str(folder))


def changed(config: TrainConfig, settings: Mapping[str, Any]) -> TrainConfig:
    """The config with other values of some entries, by their names or dotted names.

    Raises:
        ConfigError: there is no such entry, several are called so, or its value is of another type.
    """
    from rans.fast.learn.changes import change_entry
    from rans.fast.learn.config import from_table, to_table

    if not settings:
        return config
    table = json.loads(json.dumps(to_table(config)))
    for name, value in settings.items():
        change_entry(table, name, value)
    return from_table(table)


def check_loggers(names: Sequence[str]) -> None:
    """Refuse (`ConfigError`) what is no sequence of names of loggers."""
    if isinstance(names, str):
        raise ConfigError(f'log takes several names, as in log=["{names}"], got {names!r}.')
    for name in names:
        one_of("log", name, ("hparams", "wandb", "mlflow"))


def sweep(
    task: str | Task = "go-to-pose",
    spacecraft: SpacecraftLike | None = None,
    *,
    seeds: int = 8,
    device: str | None = None,
    total_timesteps: int | None = None,
    conditions: ConditionsLike | None = None,
    algorithm: Algorithm | None = None,
    log: Sequence[LoggerName] = (),
    output: str | Path | None = None,
    **settings: Any,
) -> Sweep:
    """Train many agents as one batch: every seed with every combination of settings, as `rans sweep`.

    >>> folder = tempfile.mkdtemp()
    >>> found = rans.sweep("go-to-pose", seeds=1, total_timesteps=8192, learning_rate=[1e-3, 2e-3],
    ...                    output=f"{folder}/sweep")
    >>> [row["ppo.learning_rate"] for row in found.results()]
    [0.001, 0.002]
    >>> rans.load_agent(f"{folder}/sweep/best")
    <best: GoToPose for floating-platform>

    Args:
        task: see `train`.
        spacecraft: see `train`.
        seeds: number of seeds, from 0 on.
        device: see `train`.
        total_timesteps: environment steps of each member after which it ends, solved or not.
        conditions: see `train`.
        algorithm: see `train`.
        log: loggers that the rows of the best agent go to when all are trained, see `train`.
        output: a new folder for the results; None: one under runs/.
        **settings: entries of the config by name; a list has the values to combine.

    Raises:
        ConfigError: one of these does not exist, or the folder exists.
    """
    from rans.fast.learn.loggers import check
    from rans.fast.learn.run_folder import unused_path
    from rans.fast.learn.sweep import Sweep
    from rans.show.progress import watched
    from rans.show.sweep_files import save_sweep

    check_loggers(log)
    check(log)
    base = _config(
        task, spacecraft, device, None, conditions, algorithm, None, total_timesteps=total_timesteps
    )
    if isinstance(spacecraft, Spacecraft):
        raise ConfigError(
            "members of a sweep name their spacecraft: write it to a TOML file, and give its name."
        )
    choices = [value if isinstance(value, list) else [value] for value in settings.values()]
    configs = [
        replace(changed(base, dict(zip(settings, combination, strict=True))), seed=seed)
        for combination in itertools.product(*choices)
        for seed in range(whole("seeds", seeds))
    ]
    named = unused_path(f"sweep-{base.task}-{Path(base.spacecraft).stem}")
    folder = named if output is None else Path(output)
    if folder.exists():
        raise ConfigError(f"{folder} exists already; choose another folder.")
    found = Sweep(configs, folder, "rans.sweep")
    with watched() as stage:
        step = stage(f"{len(configs)} trainings", None)
        found.train(lambda _: step(1))
    save_sweep(found, folder, log)
    return found


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
    """Search the settings of a controller that needs no training: at random, then near the best.

    >>> folder = tempfile.mkdtemp()
    >>> found = rans.tune("lqr", candidates=2, starts=4, output=f"{folder}/lqr.json")
    >>> found.costs["tuned"] <= found.costs["default"]
    True

    Args:
        controller: its name, or MODULE:NAME.
        task: what to tune it for, by name or with settings.
        spacecraft: what flies, by name, TOML file or as such.
        candidates: settings to fly, the default ones included.
        starts: starts of each, of a seed that no report uses.
        price: of thrust, s per N s: the cost is the mean of settling time and time to rest in the goal set,
            and the impulse at this price.
        seconds: processor time after which no further candidate is flown: the same for every controller is an
            equal budget.
        conditions: domain randomization, disturbances, faults and sensors to tune in; None: none.
        output: file to write the settings to (.json); None: under runs/controllers, where every command looks
            for them, unless the ones there were found on more starts or cost less.

    Raises:
        ConfigError: the controller has nothing to tune, or a number is out of its range.
    """
    from rans.episode import Setup
    from rans.evaluation.compare.tuning import ranges
    from rans.evaluation.compare.tuning import tune as search
    from rans.evaluation.fly.tuned import OWN, file_name, tuned
    from rans.files import ready_folder
    from rans.show.progress import watched

    ranges(controller)
    craft = load_spacecraft(spacecraft)
    wanted = load_task(task)
    drawn = None if conditions is None else load_conditions(conditions).or_none
    label = ""
    if drawn is not None:
        name = conditions if isinstance(conditions, str) else "own.toml"
        label = conditions_label(name, drawn)
    setup = Setup(craft, wanted.for_evaluation(), wanted.timing, drawn)
    file = Path(output) if output is not None else OWN / file_name(controller, craft, wanted, label)
    ready_folder(file.parent)
    known = None if output is not None else tuned(controller, setup)
    count = whole("candidates", candidates)
    with watched() as stage:
        step = stage(f"tuning {controller}", count)
        found = search(
            controller, setup, count, whole("starts", starts), price, "rans.tune", step, seconds
        )
    if known is None or not known.outlasts(found):
        found.write(file)
    return found


def _config(
    task: str | Task,
    spacecraft: SpacecraftLike | None,
    device: str | None,
    ppo: PPOSettings | None,
    conditions: ConditionsLike | None,
    algorithm: Algorithm | None,
    quality: Quality | None,
    **numbers: int | None,
) -> TrainConfig:
    """The training of a name, with what was given in the place of what it has."""
    from rans.fast.learn.recipes import by_gradient, training, training_of_quality

    craft = None if spacecraft is None else load_spacecraft(spacecraft)
    named: str | None = None
    if isinstance(spacecraft, str | Path):
        named = str(spacecraft)
    elif craft is not None:  # its own file is written with the run folder
        named = USUAL[craft.dimension]
    if quality is None:
        config = training(_name(task), named, device)
    else:
        config = training_of_quality(_name(task), named, quality, device, conditions is not None)
    if algorithm == "gradient":
        config = by_gradient(config)
    given: dict[str, Any] = {
        **numbers,
        "algorithm": algorithm,
        "spacecraft": named,
        "settings": task if isinstance(task, Task) else None,
        "ppo": None if ppo is None else checked("ppo", ppo, type(config.ppo)),
        "conditions": None if conditions is None else load_conditions(conditions),
    }
    return replace(config, **{key: value for key, value in given.items() if value is not None})


def _name(task: str | Task) -> str:
    """The name of a task's class, or of a recipe; `ConfigError` where it is neither a name nor a task."""
    if isinstance(task, str):
        return task
    task = load_task(task)
    kind = type(task)
    return registered_name(task) or f"{kind.__module__}:{kind.__qualname__}"
