"""Adam (Kingma and Ba, 2015) of all weights in one row, with gradients clipped by their norm."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from rans.fast.distributed import Processes
from rans.policy.network import Network

_KEEP = 0.9
_KEEP_SQUARE = 0.999
EPSILON = 1e-5
"""Term in the denominator, as in Andrychowicz et al. (2021) and most implementations of PPO; the decays above are
those of torch."""
_PIECE = 32
"""Alignment of the weights in the row, in numbers, for fast matrix products."""
_STEPPED = 2048
"""Numbers of a tensor that is stepped: a GPU gives each tensor to one multiprocessor."""


class Adam:
    """Adam optimizer of a network, whose P weights become views of one row (P,), updated by few kernels.

    `moments` are tensors like the weights.

    Args:
        network: network.
        rate: initial step size.
    """

    def __init__(self, network: Network, rate: float) -> None:
        tensors = {name: network.tensors[name] for name in network.learnt}
        like = next(iter(tensors.values())).detach()
        self.rate = like.new_full((), rate)
        # All parameters in one row, so that one operation steps them; each begins at a whole piece.
        self.row = self.joined([x.detach() for x in tensors.values()])
        self.gradient, self._first, self._second = (torch.zeros_like(self.row) for _ in range(3))
        sizes = [-(-x.numel() // _PIECE) * _PIECE for x in tensors.values()]

        def views(row: Tensor) -> list[Tensor]:
            return [
                part[: value.numel()].view(value.shape)
                for part, value in zip(row.split(sizes), tensors.values(), strict=True)
            ]

        # The network's tensors become views of that row.
        self._gradients = views(self.gradient)
        self.moments = views(self._first), views(self._second)
        self._leaves = [weight.detach().requires_grad_() for weight in views(self.row)]
        network.adopt(dict(zip(tensors, self._leaves, strict=True)))
        self._pieces = [x.split(_STEPPED) for x in (self.row, self._first, self._second)]
        self.steps = torch.zeros((), device=like.device)

    @staticmethod
    def joined(tensors: Sequence[Tensor]) -> Tensor:
        """Row (P,) of tensors like the weights, in their order, as `gradient` has them."""
        return torch.cat([functional.pad(x.flatten(), (0, -x.numel() % _PIECE)) for x in tensors])

    def descend(self, loss: Tensor, max_norm: float, world: Processes) -> Tensor:
        """One step on a loss (), with the gradient clipped to the norm ``max_norm``.

        If the loss does not require gradients, `gradient` must have been written before. Returns the norm of the
        gradient ().
        """
        with torch.no_grad():
            if loss.requires_grad:
                gradients = torch.autograd.grad(
                    loss, self._leaves, allow_unused=True, materialize_grads=True
                )
                torch._foreach_copy_(self._gradients, gradients)  # type: ignore[attr-defined]  # private in torch
            gradient = world.average(self.gradient)
            norm = gradient.norm()
            # As torch.nn.utils.clip_grad_norm_ does it.
            gradient = gradient * (max_norm / (norm + 1e-6)).clamp(max=1.0)
            row, first, second = self._pieces
            torch._fused_adam_(  # type: ignore[attr-defined]  # private in torch
                row,
                gradient.split(_STEPPED),
                first,
                second,
                [],
                [self.steps.add_(1)] * len(row),
                lr=self.rate.float() if self.row.is_cuda else self.rate,
                beta1=_KEEP,
                beta2=_KEEP_SQUARE,
                weight_decay=0.0,
                eps=EPSILON,
                amsgrad=False,
                maximize=False,
            )
            return norm

    def state(self) -> dict[str, Tensor]:
        """State of the optimizer, for `load`."""
        return {
            "first": self._first,
            "second": self._second,
            "steps": self.steps,
            "rate": self.rate,
        }

    def load(self, saved: dict[str, Tensor]) -> None:
        """Continue from the result of `state`; older checkpoints have an axis before those of the weights."""
        for name, tensor in self.state().items():
            tensor.copy_(saved[name].view(tensor.shape))
