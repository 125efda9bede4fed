"""What an engine is given by its callers: refused before anything has moved."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from torch import Tensor

from rans.errors import ConfigError, checked, counted


def check_actions(action: object, count: int, thrusters: int, with_range: bool) -> None:
    """Refuse (`ConfigError`) actions that are no tensor (environments, thrusters).

    With their range also numbers that are none from 0 to 1, of a tensor on the CPU.
    """
    tensor = checked("actions", action, Tensor)
    given = tuple(tensor.shape)
    if given != (count, thrusters):
        raise ConfigError(
            f"actions must have the shape {(count, thrusters)} (environments, "
            f"thrusters), got {given}."
        )
    if with_range:
        _check_range(tensor.numpy())


def _check_range(actions: np.ndarray) -> None:
    """Refuse (`ConfigError`) what no thruster can be told; NaN is one of these.

    It takes half a per cent of a step of 16,384 environments.
    """
    least = actions.min()
    most = actions.max()
    if not (least >= 0 and most <= 1):
        raise ConfigError(
            f"actions must be numbers from 0 (shut) to 1 (open), got numbers from {least} to {most}; "
            "the usual cause is a policy's output that nobody clipped or rounded."
        )


def check_seeds(seed: int | Sequence[int] | None, members: int) -> None:
    """Refuse (`ConfigError`) several seeds that are not one for each member."""
    if isinstance(seed, Sequence) and len(seed) not in (1, members):
        raise ConfigError(
            f"an engine of {counted(members, 'member')} is reset by one seed or by one "
            f"for each, got {len(seed)}."
        )
