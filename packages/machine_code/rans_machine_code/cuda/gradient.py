"""Gradients of the PPO losses without autograd, for GPUs with bfloat16 products (docs/decisions/kernels.md).

They are computed in matrix products, forward and backward.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from rans.extend import (
    ACTIVATIONS,
    EXTRACTOR,
    Adam,
    Batch,
    Capabilities,
    Network,
    PPOSettings,
    fused,
)
from rans_machine_code.cuda.design import padded, up
from rans_machine_code.loss_gradient import (
    WITH_SLOPE,
    d_logit,
    opening_term,
    transition_losses,
)

_ALIGNED = 16
"""Multiple to which inputs and outputs are padded, as fast products of bfloat16 need; presets have such layers."""


class _Weights(NamedTuple):
    """Weights of a network as its products take them, bfloat16 but for the last."""

    first: Tensor
    """(units of all trunks, inputs), with the biases as a column."""
    second: list[tuple[Tensor, Tensor]]
    """Weights (units, units) and biases (units,) of each trunk, rounded as in torch's bfloat16 layers."""
    heads: Tensor
    """(2 heads, units of all trunks): rounded, then what rounding leaves of them."""
    head_bias: Tensor
    """(heads,), float32."""


class MatrixGradient:
    """Gradients of minibatches on a GPU in matrix products, of networks with two layers.

    They are written into an `Adam.gradient` without synchronisation. A critic of its own lies beside the policy:
    the units of both are one first layer, each has a second layer, and heads have no weights of the other's units.

    Args:
        network: network for which `fits` is true.
        adam: optimizer, whose `gradient` keeps its address.
        settings: coefficients of the losses.
    """

    description: ClassVar[str] = "products of matrices"

    @staticmethod
    def fits(network: Network) -> bool:
        """Whether these are gradients of such a network: two layers of known slopes, and on/off thrusters."""
        architecture = network.architecture
        can = Capabilities(heads=("on-off",), activations=WITH_SLOPE)
        return not can.missing(architecture) and len(architecture.layers) == 2

    def __init__(self, network: Network, adam: Adam, settings: PPOSettings) -> None:
        architecture = network.architecture
        self._network = network
        self._adam = adam
        self._settings = settings
        self._trunks = [f"{EXTRACTOR}{name}" for name in ("trunk", "critic")]
        self._trunks = self._trunks[: 2 if architecture.privileged else 1]
        self._columns = architecture.inputs + architecture.privileged
        """Width of the observed columns and memory, followed by what only the critic is told."""
        self._inputs = up(self._columns + 1, _ALIGNED)
        """Width of the inputs of products: these columns, a one whose weights are the biases, and zeros."""
        self._heads = up(architecture.thrusters + 1, _ALIGNED)
        """Outputs: log-odds of the thrusters, the value, and zeros."""
        self._activation = architecture.activation_module()
        device = adam.row.device
        self._pack = fused(self._packed, device)
        self._gather = fused(self._gathered, device)
        self._activate = fused(self._joined_activation, device)
        self._backward = fused(self._before_activation, device)
        self._losses = fused(self._output_gradients, device)

    def inputs(
        self, seen: Tensor, memory: Tensor | None, privileged: Tensor | None = None
    ) -> Tensor:
        """Inputs of both trunks (N, inputs), bfloat16, from columns (N, k), a history and privileged observations.

        They are the same in every epoch.
        """
        x = self._network.inputs(seen, memory)
        x = x if privileged is None else torch.cat((x, privileged), dim=1)
        ones = x.new_ones(1, 1).expand(len(x), -1)
        return padded(torch.cat((x, ones), dim=1), (len(x), self._inputs)).bfloat16()

    @torch.no_grad()
    def __call__(self, part: Batch) -> tuple[Tensor, ...]:
        """Loss and `STATISTICS`, () each, of a minibatch whose memory are the `inputs`.

        All of it may be recorded in a CUDA graph: no shape and no branch depends on a value.
        """
        x = part.memory
        assert x is not None
        weights = self._pack()

        # Forward, both trunks side by side. The outputs have a column for either part of the heads' weights.
        first = self._activation(x @ weights.first.T)
        first_parts = first.chunk(len(self._trunks), dim=1)
        second = self._activate(
            *(
                torch.addmm(bias, inputs, weight.T)
                for inputs, (weight, bias) in zip(first_parts, weights.second, strict=True)
            )
        )
        outputs = _product(second, weights.heads.T)

        # Losses, and backward.
        d_outputs, d_head_bias, sums = self._losses(
            outputs, weights.head_bias, part.action, part.log_prob, part.advantage, part.target
        )
        d_second, d_second_bias = self._backward(second, d_outputs @ weights.heads[: self._heads])
        d_second_parts = d_second.chunk(len(self._trunks), dim=1)
        d_first, _ = self._backward(
            first,
            *(
                gradient @ weight
                for gradient, (weight, _) in zip(d_second_parts, weights.second, strict=True)
            ),
        )

        # Gradients of all weights and biases.
        d_seconds = [
            _product(gradient.T, inputs)
            for gradient, inputs in zip(d_second_parts, first_parts, strict=True)
        ]
        gradient, statistics = self._gather(
            _product(d_first.T, x),
            d_seconds,
            d_second_bias,
            _product(second.T, d_outputs),
            d_head_bias,
            sums,
            len(x),
        )
        self._adam.gradient.copy_(gradient)
        return statistics.unbind()

    def _packed(self) -> _Weights:
        """The network's weights as its products take them."""
        layer = self._network.layer
        architecture = self._network.architecture
        firsts = []
        for trunk in self._trunks:
            weight, bias = layer(f"{trunk}.0")
            weight = padded(weight, (len(weight), self._columns))
            biased = torch.cat((weight, bias[:, None]), dim=1)
            firsts.append(padded(biased, (len(weight), self._inputs)))
        seconds = []
        for trunk in self._trunks:
            weight, bias = layer(f"{trunk}.2")
            seconds.append((weight.bfloat16(), bias.bfloat16()))
        # A thruster's logit is a difference of outputs. The value is of the last trunk.
        weight, bias = architecture.last.folded(*layer("action_net"))
        worth, constant = layer("value_net")
        others = (len(self._trunks) - 1) * architecture.features
        rows = functional.pad(weight, (0, others)), functional.pad(worth, (others, 0))
        heads = padded(torch.cat(rows), (self._heads, architecture.features + others))
        rounded = _rounded(heads)
        return _Weights(
            torch.cat(firsts).bfloat16(),
            seconds,
            torch.cat((rounded, heads - rounded)).bfloat16(),
            padded(torch.cat((bias, constant)), (self._heads,)),
        )

    def _gathered(
        self,
        d_first: Tensor,
        d_seconds: Sequence[Tensor],
        d_second_bias: Tensor,
        d_heads: Tensor,
        d_head_bias: Tensor,
        sums: Tensor,
        count: int,
    ) -> tuple[Tensor, Tensor]:
        """Gradient (parameters,) in the order of Adam, and the loss with its statistics, of sums of transitions.

        Args:
            d_first: (units of all trunks, inputs).
            d_seconds: (units, units) of each trunk.
            d_second_bias: (units of all trunks,).
            d_heads: (units of all trunks, heads).
            d_head_bias: (heads,).
            sums: statistics.
            count: number of transitions.
        """
        architecture = self._network.architecture
        gradients: dict[str, Tensor] = {}
        trunks = len(self._trunks)
        parts = zip(
            self._trunks,
            d_first.chunk(trunks),
            d_seconds,
            d_second_bias.chunk(trunks),
            strict=True,
        )
        for trunk, first, second, bias in parts:
            width = self._network.layer(f"{trunk}.0")[0].shape[1]
            gradients[f"{trunk}.0.weight"] = first[:, :width]
            gradients[f"{trunk}.0.bias"] = first[:, self._columns]
            gradients[f"{trunk}.2.weight"] = second
            gradients[f"{trunk}.2.bias"] = bias
        # What a logit gets counts for one of its two outputs with -1.
        end = architecture.thrusters
        d_logit, d_bias = d_heads[: architecture.features, :end].T, d_head_bias[:end]
        gradients["action_net.weight"] = torch.stack((-d_logit, d_logit), dim=1)
        gradients["action_net.bias"] = torch.stack((-d_bias, d_bias), dim=1)
        gradients["value_net.weight"] = d_heads[-architecture.features :, end]
        gradients["value_net.bias"] = d_head_bias[end : end + 1]
        row = self._adam.joined([gradients[name] for name in self._network.learnt])
        surrogate, value, *rest = (sums / count).split(1)
        loss = surrogate + self._settings.vf_coef * value
        return row / count, torch.cat((loss, surrogate, value, *rest))

    def _joined_activation(self, *parts: Tensor) -> Tensor:
        """Activations (N, units) of all trunks, side by side, which costs no time if compiled."""
        return self._activation(torch.cat(parts, dim=1))

    def _before_activation(self, value: Tensor, *gradients: Tensor) -> tuple[Tensor, Tensor]:
        """Gradients before an activation function (N, units), bfloat16, and their sums (units,).

        It is compiled as one kernel; sums are of the rounded gradients, as the matrix products take them.

        Args:
            value: (N, units) values of the function.
            gradients: gradients of the values, one tensor for each trunk.
        """
        y = value.float()
        after = torch.cat(gradients, dim=1).float()
        slope = ACTIVATIONS[self._network.architecture.activation].slope
        assert slope is not None
        result = (after * slope(y)).bfloat16()
        return result, result.float().sum(dim=0)

    def _output_gradients(
        self,
        outputs: Tensor,
        bias: Tensor,
        action: Tensor,
        log_prob: Tensor,
        advantage: Tensor,
        target: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Gradients of the heads' outputs (N, heads), bfloat16, their sums (heads,), and sums of the statistics.

        Args:
            outputs: (N, 2 heads) outputs by the rounded weights, then by their remainders.
            bias: (heads,).
            action: (N, thrusters) zeros and ones.
            log_prob: (N,) log-probability of the action under the rollout's policy.
            advantage: (N,).
            target: (N,) target of the critic's value.
        """
        thrusters = action.shape[1]
        # Outputs: log-odds of the thrusters, then the value; the rest is padding.
        result = outputs[:, : self._heads] + outputs[:, self._heads :] + bias
        logit = result[:, :thrusters]
        parts = opening_term(logit, action)
        losses = transition_losses(
            parts.log_prob.sum(dim=1),
            parts.entropy.sum(dim=1),
            result[:, thrusters],
            log_prob,
            advantage,
            target,
            self._settings.clip_range,
            self._settings.vf_coef,
        )
        # Their gradients, padded likewise.
        d_logits = d_logit(action, parts.opening, losses.d_log_prob[:, None])
        d_value = losses.d_value[:, None]
        padding = d_value.new_zeros(1).expand(len(d_value), self._heads - thrusters - 1)
        gradient = torch.cat((d_logits, d_value, padding), dim=1)
        sums = torch.stack([x.sum() for x in losses.statistics])
        return gradient.bfloat16(), gradient.sum(dim=0), sums


def matrix_gradient(
    network: Network, adam: Adam, settings: PPOSettings, samples: int
) -> MatrixGradient | None:
    """Gradients of minibatches of any size; None without products of bfloat16, and for networks that do not fit."""
    is_rounded = network.architecture.bf16 and adam.row.dtype == torch.float32
    fits = is_rounded and MatrixGradient.fits(network)
    return MatrixGradient(network, adam, settings) if fits else None


def _product(a: Tensor, b: Tensor) -> Tensor:
    """Matrix product of bfloat16 matrices, accumulated and returned in float32."""
    return torch.mm(a, b, out_dtype=torch.float32) if a.is_cuda else a.float() @ b.float()


def _rounded(x: Tensor) -> Tensor:
    """Float32 numbers rounded to the nearest bfloat16, ties to even.

    By bits, as torch's compiler would drop a conversion there and back.
    """
    bits = x.view(torch.int32)
    return ((bits + 0x7FFF + (bits >> 16 & 1)) & ~0xFFFF).view(torch.float32)
