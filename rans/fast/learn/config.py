"""Everything that decides a training, as one value that goes to and from JSON."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any, Literal, get_args, get_origin

import cattrs

from rans.errors import ConfigError, RansError
from rans.fast.learn.curriculum import Numbers, Ramp, check_ramps
from rans.model.timing import Timing
from rans.tasks import TASKS, Task

Precision = Literal["float32", "tf32", "bf16"]
"""Of a GPU's matrix products: 24, 11 or, in hidden layers, 8 significant bits (docs/speed.md)."""


@dataclass(frozen=True)
class PPOSettings:
    """Hyper-parameters of `rans.PPO`, by their names in Stable-Baselines3.

    Raises:
        ConfigError: a value is out of its range.
    """

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
    activation: Literal["tanh", "elu", "relu"] = "tanh"
    """Between the layers."""
    symmetric: bool = True
    """Whether what is learnt on one side of the spacecraft serves all that look the same."""
    zoom: float = 0.0
    """Magnification of a second look at everything observed, for agents that hold millimetres (decision
    008). 0: none, which learns the rough way to go sooner."""
    matmul: Precision = "tf32"
    """How a GPU multiplies matrices; a CPU always does in float32."""
    memory: Literal["none", "history", "recurrent"] = "none"
    """What the network remembers of an episode: nothing; the last observations and commands; or what a gated
    recurrent unit keeps."""
    history: int = 4
    """How many last observations and commands."""
    recurrent_units: int = 64
    """Of that unit."""
    privileged_critic: bool = False
    """Whether the critic has layers of its own that are also given what a simulator knows and a robot does
    not: the spacecraft's true mass properties."""
    initial_duty: float = 0.5
    """Probability that a thruster is open before anything is learnt. Agents that should rest with all
    valves shut find out about it sooner from a low one."""

    def __post_init__(self) -> None:
        for name, least in (("n_envs", 1), ("n_steps", 1), ("batch_size", 2), ("n_epochs", 1),
                            ("history", 1), ("recurrent_units", 1)):
            _require(getattr(self, name) >= least, name, getattr(self, name), f">= {least}")
        for name in ("learning_rate", "max_learning_rate", "clip_range", "max_grad_norm", "reward_scale"):
            _require(0 < getattr(self, name) < math.inf, name, getattr(self, name), "finite and > 0")
        for name in ("ent_coef", "vf_coef", "zoom"):
            _require(0 <= getattr(self, name) < math.inf, name, getattr(self, name), "finite and >= 0")
        _require(0 < self.initial_duty < 1, "initial_duty", self.initial_duty, "between 0 and 1")
        _require(0 <= self.anneal <= 1, "anneal", self.anneal, "between 0 and 1")
        for name in ("gamma", "gae_lambda"):
            _require(0 < getattr(self, name) <= 1, name, getattr(self, name), "in (0, 1]")
        divergence = self.desired_kl is None or 0 < self.desired_kl < math.inf
        _require(divergence, "desired_kl", self.desired_kl, "finite and > 0, or null")
        layers = len(self.layers) > 0 and min(self.layers) >= 1
        _require(layers, "layers", list(self.layers), "one or more numbers >= 1")
        if self.memory != "none" and self.symmetric:
            raise ConfigError(f"memory {self.memory!r} needs symmetric to be false: what is remembered was "
                              "seen from one side of the spacecraft, and the next step may be from another.")


def _require(holds: bool, name: str, value: object, bound: str) -> None:
    if not holds:
        raise ConfigError(f"{name} must be {bound}, got {value}.")


@dataclass(frozen=True)
class TrainConfig:
    """One training: the same config and seed give the same agent, bit by bit on a CPU.

    Raises:
        ConfigError: a value is out of its range.
    """

    task: str
    """Name of the task."""
    settings: Task
    """The task's settings."""
    spacecraft: str
    """Name of a spacecraft, or a TOML file."""
    ppo: PPOSettings = field(default_factory=PPOSettings)
    timing: Timing = field(default_factory=Timing)
    curriculum: tuple[Ramp, ...] = ()
    """Settings of the task that move during training, from an easier value to their own."""
    seed: int = 0
    """Of starts, goals, weights and actions."""
    device: str = "cpu"
    """Torch device."""
    threads: int = 1
    """Torch's threads on a CPU. One is nearly as fast as two for small networks, many times faster when
    anything else runs, and the weights' last bits depend on the number."""
    total_timesteps: int = 30_000_000
    """Environment steps after which training ends, solved or not."""
    report_interval: int = 16
    """Iterations of PPO between reports, each of which judges the agent on 1,024 episodes."""
    solved_share: float | None = 0.995
    """Training ends once two reports in a row find this share of episodes within the task's tolerances
    throughout the last fifth. None: train for all steps."""

    def __post_init__(self) -> None:
        # What NumPy's generator takes, which Stable-Baselines3 seeds too.
        _require(0 <= self.seed < 2**32, "seed", self.seed, "between 0 and 2^32 - 1")
        for name in ("total_timesteps", "report_interval", "threads"):
            _require(getattr(self, name) >= 1, name, getattr(self, name), ">= 1")
        check_ramps(self.settings, self.curriculum)
        share = self.solved_share
        _require(share is None or 0 < share <= 1, "solved_share", share, "in (0, 1], or null")


def to_table(config: TrainConfig) -> dict[str, Any]:
    """The config as plain JSON values."""
    return dataclasses.asdict(config)


def from_table(table: dict[str, Any]) -> TrainConfig:
    """The config that `to_table` gave, with whatever the user changed in it.

    Raises:
        ConfigError: an unknown key, a value of the wrong type or out of its range.
    """
    if not isinstance(table, dict) or not isinstance(table.get("task"), str):
        raise ConfigError("a training config must name its task: {\"task\": \"go-to-pose\", ...}.")
    settings = _structure(table.get("settings", {}), TASKS[table["task"]], "settings")
    return _structure(table | {"settings": settings}, TrainConfig, "config")


def _structure(table: Any, cls: type, where: str) -> Any:
    converter = cattrs.Converter(forbid_extra_keys=True)
    converter.register_structure_hook_func(lambda kind: kind is Task, lambda value, _: value)
    for kind in (bool, int, float, str):
        converter.register_structure_hook(kind, _strict)
    converter.register_structure_hook_func(
        lambda kind: kind == Numbers,
        lambda value, _: converter.structure(value, tuple[float, float] if _is_list(value) else float))
    try:
        return converter.structure(table, cls)
    except Exception as error:  # cattrs gathers whatever the values raised in groups of its own
        reasons = cattrs.transform_error(error, path=where, format_exception=_say)
        # cattrs ends each with its place; a reader wants that first.
        places = (": ".join(reason.rsplit(" @ ", 1)[::-1]) for reason in reasons)
        raise ConfigError(f"{'; '.join(places)}.") from error


def _is_list(value: Any) -> bool:
    return isinstance(value, list | tuple)


def _strict(value: Any, kind: type) -> Any:
    """No silent conversions: "64" is not 64, and True is not 1; but 1 is 1.0."""
    if kind is float and type(value) is int:
        return float(value)
    if type(value) is not kind:
        raise ConfigError(f"expected {kind.__name__}, got {value!r}")
    return value


def _say(error: BaseException, kind: Any) -> str:
    if isinstance(error, RansError):
        return str(error).rstrip(".")
    if isinstance(error, cattrs.ForbiddenExtraKeysError):
        return f"unknown key {', '.join(sorted(map(repr, error.extra_fields)))}"
    if isinstance(error, KeyError):
        return f"the key {error} is missing"
    if isinstance(error, AttributeError):  # cattrs asks whatever it is given for its keys
        return 'expected a table, such as {"key": value}'
    if isinstance(error, TypeError):
        return "expected a table or a list of values, such as [0.5, 4.5]"
    if get_origin(kind) is Literal:
        given, _, _ = str(error).partition(" not in ")  # "gelu not in literal ..."
        return f"expected {' or '.join(map(repr, get_args(kind)))}, got {given!r}"
    return str(error)
