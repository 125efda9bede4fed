"""What a policy does to single numbers between its layers, in operations on fields.

`rans.policy.network.Network` applies these formulas to torch's tensors, and `rans.policy.traced` writes down what
they do to symbols; so every executor computes the same.
"""

from __future__ import annotations

import sys

from rans.model.fields import Field, tanh, within


def normalised(x: Field, mean: Field, scale: Field, clip: float) -> Field:
    """A column with zero mean and unit variance over those seen in training, clipped.

    The scale is one over the standard deviation.
    """
    return within((x - mean) * scale, -clip, clip)


def magnified(x: Field, zoom: Field) -> Field:
    """A column magnified and squashed: steepest at zero, where the goal is of every column that is no cosine."""
    return tanh(x * zoom)


def sigmoid(x: Field) -> Field:
    """The logistic function."""
    if type(x).__module__.partition(".")[0] == "torch":
        return sys.modules["torch"].sigmoid(x)
    return tanh(x * 0.5) * 0.5 + 0.5


def gated(
    reset: Field,
    update: Field,
    fresh: Field,
    old_reset: Field,
    old_update: Field,
    old: Field,
    state: Field,
) -> Field:
    """The next state of a gated recurrent unit (Cho et al., 2014), torch's `GRUCell`.

    The first three are what a layer makes of its input, the next three what one makes of the state.
    """
    share = sigmoid(update + old_update)
    new = tanh(fresh + sigmoid(reset + old_reset) * old)
    return new + share * (state - new)


def averaged(average: Field, newest: Field, kept: Field) -> Field:
    """An exponential moving average that keeps this share of itself."""
    return newest + kept * (average - newest)
