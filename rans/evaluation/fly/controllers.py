"""Controllers that need no training: built in, of installed packages, or a user's own.

Policies that other libraries trained are controllers too: an SB3 file, an ONNX file, or any Python function.
"""

from __future__ import annotations

import os
import pickle
import re
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cloudpickle
import numpy as np

from rans.effectors.commands import action_space, allowed, check_commands, clipped, of_outputs
from rans.episode import Guard, Setup
from rans.errors import ConfigError, RansError, brief, require, where_raised
from rans.evaluation.fly.tuned import arguments, tuned
from rans.files import first_line, read_bytes
from rans.flight import Controller, informed
from rans.guard import safety_filter
from rans.model.spacecraft import Spacecraft
from rans.registry import Registry, resolve_typed
from rans.tasks import Task, observation_width

if TYPE_CHECKING:
    from rans.fast.learn.config import TrainConfig

Maker = Callable[..., Controller]
"""Function or class that makes a controller from spacecraft, task and timing, and tuned settings by keyword."""


def _checked(result: Any) -> Maker:
    if not callable(result):
        raise ConfigError(
            "a controller must be a class or function of spacecraft, task and timing, got "
            f"{brief(result)}."
        )
    if isinstance(
        result, type
    ):  # A spacecraft or a task is a class too: it is refused before it is called.
        _check_methods(f"the class {result.__name__}", result)
    maker: Any = result
    return maker


def _check_methods(who: str, instance: object) -> None:
    missing = [need for need in ("reset", "act") if not callable(getattr(instance, need, None))]
    if missing:
        raise ConfigError(
            f"{who} is no controller: it has no {' and no '.join(missing)}; see "
            "rans.flight.Controller."
        )


CONTROLLERS: Registry[Maker] = Registry(
    "controller",
    "rans.controllers",
    {
        "lqr": "rans.optimal.control.lqr:LQR",
        "switching": "rans.optimal.control.switching:Switching",
        "mpc": "rans.optimal.control.mpc:MPC",
        "mpc-observer": "rans.optimal.control.observer:ObserverMPC",
        "mppi": "rans.optimal.control.sampling:MPPI",
        "guidance": "rans.optimal.control.guidance:VelocityToGain",
        "convex": "rans.optimal.control.convex_guidance:ConvexGuidance",
        "landing": "rans.optimal.control.landing_guidance:LandingGuidance",
        "mission": "rans.optimal.control.mission_guidance:MissionGuidance",
        "circumnavigation": "rans.optimal.control.circumnavigation:Circumnavigation",
        "passive": "rans.optimal.control.passive_approach:PassiveApproach",
        "passive-entry": "rans.optimal.control.passive_entry:PassiveEntry",
        "visiting": "rans.optimal.control.visiting:Visiting",
    },
    _checked,
    elsewhere={
        "pid": "lqr",
        "pd": "lqr",
        "lqg": "lqr",
        "nmpc": "mpc",
        "bang-bang": "switching",
    },
)
"""Makers of controllers by name, with default settings; `controller` makes one with tuned settings."""

BESIDE = ("lqr", "switching", "mpc", "optimal")
"""Default opponents of a comparison: controllers, and the best that is possible."""
_BESIDE_OTHERS = {
    "landing": ("landing", "optimal"),
    "inspection": ("circumnavigation", "visiting", "optimal"),
}
"""Default opponents of comparisons of missions that those controllers do not fly, by kind of optimal problem."""


def default_opponents(task: Task) -> tuple[str, ...]:
    """Names of controllers that fly a task beside the contestants of a comparison, and "optimal"."""
    return _BESIDE_OTHERS.get(task.optimal_problem, BESIDE)


def controller(name: str, setup: Setup) -> Controller:
    """Make a controller by name, with settings that were tuned for the setup, else with default settings.

    A built-in one that can expect errors of sensors and thrusters expects the setup's conditions.

    Raises:
        ConfigError: there is no such controller, or none for this spacecraft.
    """
    maker = CONTROLLERS[name]
    result = tuned(name, setup)
    if result is not None:
        maker = partial(maker, **arguments(maker, result.settings))
    if name not in CONTROLLERS.built_in:
        return CheckedController(name, setup, maker)
    return informed(maker(*setup[:3]), setup.conditions)


def guard_of(config: TrainConfig, craft: Spacecraft) -> Guard | None:
    """The safety filter of a training; None if it has none.

    Raises:
        ConfigError: the task has no constraints, or the craft has throttles with which no filter can brake.
    """
    return safety_filter(Setup(craft, config.settings, config.timing)) if config.guard else None


class CheckedController:
    """Controller of a plug-in or a user whose commands are checked; wrong ones raise a `ConfigError`."""

    def __init__(self, name: str, setup: Setup, maker: Maker) -> None:
        self._craft = setup.craft
        package = CONTROLLERS.package(name)
        self._who = f"the controller {brief(name)}" + (
            f" of the package {package}" if package else ""
        )
        try:
            self._made = maker(*setup[:3])
            self.name, self.slow = self._made.name, getattr(self._made, "slow", False)
            self.observes = getattr(self._made, "observes", True)
        except RansError:
            raise
        except Exception as error:  # somebody else's code raises anything
            raise ConfigError(
                f"{self._who} cannot be made: {type(error).__name__}: "
                f"{first_line(error)}{where_raised(error)}."
            ) from error
        _check_methods(self._who, self._made)

    @property
    def failures(self) -> int:
        """Number of times that its solver found no solution."""
        return getattr(self._made, "failures", 0)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._made.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller` and `answered`."""
        return answered(
            self._who,
            lambda: self._made.act(state, goal, observation),
            self._craft,
            len(observation),
        )


USER_POLICIES = "sb3:FILE.zip, onnx:FILE or python:MODULE:FUNCTION"
"""Forms of names that `user_policy` accepts, for messages and help.

Each may end in :TASK-2d or -3d, with @SPACECRAFT, see `split_policy`.
"""

Policy = Callable[[np.ndarray], Any]
"""Function of observations (N, width), float32, in the order of `rans.tasks.observation_terms`, whose results are
commands (N, commands), zeros and ones or numbers between."""


class UserPolicy:
    """A policy of another library, a function of the observation; its commands are checked before they are flown.

    Args:
        spec: text that `user_policy` opens.
        policy: the function.
        craft: spacecraft that it flies.
        task: task that it observes.
        trust: see `user_policy`.
    """

    def __init__(
        self, spec: str, policy: Policy, craft: Spacecraft, task: Task, trust: bool = False
    ) -> None:
        kind, _, file = spec.partition(":")
        self.name = f"{kind}:{Path(file).name}" if kind in ("sb3", "onnx") else spec
        self._spec = spec
        self._policy = policy
        self._craft = craft
        self._task = task
        self._trust = trust

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process loads the policy anew, because not every policy can be pickled."""
        return user_policy, (self._spec, self._craft, self._task, self._trust)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; most policies have no memory."""
        if isinstance(self._policy, OnnxPolicy):
            self._policy.memory = None

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller` and `answered`; reads the observation only."""
        return answered(self.name, lambda: self._policy(observation), self._craft, len(observation))


class ObjectPolicy(UserPolicy):
    """A policy that is an object: a Stable-Baselines3 model, a torch module, or a function of observations.

    Args:
        policy: the object; see `policy_of`.
        craft: spacecraft that it flies.
        task: task that it was trained for.
        name: name in tables; None: the name of its class or function.

    Raises:
        ConfigError: the object is no policy, or one for other observations or actions.
    """

    def __init__(
        self, policy: object, craft: Spacecraft, task: Task, name: str | None = None
    ) -> None:
        self._given = policy
        own = getattr(policy, "__name__", type(policy).__name__)
        super().__init__(name or own, policy_of(policy, craft, task), craft, task)

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process gets a copy of the object, pickled by value if its class is defined in a script."""
        content = cloudpickle.dumps((self._given, self._craft, self._task, self.name))
        return _unpickled_policy, (content,)


def _unpickled_policy(content: bytes) -> ObjectPolicy:
    """Copy of an `ObjectPolicy` that another process of this session pickled."""
    policy, craft, task, name = cloudpickle.loads(content)
    return ObjectPolicy(policy, craft, task, name)


def policy_of(policy: Any, craft: Spacecraft, task: Task) -> Policy:
    """The policy function of an object: SB3's ``predict``, a torch module's call, or the function itself.

    Observations of an SB3 model behind a VecNormalize are scaled by it.

    Raises:
        ConfigError: it is none of these, or its spaces are not those of the task and the craft.
    """
    if callable(getattr(policy, "predict", None)):
        observation_space, action_space = (
            getattr(policy, name, None) for name in ("observation_space", "action_space")
        )
        if observation_space is not None and action_space is not None:
            _check_spaces(
                f"the {type(policy).__name__}", observation_space, action_space, craft, task
            )
        environment = getattr(policy, "get_vec_normalize_env", lambda: None)()
        scaled = np.asarray if environment is None else environment.normalize_obs
        return lambda observation: policy.predict(scaled(observation), deterministic=True)[0]
    if not callable(policy) or isinstance(policy, type):
        raise ConfigError(
            "a policy is a Stable-Baselines3 model, a torch module or a function of observations "
            f"(N, width), got {brief(policy)}."
        )
    return partial(_called, policy)


def _called(function: Callable[[Any], Any], observation: np.ndarray) -> Any:
    """Result of a torch module or a function."""
    import torch

    if not isinstance(function, torch.nn.Module):
        return function(observation)
    with torch.no_grad():
        return function(torch.from_numpy(observation)).cpu().numpy()


def answered(who: str, ask: Callable[[], Any], craft: Spacecraft, count: int) -> np.ndarray:
    """Commands (N, commands) of a user's code for N observations.

    Raises:
        ConfigError: the code fails, or its commands are not those of the craft's actuators.
    """
    try:
        commands = np.asarray(ask(), dtype=np.float64)
    except (Exception, SystemExit) as error:  # somebody else's code raises anything
        raise ConfigError(
            f"{who} failed: {type(error).__name__}: {_whole(error)}{where_raised(error)}."
        ) from error
    shape = count, craft.command_count
    if commands.shape != shape:
        raise ConfigError(
            f"{who} must answer {count} observations with commands of shape "
            f"{shape}, got {commands.shape}."
        )
    try:
        check_commands(craft, commands, count)
    except ConfigError as error:
        raise ConfigError(
            f"{who} answers with commands that {craft.name} does not take: {error} Probabilities have to be "
            "rounded, and densities clipped, by the policy."
        ) from None
    return clipped(craft, commands)


_LONGEST_REASON = 400
"""Largest number of characters of an exception's text in a message."""


def _whole(error: BaseException) -> str:
    """The text of another library's exception in one line, because its first line may not hold the cause."""
    text = " ".join(str(error).split()).rstrip(".")
    return text if len(text) <= _LONGEST_REASON else f"{text[:_LONGEST_REASON]} ..."


def is_user_policy(spec: str) -> bool:
    """Whether a text names a policy of `USER_POLICIES`."""
    return spec.partition(":")[0] in _LOADERS and ":" in spec


def split_policy(spec: str) -> tuple[str, str]:
    """Split the text of a policy into what `user_policy` opens and its TASK-2d@SPACECRAFT, "" if it has none.

    >>> split_policy("sb3:policy.zip:go-to-pose-2d@atmos")
    ('sb3:policy.zip', 'go-to-pose-2d@atmos')
    >>> split_policy("python:mine:act")
    ('python:mine:act', '')
    """
    kind, _, rest = spec.partition(":")
    if kind == "python":
        module, _, rest = rest.partition(":")
        function, _, setup = rest.partition(":")
        return f"python:{module}:{function}", setup
    if Path(rest).is_file():
        return spec, ""
    drive, rest = os.path.splitdrive(rest)  # on Windows it has a colon, too
    file, _, setup = rest.partition(":")
    return f"{kind}:{drive}{file}", setup


def user_policy(spec: str, craft: Spacecraft, task: Task, trust: bool = False) -> UserPolicy:
    """Load the policy that ``sb3:FILE.zip``, ``onnx:FILE`` or ``python:MODULE:FUNCTION`` names.

    Loading a module runs its code. So does an SB3 file that RANS did not write, because it is a pickle; it is
    opened only with ``trust``.

    Raises:
        ConfigError: the policy cannot be loaded, or has other observations or actions than task and craft.
    """
    kind, _, name = spec.partition(":")
    if not is_user_policy(spec) or not name:
        raise ConfigError(f"there is no policy {brief(spec)}; known are {USER_POLICIES}.")
    return UserPolicy(spec, _LOADERS[kind](name, craft, task, trust), craft, task, trust)


def _sb3(name: str, craft: Spacecraft, task: Task, trust: bool) -> Policy:
    """Policy of any SB3 algorithm: the file names the policy's class; a VecNormalize beside it scales for it."""
    from stable_baselines3.common.save_util import load_from_zip_file

    _check_file(name)
    if not trust:
        return _ours(Path(name), craft, task)
    try:
        data, parameters, _ = load_from_zip_file(name, device="cpu")
        assert data is not None  # every SB3 file has data
        spaces = data["observation_space"], data["action_space"]
        policy = data["policy_class"](*spaces, lambda _: 0.0, **data["policy_kwargs"])
        policy.load_state_dict(parameters["policy"])
    except Exception as error:  # a damaged pickle raises anything
        reason = first_line(error).partition(". ")[
            0
        ]  # The rest is torch's advice to unpickle the file without checks.
        raise ConfigError(f"{name} is no policy that Stable-Baselines3 saved: {reason}.") from error
    policy.set_training_mode(False)
    _check_spaces(name, *spaces, craft, task)
    scaled = _normalization(Path(name), craft, task)
    if scaled is None:
        scaled = np.asarray
        if _met_scaled_observations(data, craft):
            warnings.warn(
                f"{name} was trained on observations that were scaled, as SB3's VecNormalize does, and its file "
                "does not hold the scales: observations are passed to it as they are. Save the VecNormalize "
                f"as {Path(name).stem}_vecnormalize.pkl beside it.",
                stacklevel=2,
            )
    return lambda observation: policy.predict(scaled(observation), deterministic=True)[0]


def _statistics_file(file: Path) -> Path | None:
    """File of the VecNormalize that a policy's file was saved with, by the names that SB3 and its zoo use."""
    checkpoint = re.sub(r"_(\d+_steps)$", r"_vecnormalize_\1", file.stem)
    names = f"{file.stem}_vecnormalize.pkl", f"{checkpoint}.pkl", "vecnormalize.pkl"
    return next(
        (candidate for name in names if (candidate := file.with_name(name)).is_file()), None
    )


_LARGEST_STATISTICS = 2**24
"""Bytes: means and variances of some numbers, and what SB3 keeps beside them of thousands of environments."""


def _normalization(file: Path, craft: Spacecraft, task: Task) -> Policy | None:
    """Normalisation of observations by the VecNormalize beside a trusted SB3 file; None: there is none."""
    statistics = _statistics_file(file)
    if statistics is None:
        return None
    content = read_bytes(statistics, _LARGEST_STATISTICS)
    try:
        normalizer = pickle.loads(content)
        shape = np.shape(normalizer.obs_rms.mean) if normalizer.norm_obs else None
        normalize: Policy = normalizer.normalize_obs
    except Exception as error:  # a damaged pickle raises anything
        raise ConfigError(
            f"{statistics} lies beside {file.name} and is no VecNormalize that Stable-Baselines3 saved: "
            f"{first_line(error).rstrip('.')}."
        ) from error
    width = observation_width(task, craft.dimension)
    if shape not in (None, (width,)):
        raise ConfigError(
            f"{statistics} scales observations of shape {shape}, but {craft.name} has ({width},): it is "
            "another policy's."
        )
    return normalize


def _met_scaled_observations(data: dict[str, Any], craft: Spacecraft) -> bool:
    """Whether the observations that an SB3 file holds are not a task's own.

    Off-policy algorithms keep those before the scaling. Of others the last ones are kept, whose first columns
    are a row of a rotation.
    """
    if data.get("_last_original_obs") is not None:
        return True
    last = data.get("_last_obs")
    if not isinstance(last, np.ndarray) or last.ndim != 2:
        return False
    lengths = np.linalg.norm(last[:, : craft.dimension], axis=1)
    return bool(np.any(np.abs(lengths - 1.0) > 1e-3))  # far above the rounding of float32


def _ours(file: Path, craft: Spacecraft, task: Task) -> Policy:
    """Policy of an agent that RANS wrote, which holds no pickle."""
    from rans.fast.agent_files.agent import is_agent, read_policy
    from rans.policy.predict import policy_spaces, predict

    if not is_agent(file):
        raise ConfigError(
            f"sb3:{file} is a pickle: opening it runs whatever code is in it. If you know who "
            "made it, add --trust."
        )
    if statistics := _statistics_file(file):
        raise ConfigError(
            f"{statistics}, beside {file.name}, has the scales of its observations (VecNormalize) and is a pickle: "
            "opening it runs whatever code is in it. If you know who made it, add --trust; if it is another "
            "policy's, move it away."
        )
    network = read_policy(file).network
    _check_spaces(str(file), *policy_spaces(network.architecture), craft, task)
    return lambda observation: np.stack(
        of_outputs(craft, tuple(predict(network, observation)[0].T)), axis=1
    )


def _check_spaces(
    name: str, observation_space: Any, expected: Any, craft: Spacecraft, task: Task
) -> None:
    from gymnasium.spaces import MultiBinary, MultiDiscrete

    width = observation_width(task, craft.dimension)
    count = craft.command_count
    if observation_space.shape != (width,):
        raise ConfigError(
            f"{name} observes {observation_space.shape}, but {craft.name} has ({width},)."
        )
    accepted = MultiDiscrete([2] * count), MultiBinary(count), action_space(craft)
    if expected not in accepted:
        takes = craft.actuators.allowed if not craft.wheels else allowed(craft)
        wheels = f" and {craft.wheel_count} reaction wheels" if craft.wheels else ""
        raise ConfigError(
            f"{name} acts by {expected}, but {craft.name} has {craft.thruster_count} thrusters{wheels}, which "
            f"take {takes}: {', '.join(dict.fromkeys(map(str, accepted)))}."
        )


def _onnx(name: str, craft: Spacecraft, task: Task, _: bool) -> Policy:
    """Policy of an ONNX network, whose first input is the observation and whose first output is the command.

    Its memory, (N, m), is the second input and the second output, if there is one.
    """
    onnxruntime = require("onnxruntime")
    _check_file(name)
    try:
        session = onnxruntime.InferenceSession(name, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors have no common class
        raise ConfigError(f"{name} is no ONNX network: {_whole(error)}.") from error
    inputs = [node.name for node in session.get_inputs()]
    if not 1 <= len(inputs) <= min(2, len(session.get_outputs())):
        raise ConfigError(
            f"{name} must have one input, the observation, or a second one, a memory that is also "
            f"its second output, got {', '.join(inputs)}."
        )
    width = observation_width(task, craft.dimension)
    shape = session.get_inputs()[0].shape
    if len(shape) == 2 and isinstance(shape[1], int) and shape[1] != width:
        raise ConfigError(
            f"{name} observes {shape[1]} numbers, but {craft.name} has {width} for "
            f"{type(task).__name__}."
        )
    return OnnxPolicy(session, name)


_ALONE = 16
"""Observations of the first batch of a network that are asked for alone."""


class OnnxPolicy:
    """Policy of a session of ONNX Runtime; its memory is None, which means zeros, when episodes begin.

    A network that was exported for a batch of one is run for one observation after the other. Of the first batch
    it is asked twice, and once for single observations.

    Raises:
        ConfigError: its answers differ then.
    """

    def __init__(self, session: Any, file: str = "the network") -> None:
        self._session = session
        self._file = file
        self._is_checked = False
        self.memory: np.ndarray | None = None
        self._names = [node.name for node in session.get_inputs()]
        self._is_single = session.get_inputs()[0].shape[:1] == [1]

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Commands (N, thrusters) for observations (N, width)."""
        inputs = {self._names[0]: observation}
        if len(self._names) == 2:
            if self.memory is None:
                width = self._session.get_inputs()[1].shape[1]
                self.memory = np.zeros((len(observation), width), np.float32)
            inputs[self._names[1]] = self.memory
        command, *after = self._run(inputs)
        if not self._is_checked and len(observation) > 1:
            self._check(inputs, command)
            self._is_checked = True
        self.memory = after[0] if len(self._names) == 2 else None
        return command

    def _check(self, inputs: dict[str, np.ndarray], command: np.ndarray) -> None:
        """Reject (`ConfigError`) a network that answers otherwise a second time, or to one observation alone."""
        again = self._run(inputs)[0]
        if not np.array_equal(again, command, equal_nan=True):
            raise ConfigError(
                f"{self._file} answers the same observations differently a second time: the usual cause is a "
                "dropout, or an action that is sampled. Export the deterministic policy, in evaluation mode."
            )
        rows = range(min(_ALONE, len(command)))
        alone = [self._run({name: x[k : k + 1] for name, x in inputs.items()})[0][0] for k in rows]
        # Sums in another order differ by rounding, which may turn a choice between 0 and 1 in one of several.
        off = [
            not np.allclose(action, command[k], rtol=1e-3, atol=1e-3)
            for k, action in enumerate(alone)
        ]
        if sum(off) > 1:
            raise ConfigError(
                f"{self._file} answers an observation alone otherwise than among {len(command)}: its flights would "
                "mix. The usual cause is a batch normalization that was exported in training mode."
            )

    def _run(self, inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
        """Outputs of the network for inputs by name, in the order of their rows."""
        if not self._is_single:
            return self._session.run(None, inputs)
        count = len(inputs[self._names[0]])
        rows = [
            self._session.run(None, {name: x[k : k + 1] for name, x in inputs.items()})
            for k in range(count)
        ]
        return [np.concatenate(output) for output in zip(*rows, strict=True)]


def _python(name: str, *_: object) -> Policy:
    module, colon, function = name.rpartition(":")
    if not module or not colon or not function:
        raise ConfigError(
            f"python:{name} must name a module and a function, as python:my_policy:act."
        )
    try:
        policy = resolve_typed(name)
    except ConfigError as error:
        raise ConfigError(f"python:{name} cannot be imported: {error}") from error
    if not callable(policy):
        raise ConfigError(f"python:{name} is a {type(policy).__name__}, no function.")
    return policy


def _check_file(name: str) -> None:
    if not Path(name).is_file():
        raise ConfigError(f"there is no file {name}.")


_LOADERS: dict[str, Callable[[str, Spacecraft, Task, bool], Policy]] = {
    "sb3": _sb3,
    "onnx": _onnx,
    "python": _python,
}
