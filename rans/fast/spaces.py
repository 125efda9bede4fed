"""Gymnasium spaces of a spacecraft, shared by every environment interface."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from rans.spacecraft import Spacecraft
from rans.tasks.base import observation_width


def observation_space(craft: Spacecraft) -> spaces.Box:
    """10 (plane) or 22 (space) unbounded float32 columns."""
    return spaces.Box(-np.inf, np.inf, (observation_width(craft.dimension),), np.float32)


def action_space(craft: Spacecraft) -> spaces.MultiDiscrete:
    """One on/off choice per thruster."""
    return spaces.MultiDiscrete([2] * len(craft.thrusters))
