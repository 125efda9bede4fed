"""Train a small throttled docking agent by imitation, and write it as an ONNX file for `rans prove`.

    python examples/proofs/docking_agent.py docking-agent.onnx
    rans prove docking-agent.onnx --problem examples/proofs/docking-agent.toml

The teacher is guidance in closed form: fly to the target at half the speed limit, slower within 10 m. The network
has two layers of 16 tanh units and forces within 1 N. Training takes 1,200 steps, some seconds of one core.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn

MASS = 12.0  # kg
MEAN_MOTION = 0.001027  # rad/s
LAG = 30.0  # s in which guidance removes an error of the velocity, three control periods
SCALE = np.array([100.0, 100.0, 0.5, 0.5])  # m and m/s that the first layer divides states by
UNITS = 16
STEPS = 1200


def velocity_wanted(position: np.ndarray) -> np.ndarray:
    """Velocity (N, 2) towards the target, half the limit of 0.2 m/s + 2 n r, and less within 10 m."""
    distance = np.linalg.norm(position, axis=1, keepdims=True)
    limit = 0.2 + 2.0 * MEAN_MOTION * distance
    return -0.5 * limit * position / np.sqrt(distance**2 + 10.0**2)


def guidance(states: np.ndarray) -> np.ndarray:
    """Forces (N, 2) that remove the velocity error and the Clohessy-Wiltshire accelerations, within 1 N."""
    position, velocity = states[:, :2], states[:, 2:]
    drift = np.column_stack(
        (
            3.0 * MEAN_MOTION**2 * position[:, 0] + 2.0 * MEAN_MOTION * velocity[:, 1],
            -2.0 * MEAN_MOTION * velocity[:, 0],
        )
    )
    return np.tanh(MASS * ((velocity_wanted(position) - velocity) / LAG - drift))


def states(count: int, random: np.random.Generator) -> np.ndarray:
    """States (N, 4) in all directions: some near the way of guidance, the others of any velocity."""
    distance = np.exp(random.uniform(np.log(0.5), np.log(150.0), (count, 1)))
    angle = random.uniform(0.0, 2.0 * np.pi, count)
    position = distance * np.column_stack((np.cos(angle), np.sin(angle)))
    near = velocity_wanted(position) + 0.08 * random.normal(size=(count, 2))
    velocity = np.where(
        random.random((count, 1)) < 0.6, near, random.uniform(-0.4, 0.4, (count, 2))
    )
    return np.concatenate((position, velocity), axis=1)


def trained(begin: np.ndarray, commands: np.ndarray, scale: np.ndarray) -> nn.Sequential:
    """Network from scaled states to commands (N, outputs) that a teacher gives in states (N, inputs)."""
    torch.manual_seed(0)
    network = nn.Sequential(
        *(nn.Linear(begin.shape[1], UNITS), nn.Tanh()),
        *(nn.Linear(UNITS, UNITS), nn.Tanh()),
        *(nn.Linear(UNITS, commands.shape[1]), nn.Tanh()),
    ).double()
    inputs = torch.tensor(begin / scale)
    targets = torch.tensor(commands)
    optimizer = torch.optim.Adam(network.parameters())
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 1e-2, STEPS)
    for _ in range(STEPS):
        some = torch.randint(0, len(inputs), (512,))
        loss = ((network(inputs[some]) - targets[some]) ** 2).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    return network


def write(network: nn.Sequential, scale: np.ndarray, file: Path) -> None:
    """Write a network whose first layer also scales the states."""
    nodes, tables, name = [], [], "state"
    layers = [one for one in network if isinstance(one, nn.Linear)]
    for k, layer in enumerate(layers):
        weight = layer.weight.detach().numpy() / (scale if k == 0 else 1.0)
        for kind, table in (("weight", weight), ("bias", layer.bias.detach().numpy())):
            tables.append(numpy_helper.from_array(table.astype(np.float32), f"{kind}{k}"))
        nodes.append(
            helper.make_node("Gemm", [name, f"weight{k}", f"bias{k}"], [f"sum{k}"], transB=1)
        )
        name = f"answer{k}"
        nodes.append(helper.make_node("Tanh", [f"sum{k}"], [name]))
    ends = [
        helper.make_tensor_value_info(one, TensorProto.FLOAT, ["N", width])
        for one, width in (("state", len(scale)), (name, layers[-1].out_features))
    ]
    graph = helper.make_graph(nodes, "agent", ends[:1], ends[1:], tables)
    model = helper.make_model(graph, ir_version=8, opset_imports=[helper.make_opsetid("", 17)])
    file.write_bytes(model.SerializeToString())


if __name__ == "__main__":
    starts = states(12_000, np.random.default_rng(0))
    write(trained(starts, guidance(starts), SCALE), SCALE, Path(sys.argv[1]))
