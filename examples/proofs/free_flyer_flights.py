"""Fly the agent of free_flyer_agent.py in an engine from random proved starts: none may leave 15 cm and 8 degrees.

    python examples/proofs/free_flyer_flights.py examples/proofs/free-flyer-agent.onnx fast 100000
    python examples/proofs/free_flyer_flights.py examples/proofs/free-flyer-agent.onnx drake 100

The free flyer's thrusters are throttled. Every hundredth of the flights has a mass of its own within 5 %, and every
flight an error of up to 1 mm in each coordinate of the position that is read. Flights last 9 s, after which they
are among the starts again. They take all cores.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from free_flyer_agent import STRONGEST
from rans_proof.network import apply, read_network
from rans_proof.problem import read_problem

import rans
from rans.extend import Workers
from rans.model.actuators import Throttle
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.processes import nothing

PROBLEM = read_problem(Path(__file__).with_name("free-flyer-agent.toml"))
CRAFT = replace(rans.load_spacecraft("free-flyer"), actuators=Throttle())
MASSES = 100


def in_body(states: Any) -> np.ndarray:
    """(..., 12): position and velocity in B, four modified Rodrigues parameters of the attitude, and spin in B."""
    q = states.attitude
    w, v = np.asarray(q.w), np.stack([q.x, q.y, q.z], axis=-1)
    sign = np.where(w < 0.0, -1.0, 1.0)
    w, v = sign * w, sign[..., None] * v

    def turned(vector: Any) -> np.ndarray:
        x = np.stack([vector.x, vector.y, vector.z], axis=-1)
        across = 2.0 * np.cross(-v, x)
        return x + w[..., None] * across + np.cross(-v, across)

    spin = np.stack([states.w.x, states.w.y, states.w.z], axis=-1)
    parts = [turned(states.p), turned(states.v), 4.0 * v / (1.0 + w)[..., None], spin]
    return np.concatenate(parts, axis=-1)


class Pilot:
    """The network and the throttles that make its forces and torques of the design's mass.

    Args:
        network: the ONNX file.
        errors: (N, 3) of the positions that are read, m.
    """

    name = "free-flyer-agent"
    observes = False

    def __init__(self, network: Path, errors: np.ndarray) -> None:
        self._layers = read_network(network)
        self._errors = errors
        rows = [
            [*(t.force * np.array(t.direction)), *(t.force * np.cross(t.position, t.direction))]
            for t in CRAFT.thrusters
        ]
        self._throttles = np.linalg.pinv(np.array(rows).T)
        self._scale = STRONGEST * np.repeat([CRAFT.mass, CRAFT.inertia[0][0]], 3)

    def reset(self, count: int) -> None:
        """Nothing is remembered."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Throttles (N, 16): of two opposite nozzles one is open."""
        taken = in_body(state)
        taken[:, :3] += self._errors
        both = (apply(self._layers, taken) * self._scale) @ self._throttles.T
        # Opposite nozzles have opposite parts, so that what one would pull the other pushes.
        throttles = 2.0 * np.maximum(both, 0.0)
        if throttles.max() > 1.0:
            raise ValueError("a thruster is too weak for a command.")
        return throttles


def broken(network: Path, engine: str, count: int, seed: int) -> tuple[int, float, float]:
    """Flights of one mass that leave the limits; the largest coordinate (m) and angle parameter."""
    random = np.random.default_rng(seed)
    low, high = np.array(PROBLEM.lower), np.array(PROBLEM.upper)
    x = random.uniform(low, high, (count, 16))
    factor = random.uniform(low[12], high[12])
    craft = replace(
        CRAFT,
        mass=CRAFT.mass / factor,
        inertia=tuple(tuple(value / factor for value in row) for row in CRAFT.inertia),
    )
    half = x[:, 6:9] / 4.0
    size = (half**2).sum(axis=1)
    w = (1.0 - size) / (1.0 + size)
    v = 2.0 * half / (1.0 + size)[:, None]

    def in_world(vector: np.ndarray) -> Vec3:
        across = 2.0 * np.cross(v, vector)
        return Vec3(*(vector + w[:, None] * across + np.cross(v, across)).T)

    start = SpatialState(
        in_world(x[:, :3]), Quat(w, *v.T), in_world(x[:, 3:6]), Vec3(*x[:, 9:12].T)
    )
    zero = np.zeros(count)
    none = Vec3(zero, zero, zero)
    goal = SpatialState(none, Quat(zero + 1.0, zero, zero, zero), none, none)
    timing = rans.Timing(control_period=PROBLEM.period, episode_steps=PROBLEM.steps)
    scenario = rans.scenario.Scenario(start, goal)
    pilot = Pilot(network, x[:, 13:16])
    if engine == "drake":
        from rans.reference.flight import fly_in_drake

        flight = fly_in_drake(craft, rans.GoToPose(), pilot, scenario, timing)
    else:
        flight = rans.fly(craft, rans.GoToPose(), pilot, scenario, timing)
    states = in_body(flight.states)
    np.testing.assert_allclose(states[0], x[:, :12], atol=1e-9)
    upper = PROBLEM.keep.offsets[
        len(PROBLEM.keep.offsets) // 2 :
    ]  # after those of the lower corner
    limits = np.array(upper[:12])
    is_out = (np.abs(states) > limits).any(axis=(0, 2))
    is_back = (np.abs(states[-1]) <= high[:12]).all(axis=1)
    worst = np.abs(states).max(axis=(0, 1))
    return int((is_out | ~is_back).sum()), float(worst[:3].max()), float(worst[6:9].max())


def _broken(_: None, *plan: Any) -> tuple[int, float, float]:
    """Flights of a process."""
    return broken(*plan)


def main(network: Path, engine: str, flights: int) -> None:
    """Print how many flights break what is proved."""
    jobs = [(network, engine, flights // MASSES, seed) for seed in range(MASSES)]
    results = list(Workers(nothing, (), None, "flew from proved starts").ordered(_broken, jobs))
    count = sum(result[0] for result in results)
    far, turned = (max(result[k] for result in results) for k in (1, 2))
    print(  # noqa: T201
        f"{count} of {flights // MASSES * MASSES:,} flights break what is proved; the largest coordinate is "
        f"{far:.4f} m, and the largest angle {np.rad2deg(turned):.2f} degrees."
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]))
