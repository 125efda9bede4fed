"""A pose away from the goal, as a robot measures it."""

from __future__ import annotations

import numpy as np
from rans_robot.frames import Motion, quaternion_of

AWAY = Motion(np.array([2.0, 1.0, 0.0]), quaternion_of(0.5), np.zeros(3), np.zeros(3))
