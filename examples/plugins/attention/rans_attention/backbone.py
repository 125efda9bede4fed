"""Attention over effectors: the weights are the same whatever a craft has, and in whatever order."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor, nn

from rans.extend import Program
from rans.model.fields import exp
from rans.policy.activations import ACTIVATIONS
from rans.policy.backbones import Backbone, product
from rans.policy.parts import ArchitectureView, NetworkView

_TOKEN = 8
"""Numbers of `rans.policy.backbones.effector_tokens`."""


class EffectorAttention(Backbone):
    """One layer of self-attention over a craft's effectors, each with the features of what is observed.

    The state of effector i is f(features + A token_i), f the network's activation; scaled dot-product
    attention (Vaswani et al., "Attention is all you need", 2017) adds to it what the other effectors are; one
    last layer, the same for all, gives the outputs of each. A command follows its effector when effectors
    change places, and a craft with more effectors needs no other weights.
    """

    has_tokens = True
    is_traced = True

    def rows(self, architecture: ArchitectureView) -> int:
        """See `Backbone`: of one effector."""
        return architecture.last.weights

    def modules(self, architecture: ArchitectureView) -> dict[str, nn.Module]:
        """See `Backbone`."""
        width = architecture.features
        return {
            "token": nn.Linear(_TOKEN, width),
            "query": nn.Linear(width, width),
            "key": nn.Linear(width, width),
            "value": nn.Linear(width, width),
            "mixed": nn.Linear(width, width),
        }

    def outputs(self, network: NetworkView, features: Tensor) -> Tensor:
        """See `Backbone`."""
        architecture = network.architecture
        tokens = features.new_tensor(architecture.tokens)
        count = len(tokens)
        width = features.shape[-1]

        def each(name: str, x: Tensor) -> Tensor:
            """A layer on every effector, (..., N, effectors, width)."""
            return product(x.flatten(-3, -2), *network.layer(name)).unflatten(-2, (-1, count))

        if network.members > 1:
            tokens = tokens.expand(network.members, -1, -1)
        embedded = product(tokens, *network.own_layer("token"))
        state = network.activation(features[..., None, :] + embedded[..., None, :, :])
        # Each effector attends to all of them.
        query, key, value = (each(network.own(name), state) for name in ("query", "key", "value"))
        weights = torch.softmax(query @ key.mT / math.sqrt(width), dim=-1)
        state = state + network.activation(each(network.own("mixed"), weights @ value))
        # The same last layer for every effector; outputs of one meaning stand together.
        weight, bias = architecture.last.folded(*network.layer("action_net"))
        outputs = product(state.flatten(-3, -2), weight, bias).unflatten(-2, (-1, count))
        return outputs.mT.flatten(-2)

    def traced(self, program: Program, architecture: ArchitectureView, features: str) -> str:
        """See `Backbone`."""
        width = architecture.features
        count = len(architecture.tokens)
        formula = ACTIVATIONS[architecture.activation].formula
        tokens = program.constant(architecture.tokens, "tokens")
        embedded = program.dense(tokens, "token", width, _TOKEN)
        state = program.each(
            lambda x, token: formula(x + token), program.shaped(features, 1, width), embedded
        )
        # Each effector attends to all of them.
        query, key, value = (
            program.dense(state, name, width, width, rows=count)
            for name in ("query", "key", "value")
        )
        scores = program.apply("MatMul", query, program.apply("Transpose", key, perm=(0, 2, 1)))
        scores = program.each(lambda x: x * (1.0 / math.sqrt(width)), scores)
        highest = program.apply("ReduceMax", scores, axes=(-1,), keepdims=1)
        odds = program.each(lambda x, largest: exp(x - largest), scores, highest)
        last = program.constant([-1], dtype=np.int64)
        total = program.apply("ReduceSum", odds, last, keepdims=1)
        weights = program.apply("Div", odds, total)
        mixed = program.apply("MatMul", weights, value)
        mixed = program.dense(mixed, "mixed", width, width, architecture.activation, rows=count)
        state = program.apply("Add", state, mixed)
        # The same last layer for every effector; outputs of one meaning stand together.
        outputs = program.dense(state, "head", architecture.last.outputs, width, rows=count)
        transposed = program.apply("Transpose", outputs, perm=(0, 2, 1))
        return program.shaped(transposed, architecture.outputs)
