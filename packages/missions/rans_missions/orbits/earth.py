"""The Earth: its gravity and its size."""

from __future__ import annotations

EARTH = 3.986004418e14
"""Gravitational parameter of the Earth, m^3/s^2 (IERS Conventions 2010)."""
J2 = 1.08262668e-3
"""Oblateness of the Earth's gravity, without a unit (EGM96)."""
EARTH_RADIUS = 6.378137e6
"""Equatorial radius of the Earth, m (WGS 84)."""
