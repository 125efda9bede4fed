"""Policies of other libraries: a Stable-Baselines3 model or file, a torch module, an ONNX network, a function.

A policy is more than its network. Each of its parts is flown with it, or the policy is refused in a sentence:

- memory: the states that ``predict`` returns, and those that an ONNX network takes and gives, are carried from one
  control period to the next and begin anew with an episode; a recurrent layer with a hidden state is refused;
- normalization: a VecNormalize around a model, or beside its file, scales its observations; other wrappers that
  change observations or actions are refused by their names;
- stacked observations, another order or scale of actions: the spaces must be those of the task and the craft;
- numbers: observations are float32, as RANS's environments give them.

Observations are (N, width) float32, actions (N, n); who adds a kind adds its refusals to
`tests/test_foreign_policy.py`.
"""

from __future__ import annotations

import inspect
import pickle
import re
import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from rans import RansWarning
from rans.base.inputs import array
from rans.effectors.commands import allowed
from rans.extend import (
    ConfigError,
    ForeignPolicy,
    Spacecraft,
    Task,
    action_space,
    brief,
    first_line,
    is_installed,
    observation_width,
    read_bytes,
    require,
)

Decision = tuple[Any, Any]
"""What a `ForeignPolicy` gives."""


def policy_of(policy: Any, craft: Spacecraft, task: Task, _: bool = False) -> ForeignPolicy:
    """The policy of an object: SB3's ``predict``, a torch module's call, or a function of observations.

    Raises:
        ConfigError: it is none of these, its spaces are not those of the task and the craft, or it has a part that
            cannot be flown.
    """
    who = f"the {type(policy).__name__}"
    if callable(getattr(policy, "predict", None)):
        spaces = [getattr(policy, name, None) for name in ("observation_space", "action_space")]
        if None not in spaces:
            _check_spaces(who, spaces[0], spaces[1], craft, task)
        _check_wrappers(who, policy)
        environment = getattr(policy, "get_vec_normalize_env", lambda: None)()
        scale = None if environment is None else environment.normalize_obs
        if scale is None:
            _warn_of_scales(who, getattr(policy, "_last_obs", None), craft)
        return _predicting(who, policy, scale)
    if not callable(policy) or isinstance(policy, type):
        raise ConfigError(
            "a policy is a Stable-Baselines3 model, a torch module or a function of observations "
            f"(N, width), got {brief(policy)}."
        )
    _check_module(who, policy)
    return lambda observation, memory, starts: (_called(policy, observation), None)


def _predicting(
    who: str, policy: Any, scale: Callable[[np.ndarray], np.ndarray] | None
) -> ForeignPolicy:
    """The policy of an object with ``predict``, whose second result is its memory.

    Observations (N, width) are scaled first; the memory goes in and comes out as the object has it.
    """
    try:
        parameters = inspect.signature(policy.predict).parameters
    except (TypeError, ValueError):  # a function of a compiled module
        parameters = {}
    anything = not parameters or any(
        parameter.kind is inspect.Parameter.VAR_KEYWORD for parameter in parameters.values()
    )
    takes = [name for name in ("state", "episode_start") if anything or name in parameters]

    def decide(observation: np.ndarray, memory: Any, starts: np.ndarray) -> Decision:
        """Actions and next memory for observations (N, width); ``starts`` (N,) is true where an episode begins.

        Arguments that ``predict`` does not take are left out, as policies of others lack them.
        """
        options = {
            name: value
            for name, value in (("state", memory), ("episode_start", starts))
            if name in takes
        }
        scaled = observation if scale is None else scale(observation)
        result = policy.predict(scaled, deterministic=True, **options)
        if not isinstance(result, tuple) or len(result) != 2:
            raise ConfigError(
                f"predict of {who} must return actions and a state, which is None without a memory, got "
                f"{brief(type(result).__name__)}."
            )
        commands, after = result
        if after is not None and "state" not in takes:
            raise ConfigError(
                f"predict of {who} returns a state and takes none: give it the arguments state and episode_start."
            )
        return commands, after

    return decide


_CHANGING = ("ObservationWrapper", "ActionWrapper", "VecFrameStack", "VecTransposeImage")
"""Classes of wrappers of Gymnasium and of Stable-Baselines3 that change what a policy reads or commands."""


def _wrappers(environment: Any) -> Iterator[Any]:
    """Wrappers around the environments of a model, of Stable-Baselines3 and then of Gymnasium."""
    while (inner := getattr(environment, "venv", None)) is not None:
        yield environment
        environment = inner
    environment = next(iter(getattr(environment, "envs", [])), None)
    while (inner := getattr(environment, "env", None)) is not None:
        yield environment
        environment = inner


def _check_wrappers(who: str, policy: Any) -> None:
    """Refuse (`ConfigError`) a model behind a wrapper that changes observations or actions, but VecNormalize."""
    environment = getattr(policy, "get_env", lambda: None)()
    for wrapper in _wrappers(environment):
        if any(kind.__name__ in _CHANGING for kind in type(wrapper).__mro__):
            raise ConfigError(
                f"{who} was trained behind {type(wrapper).__name__}, which changes observations or actions "
                "and would not be flown: give a function of observations that does the same and asks the model."
            )


_RECURRENT = ("RNN", "LSTM", "GRU", "RNNCell", "LSTMCell", "GRUCell")
"""Layers with a state, as torch and ONNX name them."""


def _check_module(who: str, module: Any) -> None:
    """Refuse (`ConfigError`) a torch module whose memory is out of reach."""
    for layer in getattr(module, "modules", list)():
        # A module of TorchScript has one class for all layers, and the layer's own name.
        kind = getattr(layer, "original_name", type(layer).__name__)
        if kind in _RECURRENT:
            raise ConfigError(
                f"{who} has a memory ({kind}), and a module is asked with the observation alone: give an "
                "object whose predict(observation, state, episode_start, deterministic) returns actions and the "
                "state after them."
            )


def _called(function: Callable[[Any], Any], observation: np.ndarray) -> Any:
    """Commands of a torch module, on its own device, or of a function, for observations (N, width).

    A module gets the precision of its weights. The result is checked by `UserPolicy`, not here.
    """
    import torch

    if isinstance(function, torch.nn.Module):
        floats = (x for x in function.parameters() if x.is_floating_point())
        with torch.no_grad():
            result: Any = function(torch.as_tensor(observation).to(next(floats, torch.zeros(0))))
    else:
        result = function(observation)
    if not isinstance(result, list) and not hasattr(result, "__array__"):
        raise ConfigError(
            f"a policy that is called answers with commands alone, an array (N, commands), got a "
            f"{type(result).__name__}: one with a memory takes and gives it in predict, as in Stable-Baselines3."
        )
    return array("commands", result)


# Stable-Baselines3


def of_sb3(name: str, craft: Spacecraft, task: Task, trust: bool) -> ForeignPolicy:
    """Policy of any SB3 algorithm: the file names the policy's class; a VecNormalize beside it scales for it."""
    from stable_baselines3.common.save_util import load_from_zip_file

    _check_file(name)
    if not trust:
        raise ConfigError(
            f"sb3:{name} is a pickle: opening it runs whatever code is in it. If you know who made it, add "
            "--trust; what rans export writes flies by the name of its folder."
        )
    try:
        data, parameters, _ = load_from_zip_file(name, device="cpu")
        assert data is not None  # every SB3 file has data
        spaces = data["observation_space"], data["action_space"]
        # State-dependent exploration is the algorithm's own setting, and changes the layers of its policy.
        options: dict[str, Any] = {"use_sde": True} if data.get("use_sde") else {}
        kind = data["policy_class"]
        if (
            "lr_schedule" in inspect.signature(kind).parameters
        ):  # no policy without a gradient has one
            options["lr_schedule"] = lambda _: 0.0
        policy = kind(*spaces, **options | data["policy_kwargs"])
        # torch.compile writes this before the names of what it wraps.
        saved: Any = parameters["policy"]
        weights = {name.replace("_orig_mod.", ""): x for name, x in saved.items()}
        policy.load_state_dict(weights)
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"{name} needs the package {error.name}, with which it was saved, and which is not here: install it, "
            "or load and save the policy where it is."
        ) from error
    except Exception as error:  # a damaged pickle raises anything
        reason = first_line(error).partition(". ")[
            0
        ]  # The rest is torch's advice to unpickle the file without checks.
        raise ConfigError(f"{name} is no policy that Stable-Baselines3 saved: {reason}.") from error
    policy.set_training_mode(False)
    _check_spaces(name, *spaces, craft, task)
    scale = _normalization(Path(name), craft, task)
    if scale is None:
        _warn_of_scales(name, data.get("_last_obs"), craft)
    return _predicting(name, policy, scale)


def _statistics_file(file: Path) -> Path | None:
    """File of the VecNormalize that a policy's file was saved with, by the names that SB3 and its zoo use."""
    checkpoint = re.sub(r"_(\d+_steps)$", r"_vecnormalize_\1", file.stem)
    names = f"{file.stem}_vecnormalize.pkl", f"{checkpoint}.pkl", "vecnormalize.pkl"
    return next(
        (candidate for name in names if (candidate := file.with_name(name)).is_file()), None
    )


_LARGEST_STATISTICS = 2**24
"""Bytes: means and variances of some numbers, and what SB3 keeps beside them of thousands of environments."""


def _normalization(
    file: Path, craft: Spacecraft, task: Task
) -> Callable[[np.ndarray], np.ndarray] | None:
    """Normalisation of observations by the VecNormalize beside a trusted SB3 file; None: there is none.

    It is unpickled, which runs code: only for files that the user trusts. Observations are (N, width).
    """
    statistics = _statistics_file(file)
    if statistics is None:
        return None
    content = read_bytes(statistics, _LARGEST_STATISTICS)
    try:
        normalizer = pickle.loads(content)
        shape = np.shape(normalizer.obs_rms.mean) if normalizer.norm_obs else None
        normalize: Callable[[np.ndarray], np.ndarray] = normalizer.normalize_obs
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


def _warn_of_scales(who: str, last: Any, craft: Spacecraft) -> None:
    """Warn where the last observations (N, width) of a training are not a task's own, as behind VecNormalize.

    The first columns of an observation are a row of a rotation, of length 1.
    """
    if not isinstance(last, np.ndarray) or last.ndim != 2:
        return
    lengths = np.linalg.norm(last[:, : craft.dimension], axis=1)
    if np.any(np.abs(lengths - 1.0) > 1e-3):  # far above the rounding of float32
        warnings.warn(
            f"{who} was trained on observations that were scaled, as SB3's VecNormalize does, and comes without "
            "the scales: observations are passed to it as they are. Save the VecNormalize as "
            "NAME_vecnormalize.pkl beside the file NAME.zip and name sb3:NAME.zip, or give PPO.load(..., env=...) "
            "the environment with its scales.",
            RansWarning,
            stacklevel=2,
        )


def _check_spaces(
    name: str, observation_space: Any, expected: Any, craft: Spacecraft, task: Task
) -> None:
    """Reject (`ConfigError`) a policy whose observation or action is of another size or kind than here."""
    from gymnasium.spaces import MultiBinary, MultiDiscrete

    width = observation_width(task, craft.dimension)
    count = craft.command_count
    if observation_space.shape != (width,):
        wide = observation_space.shape[-1] if observation_space.shape else 0
        stacked = (
            ": the usual cause are stacked observations (VecFrameStack), which are not flown"
            if wide > width and wide % width == 0
            else ""
        )
        raise ConfigError(
            f"{name} observes {observation_space.shape}, but {craft.name} has ({width},){stacked}."
        )
    accepted: list[Any] = [MultiDiscrete([2] * count), MultiBinary(count), action_space(craft)]
    if expected not in accepted:
        takes = craft.actuators.allowed if not craft.wheels else allowed(craft)
        wheels = f" and {craft.wheel_count} reaction wheels" if craft.wheels else ""
        raise ConfigError(
            f"{name} acts by {expected}, but {craft.name} has {craft.thruster_count} thrusters{wheels}, which "
            f"take {takes}: {', '.join(dict.fromkeys(map(str, accepted)))}."
        )


# ONNX


def of_onnx(name: str, craft: Spacecraft, task: Task, _: bool) -> ForeignPolicy:
    """Policy of an ONNX network, whose first input is the observation and whose first output is the command.

    Its states are the inputs after the first, (N, m) each, and the outputs after the command give them again in the
    same order. The name is that of a file; of unknown shapes the first run decides.
    """
    onnxruntime = require("onnxruntime")
    _check_file(name)
    _bound_memory()
    options = onnxruntime.SessionOptions()
    options.add_session_config_entry("session.use_env_allocators", "1")
    try:
        session = onnxruntime.InferenceSession(name, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors have no common class
        raise ConfigError(f"{name} is no ONNX network: {_reason(error)}.") from error
    inputs = session.get_inputs()
    if not inputs:
        raise ConfigError(f"{name} has no input, and the first one must be the observation.")
    width = observation_width(task, craft.dimension)
    shape = inputs[0].shape
    if len(shape) not in (0, 2) or (isinstance(shape[0], int) and shape[0] > 1):
        raise ConfigError(
            f"{name} takes observations of shape {shape}, and a flight gives it (N, {width}), one row for each "
            "spacecraft: export it with two axes, of which the first has any length or 1."
        )
    if len(shape) == 2 and isinstance(shape[1], int) and shape[1] != width:
        raise ConfigError(
            f"{name} observes {shape[1]} numbers, but {craft.name} has {width} for "
            f"{type(task).__name__}."
        )
    return OnnxPolicy(session, name)


_NUMBERS = {"tensor(double)": np.float64, "tensor(float16)": np.float16}
"""Kinds of numbers that a network takes, by ONNX Runtime's names; others take float32."""


class OnnxPolicy:
    """Policy of a session of ONNX Runtime.

    A network that was exported for a batch of one is run for one observation after the other.

    Raises:
        ConfigError: its states are not given as they are taken, a layer keeps a state that it does not give, or an
            operation may take any time.
    """

    def __init__(self, session: Any, file: str = "the network") -> None:
        self._session = session
        self._file = file
        inputs: list[Any] = session.get_inputs()
        first, states = inputs[0], inputs[1:]
        command, *givens = session.get_outputs()[: len(inputs)]
        self._observation = first.name
        self._types = {one.name: _NUMBERS.get(one.type, np.float32) for one in inputs}
        self._is_single = bool(first.shape[:1] == [1])
        self._asked_for: list[str] = [command.name, *(one.name for one in givens)]
        self._widths: dict[str, int] = {
            taken.name: self._width(taken, given) for taken, given in zip_longest(states, givens)
        }
        """Numbers of each state, by the name of its input."""
        self._check_layers(bool(states))

    def _width(self, taken: Any, given: Any) -> int:
        """Numbers of a state, which is given as it is taken; one row at a time sets `_is_single`."""
        shapes = [list(port.shape) for port in (taken, given) if port is not None]
        rows, width = shapes[0] if len(shapes[0]) == 2 else (0, 0)
        is_whole = isinstance(width, int) and 0 < width <= _LARGEST_STATE
        if rows == 0 or not is_whole or len(shapes) < 2 or shapes[1][1:] != [width]:
            after = "no output" if given is None else f"{shapes[1]} given as {given.name}"
            raise ConfigError(
                f"the state {taken.name} of {self._file} must be (N, m), and given back in the same shape after "
                f"the command, in the order of the inputs, got {shapes[0]} taken and {after}."
            )
        self._is_single |= rows == 1
        return width

    def _check_layers(self, has_states: bool) -> None:
        """Refuse (`ConfigError`) a network with a loop, or without states and with a recurrent layer."""
        if not is_installed("onnx") or not Path(self._file).is_file():
            return
        import onnx

        content = read_bytes(Path(self._file), _LARGEST_NETWORK)
        model = onnx.load_model_from_string(content)
        kinds = {node.op_type for node in _nodes([model.graph, *model.functions])}
        if loops := sorted(kinds.intersection(("Loop", "Scan"))):
            raise ConfigError(
                f"{self._file} has a {loops[0]}, which may take any time, and a craft waits for no command: export "
                "it without loops."
            )
        if not has_states and (kinds := sorted(kinds.intersection(_RECURRENT))):
            raise ConfigError(
                f"{self._file} has a memory ({', '.join(kinds)}) that it neither takes nor gives, so that it would "
                "begin anew in every control period: export its states as inputs after the observation and as "
                "outputs after the command."
            )

    def __call__(self, observation: np.ndarray, memory: Any, starts: np.ndarray) -> Decision:
        """Commands (N, commands) for observations (N, width), and the states after them."""
        count = len(observation)
        states = [np.zeros((count, width), np.float32) for width in self._widths.values()]
        if memory is not None:
            states = [
                np.where(starts[:, None], zeros, state)
                for zeros, state in zip(states, memory, strict=True)
            ]
        command, *after = self._run(observation, states)
        return command, tuple(after) if states else None

    def _of_row(
        self, observation: np.ndarray, states: list[np.ndarray], row: int
    ) -> list[np.ndarray]:
        """Command for one observation, and the states after it."""
        own = [state[row : row + 1] for state in states]
        return self._asked(observation[row : row + 1], own)

    def _asked(self, observation: np.ndarray, states: list[np.ndarray]) -> list[np.ndarray]:
        named = dict(zip(self._widths, states, strict=True))
        named[self._observation] = observation
        taken = {name: x.astype(self._types[name], copy=False) for name, x in named.items()}
        try:
            return self._session.run(self._asked_for, taken)
        except Exception as error:  # as above
            raise ConfigError(f"{self._file} cannot be computed: {_reason(error)}.") from error

    def _run(self, observation: np.ndarray, states: list[np.ndarray]) -> list[np.ndarray]:
        """Commands (N, n) in the order of the observations (N, width), and the states after them.

        A network that was exported for one row gets one at a time: its answers may not depend on the batch.
        """
        if not self._is_single:
            return self._asked(observation, states)
        rows = [self._of_row(observation, states, k) for k in range(len(observation))]
        return [
            np.concatenate([np.atleast_1d(x) for x in column]) for column in zip(*rows, strict=True)
        ]


@cache
def _bound_memory() -> None:
    """Give the networks of this process one memory, of at most `_MOST_MEMORY`."""
    runtime = require("onnxruntime")
    kinds = runtime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, runtime.OrtMemType.DEFAULT
    # 1: it grows by what is asked for, not in powers of two.
    bound = runtime.OrtArenaCfg({"max_mem": _MOST_MEMORY, "arena_extend_strategy": 1})
    runtime.create_and_register_allocator(runtime.OrtMemoryInfo("Cpu", *kinds), bound)


def _reason(error: Exception) -> str:
    """What onnxruntime says, without the places in its own source."""
    text = re.sub(r"/\S*onnxruntime\S* ", "", " ".join(str(error).split())).rstrip(".")
    if asked := re.search(r"requested b\w+ of (?:size )?(\d+)", text):
        return (
            f"it asks for {int(asked[1]) / 1e9:.3g} GB, and the networks of a process may take "
            f"{_MOST_MEMORY / 1e9:.3g} GB in all"
        )
    return text[:400]


def _nodes(graphs: Iterable[Any]) -> Iterator[Any]:
    """Nodes of graphs of ONNX, and of those within them."""
    for graph in graphs:
        for node in graph.node:
            yield node
            yield from _nodes(x.g for x in node.attribute if x.HasField("g"))


_LARGEST_STATE = 2**16
"""Numbers of a state; layers in control have some hundred."""
_MOST_MEMORY = 2**31
"""Bytes of numbers in networks; a thousand layers of a control network for 10,000 craft take as much."""
_LARGEST_NETWORK = 2**26
"""Bytes of a network whose layers are looked through; networks in control have less than a thousandth of it."""


def _check_file(name: str) -> None:
    if not Path(name).is_file():
        raise ConfigError(f"there is no file {name}.")
