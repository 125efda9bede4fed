"""Random flights from proved starts, none of which may break what is proved; see docs/proof/proofs.md.

`python -m campaigns.proof_flights --problem FILE.toml --network FILE.onnx` flies a network;
`python -m campaigns.proof_flights --agent AGENT --certificate FILE` flies an agent from its trapping set, of
velocities for one period and of poses for 30 periods. They take all cores.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rans_proof.flights import lowest_margins
from rans_proof.network import read_network
from rans_proof.pose_flights import leaving as leaving_poses
from rans_proof.problem import read_problem
from rans_proof.trap import Loop, Trap, Uncertainty, velocity_loop

from campaigns.command import ended
from rans.errors import ConfigError
from rans.evaluation.fly.agent import load_policy
from rans.pretrained import pretrained_folder
from rans.processes import Workers, nothing

_BATCH = 20_000
_POSE_PERIODS = 30
"""Periods of a flight from a trapping set of poses, in which most come to several pulses."""


@dataclass
class ProofFlights:
    """Fly a network or an agent from random proved starts, and count the flights that break the property."""

    problem: Path | None = None
    """Plant, starts and property of a network that is proved from every start."""
    network: Path | None = None
    """The network's ONNX file."""
    agent: str | None = None
    """Name of a shipped agent, or a run folder."""
    certificate: Path | None = None
    """Certificate of the agent's trapping set."""
    flights: int = 1_000_000
    """Flights; those of an agent of velocities last one period, since they end in a cell again."""

    def run(self) -> int:
        """Number of flights that break the property."""
        batches = [min(_BATCH, self.flights - k) for k in range(0, self.flights, _BATCH)]
        if (self.problem is None or self.network is None) and (
            self.agent is None or self.certificate is None
        ):
            raise ConfigError("name --problem and --network, or --agent and --certificate.")
        jobs = [(self, count, seed) for seed, count in enumerate(batches)]
        workers = Workers(nothing, (), None, "flew from proved starts")
        return sum(answer for _, answer in workers.finished(_broken, jobs))


def _broken(_: None, plan: ProofFlights, count: int, seed: int) -> int:
    """Number of flights of one batch that break the property."""
    if plan.problem is not None and plan.network is not None:
        problem, layers = read_problem(plan.problem), read_network(plan.network)
        random = np.random.default_rng((6, seed))
        start = random.uniform(problem.lower, problem.upper, (count, problem.states))
        return int((lowest_margins(problem, layers, start) <= 0.0).sum())
    assert plan.agent is not None
    assert plan.certificate is not None
    is_folder = (Path(plan.agent) / "config.json").is_file()
    run = load_policy(Path(plan.agent) if is_folder else pretrained_folder(plan.agent))
    table = json.loads(plan.certificate.read_text())
    if "reach" in table:
        return leaving_poses(run, table, count, _POSE_PERIODS, seed)[0]
    loop = velocity_loop(run.network, run.craft, run.timing.control_period)
    return leaving(loop, read_trap(plan.certificate), count, 1, seed)


def read_trap(certificate: Path) -> Trap:
    """Trapping set of a certificate's file."""
    table = json.loads(certificate.read_text())
    off = Uncertainty(**table["uncertainty"])
    return Trap(
        table["keep"]["speed"], **table["grid"], cells=np.array(table["cells"]), uncertainty=off
    )


def leaving(loop: Loop, trap: Trap, flights: int, periods: int, seed: int) -> int:
    """Number of flights from random states of random cells, with random errors, that leave the cells."""
    random = np.random.default_rng(seed)
    inside = trap.inside()
    cells = np.argwhere(inside)[random.integers(0, inside.sum(), flights)]
    r, phi, w = (cells + random.random((flights, 3))).T
    speed = r / trap.rings * trap.speed
    angle = phi / trap.sectors * 2.0 * np.pi
    velocity = speed[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
    off = trap.uncertainty
    factor = random.uniform(*off.push(), flights)
    spin = (w - trap.layers) / trap.fine * loop.step * factor
    # Cells are of the time at which a command acts, which is later than that at which the state was read.
    late = random.uniform(0.0, off.delay)
    begin, rest = (
        replace(loop, period=x, step=loop.step * x / loop.period)
        for x in (loop.period - late, late)
    )
    c, s = np.cos(spin * late), np.sin(spin * late)
    before = np.column_stack(
        (c * velocity[:, 0] - s * velocity[:, 1], s * velocity[:, 0] + c * velocity[:, 1])
    )

    def commanded(velocity: np.ndarray, spin: np.ndarray) -> np.ndarray:
        read = velocity + random.uniform(-off.velocity, off.velocity, velocity.shape)
        read_spin = spin + random.uniform(-off.spin, off.spin, flights)
        return (loop.log_odds(read, read_spin) > 0) * factor[:, None]

    commands = commanded(before, spin)
    left = np.zeros(flights, dtype=bool)
    for _ in range(periods):
        velocity, spin = begin.fly(velocity, spin, commands)
        new = commanded(velocity, spin)
        if late:
            velocity, spin = rest.fly(velocity, spin, commands)
        commands = new
        place = (
            np.linalg.norm(velocity, axis=1) / trap.speed * trap.rings,
            np.arctan2(velocity[:, 1], velocity[:, 0]) / (2.0 * np.pi) * trap.sectors,
            spin / factor / loop.step * trap.fine + trap.layers,
        )
        # A state on an edge is in the cells of both sides.
        near = np.zeros(flights, dtype=bool)
        for shift in (-1e-7, 1e-7):
            i, j, k = (np.floor(x + shift).astype(int) for x in place)
            legal = (i < trap.rings) & (k >= 0) & (k < 2 * trap.layers)
            i, k = np.where(legal, np.maximum(i, 0), 0), np.where(legal, k, 0)
            near |= legal & inside[i, j % trap.sectors, k]
        left |= ~near
    return int(left.sum())


def main() -> int:
    """Print the number of flights that break the property; 1 if any does."""
    import tyro

    flights = tyro.cli(ProofFlights)
    broken = flights.run()
    print(f"{broken} of {flights.flights:,} flights break what is proved.")  # noqa: T201
    return 1 if broken else 0


if __name__ == "__main__":
    raise SystemExit(ended("proof_flights", main))
