"""How soon a controller without training must settle."""

from __future__ import annotations

NAMES = ["go-to-position", "go-to-pose", "track-velocity", "track-twist", "track-velocity-heading"]
SLOWEST = {
    "go-to-position": 8.0,
    "go-to-pose": 8.0,
    "track-velocity": 2.0,
    "track-twist": 2.0,
    "track-velocity-heading": 3.0,
}
"""Bounds of the median settling time, s. Where a way is to be gone, 6.8 s are published of a baseline of
this kind; 0.75 m/s take 1.5 s at full thrust and half a turn 2 s."""
