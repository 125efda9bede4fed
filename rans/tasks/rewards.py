"""Shapes that the tasks' reward terms are made of."""

from __future__ import annotations

from rans.fields import Field, exp


def nearness(error: Field, scale: float) -> Field:
    """exp(-error / scale): 1 at the goal, 1/e at the scale (original system, 2023)."""
    return exp(error * (-1.0 / scale))


def price(thrust: tuple[Field, ...], weight: float) -> Field:
    """Minus the weight for every fully open thruster."""
    return sum(thrust[1:], start=thrust[0]) * -weight
