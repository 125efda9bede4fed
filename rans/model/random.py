"""Counter-based random numbers: what an episode draws is a function of seed and episode number alone."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from rans.errors import ConfigError
from rans.model.dynamics import PlanarState, SpatialState, State
from rans.model.fields import Attitude, Field, Heading, Quat, Vec2, Vec3, Vector, cos, sin, sqrt


def seed_words(seed: int) -> tuple[int, int]:
    """A 64-bit seed, signed or not, as two signed 32-bit words (low, high).

    Raises:
        ConfigError: the seed has more than 64 bits.
    """
    if not -(2**63) <= seed < 2**64:
        raise ConfigError(f"the seed must be a whole number of at most 64 bits, got {seed}.")
    low, high = np.array([seed & 0xFFFFFFFF, (seed >> 32) & 0xFFFFFFFF], np.uint32).view(np.int32).tolist()
    return low, high


def hash4(a: Field, b: Field, c: Field, d: Field) -> tuple[Field, ...]:
    """Four random 32-bit words from four counters, each an int32 field with wrap-around arithmetic.

    PCG4D of Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020: the cheapest
    of their hashes that passes the statistical tests at four words in, four words out.
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


class Random:
    """Draws for one episode (of many spacecraft at once); each call takes the next numbers.

    The dimension, 2 or 3, decides what `direction` and `attitude` return. The seed's low and high word are
    ints or int32 fields, the episode's number is an int32 field; the draws have a dtype of its library.
    """

    def __init__(self, dimension: Literal[2, 3], low: Field, high: Field, episode: Field, dtype: Any) -> None:
        self.dimension, self._key, self._episode, self._dtype = dimension, (low, high), episode, dtype
        self._words: tuple[Field, ...] = ()
        self._blocks = 0

    def unit(self) -> Field:
        """Uniform in [0, 1), a multiple of 2^-24 and so the same in float32 and float64."""
        if not self._words:
            low, high = (self._episode * 0 + word for word in self._key)
            self._words = hash4(self._episode, self._episode * 0 + self._blocks, low, high)
            self._blocks += 1
        word, self._words = self._words[0], self._words[1:]
        bits = (word >> 8) & 0xFFFFFF
        real = bits.astype(self._dtype) if isinstance(bits, np.ndarray) else bits.to(self._dtype)
        return real * 2.0**-24

    def uniform(self, low: float, high: float) -> Field:
        """Uniform between two bounds."""
        return low + (high - low) * self.unit()

    def direction(self) -> Vec2 | Vec3:
        """A unit vector, uniform on the circle or the sphere (Archimedes' cylinder)."""
        angle = self.uniform(-math.pi, math.pi)
        if self.dimension == 2:
            return Vec2(cos(angle), sin(angle))
        z = self.uniform(-1.0, 1.0)
        r = sqrt(1.0 - z * z)
        return Vec3(r * cos(angle), r * sin(angle), z)

    def attitude(self) -> Heading | Quat:
        """A rotation, uniform over the full circle or over SO(3) (Shoemake, Graphics Gems III)."""
        if self.dimension == 2:
            return Heading(self.uniform(-math.pi, math.pi))
        u = self.unit()
        first, second = self.uniform(-math.pi, math.pi), self.uniform(-math.pi, math.pi)
        a, b = sqrt(1.0 - u), sqrt(u)
        return Quat(b * cos(second), a * sin(first), a * cos(first), b * sin(second))

    def spin(self, fastest: float) -> Field:
        """An angular velocity up to this rate, rad/s: about z either way, or about any axis of B."""
        if self.dimension == 2:
            return self.uniform(-fastest, fastest)
        return self.direction().scale(self.uniform(0.0, fastest))

    def around(self, low: float, high: float) -> State:
        """A state at rest so far from the origin, m, with any bearing and attitude."""
        direction, distance = self.direction(), self.uniform(low, high)
        return self.at_rest(direction.scale(distance), self.attitude())

    def at_rest(self, p: Vector, attitude: Attitude) -> State:
        """The state at this place with no velocity."""
        return replace(self.moving(self.origin(), attitude), p=p)

    def moving(self, velocity: Vector, attitude: Attitude, spin: Field = None) -> State:
        """The state at the origin with this velocity and spin, by default none."""
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
