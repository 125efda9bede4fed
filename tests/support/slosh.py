"""Craft with sloshing liquid."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import rans
from rans import Spacecraft

SLOSH = rans.Slosh(1.064, 0.06, (0.05, 0.03, 0.0), (-0.6, 0.8, 0.0), 0.002)
SLOSHING = replace(
    rans.load_spacecraft("floating-platform"), name="sloshing", further_effectors=(SLOSH,)
)
"""The floating platform, of whose mass 20 % swing."""

IN_SPACE_SLOSH = rans.Slosh(0.8, 0.05, (0.03, -0.02, 0.04), (-0.48, 0.6, 0.64), 0.004)
IN_SPACE = replace(
    rans.load_spacecraft("free-flyer"),
    name="sloshing in space",
    inertia=((0.15, 0.01, -0.005), (0.01, 0.12, 0.015), (-0.005, 0.015, 0.2)),
    further_effectors=(IN_SPACE_SLOSH,),
)
"""A craft with different moments of inertia, of whose mass 15 % swing."""


def slosh_of(craft: Spacecraft) -> Any:
    """The liquid of a craft that has one."""
    (slosh,) = craft.further_effectors
    return slosh
