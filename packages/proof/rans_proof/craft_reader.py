"""The checkers' own reader of an agent's craft, task and period, apart from the reader that flies it.

Numbers of thrusters are rational, so that what is equal is so without rounding.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from fractions import Fraction
from typing import Any, NamedTuple

from rans_proof.balls import need
from rans_proof.claims import json_of, toml_of

FILES = ("agent.safetensors", "config.json", "spacecraft.toml")
"""Files of an agent that decide its flight, and whose SHA-256 a certificate has."""
_LARGEST = 2**24
"""Bytes of a file of settings."""
_CRAFT: dict[str, Any] = {
    "name": None,
    "dimension": 2,
    "mass": None,
    "inertia": None,
    "radius": None,
    "shape": None,
    "thrust_sharing": "none",
    "centre_of_mass": None,
    "actuators": {"kind": "on-off"},
    "thruster": None,
}
"""Keys that a craft may have, and the one value that is proved for; None: any, or read below."""
_THRUSTER = {"position", "direction", "force", "supply"}


class Thruster(NamedTuple):
    """A thruster in the plane."""

    force: Fraction
    """N."""
    direction: tuple[Fraction, Fraction]
    """Direction of the force in the frame of the craft; its length is not 1 in general."""
    moment: Fraction
    """Position times direction, m."""

    @property
    def lever(self) -> int:
        """Sign of its torque."""
        return (self.moment > 0) - (self.moment < 0)

    @property
    def squared_torque(self) -> Fraction:
        """Square of its torque, (N m)^2."""
        x, y = self.direction
        return (self.force * self.moment) ** 2 / (x * x + y * y)


class Craft(NamedTuple):
    """A rigid craft in the plane, whose thrusters are on or off and do not share what feeds them."""

    mass: float
    inertia: float
    thrusters: list[Thruster]


def check_digests(digests: Mapping[str, str], files: Mapping[str, bytes]) -> None:
    """Refuse files of an agent that are others than a certificate's."""
    for name in FILES:
        digest = hashlib.sha256(files[name]).hexdigest()
        need(digests[name] == digest, f"it is of another agent: the SHA-256 of {name} differs.")


def read_period(config: bytes) -> float:
    """Control period, s, of a run's settings, whose task must be go-to-pose."""
    table = json_of(config, _LARGEST)
    need(table["task"] == "go-to-pose", "its task is not go-to-pose.")
    period = float(table["timing"]["control_period"])
    need(0.0 < period <= 10.0, "its control period is not from 0 to 10 s.")
    return period


def read_craft(content: bytes) -> Craft:
    """Craft of a spacecraft's file with exact numbers; `Refused` for any key or effector that no proof knows.

    Keys are an allow list: what a file says and the proof leaves out would be a craft that flies otherwise.
    """
    table = toml_of(content)
    for key, value in table.items():
        is_proved = key in _CRAFT and _CRAFT[key] in (None, value)
        need(is_proved, f"its spacecraft's {key[:40]} is one that no proof is known for.")
    need(table["dimension"] == 2, "its spacecraft is not in the plane.")
    need(
        not any(table.get("centre_of_mass", ())),
        "the centre of mass is not in the middle of its frame.",
    )
    inertia = table["inertia"]
    inertia = inertia[2][2] if isinstance(inertia, list) else inertia
    mass = float(table["mass"])
    inertia = float(inertia)
    need(mass > 0.0 and inertia > 0.0, "its mass or inertia is not above 0.")
    thrusters = []
    for thruster in table["thruster"]:
        need(thruster.keys() <= _THRUSTER, "a thruster has a key that no proof is known for.")
        position, direction = (
            [Fraction(float(x)) for x in thruster[key]] for key in ("position", "direction")
        )
        force = Fraction(float(thruster["force"]))
        need(not any(position[2:] + direction[2:]), "a thruster is not in the plane.")
        (px, py), (dx, dy) = position[:2], direction[:2]
        need(force > 0 and (dx or dy), "a thruster has no force.")
        thrusters.append(Thruster(force, (dx, dy), px * dy - py * dx))
    need(thrusters, "its spacecraft has no thruster.")
    return Craft(mass, inertia, thrusters)
