"""Commands of a craft: their Gymnasium space, their bounds and checks, and commands from policy outputs.

The order of commands is that of `Spacecraft.commands`, which every trained network has too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rans.base.errors import ConfigError, brief
from rans.model.fields import Field, where
from rans.model.spacecraft import CommandRange, Spacecraft

if TYPE_CHECKING:
    from gymnasium import spaces

_ROUNDING = 1e-6
"""Tolerance of a bound, such as 0.3, which single precision cannot represent and formulas miss by an ulp."""


def action_space(craft: Spacecraft) -> spaces.Space[np.ndarray]:
    """Gymnasium action space (n,): MultiDiscrete for on/off thrusters alone, else a Box of the bounds.

    Agents' files have it, and Stable-Baselines3 refuses one that differs, also in the shape of its bounds.
    """
    from gymnasium import spaces

    if not craft.is_continuous:
        return spaces.MultiDiscrete([2] * craft.command_count)
    low, high = command_bounds(craft)
    if len({*low.tolist()}) == len({*high.tolist()}) == 1:
        return spaces.Box(float(low[0]), float(high[0]), low.shape, np.float32)
    return spaces.Box(low, high, dtype=np.float32)


def command_bounds(craft: Spacecraft, dtype: Any = np.float32) -> np.ndarray:
    """Lower and upper bound of each command, (2, n)."""
    return np.array([(x.low, x.high) for x in craft.commands], dtype).T


def limits(craft: Spacecraft) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bound (n,) that `check_commands` accepts, with a tolerance where not on/off.

    What is accepted beyond a bound has to be `clipped`.
    """
    low, high = command_bounds(craft, float)
    slack = np.array(
        [0.0 if command_range.kind == "on-off" else _ROUNDING for command_range in craft.commands]
    )
    return low - slack, high + slack


def clipped(craft: Spacecraft, values: np.ndarray) -> np.ndarray:
    """Commands (..., n) that `check_commands` accepts, within their bounds."""
    if not craft.is_continuous:
        return values
    low, high = command_bounds(craft, float)
    return np.clip(values, low, high)


def per_velocity(craft: Spacecraft, period: float) -> tuple[tuple[float, ...], ...]:
    """Command of each thruster for a change of velocity of 1 m/s along each axis of B in a period, 1/(m/s).

    (thrusters, d); a negative command is one that the opposite thruster gives.

    Args:
        craft: with one throttled or pulsed thruster either way along each axis.
        period: control period, s.

    Raises:
        ConfigError: there are other thrusters, or wheels.
    """
    directions = np.array([thruster.direction for thruster in craft.thrusters])
    axes = np.eye(craft.dimension)
    needed = {tuple(row) for row in np.concatenate([axes, -axes])}
    if (
        {tuple(row) for row in directions + 0.0} != needed
        or craft.command_count != len(needed)
        or not craft.is_continuous
    ):
        raise ConfigError(
            "shares of a recommended velocity need one throttled or pulsed thruster either way along each axis "
            f"and nothing else, which {craft.name} has not; fly one such as afrl-deputy."
        )
    return tuple(
        tuple(float(x) * craft.mass / (thruster.force * period) for x in thruster.direction)
        for thruster in craft.thrusters
    )


def allowed(craft: Spacecraft) -> str:
    """Ranges of the craft's commands in words, in their order, for sentences about wrong commands."""
    parts = [f"{craft.actuators.allowed}, one per thruster"]
    if craft.wheels:
        parts.append("-1 to 1 (the largest torque on the wheel either way), one per wheel")
    further = [command for effector in craft.further_effectors for command in effector.commands]
    parts += [
        f"{command_range.low:g} to {command_range.high:g} ({command_range.name})"
        for command_range in further
    ]
    return ", then ".join(parts)


def check_commands(craft: Spacecraft, values: Any, *batch: int) -> None:
    """Reject commands that a craft cannot follow.

    Args:
        craft: spacecraft with n commands.
        values: commands (n,), or (N, n) with a batch.
        batch: N for a batch of N commands.

    Raises:
        ConfigError: the shape is wrong, or a command is out of range.
    """
    shape = (*batch, craft.command_count)
    commands = np.asarray(values)
    if (
        commands.shape != shape
        or commands.dtype.kind not in "biuf"
        or not is_possible(craft, commands)
    ):
        times = f"{batch[0]:,} times " if batch else ""
        raise ConfigError(
            f"an action must be {times}{shape[-1]} numbers, {allowed(craft)}, got "
            f"{_shown(commands, shape, values)}."
        )


def is_possible(craft: Spacecraft, values: np.ndarray) -> bool:
    """Whether every command of an array (..., n) is in range (`limits`), one answer; NaN is not."""
    choices = [
        k for k, command_range in enumerate(craft.commands) if command_range.kind == "on-off"
    ]
    if choices and not np.isin(values[..., choices], (0, 1)).all():
        return False
    if not craft.is_continuous:
        return True
    low, high = limits(craft)
    return bool(((values >= low) & (values <= high)).all())


def of_outputs(craft: Spacecraft, outputs: Sequence[Field]) -> Sequence[Field]:
    """Commands from policy outputs in [0, 1], one for each command of the craft.

    An output of 0 is the least command and 1 the largest. An on/off thruster among commands of other kinds opens
    from 0.5 on. If all ranges are 0 to 1, the outputs are the commands.
    """
    if is_identity(craft):
        return outputs
    return tuple(
        _command(command_range, x) for command_range, x in zip(craft.commands, outputs, strict=True)
    )


def is_identity(craft: Spacecraft) -> bool:
    """Whether `of_outputs` changes nothing for this craft."""
    return all(
        (command_range.low, command_range.high) == (0.0, 1.0) for command_range in craft.commands
    )


def _command(command_range: CommandRange, output: Field) -> Field:
    """A command (field) in its range from an output in [0, 1]; an on/off thruster opens from 0.5 on.

    Kernels and exports print it: 0.5 itself opens, in all of them.
    """
    if command_range.kind == "on-off":
        return where(output < 0.5, output * 0.0, output * 0.0 + 1.0)
    scaled = (
        output
        if command_range.high - command_range.low == 1.0
        else output * (command_range.high - command_range.low)
    )
    return scaled if command_range.low == 0.0 else scaled + command_range.low


def _shown(commands: np.ndarray, shape: tuple[int, ...], values: Any) -> str:
    """Text of wrong commands, an array of any shape: all values if they are few, else their shape or range."""
    if commands.size <= 32:
        return " ".join(brief(values).split())
    if commands.shape != shape:
        return f"an array of shape {commands.shape}"
    return (
        f"numbers from {commands.min()} to {commands.max()}"
        if commands.dtype.kind in "biuf"
        else f"{commands.dtype}"
    )
