"""Picture of a trapping set: `python -m rans_proof.picture CERTIFICATE PICTURE.svg`.

The certificate is that of `rans prove AGENT`; see docs/proof/proofs.md.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from rans.extend import Figure, read_bytes
from rans.show.figures.plotting import ListedColormap, rcParams
from rans_proof.trap_certificate import LARGEST, read_certificate

SPINS = (0.0, 0.6, 1.2)
"""Spins of the panels, rad/s: within the starts, of two pulses, and near the limit."""


def draw(certificate: Path, picture: Path) -> None:
    """Draw velocities in the body frame for some spins: in the set, and left out."""
    trap = read_certificate(read_bytes(certificate, LARGEST), certificate)
    grid, keep = trap.grid, trap.keep
    inside = np.zeros((grid["rings"], grid["sectors"], 2 * grid["layers"]))
    for a, b, c, d, e, f in trap.cells:
        inside[a:b, c:d, e + grid["layers"] : f + grid["layers"]] = 1.0
    rcParams["svg.hashsalt"] = "rans"  # the same picture has the same bytes
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    axes = figure.subplots(1, len(SPINS), subplot_kw={"projection": "polar"})
    angle = np.linspace(0.0, 2.0 * np.pi, grid["sectors"] + 1)
    radius = np.linspace(0.0, 100.0 * keep["speed"], grid["rings"] + 1)
    colors = ListedColormap(["#d9d9d9", "#2a7f62"])
    for axis, spin in zip(axes, SPINS, strict=True):
        layer = grid["layers"] + int(spin / keep["spin"] * grid["layers"])
        mesh = axis.pcolormesh(angle, radius, inside[:, :, layer], cmap=colors, vmin=0, vmax=1)
        mesh.set_rasterized(True)
        axis.set_title(f"spin {spin:g} rad/s", fontsize=10)
        axis.set_rlabel_position(100)
        axis.set_yticks([4, 8, 12, 16], ["4", "8", "12", "16 cm/s"], fontsize=7)
        axis.set_xticks([0.0, 0.5 * np.pi], ["x", "y"], fontsize=8)
        axis.grid(visible=True, alpha=0.3)
    figure.suptitle("Velocity in the body frame: proved (green) and open (gray)", fontsize=11)
    figure.savefig(picture, metadata={"Date": None})


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
