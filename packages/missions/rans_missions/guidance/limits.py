"""Limits that guidance on orbits keeps: keep-out balls and speed limits, the shapes of tasks at rest in W."""

from __future__ import annotations

from typing import NamedTuple

from rans.extend import Ball, Shape, SpeedLimit


class Limits(NamedTuple):
    """Limits of a mission, by what guidance does about them."""

    balls: tuple[Ball, ...] = ()
    """Keep-out balls, which do not move: coasts go around them."""
    speeds: tuple[SpeedLimit, ...] = ()
    """Speed limits, whose margin at rest is the allowed speed, m/s: velocities are scaled below it."""
    others: tuple[Shape, ...] = ()
    """Limits of other kinds: plans of arrivals have a price for violating them."""
