"""Tasks of missions: near a target on an orbit, on a moon, and among zones that move."""

from rans_missions.tasks.avoid import Avoid
from rans_missions.tasks.dock import Dock
from rans_missions.tasks.dock_port import DockPort
from rans_missions.tasks.final_approach import FinalApproach
from rans_missions.tasks.hold import Hold
from rans_missions.tasks.inspect import Inspect
from rans_missions.tasks.land import Land
from rans_missions.tasks.orbital import TargetOrbit
from rans_missions.tasks.rendezvous import Rendezvous

__all__ = [
    "Avoid",
    "Dock",
    "DockPort",
    "FinalApproach",
    "Hold",
    "Inspect",
    "Land",
    "Rendezvous",
    "TargetOrbit",
]
