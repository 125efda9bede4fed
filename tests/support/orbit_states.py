"""States and goals of one craft on an orbit, without rotation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from rans_missions.tasks.orbital import Plan

from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3


def at(p: Sequence[float], v: Sequence[float]) -> Any:
    """A state of one craft, without rotation."""
    zero = np.zeros(1)
    place = Vec3(*(zero + x for x in p))
    velocity = Vec3(*(zero + x for x in v))
    return SpatialState(place, Quat(zero + 1.0, zero, zero, zero), velocity, Vec3(zero, zero, zero))


def goal_of(place: tuple[float, float, float]) -> Any:
    """A goal at rest with 1,000 s to the deadline and a plan of 900 s."""
    zero = np.zeros(1)
    return replace(at(place, (0.0,) * 3), notes=Plan(zero + 1000.0, zero + 900.0, zero))
