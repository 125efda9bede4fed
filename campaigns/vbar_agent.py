"""A network that flies the legs of V-BAR: trained here, kept as ``vbar_agent.onnx``, flown by ONNX Runtime.

    python -m campaigns.vbar_agent campaigns/vbar_agent.onnx

It is one small network for each axis alike. It reads where the craft is from the point that it flies to, how
fast it is, how fast it may be, and by how much its velocity changes without thrust; it answers with a command
from -1 to 1. It imitates a law of velocity.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch

FILE = Path(__file__).with_suffix(".onnx")
ACCELERATION = 0.02
"""Acceleration of a full command along an axis, m/s^2: that of every craft of V-BAR."""
INPUTS = 5
"""Position from the point, velocity, natural acceleration (each along the axis), distance and greatest speed."""
_SCALES = ((0.2, 5.0, 200.0), (2e-3, 0.05, 1.0), (1e-4, 2e-3), (0.5, 20.0, 500.0), (0.02, 0.3))
"""Scales of each input: the network reads asinh(input / scale), so that centimetres count at the end and kilometres
before."""
_LAG = 14.0
"""Time in which the law of velocity corrects an error, s: above the control periods of 5 and 10 s."""
_SLOWING = 0.02
"""Speed for the distance that is left, 1/s."""
_BRAKING = 0.01
"""Half of the acceleration of a full command, m/s^2, is left to brake and for errors."""
_WIDTH = 48


def law(x: torch.Tensor) -> torch.Tensor:
    """The law of velocity that the network begins from: commands, (N,), of inputs, (N, 5)."""
    position, velocity, natural, distance, fastest = x.unbind(-1)
    braking = torch.sqrt(2.0 * _BRAKING * distance)
    speed = torch.minimum(torch.minimum(fastest, _SLOWING * distance), braking)
    wanted = -speed * position / distance.clamp(min=1e-6)
    return (((wanted - velocity) / _LAG - natural) / ACCELERATION).clamp(-1.0, 1.0)


class Network(torch.nn.Module):
    """Inputs, (..., 5), to commands, (...)."""

    which: torch.Tensor
    """Input of each scale."""
    scale: torch.Tensor
    """Scales."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer(
            "which", torch.tensor([k for k, scales in enumerate(_SCALES) for _ in scales])
        )
        self.register_buffer(
            "scale", torch.tensor([one for scales in _SCALES for one in scales], dtype=torch.float)
        )
        count = sum(map(len, _SCALES))
        self.layers: torch.nn.Sequential = torch.nn.Sequential(
            torch.nn.Linear(count, _WIDTH),
            torch.nn.Tanh(),
            torch.nn.Linear(_WIDTH, _WIDTH),
            torch.nn.Tanh(),
            torch.nn.Linear(_WIDTH, 1),
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Commands from -1 to 1."""
        features = torch.asinh(x[..., self.which] / self.scale)
        return self.layers(features)[..., 0].clamp(-1.0, 1.0)


def inputs(
    position: torch.Tensor, velocity: torch.Tensor, natural: torch.Tensor, fastest: torch.Tensor
) -> torch.Tensor:
    """What the network reads of N craft, (N, 3, 5)."""
    distance = torch.linalg.vector_norm(position, dim=-1, keepdim=True).expand_as(position)
    return torch.stack(
        [position, velocity, natural, distance, fastest[:, None].expand_as(position)], dim=-1
    )


def _examples(count: int) -> torch.Tensor:
    """Random inputs of each size, (count, 5)."""

    def sized(low: float, high: float, shape: tuple[int, ...]) -> torch.Tensor:
        return torch.exp(torch.empty(shape).uniform_(np.log(low), np.log(high)))

    distance = sized(1e-3, 2e4, (count, 1))
    direction = torch.nn.functional.normalize(torch.randn(count, 3), dim=-1)
    # Along the line, or nearly so, half of the craft.
    direction = torch.where(
        torch.rand(count, 1) < 0.5,
        torch.nn.functional.normalize(
            direction * torch.tensor([1.0, 0.03, 0.03])[torch.randperm(3)], dim=-1
        ),
        direction,
    )
    position = distance * direction
    fastest = sized(0.02, 4.0, (count,))
    speed = torch.minimum(
        torch.minimum(fastest[:, None], 0.02 * distance), (0.02 * distance).sqrt()
    )
    # Velocities of the law with errors of each size, and natural accelerations of V-BAR's orbits.
    velocity = -speed * direction * torch.rand(count, 1) * 1.2
    velocity = velocity + sized(1e-4, 0.5, (count, 1)) * torch.randn(count, 3)
    natural = sized(1e-6, 5e-3, (count, 1)) * torch.randn(count, 3)
    rows = inputs(position, velocity, natural, fastest)
    return rows[torch.arange(count), torch.randint(3, (count,))]


def _away(network: Network, count: int) -> torch.Tensor:
    """How far a network is from the law, on random inputs."""
    x = _examples(count)
    goal = law(x)
    # An error counts against the size of the command, and 0.002 of a full command is small.
    away = (network(x) - goal) / (0.002 + 0.1 * goal.abs())
    return torch.sqrt(1.0 + away.square()).mean() - 1.0


def imitated(steps: int = 12000, batch: int = 4096) -> Network:
    """A network that answers as the law does."""
    network = Network()
    optimizer = torch.optim.Adam(network.parameters(), 3e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for _ in range(steps):
        loss = _away(network, batch)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    return network


def export(network: Network, file: Path) -> None:
    """Write a network as ONNX: ``obs`` (N, 5) to ``action`` (N, 1)."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    def constant(name: str, value: Any) -> Any:
        return numpy_helper.from_array(np.asarray(value), name)

    linear = [one for one in network.layers if isinstance(one, torch.nn.Linear)]
    constants = [
        constant("which", network.which.numpy().astype(np.int64)),
        constant("scale", network.scale.numpy()),
        constant("low", np.float32(-1.0)),
        constant("high", np.float32(1.0)),
    ]
    nodes = [
        helper.make_node("Gather", ["obs", "which"], ["chosen"], axis=1),
        helper.make_node("Div", ["chosen", "scale"], ["scaled"]),
        helper.make_node("Asinh", ["scaled"], ["hidden_0"]),
    ]
    for k, one in enumerate(linear):
        constants += [
            constant(f"weight_{k}", one.weight.detach().numpy()),
            constant(f"bias_{k}", one.bias.detach().numpy()),
        ]
        names = [f"hidden_{k}", f"weight_{k}", f"bias_{k}"]
        nodes.append(helper.make_node("Gemm", names, [f"sum_{k}"], transB=1))
        if k < len(linear) - 1:
            nodes.append(helper.make_node("Tanh", [f"sum_{k}"], [f"hidden_{k + 1}"]))
    last = f"sum_{len(linear) - 1}"
    nodes.append(helper.make_node("Clip", [last, "low", "high"], ["action"]))
    graph = helper.make_graph(
        nodes,
        "vbar_agent",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, ["n", INPUTS])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["n", 1])],
        constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    file.write_bytes(model.SerializeToString())


def read(file: Path) -> Network:
    """The network of a file that `export` wrote."""
    import onnx
    from onnx import numpy_helper

    values = {one.name: one for one in onnx.load(file).graph.initializer}
    network = Network()
    linear = [one for one in network.layers if isinstance(one, torch.nn.Linear)]
    for k, one in enumerate(linear):
        for name, parameter in (("weight", one.weight), ("bias", one.bias)):
            parameter.data = torch.tensor(numpy_helper.to_array(values[f"{name}_{k}"]))
    return network


if __name__ == "__main__":
    torch.manual_seed(0)
    torch.set_num_threads(1)
    export(imitated(), Path(sys.argv[1]))
