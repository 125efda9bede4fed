"""Craft with an effector that RANS does not know: the torquer of ``examples/plugin``, which a battery feeds."""

from dataclasses import replace

from rans_example.in_drake import TorquerInDrake
from rans_example.motion import Torquer

from rans.model.spacecraft_file import load_spacecraft
from rans.reference.further import register

register("Torquer", TorquerInDrake)
TURNED = replace(
    load_spacecraft("floating-platform"),
    name="turned",
    further_effectors=(Torquer((0.0, 0.0, 1.0), 0.05, 1.5),),
)
TURNED_IN_SPACE = replace(
    load_spacecraft("free-flyer"),
    name="turned-in-space",
    further_effectors=(Torquer((0.0, 0.6, 0.8), 0.03, 1.5),),
)
