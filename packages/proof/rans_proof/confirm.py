"""Proofs whose every cell the checker accepts: what it refuses is split until it proves the parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rans_proof.balls import Refused
from rans_proof.check import Loop
from rans_proof.check_file import problem_table
from rans_proof.prove import Proof


def confirmed(
    proof: Proof,
    network: bytes,
    smallest: float = 1.0 / 512,
    report: Callable[[int, int], object] = lambda done, left: None,
) -> Proof:
    """A proof of the same property of cells that the checker accepts; what it never accepts is open.

    Args:
        proof: proved cells, of which there may be open ones beside.
        network: content of the network's file.
        smallest: cells are not split below this part of the start set along a state.
        report: called after every cell with the numbers of accepted cells and of those that are left.
    """
    loop = Loop(problem_table(proof.problem.text), network)
    span = np.maximum(np.subtract(proof.problem.upper, proof.problem.lower), 1e-300)
    queue = list(zip(proof.low, proof.high, strict=True))
    accepted: list[tuple[np.ndarray, np.ndarray, float]] = []
    stuck = list(zip(proof.open_low, proof.open_high, strict=True))
    while queue:
        low, high = queue.pop()
        try:
            margin = loop.margin(list(zip(low.tolist(), high.tolist(), strict=True)))
        except (Refused, ArithmeticError, ValueError):
            margin = -np.inf
        parts = (high - low) / span
        if margin > 0.0:
            accepted.append((low, high, margin))
        elif parts.max() <= smallest:
            stuck.append((low, high))
        else:
            axis = int(parts.argmax())
            middle = 0.5 * (low[axis] + high[axis])
            ends = high.copy(), low.copy()
            for end in ends:
                end[axis] = middle
            queue += [(low, ends[0]), (ends[1], high)]
        report(len(accepted), len(queue))
    none = np.zeros((0, proof.problem.states))
    return replace(
        proof,
        low=np.array([cell[0] for cell in accepted]) if accepted else none,
        high=np.array([cell[1] for cell in accepted]) if accepted else none,
        margins=np.array([cell[2] for cell in accepted]),
        open_low=np.array([cell[0] for cell in stuck]) if stuck else none,
        open_high=np.array([cell[1] for cell in stuck]) if stuck else none,
    )
