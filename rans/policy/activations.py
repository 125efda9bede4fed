"""Activation functions between layers: one line each, in operations on fields.

Executors that know a function print it in their own way. The others print its formula. The gradients of an
update that need no autograd print its slope; functions without one are left to autograd.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from rans.model.fields import Field, exp, tanh, where


class Activation(NamedTuple):
    """One function of a number."""

    module: str
    """Name of the module of `torch.nn` that computes it."""
    formula: Callable[[Field], Field]
    """Activation of fields of any library."""
    slope: Callable[[Field], Field] | None = None
    """Derivative at a number, from the function's value there; None: autograd computes it."""


ACTIVATIONS = {
    "tanh": Activation("Tanh", tanh, lambda y: 1.0 - y * y),
    "elu": Activation(
        "ELU",
        lambda x: where(x > 0.0, x, exp(where(x > 0.0, x * 0.0, x)) - 1.0),
        lambda y: where(y > 0.0, 1.0, y + 1.0),
    ),
    "relu": Activation(
        "ReLU", lambda x: where(x > 0.0, x, x * 0.0), lambda y: where(y > 0.0, 1.0, 0.0)
    ),
    "silu": Activation("SiLU", lambda x: x * (tanh(x * 0.5) * 0.5 + 0.5)),
}
"""By their names in settings and agents' files."""
