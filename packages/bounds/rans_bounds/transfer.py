"""Dual function of transfers in a given time: whatever multipliers are found, their value is a lower bound.

A convex relaxation for any commands between 0 and 1 that may change at any instant. The attitude at every instant
lies in a tube around a known one, and one set of thrusters has to push and to turn. docs/bounds/certificate.md
proves it, and tests hold bounds below linear programs and every trajectory found.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rans_bounds.cutting_planes import ascend

_ROUNDS = 200
"""Largest number of cutting planes; in space 60 to 130 are usual."""
_CLOSE = 3e-4
"""Rise of a bound, relative, that is not worth another cutting plane."""
_SMALL = 1e-6
"""Rise of a bound, over the value that all multipliers of size 1 give, that is not worth another cutting plane."""
_ROUNDING = 1e-8
"""Relative part of a bound that is subtracted for rounding: wrenches count as one where they agree to 1e-9."""
_LARGEST = 30.0
"""Largest multiplier of an impulse; those of optimal flights are below 5."""


class Corners(NamedTuple):
    """Extreme wrenches of the thrusters, and what wheels give beside them."""

    force: np.ndarray
    """(K, d) in B, N."""
    torque: np.ndarray
    """(K,) about z in the plane, N m; in space how fast it changes a measure of rotation."""
    thrust: np.ndarray
    """(K,) sum of the open thrusters' forces, N."""
    wheels: float = 0.0
    """Largest torque of all wheels together, as those of the thrusters."""


class Turning(NamedTuple):
    """What torque has to give in a transfer, and its E multipliers."""

    gain: np.ndarray
    """(E,) linear part of the bound."""
    spared: np.ndarray
    """(E,) price of the size of each multiplier: what the goal set leaves open."""
    basis: np.ndarray
    """(N, 2, E) by what the multipliers price torque at both ends of each interval."""
    lean: np.ndarray
    """(N, E) by what the multipliers price, in each interval, the angle from the middle of the tube."""
    signs: tuple[int, ...]
    """Sign that each multiplier must have; 0: either."""

    @classmethod
    def none(cls, count: int) -> Turning:
        """A turning without multipliers in ``count`` intervals, for craft and goals where nothing has to turn."""
        nothing = np.zeros(0)
        return cls(nothing, nothing, np.zeros((count, 2, 0)), np.zeros((count, 0)), ())


class Worth(NamedTuple):
    """Value of the dual function."""

    value: float
    gradient: np.ndarray
    """A supergradient by the multipliers."""


@dataclass(frozen=True)
class Transfer:
    """A transfer of one craft in a given time, with a heading to turn by at least or exactly."""

    corners: Corners
    mass: float
    time: float
    """s"""
    way: np.ndarray
    """(d,) displacement that thrust has to give, m."""
    change: np.ndarray
    """(d,) change of velocity, m/s."""
    near: tuple[float, float]
    """Tolerances of velocity (m/s) and position (m); infinite: it is not asked for."""
    turning: Turning
    """What torque has to give."""
    centre: np.ndarray
    """(N, d, d) attitude in the middle of the tube in each interval."""
    width: np.ndarray
    """(N,) largest angle from there, rad."""

    def bound(self, price: float) -> float:
        """The best bound that cutting planes find; 0 if there is none.

        Args:
            price: of thrust. 1: the bound is that of the impulse, N s. 0: thrust costs nothing, and a result above
                0 proves, whatever its size, that nothing arrives in the time; the first such result is returned.
        """
        d = len(self.way)
        torques = np.abs(self.corners.torque) / np.maximum(self.corners.thrust, 1e-300)
        # A torque counts as the force at the largest arm, which is 1e-6 m at least: a craft may have no torque.
        unit = np.repeat(
            [1.0, 1.0 / max(float(torques.max()), 1e-6)], [2 * d, len(self.turning.gain)]
        )
        asked = np.isfinite(self.near)
        most = _LARGEST if price else 1.0
        signs = np.array(self.turning.signs)
        low = -most * np.append(np.repeat(asked, d), signs <= 0)
        high = most * np.append(np.repeat(asked, d), signs >= 0)
        # First along the way: the pull is x[:d] + left x[d : 2 d], which goes from ahead to -ahead. At a size of 1
        # thrust is worth its price. Without a price every size gives the same sign: 0.3 keeps twice of it below 1,
        # the largest multiplier.
        start = np.zeros(len(unit))
        response = self.way if asked[1] and self.way.any() else self.change
        if response.any():
            ahead = response / np.linalg.norm(response) * (1.0 if price else 0.3)
            start[: 2 * d] = np.concatenate([-ahead, 2.0 * ahead] if asked[1] else [ahead, ahead])
        result = ascend(
            lambda x: self.worth(x, price),
            np.clip(start, low, high),
            unit,
            target=math.inf if price else 0.0,
            tolerance=_SMALL * float(np.abs(self.gain() * unit).sum()),
            trust=0.3,
            iterations=_ROUNDS,
            low=low,
            high=high,
            relative=_CLOSE,
        )
        return max(0.0, float(result.best.value))

    def gain(self) -> np.ndarray:
        """Linear part of the bound, by its multipliers."""
        way = self.mass * self.way / self.time
        return np.concatenate([self.mass * self.change, way, self.turning.gain])

    def worth(self, x: np.ndarray, price: float) -> Worth:
        """Bound of multipliers: d of the velocity, d of the position over the time, and those of the rotation."""
        d = len(self.way)
        corners = self.corners
        left = np.linspace(1.0, 0.0, len(self.width) + 1)
        left = np.stack([left[:-1], left[1:]], axis=1)[..., None]
        pull = x[:d] + left * x[d : 2 * d]
        turning = self.turning.basis @ x[2 * d :]
        size = np.linalg.norm(pull, axis=-1)
        ahead = pull / np.where(size > 0.0, size, 1.0)[..., None]
        # In the frame of the middle of the tube: angles between the pull and the force of every set.
        force = np.linalg.norm(corners.force, axis=1)
        unit = corners.force / np.where(force > 0.0, force, 1.0)[:, None]
        inside = np.einsum("nji,nej->nei", self.centre, ahead)
        angle = np.arccos(np.clip(inside @ unit.T, -1.0, 1.0))
        # The attitude turns a force towards the pull: not, as far as the tube lets it, or as far as its price says.
        pulled = size[..., None] * force
        turned = np.minimum(angle, self.width[:, None, None])
        lean = np.maximum(self.turning.lean @ x[2 * d :], 0.0)[:, None, None]
        worth = pulled * np.cos(angle - turned)
        if lean.any():
            with np.errstate(divide="ignore", invalid="ignore"):
                rest = np.arcsin(np.where(pulled > lean, lean / pulled, 1.0))
            worth -= lean * turned
            for less in (np.clip(angle - rest, 0.0, turned), 0.0 * turned):
                value = pulled * np.cos(angle - less) - lean * less
                turned = np.where(value > worth, less, turned)
                worth = np.maximum(value, worth)
        off = angle - turned
        worth += turning[..., None] * corners.torque - price * corners.thrust
        which = worth.argmax(axis=-1)
        wheel = np.sign(turning) * corners.wheels
        values = np.take_along_axis(worth, which[..., None], -1)[..., 0] + turning * wheel
        # The slope by the pull is the best force in W: turned by the tube towards the pull.
        off = np.take_along_axis(off, which[..., None], -1)
        axis = np.einsum("nij,nej->nei", self.centre, unit[which])
        aside = axis - np.sum(axis * ahead, axis=-1, keepdims=True) * ahead
        length = np.linalg.norm(aside, axis=-1, keepdims=True)
        aside = aside / np.where(length > 0.0, length, 1.0)
        forces = force[which][..., None] * (np.cos(off) * ahead + np.sin(off) * aside)
        torque = (corners.torque[which] + wheel)[..., None]
        leant = np.take_along_axis(turned, which[..., None], -1)[..., 0].sum(axis=1)

        # What has to be given, less what the goal set leaves open and what thrust is worth: the trapezoidal rule.
        step = 0.5 * self.time / len(self.width)
        used = step * float(values.sum())
        by_turning = (torque * self.turning.basis).sum(axis=(0, 1)) - leant @ self.turning.lean
        worth_slope = [forces.sum(axis=(0, 1)), (left * forces).sum(axis=(0, 1)), by_turning]
        gain = self.gain()
        gradient = gain - step * np.concatenate(worth_slope)
        spared = 0.0
        parts = [slice(0, d), slice(d, 2 * d), *(slice(k, k + 1) for k in range(2 * d, len(x)))]
        radii = [self.mass * self.near[0], self.mass * self.near[1] / self.time]
        for part, radius in zip(parts, [*radii, *self.turning.spared], strict=True):
            length = float(np.linalg.norm(x[part]))
            if length > 0.0:
                spared += radius * length
                gradient[part] -= radius * x[part] / length
        linear = float(gain @ x)
        rounding = _ROUNDING * (abs(linear) + spared + used)
        return Worth(linear - spared - used - rounding, gradient)
