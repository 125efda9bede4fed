"""Decide ARCH-COMP's vertical collision avoidance (VCAS) in ball arithmetic, with the middle of each choice.

`python packages/proof/archcomp/vcas.py FOLDER` needs the nine networks `vcas-pra0N.onnx`, or the organisers' own
`VertCAS_noResp_pra0N_v9_20HU_200.onnx`. Every second the network of the last advisory gives nine scores, and the
advisory of the largest one is the new one. Heights are balls, cut until one advisory has the largest score from the
whole ball; so what is printed holds for every start, and what is violated is violated by every start.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flint import arb, arb_mat, ctx
from rans_proof.balls import absolute_row_sums, column, network_enclosure
from rans_proof.network_reader import layers_of

from rans.extend import Terminal

G = arb(322) / 10
"""ft/s^2."""
CLIMB = 7 * G / 24
ACCELERATIONS = {
    1: 0 * G,
    2: -CLIMB,
    3: CLIMB,
    4: -CLIMB,
    5: CLIMB,
    6: -G / 3,
    7: G / 3,
    8: -G / 3,
    9: G / 3,
}
"""ft/s^2, the middle of each advisory's choices."""
RATES = {
    2: (-1, 0),
    3: (1, 0),
    4: (-1, 1500),
    5: (1, 1500),
    6: (-1, 1500),
    7: (1, 1500),
    8: (-1, 2500),
    9: (1, 2500),
}
"""A climb rate r, ft/min, complies with an advisory if sign * r is at least the number."""
SPEEDS = ("-19.5", "-22.5", "-25.5", "-28.5")
SECONDS = 10
SMALLEST = 1e-3
"""ft; a ball that is narrower and has no advisory is open."""


def advisory(layers: Any, h: Any, v: Any, tau: int) -> int | None:
    """The advisory of the largest score from every height of a ball, or None."""
    centre = column([arb(h.mid()) / 16000, v / 5000, arb(tau - 20) / 40])
    spread = arb_mat([[arb(h.rad()) / 16000], [arb(0)], [arb(0)]])
    gain, offset, errors = network_enclosure(layers, centre, spread)
    for k in range(9):
        others = [j for j in range(9) if j != k]
        rows = arb_mat([[gain[k, i] - gain[j, i] for i in range(3)] for j in others])
        at = (rows * centre).entries()
        spans = absolute_row_sums(rows * spread)
        if all(
            a + offset[k, 0] - offset[j, 0] - span - errors[k] - errors[j] > 0
            for a, span, j in zip(at, spans, others, strict=True)
        ):
            return k + 1
    return None


def distances(networks: Sequence[Any], low: Any, high: Any, v: Any) -> list[tuple[Any, Any]]:
    """Least and largest |h| over the seconds from heights of an interval, for each ball that it is cut into."""
    begin = low.union(high)
    h, last = begin, 1
    least, largest = arb("inf"), arb("inf")
    for second in range(SECONDS):
        new = advisory(networks[last - 1], h, v, 25 - second)
        if new is None:
            middle = (low + high) / 2
            if high - low < SMALLEST:
                return [(arb(0), arb("inf"))]
            return distances(networks, low, arb(middle.mid()), v) + distances(
                networks, arb(middle.mid()), high, v
            )
        sign, rate = RATES.get(new, (1, 0))
        excess = sign * 60 * v - rate
        complies = new == last != 1 and bool(excess >= 0)
        a = arb(0) if complies else ACCELERATIONS[new]
        h, v, last = h - v - a / 2, v + a, new
        least = min(least, abs(h).lower(), key=float)
        largest = min(largest, abs(h).upper(), key=float)
    return [(least, largest)]


def main(folder: Path) -> None:
    """Print the verdict of each speed."""
    ctx.prec = 80
    files: dict[int, Path] = {}
    for file in folder.rglob("*.onnx"):
        if found := re.search(r"pra0([1-9])", file.name):
            files[int(found[1])] = file
    edges = (-133 / 16000, -28.5 / 5000, 0.1), (-129 / 16000, 100 / 5000, 0.2)
    networks = [layers_of(files[k].read_bytes(), *edges) for k in range(1, 10)]
    for text in SPEEDS:
        parts = distances(networks, arb(-133), arb(-129), arb(text))
        least = min(float(low) for low, _ in parts)
        verdict = "open"
        if least > 100.0:
            verdict = "proved"
        elif any(float(high) <= 100.0 for _, high in parts):
            verdict = "refuted"
        Terminal().say(f"v = {text} ft/s: {verdict}; least |h| {least:.3f} ft, {len(parts)} balls")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
