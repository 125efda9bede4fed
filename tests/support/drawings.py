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


def volume(part: Part) -> float:
    """Volume of a closed mesh whose faces and normals point outwards, by the divergence theorem."""
    points = corners(part)
    normals = np.array(lines(part, "vn"), dtype=float)
    # Corner and normal of each corner of each triangle.
    faces = np.array(
        [[[int(x) - 1 for x in corner.split("//")] for corner in face] for face in lines(part, "f")]
    )
    a, b, c = (points[faces[:, k, 0]] for k in range(3))
    edges = {(face[k], face[k - 2]) for face in faces[..., 0].tolist() for k in range(3)}
    assert {(end, start) for start, end in edges} == edges  # each edge has two sides
    outwards = np.cross(b - a, c - a)
    assert (np.sum(normals[faces[..., 1]] * outwards[:, None], axis=-1) > 0.0).all()
    return float(np.sum(a * np.cross(b, c)) / 6.0)
