"""Network of a value function: the least cost of a flight from a state, for every price of thrust."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from rans_value.problem import PoseProblem


class ValueNetwork(nn.Module):
    """Value of states (rows, ...): four layers with skips, and at least the cost of a period outside."""

    def __init__(self, problem: PoseProblem, example: Tensor, units: int) -> None:
        super().__init__()
        self.problem = problem
        inputs = problem.features(example).flatten(0, -2)
        self.register_buffer("mean", inputs.mean(dim=0))
        self.register_buffer("spread", inputs.std(dim=0).clamp(min=0.05))
        self.first = nn.Linear(inputs.shape[1], units)
        self.hidden = nn.ModuleList(nn.Linear(units, units) for _ in range(3))
        self.last = nn.Linear(units, 1)
        self.to(example.device)

    def forward(self, state: Tensor) -> Tensor:
        """Values, s."""
        problem = self.problem
        # Eight bits would round the inputs to centimetres, and values of seconds to hundredths; eleven are enough
        # for values, but not for the range of gradients.
        x = functional.silu(self.first((problem.features(state) - self.mean) / self.spread))
        half = torch.bfloat16
        if x.is_cuda and not torch.is_grad_enabled():
            # To move sums between layers takes longer than to compute them.
            half = torch.float16
            x = x.half()
        with torch.autocast("cuda", half, enabled=x.is_cuda):
            for layer in self.hidden:
                x = x + functional.silu(layer(x))
        raw = self.last(x.float())[..., 0]
        scale = problem.scale * (1.0 + problem.price(state))
        return problem.terms(state)[0] + scale * functional.softplus(raw)

    def resembles(self, other: ValueNetwork) -> bool:
        """Whether it has the layers of another value function, and its inputs but for phases and limits.

        The other has the same inputs of limits and turning goals, or none.
        """

        def sizes(network: ValueNetwork) -> tuple[int, int]:
            units, inputs = network.first.weight.shape
            return units, inputs - network.problem.phases - network.problem.limits

        return sizes(self) == sizes(other) and other.problem.limits in (0, self.problem.limits)

    @torch.no_grad()
    def begin_as(self, other: ValueNetwork) -> None:
        """Take the weights of a value function that it `resembles`, of another craft or of flights without limits.

        Inputs are in units of a craft's authority, but phases are of its pulses: values are taken at spins and
        headings that these can reach. Phases, and limits that the other has not, have no weight.
        """
        weights = dict(other.state_dict())
        count = other.problem.phases
        reached = torch.tensor([0.0, 1.0]).repeat(count // 2)
        parts = {}
        for name, filling in (("first.weight", 0.0), ("mean", 0.0), ("spread", 1.0)):
            before, parts[name], after = weights[name].tensor_split((-3 - count, -3), dim=-1)
            new = len(self.mean) - before.shape[-1] - 3
            own = before.new_full((*before.shape[:-1], new), filling)
            weights[name] = torch.cat((before, own, after), dim=-1)
        inputs = (reached - parts["mean"]) / parts["spread"]
        weights["first.bias"] = weights["first.bias"] + parts["first.weight"] @ inputs
        self.load_state_dict(weights)
