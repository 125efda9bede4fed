"""Configuration of a training as one value, converted to and from JSON.

Run folders and recipes hold it as a table; old files must stay readable, so a new entry needs a default.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, get_args

from rans.display import Settings
from rans.errors import ConfigError, brief, fits, whole
from rans.fast.learn.curriculum import Ramp, check_ramps
from rans.fast.learn.learners import complete
from rans.model.timing import Timing
from rans.policy.backbone_registry import BACKBONES
from rans.randomization.conditions import Conditions
from rans.structure import structure
from rans.tasks import TASKS, Task

Precision = Literal["float32", "tf32", "bf16"]
"""Precision of a GPU's matrix products: 24, 11 or, in hidden layers, 8 significant bits (docs/speed.md)."""

Head = Literal["auto", "gated"]
MemoryKind = Literal["none", "history", "commands"]

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
        ConfigError: a value is out of its range, or nothing would be stored.
    """

    kind: MemoryKind = "none"
    """"none"; "history" of the last observations and commands; or "commands", the last commands alone, which
    suffice beside filters."""
    history: int = 4
    """Number of last observations and commands in the memory."""
    averages: tuple[float, ...] = ()
    """Exponential moving averages of all observations and commands, beside the history or (with history 0) instead
    of it: the fraction of the average that remains at every step. They separate constant signals from noise and
    reach further back than a history. The average of commands that halves at every step has the last command as its
    first binary digit, the one before as its second."""

    def __post_init__(self) -> None:
        kinds = get_args(MemoryKind)
        require_bounds(self, f"one of {', '.join(kinds)}", lambda x: x in kinds, "kind")
        require_bounds(
            self, f">= 0 and <= {MOST_UNITS:,}", lambda x: 0 <= x <= MOST_UNITS, "history"
        )
        require_bounds(
            self,
            "numbers between 0 and 1",
            lambda x: isinstance(x, tuple | list) and all(0 < item < 1 for item in x),
            "averages",
        )
        recalls = self.kind in ("history", "commands")
        if self.averages and not recalls:
            raise ConfigError(
                "averages are of a history, so that memory.kind must be 'history' or 'commands', "
                f"got {self.kind!r}."
            )
        if recalls and not (self.history or self.averages):
            raise ConfigError(
                f"memory {self.kind!r} with history 0 and no averages stores nothing: "
                "give history 1 or more, averages, or memory 'none'."
            )


@dataclass(frozen=True)
class FilterSettings(Settings):
    """Kalman filters with the model of the spacecraft as designed, whose estimates a network observes.

    Each list has a number for every filter. By default there are none (docs/decisions/robustness.md).

    Raises:
        ConfigError: a number is out of its range, or a list has another length.
    """

    drift: tuple[float, ...] = ()
    """Variance of the random walk of velocities in a control period, in units of the noise of their readings."""
    steady: tuple[float, ...] = ()
    """Variance of the constant accelerations that each filter estimates, such as that of a sloping floor, in units
    of the noise of its readings. 0 or empty: none."""
    response: tuple[float, ...] = ()
    """Variance of the thrusters' deviation from their design that each filter estimates, immediate and one control
    period late, in units of the noise of readings over the velocity change of the strongest thruster in a period. 0
    or empty: thrusters act as designed."""

    gate: ClassVar[float] = 5.0
    """Gate of readings: the prediction of the filters is observed in place of readings that are missing or deviate
    by more than this, in units of the velocity change of all thrusters along one axis in a control period (for
    poses the same number in m and rad). Every agent that ships with filters was trained and judged with it
    (docs/decisions/robustness.md)."""

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
            "steady",
            "response",
        )
        count = len(self.drift)
        for name in ("steady", "response"):
            values = getattr(self, name)
            if values and len(values) != count:
                raise ConfigError(
                    f"{name} has {len(values)} numbers for {count} filters: give one for each."
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
    much trains as well (docs/decisions/commands.md)."""

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
    """Hyper-parameters of `rans.PPO`, by their names in SB3.

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
    which on/off thrusters open together; installed packages may have others."""
    head: Head = "auto"
    """Distribution of the commands: "auto" is Bernoulli for on/off thrusters and Gaussian for others; "gated" first
    decides whether a throttled or pulsed thruster fires at all, so that 0 is exactly 0."""
    symmetric: bool = True
    """Whether the policy is equivariant under the symmetries of the spacecraft."""
    zoom: float = 0.0
    """Magnification of a second copy of all observed columns, for agents that keep the position within millimetres
    (docs/decisions/policies.md). 0: no copy, which learns coarse motion sooner."""
    matmul: Precision = "tf32"
    """Precision of matrix products on a GPU; a CPU always uses float32. With bf16 the gradients of most networks
    are one kernel (docs/decisions/kernels.md)."""
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
        for name, kind in (
            ("head", Head),
            ("matmul", Precision),
        ):
            choices = get_args(kind)
            require_bounds(
                self, f"one of {', '.join(choices)}", lambda x, choices=choices: x in choices, name
            )
        if self.backbone not in [*BACKBONES]:
            raise ConfigError(
                f"backbone must be one of {', '.join(BACKBONES)}, got {brief(self.backbone)}."
            )
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
    """Whether torch's compiler compiles the kernels of a GPU before training, or never; null: as soon as enough
    steps are left to pay for the 5 to 35 s that it takes."""
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
            object.__setattr__(self, "learner", complete(self.algorithm, self.learner))
        if self.plain and self.compiled:
            raise ConfigError(
                "plain computes by single operations of torch, and compiled has torch's compiler make "
                "kernels: set one of them."
            )
        object.__setattr__(self, "curriculum", tuple(self.curriculum))
        if self.curriculum:
            check_ramps(self.settings, self.curriculum)


def to_table(config: TrainConfig) -> dict[str, Any]:
    """Plain JSON values of a config."""
    return dataclasses.asdict(config)


def from_table(table: dict[str, Any]) -> TrainConfig:
    """Config from a table of `to_table`, which may have been changed.

    Raises:
        ConfigError: a key or value is wrong.
    """
    if not isinstance(table, dict) or not isinstance(table.get("task"), str):
        raise ConfigError(
            'a training must name its task: task = "go-to-pose" in a recipe, "task": "go-to-pose" in a '
            "config.json."
        )
    settings = structure(table.get("settings", {}), TASKS[table["task"]], "settings")
    timing = table.get("timing", {})
    if isinstance(timing, dict):  # missing values are those of the task
        timing = dataclasses.asdict(settings.timing) | timing
    return structure(table | {"settings": settings, "timing": timing}, TrainConfig, "config")
