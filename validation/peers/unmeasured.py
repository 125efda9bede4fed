"""Simulators and trainers that a reader may miss among the peers, and why they are not measured."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Unmeasured:
    """A package without a script."""

    name: str
    """As its authors call it."""
    reason: str
    """What stands in the way."""
    tried: str
    """What showed it, in November 2026 on a machine without a GPU."""


_ABSENT = "no package on PyPI"

UNMEASURED = (
    Unmeasured(
        "PufferLib 4",
        "not on PyPI, whose newest, 3.0.0, has no wheel and downloads a graphics library to be built",
        "pip install pufferlib==3.0.0: no such host; with NO_OCEAN=1, without games: NameError",
    ),
    Unmeasured(
        "BSK-RL",
        "its environments download gravity data; Basilisk, on which they stand, is measured",
        "pip install bsk-rl==1.3.8; reset() of one with AttitudeSetpoint: no such host",
    ),
    Unmeasured(
        "mjlab",
        "MuJoCo Warp, its physics, is made for GPUs; needs torch; nothing in it flies",
        "pip install mjlab==1.6.0: 15 to 21 k steps/s of 1,024 cart-poles on one core",
    ),
    Unmeasured(
        "Genesis",
        "3 GB without torch, which it needs and does not bring",
        "pip install genesis-world==1.4.5; import genesis: ImportError",
    ),
    Unmeasured(
        "OrbitZoo",
        "needs exactly torch 2.4.1 and NumPy 1.24.4",
        "pip install orbitzoo==0.1.2 beside torch 2.13: ResolutionImpossible",
    ),
    Unmeasured(
        "RANS of 2023, RoboRAN, Space Robotics Bench",
        "need Isaac Sim, of which PyPI has a placeholder; the rest is on NVIDIA's index, for its GPUs",
        "pip install isaacsim==5.1.0.0: InstallFailedError",
    ),
    Unmeasured(
        "SmallSatSim",
        f"{_ABSENT}; its repository builds a container",
        "pip index versions smallsat_sim",
    ),
    Unmeasured(
        "dpang/rans-env",
        f"{_ABSENT}; a server in a container, stepped over HTTP",
        "pip index versions rans-env",
    ),
    Unmeasured("DiffAero", f"{_ABSENT}; a repository", "pip index versions diffaero"),
    Unmeasured("FlashSAC", f"{_ABSENT}; a repository", "pip index versions flashsac"),
    Unmeasured("FastTD3", f"{_ABSENT}; a repository", "pip index versions fast-td3"),
    Unmeasured(
        "EvoX",
        "evolution instead of gradients, on the simulators of brax and Playground, which are measured",
        "pip download --no-deps evox==1.4.0",
    ),
)
