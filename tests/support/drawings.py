"""The meshes of a scene."""

from __future__ import annotations

import numpy as np

from rans.show.scene.craft import Part


def lines(part: Part, key: str) -> list[list[str]]:
    """Of the text of a part's mesh."""
    text = part.shape.source().in_memory().mesh_file.contents().decode()  # type: ignore[attr-defined]
    return [line.split()[1:] for line in text.splitlines() if line.split()[0] == key]


def corners(part: Part) -> np.ndarray:
    """(K, 3), before the mesh's scale."""
    return np.array(lines(part, "v"), dtype=float)
