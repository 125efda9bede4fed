"""The text of a valid spacecraft file, and values as TOML writes them."""

from __future__ import annotations

from typing import Any

VALID = """\
name = "probe"
dimension = 2
mass = 4.5
inertia = [[0.2, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.4]]
centre_of_mass = [0.1, 0.0]
radius = 0.3
shape = "cylinder"
thrust_sharing = "split"
thruster = [
  {position = [0.3, 0.2], direction = [-1, 0], force = 1.0},
  {position = [0.3, -0.2], direction = [-1, 0], force = 1.0},
  {position = [-0.3, 0.2], direction = [1, 0], force = 1.0},
  {position = [-0.3, -0.2], direction = [1, 0], force = 1.0},
  {position = [0.1, 0.3], direction = [0, -1], force = 2.0},
  {position = [0.1, -0.3], direction = [0, 1], force = 2.0},
]
"""


def toml(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{toml(k)} = {toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, str):
        return '"' + "".join(f"\\U{ord(c):08x}" for c in value) + '"'
    return repr(value)
