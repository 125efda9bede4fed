"""Counter-based random numbers: the draws of an episode are a function of its seed and number alone.

Engines, kernels and pages draw the same numbers, so that the order of draws is part of every recorded flight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from rans.base.errors import whole
from rans.base.structure import Range
from rans.model.dynamics import PlanarState, SpatialState, State
from rans.model.fields import (
    Attitude,
    Field,
    Heading,
    Quat,
    Vec2,
    Vec3,
    Vector,
    cos,
    floor,
    log,
    sin,
    sqrt,
    where,
)


def seed_words(seed: int) -> tuple[int, int]:
    """A 64-bit seed as two signed 32-bit words (low, high).

    Raises:
        ConfigError: the seed is not a whole number, is negative, or has more than 64 bits.
    """
    seed = whole("the seed", seed, 0, 64)
    low, high = (
        np.array([seed & 0xFFFFFFFF, (seed >> 32) & 0xFFFFFFFF], np.uint32).view(np.int32).tolist()
    )
    return low, high


def generator(seed: int) -> np.random.Generator:
    """NumPy random generator for any seed that `seed_words` accepts."""
    return np.random.default_rng(whole("the seed", seed, 0, 64))


def hash4(a: Field, b: Field, c: Field, d: Field) -> tuple[Field, ...]:
    """Four random 32-bit words from four counters, each an int32 field with wrap-around arithmetic.

    Every scenario follows from it: a change changes all starts (`tests/episode/test_scenario.py`).

    Source: PCG4D of Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020, the cheapest of
    their hashes from four words to four words that passes the statistical tests.
    """
    a, b, c, d = (x * 1664525 + 1013904223 for x in (a, b, c, d))
    a, b, c, d = _mix(a, b, c, d)
    a, b, c, d = (x ^ ((x >> 16) & 0xFFFF) for x in (a, b, c, d))
    return _mix(a, b, c, d)


def _mix(a: Field, b: Field, c: Field, d: Field) -> tuple[Field, ...]:
    a = a + b * d
    b = b + c * a
    c = c + a * b
    d = d + b * c
    return a, b, c, d


def real(whole: Field, dtype: Any) -> Field:
    """Whole number, or field of whole numbers, converted to this floating dtype."""
    if isinstance(whole, int | float | np.generic):
        return float(whole)
    return whole.astype(dtype) if isinstance(whole, np.ndarray) else whole.to(dtype)


@dataclass(frozen=True)
class Draws:
    """Seed and episode numbers of N environments, from which their random numbers follow."""

    low: Field
    """Low word of the seed (`seed_words`), one for all environments or one for each."""
    high: Field
    """High word of the seed, one for all environments or one for each."""
    first: Field
    """Number of the first episode of each environment, int32."""
    stride: Any
    """Difference between the numbers of two successive episodes of an environment."""
    dtype: Any
    """Floating dtype of the draws, of the library of the fields."""

    def random(self, dimension: Literal[2, 3], number: Field, block: Field = 0) -> Random:
        """Random numbers of the episodes with these numbers, see `Random`."""
        return Random(dimension, self.low, self.high, number, self.dtype, block)

    def real(self, whole: Field) -> Field:
        """Whole number, or field of whole numbers, converted to the floating dtype."""
        return real(whole, self.dtype)


@dataclass(eq=False)
class Random:
    """Random numbers of one episode, of one or many spacecraft; each call takes the next ones."""

    dimension: Literal[2, 3]
    """Determines the results of `direction` and `attitude`."""
    low: Field
    """Low word of the seed, an int or an int32 field."""
    high: Field
    """High word of the seed, an int or an int32 field."""
    episode: Field
    """Number of the episode, an int32 field."""
    dtype: Any
    """Floating dtype of the draws, of the library of ``episode``."""
    block: Field = 0
    """Index of the next block of four numbers, an int or an int32 field."""
    _words: tuple[Field, ...] = ()
    _spare: Field = None

    def unit(self) -> Field:
        """Uniform in [0, 1), the next word of a hash: a multiple of 2^-24, the same in float32 and float64.

        A hash has four words; the next one begins with the next block. Pages compute the same hash in JavaScript.
        """
        if not self._words:
            low, high = (self.episode * 0 + word for word in (self.low, self.high))
            self._words = hash4(self.episode, self.episode * 0 + self.block, low, high)
            self.block = self.block + 1
        word = self._words[0]
        self._words = self._words[1:]
        bits = (word >> 8) & 0xFFFFFF
        return real(bits, self.dtype) * 2.0**-24

    def uniform(self, low: float, high: float) -> Field:
        """Uniform between two bounds."""
        return low + (high - low) * self.unit()

    def within(self, values: Range) -> Field:
        """Uniform between the bounds of a range; a number is returned as is, and one draw is skipped."""
        u = self.unit()
        return values[0] + (values[1] - values[0]) * u if isinstance(values, tuple) else values

    def whole(self, values: Range) -> Field:
        """Whole number, uniform over those within a range, as a floating number."""
        u = self.unit()
        return (
            values[0] + floor((values[1] - values[0] + 1.0) * u)
            if isinstance(values, tuple)
            else values
        )

    def normal(self) -> Field:
        """Draw from the standard normal distribution (Box and Muller, 1958).

        Every second call takes the number that the one before left.
        """
        if self._spare is not None:
            result = self._spare
            self._spare = None
            return result
        radius = sqrt(-2.0 * log(1.0 - self.unit()))
        angle = self.uniform(-math.pi, math.pi)
        self._spare = radius * sin(angle)
        return radius * cos(angle)

    def vector(self, length: Range) -> Vec2 | Vec3:
        """Vector in a uniformly drawn direction whose length is drawn from a range."""
        return self.direction().scale(self.within(length))

    def turn(self, size: Range) -> Field:
        """Rotation of a size drawn from a range: about z with a random sign, or a vector about a random axis."""
        if self.dimension == 3:
            return self.vector(size)
        side = self.unit()
        return where(side < 0.5, side * 0.0 - 1.0, side * 0.0 + 1.0) * self.within(size)

    def direction(self) -> Vec2 | Vec3:
        """Unit vector, uniform on the circle or the sphere (Archimedes' cylinder)."""
        angle = self.uniform(-math.pi, math.pi)
        if self.dimension == 2:
            return Vec2(cos(angle), sin(angle))
        z = self.uniform(-1.0, 1.0)
        r = sqrt(1.0 - z * z)
        return Vec3(r * cos(angle), r * sin(angle), z)

    def attitude(self) -> Heading | Quat:
        """Attitude, uniform over the full circle or over SO(3) (Shoemake, Graphics Gems III).

        One draw in the plane and three in space, in this order.
        """
        if self.dimension == 2:
            return Heading(self.uniform(-math.pi, math.pi))
        u = self.unit()
        first = self.uniform(-math.pi, math.pi)
        second = self.uniform(-math.pi, math.pi)
        a = sqrt(1.0 - u)
        b = sqrt(u)
        return Quat(b * cos(second), a * sin(first), a * cos(first), b * sin(second))

    def spin(self, fastest: float) -> Field:
        """Angular velocity up to this rate, rad/s: about z with a random sign, or about a random axis of B."""
        if self.dimension == 2:
            return self.uniform(-fastest, fastest)
        return self.direction().scale(self.uniform(0.0, fastest))

    def around(self, low: float, high: float) -> State:
        """State at rest at a distance between two bounds from the origin (m), with random bearing and attitude."""
        direction = self.direction()
        distance = self.uniform(low, high)
        return self.at_rest(direction.scale(distance), self.attitude())

    def at_rest(self, p: Vector, attitude: Attitude) -> State:
        """State at rest at this position (W, m)."""
        return replace(self.moving(self.origin(), attitude), p=p)

    def moving(self, velocity: Vector, attitude: Attitude, spin: Field = None) -> State:
        """State at the origin with this velocity (W, m/s) and spin (rad/s); by default without spin."""
        kind: Any = PlanarState if self.dimension == 2 else SpatialState
        if spin is None:
            spin = 0.0 if self.dimension == 2 else Vec3(0.0, 0.0, 0.0)
        return kind(self.origin(), attitude, velocity, spin)

    def no_rotation(self) -> Heading | Quat:
        """The attitude of W."""
        return Heading(0.0) if self.dimension == 2 else Quat(1.0, 0.0, 0.0, 0.0)

    def origin(self) -> Vec2 | Vec3:
        """The origin of W."""
        return Vec2(0.0, 0.0) if self.dimension == 2 else Vec3(0.0, 0.0, 0.0)
