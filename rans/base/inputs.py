"""Arrays of a user or of another library, of NumPy, torch or Python: converted in one place, or refused.

Every door takes actions, observations and ends of episodes through these functions (`tests/test_doors.py`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rans.base.errors import ConfigError, brief


def dense(value: Any) -> Any:
    """A torch tensor detached from its graph, without lazy conjugation; other values are returned as is.

    Raises:
        ConfigError: the tensor is sparse, nested, quantized or on the meta device.
    """
    if not hasattr(value, "detach"):
        return value
    kinds = {
        "nested": value.is_nested,
        "quantized": value.is_quantized,
        "meta": value.is_meta,
        str(value.layout): str(value.layout) != "torch.strided",
    }
    if odd := [kind for kind, true in kinds.items() if true]:
        raise ConfigError(
            f"actions, observations and masks of torch must be ordinary tensors, got a {odd[0]} one; "
            "to_dense() converts most others."
        )
    return value.detach().resolve_conj().resolve_neg()


def array(what: str, values: Any) -> np.ndarray:
    """Array of values, in a dtype that torch supports too; a tensor is copied to the processor.

    Raises:
        ConfigError: rows have different lengths.
    """
    values = dense(values)
    if hasattr(values, "detach"):
        return (values.cpu() if values.is_complex() else values.cpu().double()).numpy()
    try:
        values = np.asarray(values)
    except ValueError as error:
        raise ConfigError(
            f"{what} must be numbers in rows of one length, got {brief(values)}."
        ) from error
    wide = values.dtype.kind == "f" and values.dtype.itemsize > 8
    return values.astype(np.float64 if wide else values.dtype.newbyteorder("="), copy=False)


def observation_array(observation: Any) -> np.ndarray:
    """Observations (..., width) as float32, in which networks were trained.

    Raises:
        ConfigError: they are no numbers, or a number alone.
    """
    result = array("observations", observation)
    if result.dtype.kind not in "biuf" or not result.ndim:
        raise ConfigError(
            f"an observation is an array of numbers, (width,) or (N, width), got {brief(observation)}."
        )
    return result.astype(np.float32, copy=False)


def episode_starts(starts: Any, count: int) -> np.ndarray | None:
    """Where episodes begin, (N,) bool, of truth values or of zeros and ones, (N,) or (N, 1); None: nowhere.

    Raises:
        ConfigError: they are of another number or kind.
    """
    if starts is None:
        return None
    result = array("episode_start", starts)
    if result.size != count or result.ndim > 2 or not np.isin(result, (0, 1)).all():
        raise ConfigError(
            f"episode_start must be {count:,} times true or false, one for each observation, got {brief(starts)}."
        )
    return result.reshape(count).astype(bool)
