"""Mass properties that may differ from spacecraft to spacecraft."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch

from rans.errors import ConfigError
from rans.model.dynamics import MassProperties


def in_memory(body: MassProperties, nominal: MassProperties, count: int,
              field: Callable[[Any], Any]) -> MassProperties:
    """The same with a field in memory of its own wherever there is not one number for all.

    Args:
        body: numbers, or arrays or tensors (N,).
        nominal: those of the craft.
        count: N.
        field: copies an array or a tensor.

    Raises:
        ConfigError: a mass is not positive, an inertia is that of no rigid body, a number is not finite,
            there are not N of them, or the craft is not of that dimension.
    """
    if len(body.inertia) != len(nominal.inertia):
        raise ConfigError(f"the body has {len(body.inertia)} moments of inertia; in "
                          f"{'the plane it has 1' if len(nominal.inertia) == 1 else 'space it has 6'}.")

    def placed(name: str, value: Any, positive: bool) -> Any:
        values = torch.as_tensor(value, dtype=torch.float64)
        if values.shape not in ((), (count,)):
            raise ConfigError(f"{name} must be one number or one for each of {count:,} spacecraft, got an "
                              f"array of shape {tuple(values.shape)}.")
        wrong = ~values.isfinite() | (values <= 0) & positive
        if wrong.any():
            raise ConfigError(f"{name} must be finite{' and > 0' if positive else ''}, got "
                              f"{float(values[wrong].flatten()[0])!r}.")
        return field(values) if values.ndim else float(value)

    names = ("I_zz",) if len(body.inertia) == 1 else ("I_xx", "I_xy", "I_xz", "I_yy", "I_yz", "I_zz")
    result = MassProperties(
        placed("mass", body.mass, True),
        tuple(placed(name, value, name[2] == name[3])
              for name, value in zip(names, body.inertia, strict=True)))
    if len(names) == 6:
        _check_rigid(body.inertia)
    return result


def _check_rigid(inertia: Sequence[Any]) -> None:
    """As in `rans.model.spacecraft.check`, but for rounding to float32, in which bodies may be given."""
    entries = torch.broadcast_tensors(*(torch.as_tensor(x).to("cpu", torch.float64) for x in inertia))
    xx, xy, xz, yy, yz, zz = entries
    low, middle, high = torch.linalg.eigvalsh(torch.stack((xx, xy, xz, xy, yy, yz, xz, yz, zz), dim=-1)
                                              .unflatten(-1, (3, 3))).unbind(-1)
    wrong = (low <= 0) | (high > (low + middle) * (1 + 1e-6))
    if wrong.any():
        moments = ", ".join(f"{float(moment[wrong].flatten()[0]):.4g}" for moment in (low, middle, high))
        raise ConfigError("principal moments of inertia must be > 0 and none above the sum of the other two, "
                          f"got {moments} kg m^2.")
