"""Everything that decides a training, as one value that goes to and from JSON."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

from rans.errors import ConfigError, brief, fits
from rans.fast.learn.curriculum import Ramp, check_ramps, with_present_settings
from rans.model.timing import Timing
from rans.policy.activations import ACTIVATIONS
from rans.randomization.conditions import Conditions
from rans.renamed import renamed
from rans.structure import structure
from rans.tasks import TASKS, Task

if TYPE_CHECKING:
    from torch import Tensor

Precision = Literal["float32", "tf32", "bf16"]
"""Of a GPU's matrix products: 24, 11 or, in hidden layers, 8 significant bits (docs/speed.md)."""

if TYPE_CHECKING:
    Activation = str
else:
    Activation = Literal[tuple(ACTIVATIONS)]
Head = Literal["auto", "gated", "guided"]
BackboneName = Literal["dense", "attention"]
PreprocessorName = Literal["body", "world"]
Memory = Literal["none", "history", "commands", "recurrent"]

MOST_LAYERS = 32
MOST_UNITS = 65_536
"""A hundred times what any agent here has: more is a slip, and fills the memory."""


@dataclass(frozen=True)
class PPOSettings:
    """Hyper-parameters of `rans.PPO`, by their names in SB3; ConfigError where one is out of its range."""

    n_envs: int = 128
    """Spacecraft flown together."""
    n_steps: int = 64
    """Control periods between updates."""
    batch_size: int = 2048
    """Transitions a minibatch."""
    n_epochs: int = 4
    """Passes over the transitions in an update."""
    learning_rate: float = 1e-3
    """Step size to start with."""
    desired_kl: float | None = 0.016
    """Divergence an update should cause: the step size adapts to it. None: constant step size."""
    max_learning_rate: float = 1e-2
    """Upper bound of the adapted step size."""
    anneal: float = 0.0
    """Last share of all steps over which that bound falls to zero, for agents trained to the end: their
    last bits of precision come from small steps."""
    gamma: float = 0.98
    """Discount per control period."""
    gae_lambda: float = 0.95
    """Bias-variance trade-off of the advantages."""
    clip_range: float = 0.2
    """Bound of the probability ratio."""
    ent_coef: float = 0.0
    """Weight of the entropy bonus."""
    vf_coef: float = 0.5
    """Weight of the value loss."""
    max_grad_norm: float = 1.0
    """Gradients are scaled down to this length."""
    reward_scale: float = 0.1
    """Factor on every reward."""
    layers: tuple[int, ...] = (64, 64)
    """Units of the network's hidden layers, shared by actor and critic."""
    activation: Activation = "tanh"
    """Between the layers."""
    preprocessor: PreprocessorName = "body"
    """Which columns the network is given: "body", vectors in the frame of the spacecraft (decision 004); "world",
    those observed, which needs symmetric to be false and no filters."""
    backbone: BackboneName = "dense"
    """How features become commands: "dense" by a last layer; "attention" by a layer of attention over the
    effectors, whose weights fit any craft."""
    head: Head = "auto"
    """How outputs become commands: "auto" opens on/off thrusters or not, and commands the others by a Gaussian;
    "gated" first decides whether a throttled or pulsed thruster fires at all, so that 0 is exactly 0; "guided"
    gives shares of the commands that a mission's guidance recommends, and begins as guidance."""
    symmetric: bool = True
    """Whether what is learnt on one side of the spacecraft serves all that look the same."""
    zoom: float = 0.0
    """Magnification of a second look at everything observed, for agents that hold millimetres (decision
    008). 0: none, which learns the rough way to go sooner."""
    matmul: Precision = "tf32"
    """How a GPU multiplies matrices; a CPU always does in float32. In bf16 gradients are one kernel for most
    networks (decision 020)."""
    memory: Memory = "none"
    """What the network remembers of an episode: nothing, the last observations and commands, the last
    commands alone, which is all that filters leave to remember, or what a gated recurrent unit keeps."""
    history: int = 4
    """How many last observations and commands."""
    averages: tuple[float, ...] = ()
    """Beside them, or with history 0 in their place, exponential moving averages of all: the share that each
    keeps from step to step. They tell what is steady from noise, and are longer than a history can be; of
    commands alone the average that keeps a half has the last one as its first binary digit, the one before
    as its second."""
    filters: tuple[float, ...] = ()
    """What Kalman filters make of everything observed, besides: of each the variance by which it lets
    velocities wander in a control period, in units of their readings' noise. They know the spacecraft as
    designed and what its thrusters were told (decision 024)."""
    filtered_steady: tuple[float, ...] = ()
    """Of each filter the variance of the steady accelerations that it looks for, such as a floor's that
    slopes, in units of its readings' noise. 0, or without: it looks for none."""
    filtered_response: tuple[float, ...] = ()
    """Of each filter the variance of what it lets thrusters give beyond their design, at once and a control
    period late, in units of the readings' noise over what the strongest thruster gives a velocity in a
    period. 0, or without: they give what they are designed to."""
    filtered_gate: float = 0.0
    """Above 0 what filters expect is observed in place of readings that a sensor missed, so that they repeat
    the last one, and of those that err by more than this: in units of the velocity that all thrusters which
    push along one axis give in a control period, of poses the same number in m and rad. 0: every reading
    counts as it came."""
    recurrent_units: int = 64
    """Of that unit."""
    privileged_critic: bool = False
    """Whether the critic has layers of its own that are also given what a robot does not know: all that
    conditions draw, or without any the spacecraft's true mass properties."""
    initial_duty: float = 0.5
    """Probability that a thruster is open before anything is learnt. Agents that should rest with all
    valves shut find out about it sooner from a low one."""
    log_std_init: float = 0.0
    """Logarithm of the standard deviation of throttled or pulsed commands before anything is learnt; every unit
    of a command is full thrust for a control period. Where that is a large part of what a flight needs, -2."""

    def __post_init__(self) -> None:
        _require(self, ">= 1 and < 2^31", lambda x: 1 <= x < 2**31, "n_envs", "n_steps", "n_epochs")
        _require(self, ">= 2 and < 2^31", lambda x: 2 <= x < 2**31, "batch_size")
        _require(
            self, f">= 1 and <= {MOST_UNITS:,}", lambda x: 1 <= x <= MOST_UNITS, "recurrent_units"
        )
        _require(self, f">= 0 and <= {MOST_UNITS:,}", lambda x: 0 <= x <= MOST_UNITS, "history")
        _require(
            self,
            "finite and > 0",
            lambda x: 0 < x < math.inf,
            "learning_rate",
            "max_learning_rate",
            "clip_range",
            "max_grad_norm",
            "reward_scale",
        )
        _require(
            self, "finite and >= 0", lambda x: 0 <= x < math.inf, "ent_coef", "vf_coef", "zoom"
        )
        _require(
            self, ">= 1e-6 and <= 1e6, or 0", lambda x: x == 0 or 1e-6 <= x <= 1e6, "filtered_gate"
        )
        _require(self, "between 0 and 1", lambda x: 0 < x < 1, "initial_duty")
        _require(self, ">= -10 and <= 2", lambda x: -10 <= x <= 2, "log_std_init")
        _require(self, "between 0 and 1", lambda x: 0 <= x <= 1, "anneal")
        _require(self, "in (0, 1]", lambda x: 0 < x <= 1, "gamma", "gae_lambda")
        _require(
            self, "finite and > 0, or null", lambda x: x is None or 0 < x < math.inf, "desired_kl"
        )
        _require(
            self,
            "numbers between 0 and 1",
            lambda x: isinstance(x, tuple | list) and all(0 < share < 1 for share in x),
            "averages",
        )
        _require(
            self,
            "numbers >= 1e-6 and <= 1e6",
            lambda x: isinstance(x, tuple | list) and all(1e-6 <= one <= 1e6 for one in x),
            "filters",
        )
        _require(
            self,
            "numbers >= 1e-6 and <= 1e6, or 0",
            lambda x: (
                isinstance(x, tuple | list) and all(one == 0 or 1e-6 <= one <= 1e6 for one in x)
            ),
            "filtered_steady",
            "filtered_response",
        )
        for name, kind in (
            ("activation", Activation),
            ("backbone", BackboneName),
            ("preprocessor", PreprocessorName),
            ("head", Head),
            ("matmul", Precision),
            ("memory", Memory),
        ):
            known = get_args(kind)
            _require(self, f"one of {', '.join(known)}", lambda x, known=known: x in known, name)
        _require(
            self,
            f"1 to {MOST_LAYERS} numbers >= 1 and <= {MOST_UNITS:,}",
            lambda x: 1 <= len(x) <= MOST_LAYERS and 1 <= min(x) <= max(x) <= MOST_UNITS,
            "layers",
        )
        self._check_memory()

    def _check_memory(self) -> None:
        """Whether what is remembered and filtered goes together."""
        recalls = self.memory in ("history", "commands")
        if self.averages and not recalls:
            raise ConfigError(
                "averages are of a history, so that memory must be 'history' or 'commands', "
                f"got {self.memory!r}."
            )
        if recalls and not (self.history or self.averages):
            raise ConfigError(
                f"memory {self.memory!r} with history 0 and no averages remembers nothing: "
                "give history 1 or more, averages, or memory 'none'."
            )
        count = len(self.filters)
        for name, given in (("steady", self.filtered_steady), ("response", self.filtered_response)):
            if given and len(given) != count:
                raise ConfigError(
                    f"filtered_{name} has {len(given)} numbers, of {count} filters: give one "
                    "of each."
                )
        if self.filtered_gate and not self.filters:
            raise ConfigError(
                f"filtered_gate is {self.filtered_gate:g}, but there are no filters whose "
                "readings it could screen: give filters too, or a gate of 0."
            )
        if self.filters and self.memory == "recurrent":
            raise ConfigError(
                "filters stand beside a history or nothing, not beside memory 'recurrent', "
                "which is all that such a network remembers."
            )
        if self.preprocessor == "world" and (self.symmetric or self.filters):
            raise ConfigError(
                "preprocessor 'world' needs symmetric to be false and no filters: both work on vectors in "
                "the frame of the spacecraft."
            )
        if self.memory == "recurrent" and self.symmetric:
            raise ConfigError(
                "memory 'recurrent' needs symmetric to be false: what is remembered was seen "
                "from one side of the spacecraft, and the next step may be from another."
            )


class Coefficients(NamedTuple):
    """Hyper-parameters in which members may differ, by their names in `PPOSettings`; (K,), NaN for None."""

    learning_rate: Tensor
    desired_kl: Tensor
    max_learning_rate: Tensor
    anneal: Tensor
    gamma: Tensor
    gae_lambda: Tensor
    clip_range: Tensor
    ent_coef: Tensor
    vf_coef: Tensor
    max_grad_norm: Tensor
    reward_scale: Tensor

    @classmethod
    def of(cls, settings: Sequence[PPOSettings], like: Tensor) -> Coefficients:
        """Those of these members, in the dtype and on the device of another tensor."""
        table = ([getattr(one, name) for one in settings] for name in cls._fields)
        return cls(
            *(
                like.new_tensor([float("nan") if x is None else x for x in column])
                for column in table
            )
        )


def _require(config: object, bound: str, holds: Callable[[Any], bool], *names: str) -> None:
    for name in names:
        if not fits(value := getattr(config, name), holds):
            said = list(value) if isinstance(value, tuple) else value
            raise ConfigError(f"{name} must be {bound}, got {brief(said)}.")


@renamed(looks="searches")
@dataclass(frozen=True)
class Failures:
    """Training where the agent fails; ConfigError where a number is out of its range."""

    share: float = 0.0
    """Of the environments, whose episodes begin somewhere along flights that the agent failed in. 0: none,
    and such flights are not searched for."""
    begin: float = 0.5
    """Share of all steps before the first search for failures: until then there is more than enough of them."""
    searches: int = 8
    """How many searches there are, equally spaced over the rest."""
    flights: int = 65_536
    """Flights of a search, by the agent's likeliest commands."""

    def __post_init__(self) -> None:
        _require(self, "at least 0 and below 1", lambda x: 0 <= x < 1, "share", "begin")
        _require(self, ">= 1 and < 2^24", lambda x: 1 <= x < 2**24, "searches", "flights")


Algorithm = Literal["ppo", "gradient", "imitation"]


@dataclass(frozen=True)
class GradientSettings:
    """What only the learner through the motion has, besides `PPOSettings`; ConfigError where out of range."""

    critic_learning_rate: float = 2e-3
    """Step size of the critic, a network of its own."""
    target_rate: float = 0.2
    """Share of the critic's weights that the target network, the value of what comes after the horizon, takes
    in an iteration (Polyak averaging)."""
    noise: float = 0.2
    """Standard deviation of commands to begin with; it is learnt."""
    bound: float = 10.0
    """Most that a spacecraft's scaled return may change with a number of its state or of its observation, per
    unit of it, as far as it is passed back from a control period to the one before: through many periods of a
    policy that reacts strongly it would grow without bound."""

    def __post_init__(self) -> None:
        _require(
            self,
            "finite and > 0",
            lambda x: 0 < x < math.inf,
            "critic_learning_rate",
            "noise",
            "bound",
        )
        _require(self, "in (0, 1]", lambda x: 0 < x <= 1, "target_rate")


@dataclass(frozen=True)
class ImitationSettings:
    """What only the learner from an expert has, besides `PPOSettings`; ConfigError where out of range."""

    expert: str = "convex"
    """Controller that is imitated: a name (docs/comparison.md), or MODULE:NAME of your own."""
    updates: int = 400
    """Steps down the gradient in an iteration, each on a minibatch of all labels so far."""
    roll_in: float = 0.6
    """Most that the agent flies of an episode before the expert flies on, as a share of an episode's length."""

    def __post_init__(self) -> None:
        _require(self, ">= 1 and < 2^31", lambda x: 1 <= x < 2**31, "updates")
        _require(self, "between 0 and 1", lambda x: 0 <= x <= 1, "roll_in")


@dataclass(frozen=True)
class TrainConfig:
    """One training, checked: the same config and seed give the same agent, bit by bit on a CPU."""

    task: str
    """Name of the task."""
    settings: Task
    """The task's settings."""
    spacecraft: str
    """Name of a spacecraft, or a TOML file."""
    ppo: PPOSettings = field(default_factory=PPOSettings)
    """Hyper-parameters of the network and of its training. The gradient learner ignores those of PPO alone:
    desired_kl, max_learning_rate, clip_range, ent_coef and vf_coef."""
    timing: Timing = field(default_factory=Timing)
    """Of the episodes that agents are judged in, and learn in if not said otherwise."""
    episode_steps: int | None = None
    """Length of the episodes they learn in: where the way to the goal is hard and rest is easy, shorter ones
    show more of the way."""
    conditions: Conditions = field(default_factory=Conditions)
    """What episodes do not promise."""
    curriculum: tuple[Ramp, ...] = ()
    """Settings of the task that move during training, from an easier value to their own."""
    failures: Failures = field(default_factory=Failures)
    """Where episodes begin that do not begin at the task's starts."""
    seed: int = 0
    """Of starts, goals, weights and actions."""
    device: str = "cpu"
    """Torch device."""
    compiled: bool | None = None
    """Whether torch's compiler makes a GPU's kernels before training begins, or never; null: once so much is
    left to train that it pays for the 5 to 35 s that it takes."""
    algorithm: Algorithm = "ppo"
    """What learns: proximal policy optimisation, the gradient of the return through the motion, or imitation of
    an expert."""
    gradient: GradientSettings = field(default_factory=GradientSettings)
    """What the gradient through the motion has besides."""
    imitation: ImitationSettings = field(default_factory=ImitationSettings)
    """What imitation of an expert has besides."""
    begin_from: str | None = None
    """Run folder, or pretrained:NAME, of an agent whose weights training begins with, of the same network; null:
    with weights that have learnt nothing. What its inputs are normalised by stays as it is."""
    guard: bool = False
    """Whether the safety filter for the spacecraft and task (docs/missions/guard.md) stands between the agent and
    the effectors while it learns, and while it is judged. On a GPU only together with plain."""
    plain: bool = False
    """Whether everything is computed as it is written: torch's operations one by one, no generated program or
    kernel, autograd's gradients. A breakpoint in a task then stops (docs/plain.md); many times slower."""
    threads: int = 1
    """Torch's on a CPU. One is nearly as fast as two for small networks, many times faster when anything else
    runs, and the weights' last bits depend on the number."""
    total_timesteps: int = 30_000_000
    """Environment steps after which training ends, solved or not."""
    report_interval: int = 16
    """Iterations of PPO between reports, each of which judges the agent on 1,024 episodes."""
    solved_share: float | None = 0.995
    """Training ends once two reports in a row find this share of episodes within the task's tolerances
    throughout the last fifth. None: train for all steps."""

    def __post_init__(self) -> None:
        # What NumPy's generator takes, which Stable-Baselines3 seeds too.
        _require(self, "between 0 and 2^32 - 1", lambda x: 0 <= x < 2**32, "seed")
        _require(
            self, ">= 1 and < 2^31, or null", lambda x: x is None or 1 <= x < 2**31, "episode_steps"
        )
        _require(
            self,
            "a whole number >= 1 and < 2^63",
            lambda x: isinstance(x, int) and 1 <= x < 2**63,
            "total_timesteps",
            "report_interval",
        )
        _require(self, ">= 1 and <= 1,024", lambda x: 1 <= x <= 1024, "threads")
        _require(self, "in (0, 1], or null", lambda x: x is None or 0 < x <= 1, "solved_share")
        known = get_args(Algorithm)
        _require(self, f"one of {', '.join(known)}", lambda x: x in known, "algorithm")
        if self.plain and self.compiled:
            raise ConfigError(
                "plain computes everything as it is written, and compiled has torch's compiler make "
                "kernels: set one of them."
            )
        ramps = with_present_settings(self.settings, self.curriculum)
        object.__setattr__(self, "curriculum", ramps)
        check_ramps(self.settings, ramps)


def to_table(config: TrainConfig) -> dict[str, Any]:
    """The config as plain JSON values."""
    return dataclasses.asdict(config)


def from_table(table: dict[str, Any]) -> TrainConfig:
    """The config that `to_table` gave, with what the user changed in it; ConfigError where that is wrong."""
    if not isinstance(table, dict) or not isinstance(table.get("task"), str):
        raise ConfigError('a training config must name its task: {"task": "go-to-pose", ...}.')
    settings = structure(table.get("settings", {}), TASKS[table["task"]], "settings")
    timing = table.get("timing", {})
    if isinstance(timing, dict):  # as the task's own where it says nothing
        timing = dataclasses.asdict(settings.timing) | timing
    return structure(table | {"settings": settings, "timing": timing}, TrainConfig, "config")
