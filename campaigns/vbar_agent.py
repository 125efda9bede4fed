"""A network that flies the legs of V-BAR: trained here, kept as ``vbar_agent.onnx``, flown by ONNX Runtime.

    python -m campaigns.vbar_agent campaigns/vbar_agent.onnx

It is one small network for each axis alike. It reads where the craft is from the point that it flies to, how
fast it is, how fast it may be, and by how much its velocity changes without thrust; it answers with a command
from -1 to 1. It imitates a law of velocity. The points, and the speed that it may have, follow from the public
description of a scenario.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from campaigns.vbar import AVERAGED, Array, Coast, Guidance, Leg, Port, Route, gate
from rans.deploy.onnx_file import write_onnx
from rans.deploy.program import Ports
from rans.policy.program import Program

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
_MARGIN = 0.8
"""Part of the speed that a scenario allows."""
_FASTEST = 5.5
"""Greatest speed, m/s: the turn of the Hill frame then takes three fifths of the thrusters."""
_CRUISE = 0.5
"""Greatest speed where a scenario sets no lower limit, m/s."""
_AHEAD = 60.0
"""Time to the point on the axis that the network pursues, s: it brakes for a point that is less than 50 s away."""


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
    """Write a network as ONNX: ``observation`` (N, 5) to ``command`` (N, 1)."""
    program = Program()

    def table(value: Any) -> str:
        return program.constant(value, dtype=np.float32)

    which = program.constant(network.which.numpy(), dtype=np.int64)
    hidden = program.apply("Gather", "observation", which, axis=1)
    hidden = program.apply("Asinh", program.apply("Div", hidden, table(network.scale.numpy())))
    for layer in network.layers:
        if isinstance(layer, torch.nn.Linear):
            tables = [table(one.detach().numpy()) for one in (layer.weight, layer.bias)]
            hidden = program.apply("Gemm", hidden, *tables, transB=1)
        else:
            hidden = program.apply("Tanh", hidden)
    program.apply("Clip", hidden, table(-1.0), table(1.0), name="command")
    write_onnx(file, program, Ports(INPUTS, 1), {"what": "V-BAR's legs, axis by axis"})


class Agent(Guidance):
    """An agent of V-BAR that flies the network by ONNX Runtime, from point to point.

    Args:
        file: the network.
    """

    name = "network"

    def __init__(self, file: Path = FILE) -> None:
        runtime: Any = importlib.import_module("onnxruntime")
        options = runtime.SessionOptions()
        options.intra_op_num_threads = 1
        self._session = runtime.InferenceSession(str(file), options)

    def route(self, view: Any, start: Array) -> Route:
        """See `Guidance.route`."""
        limits = {one["type"]: one for one in view.constraints}
        to = _to_port if view.goal["task"] == "dock" else _to_hold
        return to(view, self._answer, limits, start)

    def reset(self, view: Any, rng: np.random.Generator | None = None) -> None:
        """Begin an episode.

        Raises:
            ValueError: the scenario asks for a tour, a departure or a turning cone.
        """
        task = view.goal["task"]
        turning_cone = task == "hold" and any(
            one["type"] == "approach_cone" for one in view.constraints
        )
        if task not in ("hold", "berth", "dock") or turning_cone:
            raise ValueError(f"the network flies no {view.scenario_id}")
        super().reset(view, rng)

    def _answer(self, inputs: Array) -> Array:
        """Commands along three axes, (3,), for what the network reads, (3, 5)."""
        return self._session.run(None, {"observation": inputs.astype(np.float32)})[0][:, 0].astype(
            float
        )


@dataclass
class Learned(Leg):
    """The network flies to a point, which may turn about the target."""

    view: Any
    """What V-BAR says of the scenario."""
    answer: Callable[[Array], Array]
    """Commands along three axes, (3,), for inputs (3, 5)."""
    point: Callable[[Array, float], Array]
    """Where to from a state at a time, m."""
    fastest: Callable[[Array, float], float]
    """The greatest speed at a state and time, m/s."""
    ends: Callable[[Array, float], bool] = lambda state, time: False
    """Whether the leg is over at a state and time."""
    rate: float = 0.0
    """Rate at which the point turns about z, rad/s."""

    def over(self, state: Array, time: float) -> bool:
        """See `Leg`."""
        return self.ends(state, time)

    def change(self, state: Array, time: float) -> Array:
        """See `Leg`."""
        n, place, speed = self.view.n, state[:3], state[3:]
        away = place - self.point(state, time)
        spin = np.array([0.0, 0.0, self.rate])
        # The network reads velocity and natural acceleration in the frame that turns with the point.
        moving = speed - np.cross(spin, place)
        natural = np.array(
            [
                3.0 * n * n * place[0] + 2.0 * n * speed[1],
                -2.0 * n * speed[0],
                -n * n * place[2],
            ]
        ) - np.cross(spin, speed + moving)
        both = [np.linalg.norm(away), self.fastest(state, time)]
        rows = [[away[k], moving[k], natural[k], *both] for k in range(3)]
        return self.answer(np.array(rows)) * self.view.max_accel * self.view.dt


def _to_hold(view: Any, answer: Callable[[Array], Array], limits: Any, start: Array) -> Route:
    """Around the ball to a hold point or box, and stay."""
    point = np.array(view.goal["hold_point"], float)
    ball = 1.3 * limits.get("keep_out", {}).get("radius", 0.0)
    ball = min(ball, 0.9 * float(np.linalg.norm(point)))

    def fastest(state: Array, time: float) -> float:
        if view.goal["task"] == "berth":
            return 0.06
        return _allowed(limits, float(np.linalg.norm(state[:3])))

    if "zone_entry" in limits:
        yield Coast(limits["zone_entry"]["go_time"])
    yield Learned(view, answer, lambda state, time: beside(state[:3], point, ball), fastest)


def _to_port(view: Any, answer: Callable[[Array], Array], limits: Any, start: Array) -> Route:
    """To a point on the axis of a port outside its corridor, and along the axis into the port."""
    port = Port(view, limits)
    earliest = AVERAGED if ":nav1" in view.scenario_id else 0.0
    # Without the gates, which the speed of a port keeps: the mechanism asks for more than the last one allows.
    without_gates = {name: one for name, one in limits.items() if name != "gate_table"}

    def outside(time: float) -> Array:
        return port.origin(time) + (port.corridor + 10.0) * port.axis(time)

    def fastest(state: Array, time: float) -> float:
        range_ = float(np.linalg.norm(state[:3]))
        return _allowed(limits, range_) - abs(port.rate) * range_

    def ready(state: Array, time: float) -> bool:
        turning = np.cross([0.0, 0.0, port.rate], state[:3])
        near = float(np.linalg.norm(state[:3] - outside(time))) < 2.0
        slow = float(np.linalg.norm(state[3:] - turning)) < 0.05
        return near and slow and time >= earliest

    def along(state: Array, time: float) -> float:
        return float((state[:3] - port.origin(time)) @ port.axis(time))

    def ahead(state: Array, time: float) -> Array:
        # A point on the axis some metres ahead, behind the port at the end, pulls the craft onto the axis.
        distance = along(state, time)
        later = distance - _AHEAD * closing(state, time)
        if distance > port.waits - 1.0 and not port.free(time):
            later = max(later, port.waits)
        return port.origin(time) + later * port.axis(time)

    def closing(state: Array, time: float) -> float:
        range_ = float(np.linalg.norm(state[:3]))
        allowed = _allowed(without_gates, range_) - abs(port.rate) * range_
        return min(port.speed(along(state, time)), allowed)

    if np.linalg.norm(start[:3] - port.origin(0.0)) > port.corridor:
        around = port.arm + port.corridor + 3.0
        yield Learned(
            view,
            answer,
            lambda state, time: beside(state[:3], outside(time), around),
            fastest,
            ready,
            port.rate,
        )
    yield Learned(view, answer, ahead, closing, rate=port.rate)


def _allowed(limits: Any, range_: float) -> float:
    """The greatest speed at a range from the target, m/s."""
    speed = _CRUISE
    if "gate_table" in limits:
        gates = limits["gate_table"]["gates"]
        furthest = max(gates)
        # Beyond the last gate an episode is too short for its speed.
        speed = min(gate(gates, range_) + 0.003 * max(range_ - furthest[0], 0.0), _FASTEST)
    for name in ("speed_limit", "closing_speed_limit"):
        if name in limits:
            speed = min(speed, _MARGIN * (limits[name]["v0"] + limits[name]["v1"] * range_))
    return speed


def beside(place: Array, point: Array, ball: float) -> Array:
    """The point, m, or one beside a ball about the target that is in the way."""
    line = point - place
    part = np.clip(-(place @ line) / max(line @ line, 1e-9), 0.0, 1.0)
    nearest = place + part * line
    apart = float(np.linalg.norm(nearest))
    if apart >= ball or part in (0.0, 1.0):
        return point
    # Off the line on the side on which it passes the target; across the line if it passes through it.
    side = nearest / apart if apart > 1e-3 else np.eye(3)[int(np.argmin(np.abs(line)))]
    return 1.25 * ball * side


if __name__ == "__main__":
    torch.manual_seed(0)
    torch.set_num_threads(1)
    export(imitated(), Path(sys.argv[1]))
