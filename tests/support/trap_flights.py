"""Random flights from a trapping set of velocities, none of which may leave it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from rans_proof.trap import Loop, Trap, Uncertainty


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
