"""Activation functions between layers: one line each, in operations on fields.

Executors that know a function print it in their own way. The others print its formula; the fused gradients of
an update, which need its slope too, leave it to autograd.
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
    """The same of fields of any library."""


ACTIVATIONS = {
    "tanh": Activation("Tanh", tanh),
    "elu": Activation("ELU", lambda x: where(x > 0.0, x, exp(where(x > 0.0, x * 0.0, x)) - 1.0)),
    "relu": Activation("ReLU", lambda x: where(x > 0.0, x, x * 0.0)),
    "silu": Activation("SiLU", lambda x: x * (tanh(x * 0.5) * 0.5 + 0.5)),
}
"""By their names in settings and agents' files."""
WITH_SLOPE = ("tanh", "elu", "relu")
"""Those whose slopes the fused gradients know, from the function's value."""
