"""A loss of transitions with on/off thrusters as a program, with its derivatives by the network's outputs.

The loss is the learner's own (`rans.fast.learn.ppo.PPOLearner.loss`), run on symbols. A GPU's kernel
(`rans_machine_code.cuda.update`) and machine code of a CPU (`rans_machine_code.gradient`) are printed from it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from operator import add
from typing import Any, NamedTuple

from rans.extend import (
    ACTIVATIONS,
    Field,
    Losses,
    LossInputs,
    Symbol,
    absolute,
    at_least,
    fields,
    ordered,
    where,
)

WITH_SLOPE = tuple(name for name, activation in ACTIVATIONS.items() if activation.slope is not None)
"""Activations between layers whose gradients need no autograd."""
STATISTICS = len(Losses._fields)
"""Number of the losses of a transition."""
Loss = Callable[[LossInputs], Losses]


class LossProgram(NamedTuple):
    """Symbols of a transition, with one on/off thruster for each command."""

    outputs: tuple[Symbol, ...]
    """Inputs: the log-odds of each thruster, and the value."""
    commands: tuple[Symbol, ...]
    """Inputs: the command of each thruster, 0 or 1."""
    given: tuple[Symbol, ...]
    """Inputs: log-probability under the rollout's policy, advantage and target of the value."""
    roots: tuple[Symbol, ...]
    """Results: the derivative of the loss by each output, then the losses."""

    @classmethod
    def of(cls, thrusters: int, loss: Loss) -> LossProgram:
        """Program of a loss; one that is not arithmetic on fields raises `rans.model.trace.UNTRACEABLE`."""
        outputs = tuple(Symbol.input(f"output[{k}]") for k in range(thrusters + 1))
        commands = tuple(Symbol.input(f"command[{k}]") for k in range(thrusters))
        given = tuple(map(Symbol.input, ("log_prob", "advantage", "target")))
        # The loss by what the outputs give, and that by the outputs.
        choices = [*map(_choice, outputs, commands)]
        log_probs, entropies, openings = zip(*choices, strict=True)
        joint = reduce(add, log_probs), reduce(add, entropies), outputs[-1]
        losses = [Symbol.constant(x, "real") for x in loss(LossInputs(*joint, *given))]
        d_joint, d_entropy, d_value = _derivatives(losses[0], joint)
        d_logits = [
            d_joint * (command - opening) - d_entropy * (logit * (opening * (1.0 - opening)))
            for logit, command, opening in zip(outputs, commands, openings, strict=False)
        ]
        roots = (*d_logits, d_value, *losses)
        return cls(outputs, commands, given, roots)


def _choice(logit: Field, command: Field) -> tuple[Field, Field, Field]:
    """Log-probability of a thruster's command, 0 or 1, its entropy, nats, and the probability that it opens."""
    # log(1 + e^x) = max(x, 0) + log(1 + e^-|x|), whose derivative is the probability.
    small = fields.exp(-absolute(logit))
    reciprocal = 1.0 / (1.0 + small)
    opening = where(logit >= 0.0, reciprocal, small * reciprocal)
    softplus = at_least(logit, 0.0) + fields.log1p(small)
    return command * logit - softplus, softplus - logit * opening, opening


_BACK: dict[str, Callable[..., tuple[Any, ...]]] = {
    "+": lambda s, y, a, b: (s, s),
    "-": lambda s, y, a, b: (s, -s),
    "*": lambda s, y, a, b: (s * b, s * a),
    "/": lambda s, y, a, b: (s / b, -(s * y) / b),
    "neg": lambda s, y, a: (-s,),
    "where": lambda s, y, condition, a, b: (
        0.0,
        where(condition, s, 0.0),
        where(condition, 0.0, s),
    ),
    "maximum": lambda s, y, a, b: (where(a >= b, s, 0.0), where(a >= b, 0.0, s)),
    "minimum": lambda s, y, a, b: (where(a <= b, s, 0.0), where(a <= b, 0.0, s)),
    "abs": lambda s, y, a: (where(a >= 0.0, s, -s),),
    "exp": lambda s, y, a: (s * y,),
    "log1p": lambda s, y, a: (s / (1.0 + a),),
}
"""What each operand adds to a derivative, from that by the result, the result and the operands."""


def _derivatives(root: Symbol, inputs: Sequence[Symbol]) -> list[Symbol]:
    """Derivatives of a symbol by others that it depends on, in reverse mode."""
    slopes: dict[Symbol, Any] = {root: Symbol.constant(1.0)}
    for symbol in reversed([*ordered([root], inputs)]):
        slope = slopes.get(symbol)
        if slope is None or not symbol.args:
            continue
        if symbol.operation not in _BACK:
            raise TypeError(f"derivatives of losses have no operation {symbol.operation!r}.")
        parts = _BACK[symbol.operation](slope, symbol, *symbol.args)
        for operand, part in zip(symbol.args, parts, strict=True):
            if operand.kind == "real" and operand.operation != "constant":
                slopes[operand] = part + slopes[operand] if operand in slopes else part
    return [Symbol.constant(slopes.get(one, 0.0)) for one in inputs]
