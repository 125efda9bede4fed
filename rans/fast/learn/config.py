"""Configuration of a training as one value: settings, recipes that are known to work, and changes by name.

Run folders hold a config as a table, converted to and from JSON; old files must stay readable, so a new entry needs
a default.

A recipe is a config in TOML (``rans/data/recipes``) with three more keys. ``base`` names a recipe that supplies
missing values; ``conditions`` is a name (see `load_conditions`); ``[gpu]`` overrides values on a GPU. Its
``step_factor`` multiplies ``total_timesteps`` and the ``begin`` and ``duration`` of the curriculum unless ``[gpu]``
sets them. docs/decisions/learning.md says how the values of the presets were chosen.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

from rans.base.choices import Quality
from rans.base.display import Settings
from rans.base.errors import ConfigError, brief, fits, meant, meant_file, one_of, whole
from rans.base.files import read_text
from rans.base.pretrained import RECIPE_FOLDER, agent_recipes
from rans.base.registry import typed
from rans.base.structure import LARGEST_TOML, merged, read_toml, refuse_other_file, structure
from rans.fast.device import torch_device
from rans.fast.learn.curriculum import Ramp, check_ramps
from rans.fast.learn.learners import LEARNERS, own_settings
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import USUAL, load_spacecraft
from rans.model.timing import Timing
from rans.policy.backbone_registry import BACKBONES
from rans.randomization.conditions import Conditions
from rans.randomization.conditions_file import load_conditions
from rans.tasks import TASKS, Task

Precision = Literal["float32", "tf32", "bf16"]
"""Precision of a GPU's matrix products: 24, 11 or, in hidden layers, 8 significant bits (docs/speed.md)."""

Head = Literal["auto", "gated"]

MOST_LAYERS = 32
MOST_UNITS = 65_536
"""Largest number of hidden layers, and of units in a layer, far above those of any agent."""


def require_bounds(config: object, bound: str, holds: Callable[[Any], bool], *names: str) -> None:
    """Refuse settings that are out of a bound.

    Args:
        config: dataclass of settings.
        bound: the bound in words, for the message.
        holds: whether a value is within it.
        names: names of the settings.

    Raises:
        ConfigError: a value is out of the bound.
    """
    for name in names:
        if not fits(value := getattr(config, name), holds):
            printed = list(value) if isinstance(value, tuple) else value
            raise ConfigError(f"{name} must be {bound}, got {brief(printed)}.")


@dataclass(frozen=True)
class MemorySettings(Settings):
    """Memory of a network; by default there is none.

    Raises:
        ConfigError: a value is out of its range.
    """

    history: int = 0
    """Number of last observations and commands in the memory; beside filters of commands alone, since the filters
    remember what was observed."""
    averages: tuple[float, ...] = ()
    """Exponential moving averages of all that a history would have, beside it or (with history 0) instead of it:
    the fraction of the average that remains at every step. They separate constant signals from noise and reach
    further back than a history. The average of commands that halves at every step has the last command as its first
    binary digit, the one before as its second."""

    def __post_init__(self) -> None:
        require_bounds(
            self, f">= 0 and <= {MOST_UNITS:,}", lambda x: 0 <= x <= MOST_UNITS, "history"
        )
        require_bounds(
            self,
            "numbers between 0 and 1",
            lambda x: isinstance(x, tuple | list) and all(0 < item < 1 for item in x),
            "averages",
        )

    @property
    def remembers(self) -> bool:
        """Whether there is a memory."""
        return bool(self.history or self.averages)


@dataclass(frozen=True)
class FilterSettings(Settings):
    """Kalman filters with the model of the spacecraft as designed, whose estimates a network observes.

    Each list has a number for every filter. By default there are none (docs/decisions/learning.md).

    Raises:
        ConfigError: a number is out of its range, or a list has another length.
    """

    drift: tuple[float, ...] = ()
    """Variance of the random walk of velocities in a control period, in units of the noise of their readings."""
    response: tuple[float, ...] = ()
    """Variance of the thrusters' deviation from their design that each filter estimates, immediate and one control
    period late, in units of the noise of readings over the velocity change of the strongest thruster in a period.
    Such a filter also estimates constant accelerations (`steady`). 0 or empty: the craft moves as designed."""

    steady: ClassVar[float] = 25.0
    """Variance of the constant accelerations, such as that of a sloping floor, in units of the noise of readings:
    up to five times that noise in a second. Every filter that ships has it."""

    gate: ClassVar[float] = 5.0
    """Gate of readings: the prediction of the filters is observed in place of readings that are missing or deviate
    by more than this, in units of the velocity change of all thrusters along one axis in a control period (for
    poses the same number in m and rad). Every agent that ships with filters was trained and judged with it
    (docs/decisions/learning.md)."""

    def __post_init__(self) -> None:
        within = lambda x: 1e-6 <= x <= 1e6  # noqa: E731
        require_bounds(
            self,
            "numbers >= 1e-6 and <= 1e6",
            lambda x: isinstance(x, tuple | list) and all(map(within, x)),
            "drift",
        )
        require_bounds(
            self,
            "numbers >= 1e-6 and <= 1e6, or 0",
            lambda x: isinstance(x, tuple | list) and all(item == 0 or within(item) for item in x),
            "response",
        )
        count = len(self.drift)
        if self.response and len(self.response) != count:
            raise ConfigError(
                f"response has {len(self.response)} numbers for {count} filters: give one for each."
            )


@dataclass(frozen=True)
class ScheduleSettings(Settings):
    """How the step size changes during a training.

    Raises:
        ConfigError: a value is out of its range.
    """

    max_learning_rate: float = 1e-2
    """Upper bound of the adapted step size."""
    anneal: float = 0.0
    """Final share of all steps over which the bound of the step size decreases to zero, for the precision of agents
    that are trained to the end."""

    desired_kl: ClassVar[float] = 0.016
    """Target KL divergence of an update, to which the step size adapts. All agents that ship have it, and half as
    much trains as well (docs/decisions/software.md)."""

    def __post_init__(self) -> None:
        require_bounds(self, "finite and > 0", lambda x: 0 < x < math.inf, "max_learning_rate")
        require_bounds(self, "between 0 and 1", lambda x: 0 <= x <= 1, "anneal")

    def left(self, remaining: float) -> float:
        """Factor of the bound, 1 to 0, where ``remaining`` of all steps is left, 1 to 0."""
        return min(1.0, remaining / max(self.anneal, 1e-9))


@dataclass(frozen=True)
class ExplorationSettings(Settings):
    """Distribution of the commands before the first update.

    Raises:
        ConfigError: a value is out of its range.
    """

    initial_duty: float = 0.5
    """Initial probability that a thruster is open. Agents that should rest with all valves shut learn it sooner
    with a low value."""
    log_std_init: float = 0.0
    """Initial logarithm of the standard deviation of throttled or pulsed commands, where a command of 1 is full
    thrust for a control period. Use -2 where that is a large part of the impulse of a flight."""

    def __post_init__(self) -> None:
        require_bounds(self, "between 0 and 1", lambda x: 0 < x < 1, "initial_duty")
        require_bounds(self, ">= -10 and <= 2", lambda x: -10 <= x <= 2, "log_std_init")


_NO_MEMORY = MemorySettings()
_NO_FILTERS = FilterSettings()
_SCHEDULE = ScheduleSettings()
_EXPLORATION = ExplorationSettings()


@dataclass(frozen=True)
class PPOSettings:
    """Hyper-parameters of PPO, by their names in SB3.

    Raises:
        ConfigError: a hyper-parameter is out of its range.
    """

    n_envs: int = 128
    """Number of environments."""
    n_steps: int = 64
    """Control periods per environment between updates."""
    batch_size: int = 2048
    """Transitions in a minibatch."""
    n_epochs: int = 4
    """Passes over the transitions in an update."""
    learning_rate: float = 1e-3
    """Initial step size."""
    schedule: ScheduleSettings = _SCHEDULE
    """How the step size changes during a training."""
    gamma: float = 0.98
    """Discount per control period."""
    gae_lambda: float = 0.95
    """Bias-variance trade-off of the advantages."""
    reward_scale: float = 0.1
    """Factor on every reward."""
    layers: tuple[int, ...] = (64, 64)
    """Units of the hidden layers, which actor and critic share."""
    backbone: str = "dense"
    """Network from features to commands: "dense" has a last layer; "allocated" demands a change of twist, after
    which on/off thrusters open together."""
    head: Head = "auto"
    """Distribution of the commands: "auto" is Bernoulli for on/off thrusters and Gaussian for others; "gated" first
    decides whether a throttled or pulsed thruster fires at all, so that 0 is exactly 0."""
    symmetric: bool = True
    """Whether the policy is equivariant under the symmetries of the spacecraft."""
    zoom: float = 0.0
    """Magnification of a second copy of all observed columns, for agents that keep the position within millimetres
    (docs/decisions/learning.md). 0: no copy, which learns coarse motion sooner."""
    matmul: Precision = "tf32"
    """Precision of matrix products on a GPU; a CPU always uses float32. With bf16 the gradients of most networks
    are one kernel (docs/decisions/engine.md)."""
    memory: MemorySettings = _NO_MEMORY
    """Memory of the network."""
    filters: FilterSettings = _NO_FILTERS
    """Kalman filters whose estimates are added to the input."""
    privileged_critic: bool = False
    """Whether the critic has layers of its own with privileged observations: all draws of the conditions, or
    without conditions the true mass properties of the spacecraft."""
    exploration: ExplorationSettings = _EXPLORATION
    """Distribution of the commands before the first update."""

    clip_range: ClassVar[float] = 0.2
    """Clipping range of the probability ratio (J. Schulman et al., "Proximal policy optimization algorithms",
    arXiv:1707.06347, table 3)."""
    vf_coef: ClassVar[float] = 0.5
    """Weight of the value loss, that of SB3."""
    max_grad_norm: ClassVar[float] = 1.0
    """Largest norm of a gradient, to which longer ones are scaled down; `reward_scale` sets their size."""
    activation: ClassVar[str] = "tanh"
    """Activation function of the hidden layers, with which all recipes train. Networks that were trained elsewhere
    may have others of `rans.policy.activations.ACTIVATIONS`."""

    def __post_init__(self) -> None:
        # Sizes of a rollout and of its batches.
        require_bounds(
            self, ">= 1 and < 2^31", lambda x: 1 <= x < 2**31, "n_envs", "n_steps", "n_epochs"
        )
        require_bounds(self, ">= 2 and < 2^31", lambda x: 2 <= x < 2**31, "batch_size")
        if self.n_envs > MOST_ENVS or self.n_envs * self.n_steps > MOST_TRANSITIONS:
            raise ConfigError(
                f"n_envs must be at most {MOST_ENVS:,}, and n_envs x n_steps at most {MOST_TRANSITIONS:,}, got "
                f"{self.n_envs:,} x {self.n_steps:,}: a rollout would need about "
                f"{self.n_envs * self.n_steps * 200e-9:,.0f} GB of memory."
            )
        # Numbers of the algorithm.
        require_bounds(
            self,
            "finite and > 0",
            lambda x: 0 < x < math.inf,
            "learning_rate",
            "reward_scale",
        )
        require_bounds(self, "finite and >= 0", lambda x: 0 <= x < math.inf, "zoom")
        require_bounds(self, "in (0, 1]", lambda x: 0 < x <= 1, "gamma", "gae_lambda")
        # The network: names first, then sizes, then what does not go together.
        for name, choices in (
            ("head", get_args(Head)),
            ("matmul", get_args(Precision)),
            ("backbone", BACKBONES),
        ):
            one_of(name, getattr(self, name), choices)
        require_bounds(
            self,
            f"1 to {MOST_LAYERS} numbers >= 1 and <= {MOST_UNITS:,}",
            lambda x: 1 <= len(x) <= MOST_LAYERS and 1 <= min(x) <= max(x) <= MOST_UNITS,
            "layers",
        )


MOST_ENVS = 2**24
"""Largest number of environments of a training."""
MOST_TRANSITIONS = 2**28
"""Largest number of transitions of a rollout: with about 200 bytes each they fill 54 GB."""


@dataclass(frozen=True)
class TrainConfig:
    """Configuration of one training; equal configurations give equal agents, bit for bit on a CPU.

    Raises:
        ConfigError: a value is out of its range.
    """

    task: str
    """Name of the task."""
    settings: Task
    """Settings of the task."""
    spacecraft: str
    """Name of a spacecraft, or a TOML file."""
    ppo: PPOSettings = field(default_factory=PPOSettings)
    """Hyper-parameters of the network and of PPO, of which other algorithms read their part."""
    timing: Timing = field(default_factory=Timing)
    """Timing of the episodes of evaluation and training."""
    episode_steps: int | None = None
    """Length of training episodes, control periods; null: that of ``timing``. Shorter episodes have more of the
    approach and less of the rest at the goal."""
    conditions: Conditions = field(default_factory=Conditions)
    """Domain randomization, disturbances, faults and sensors of the episodes; by default everything is nominal."""
    curriculum: tuple[Ramp, ...] = ()
    """Settings of the task that change during training, from an easier value to their own."""
    seed: int = 0
    """Seed of starts, goals, weights and actions."""
    device: str = "cpu"
    """Torch device."""
    compiled: bool | None = None
    """Whether torch's compiler compiles losses and their gradients by autograd on a GPU before training, or never;
    null: as soon as enough steps are left to pay for the time that it takes."""
    algorithm: str = "ppo"
    """Learning algorithm: "ppo", or the name of one that an installed package offers (docs/learners.md)."""
    learner: dict[str, Any] = field(default_factory=dict)
    """Further settings of an algorithm of another package, by their names there."""
    begin_from: str | None = None
    """Run folder, or pretrained:NAME, of an agent with the same network whose weights and input normalisation are
    the initial ones, or of an agent for any craft, which is imitated first; null: random weights."""
    guard: bool = False
    """Whether training and evaluation use the safety filter for the spacecraft and task (docs/missions/guard.md).
    On a GPU only together with plain."""
    plain: bool = False
    """Whether everything is computed by single operations of torch and gradients by autograd, without generated
    programs and kernels, so that breakpoints in a task work (docs/plain.md); many times slower."""
    threads: int = 1
    """Number of threads of torch on a CPU. One is as fast as two for small networks, whose work is machine code of
    one thread, and many times faster beside other programs; the last bits of the weights depend on it."""
    total_timesteps: int = 30_000_000
    """Environment steps after which training ends, solved or not."""
    report_interval: int = 16
    """Iterations between reports, each of which evaluates the agent on 1,024 episodes."""
    solved_share: float | None = 0.995
    """Share of episodes within the task's tolerances throughout the last fifth at which, in two successive reports,
    training ends. None: train for all steps."""

    def __post_init__(self) -> None:
        for name, least, bits in (
            ("seed", 0, 32),  # the range of NumPy's generator, which Stable-Baselines3 seeds too
            ("total_timesteps", 1, 63),
            ("report_interval", 1, 63),
        ):
            object.__setattr__(self, name, whole(name, getattr(self, name), least, bits))
        require_bounds(
            self, ">= 1 and < 2^31, or null", lambda x: x is None or 1 <= x < 2**31, "episode_steps"
        )
        require_bounds(self, ">= 1 and <= 1,024", lambda x: 1 <= x <= 1024, "threads")
        require_bounds(
            self, "in (0, 1], or null", lambda x: x is None or 0 < x <= 1, "solved_share"
        )
        if self.algorithm != "ppo" or self.learner:
            own = own_settings(self.algorithm, self.learner)
            object.__setattr__(self, "learner", dataclasses.asdict(own))
        if self.plain and self.compiled:
            raise ConfigError(
                "plain computes by single operations of torch, and compiled has torch's compiler make "
                "kernels: set one of them."
            )
        object.__setattr__(self, "curriculum", tuple(self.curriculum))
        if self.curriculum:
            check_ramps(self.settings, self.curriculum)


to_table = dataclasses.asdict
"""Plain JSON values of a config."""


def from_table(table: dict[str, Any], is_written: bool = False) -> TrainConfig:
    """Config from a table of `to_table`, which may have been changed; ``is_written`` as of `structure`.

    Raises:
        ConfigError: a key or value is wrong.
    """
    if not isinstance(table, dict) or not isinstance(table.get("task"), str):
        raise ConfigError(
            'a training must name its task: task = "go-to-pose" in a recipe, "task": "go-to-pose" in a '
            "config.json."
        )
    settings = structure(table.get("settings", {}), TASKS[table["task"]], "settings", is_written)
    if isinstance(ppo := table.get("ppo"), dict):
        table = table | {"ppo": without_kinds(ppo)}
    timing = table.get("timing", {})
    if isinstance(timing, dict):  # missing values are those of the task
        timing = dataclasses.asdict(settings.timing) | timing
    table = table | {"settings": settings, "timing": timing}
    return structure(table, TrainConfig, "config", is_written)


def without_kinds(ppo: dict[str, Any]) -> dict[str, Any]:
    """Hyper-parameters of a config as version 0.2 wrote it, with a kind of memory and variances of accelerations.

    Those that the present settings cannot say are left, so that they are refused.
    """
    parts = {name: ppo[name] for name in ("memory", "filters") if isinstance(ppo.get(name), dict)}
    memory, filters = parts.get("memory", {}), parts.get("filters", {})
    kinds = ("none", "commands" if filters.get("drift") else "history")
    kept = memory.get("kind") != "none"
    # A kind without a size would leave no memory.
    is_sized = "history" in memory or "averages" in memory
    if memory.get("kind") in kinds and (is_sized or not kept):
        parts["memory"] = {name: x for name, x in memory.items() if kept and name != "kind"}
    response = filters.get("response", [])
    if isinstance(response, list) and filters.get("steady") == [
        FilterSettings.steady * bool(x) for x in response
    ]:
        parts["filters"] = {name: x for name, x in filters.items() if name != "steady"}
    return ppo | parts


# Recipes and presets.

RECIPES: tuple[str, ...] = tuple(agent_recipes())
"""Names of the recipes, one per agent that comes with RANS.

Other files of the folder: ``base-NAME.toml`` (shared values), ``preset-NAME.toml``, and
``good-TASK-PLACE.toml`` (trainings of minutes for any spacecraft).
"""


def recipe(name: str, device: str) -> TrainConfig:
    """Training config of an agent that comes with RANS.

    On a GPU the network is larger and trains for many more steps, in less time than on a CPU core.

    Args:
        name: one of `RECIPES`.
        device: torch device to train on.
    """
    return _config(RECIPE_FOLDER / f"{name}.toml", device)


def check_task(name: str) -> None:
    """Raise ConfigError if there is neither a task nor a recipe of this name."""
    if name.endswith(".toml") or ":" in name or name in TASKS or name in RECIPES:
        return
    own = f" (did you mean {Path(name).stem}:CLASS, a class in that file?)"
    is_module = name.endswith(".py") or Path(f"{name}.py").is_file()
    near = own if is_module else meant(name, [*TASKS, *RECIPES]) or meant_file(name)
    raise ConfigError(
        f"there is no task and no recipe named {brief(name)}{near}; tasks are {', '.join(TASKS)}; recipes have the "
        "names of agents (`rans list AGENTS`), and your own is a file whose name ends in .toml."
    )


def training(task: str, spacecraft: str | None = None, device: str | None = None) -> TrainConfig:
    """Training config by name: a task with its defaults and known-good settings, or a recipe.

    Args:
        task: name in `TASKS` or `RECIPES`, MODULE:NAME of a task, or your own recipe file ending in .toml.
        spacecraft: name or TOML file; None: that of the task, or floating-platform. Recipes name theirs.
        device: cpu or cuda; None: a GPU if there is one.

    Raises:
        ConfigError: there is no such task, recipe or spacecraft, or the recipe's file is wrong.
    """
    from rans.policy.timing import timing_of_file

    device = device or torch_device()
    if task in RECIPES:
        return recipe(task, device)
    if task.endswith(".toml"):
        return _config(Path(task), device)
    check_task(task)
    settings = TASKS[task]()
    named: str = settings.spacecraft or USUAL[2] if spacecraft is None else spacecraft
    craft = load_spacecraft(named)
    return TrainConfig(
        task,
        settings,
        named,
        preset(task, craft.dimension, device),
        timing=timing_of_file(craft, settings, named),
        device=device,
    )


def training_of_quality(
    task: str,
    spacecraft: str | None,
    quality: Quality,
    device: str | None = None,
    randomized: bool = False,
    algorithm: str | None = None,
) -> TrainConfig:
    """Training config of a task with any spacecraft, with a length set by its quality.

    "quick" ends as soon as the task is solved. "good" and "best" train to the end of a recipe: the one for
    this task and dimension, otherwise the task's default settings with the hyper-parameters of long trainings;
    "best" by another algorithm than PPO if one says that it is better (`Algorithm.best` of `algorithms`).

    Args:
        task: name in `TASKS`, or MODULE:NAME of a task.
        spacecraft: name or TOML file; None: that of the task, or floating-platform.
        quality: training effort, see `Quality`.
        device: cpu or cuda; None: a GPU if there is one.
        randomized: whether conditions are used; agents then have a memory of their episode.
        algorithm: learner that the user has named; "best" then chooses none.

    Raises:
        ConfigError: there is no such task or spacecraft, or the name is a recipe, which sets its own length.
    """
    one_of("quality", quality, get_args(Quality))
    if task in RECIPES or task.endswith(".toml"):
        raise ConfigError(
            f"{brief(task)} is a recipe, which has its own length: leave out the quality, or name the task."
        )
    quick = training(task, spacecraft, device)
    if quality == "quick":
        return quick
    craft = craft_of(quick)
    if quality == "best" and algorithm is None and not randomized:
        for learner in LEARNERS.values():
            if (better := learner.best(quick, craft)) is not None:
                return better
    file = _recipe_file(task, craft.dimension, quality, randomized)
    result = _config(file, quick.device, task=task, spacecraft=quick.spacecraft)
    if quick.timing != quick.settings.timing:
        result = replace(result, timing=quick.timing)
    # Under conditions a network needs a memory, as base-adaptive has it.
    ppo = result.ppo
    if randomized and not ppo.memory.remembers:  # the spacecraft varies between episodes
        table = _table(RECIPE_FOLDER / "base-adaptive.toml")["ppo"]
        adaptive = structure(table, PPOSettings, "base-adaptive.ppo")
        ppo = replace(ppo, memory=adaptive.memory, privileged_critic=adaptive.privileged_critic)
    return replace(result, ppo=ppo, conditions=Conditions())


def craft_of(config: TrainConfig) -> Spacecraft:
    """Spacecraft that a training config names; a module (MODULE:NAME) only if the user has typed or trusts it.

    Raises:
        ConfigError: there is no such spacecraft.
    """
    return load_spacecraft(config.spacecraft)


def _recipe_file(task: str, dimension: int, quality: Quality, randomized: bool) -> Path:
    """Recipe file of a quality, by the names that recipes have; that of any long training if the task has none.

    The first that exists counts, from the most special one on. Names are part of the interface: pages and tests
    have them.
    """
    names = [f"{task}-{dimension}d{ending}" for ending in ("", "-shared")]
    if quality == "best" and randomized:
        names = [f"{task}-{dimension}d-robust", *names]
    else:
        names = [f"{quality}-{task}-{_PLACES[dimension]}", *names]
    return _first(*names, "base-precise")


_PLACES = {2: "plane", 3: "space"}


def _first(*names: str) -> Path:
    """The first recipe of these names that comes with RANS; a task of the user's own, MODULE:NAME, has none."""
    files = (RECIPE_FOLDER / f"{name}.toml" for name in names if ":" not in name)
    return next(file for file in files if file.exists())


def preset(task: str, dimension: int, device: str) -> PPOSettings:
    """Hyper-parameters known to solve a task with its default settings.

    Args:
        task: name; user-defined tasks use the preset of their dimension.
        dimension: 2 or 3.
        device: torch device; any device but a CPU uses the GPU values.
    """
    place = _PLACES[dimension]
    return _config(_first(f"preset-{task}-{place}", f"preset-{place}"), device, task=task).ppo


def _config(file: Path, device: str, **given: str) -> TrainConfig:
    """Training config of a recipe file on a device, with some entries ``given``; errors name the file.

    A table of ``[gpu]`` counts more than its ``step_factor``.
    """
    try:
        own = _table(file)
        table = {"spacecraft": "", "solved_share": None} | own | given
        gpu = table.pop("gpu", {})
        if not isinstance(gpu, dict):
            raise ConfigError(f"gpu must be a table of what differs on a GPU, got {brief(gpu)}.")
        gpu = {} if device.startswith("cpu") else dict(gpu)
        factor = whole("gpu.step_factor", gpu.pop("step_factor", 1))
        table = merged(table, gpu) | {"device": device}
        named = table.pop("conditions", None)
        conditions = Conditions() if named is None else load_conditions(named)
        config = from_table(table)
        longer: dict[str, Any] = {
            "total_timesteps": config.total_timesteps * factor,
            "curriculum": [
                replace(ramp, begin=ramp.begin * factor, duration=ramp.duration * factor)
                for ramp in config.curriculum
            ],
        }
        changes = {name: value for name, value in longer.items() if name not in gpu}
        if "task" not in own:  # a file for any task
            changes["ppo"] = replace(config.ppo, symmetric=config.settings.symmetric)
        return replace(config, conditions=conditions, **changes)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from error


def _table(file: Path) -> dict[str, Any]:
    """Table of a recipe file merged over that of its ``base``, and of the base's own.

    Bases may not be files of a user, which ends every chain of them.
    """
    table = read_toml(read_text(file, LARGEST_TOML))
    refuse_other_file(table, "recipe")
    base = table.pop("base", None)
    if base is None:
        return table
    recipe_names = sorted(path.stem for path in RECIPE_FOLDER.glob("*.toml"))
    if base not in recipe_names:
        raise ConfigError(
            f"base must be the name of a recipe that comes with RANS, one of {', '.join(recipe_names)}, "
            f"got {brief(base)}."
        )
    below = _table(RECIPE_FOLDER / f"{base}.toml")
    return merged(below, table)


# Changes of entries by their names, for options and keyword arguments.


def change_entry(table: dict[str, Any], name: str, value: Any) -> None:
    """Change one entry of a config table.

    Args:
        table: config from `rans.fast.learn.config.to_table`, changed in place.
        name: see `entry_named`.
        value: new value, which the user has given: names in it may be MODULE:NAME (`rans.base.registry.typed`).

    Raises:
        ConfigError: see `entry_named`.
    """
    entry = entry_named(table, name)
    *parents, last = entry.split(".")
    inner = table
    for parent in parents:
        inner = inner[parent]
    inner[last] = _typed(value)
    if entry == "algorithm":  # whose own settings are others
        table["learner"] = dataclasses.asdict(own_settings(table["algorithm"], {}))


def entry_named(table: Mapping[str, Any], name: str) -> str:
    """Full dotted name of the entry of a config table that a name means.

    Args:
        table: config from `rans.fast.learn.config.to_table`.
        name: full name of the entry, as ``ppo.learning_rate``, or its last part if that is unique.

    Raises:
        ConfigError: there is no such entry, or the name is not unique.
    """
    names = list(_names(table))
    result = (
        [name]
        if name in names
        else [candidate for candidate in names if candidate.endswith(f".{name}")]
    )
    # An entry of the task itself comes before one of a value in it.
    depth = min((key.count(".") for key in result), default=0)
    result = [key for key in result if key.count(".") == depth]
    if len(result) > 1:
        raise ConfigError(
            f"several entries of the config are called {brief(name)}: choose one of {', '.join(result)}."
        )
    if not result:
        near = meant(name, [*names, *(entry.rpartition(".")[2] for entry in names)])
        raise ConfigError(
            f"the config has no {brief(name)}{near}; `rans list TASK`, "
            "`rans list TRAINING` and the config.json of any run show its entries."
        )
    return result[0]


def _typed(value: Any) -> Any:
    """The value, all of whose texts count as typed by the user."""
    if isinstance(value, Mapping):
        return {key: _typed(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(map(_typed, value))
    return typed(value)


def _names(table: Mapping[str, Any], above: str = "") -> Iterator[str]:
    """Yield the dotted names of all entries of a nested table, including tables."""
    for key, value in table.items():
        yield above + key
        if isinstance(value, Mapping):
            yield from _names(value, f"{above}{key}.")
