"""Counter-based random numbers: what an episode draws is a function of seed and episode number alone."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Any, Literal

import numpy as np

from rans.errors import ConfigError, brief
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
from rans.structure import Range


def seed_words(seed: int) -> tuple[int, int]:
    """A 64-bit seed, signed or not, as two signed 32-bit words (low, high).

    Raises:
        ConfigError: the seed is no whole number, or has more than 64 bits.
    """
    if not isinstance(seed, Integral) or not -(2**63) <= seed < 2**64:
        raise ConfigError(f"the seed must be a whole number of at most 64 bits, got {brief(seed)}.")
    low, high = (
        np.array([seed & 0xFFFFFFFF, (seed >> 32) & 0xFFFFFFFF], np.uint32).view(np.int32).tolist()
    )
    return low, high


def generator(seed: int) -> np.random.Generator:
    """NumPy's, of any seed that `seed_words` takes."""
    seed_words(seed)
    return np.random.default_rng(seed % 2**64)


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


def real(whole: Field, dtype: Any) -> Field:
    """A whole number, or a field of them, as a real of this floating dtype."""
    if isinstance(whole, int | float | np.generic):
        return float(whole)
    return whole.astype(dtype) if isinstance(whole, np.ndarray) else whole.to(dtype)


@dataclass(frozen=True)
class Draws:
    """What N running environments draw with."""

    low: Field
    """Low word of the seed (`seed_words`), one for all or each one's own."""
    high: Field
    """High word."""
    first: Field
    """Number of each environment's first episode, int32."""
    stride: Any
    """How far it is from one episode of an environment to its next."""
    dtype: Any
    """Floating dtype of what is drawn, of the fields' library."""

    def random(self, dimension: Literal[2, 3], number: Field, block: Field = 0) -> Random:
        """The random numbers of the episodes with these numbers, see `Random`."""
        return Random(dimension, self.low, self.high, number, self.dtype, block)

    def real(self, whole: Field) -> Field:
        """A whole number, or a field of them, as a real."""
        return real(whole, self.dtype)


class Random:
    """Draws for one episode (of many spacecraft at once); each call takes the next numbers.

    The dimension, 2 or 3, decides what `direction` and `attitude` return. The seed's low and high word are
    ints or int32 fields, the episode's number is an int32 field; the draws have a dtype of its library.
    Blocks of four numbers each are counted from ``block`` on, an int or an int32 field.
    """

    def __init__(
        self,
        dimension: Literal[2, 3],
        low: Field,
        high: Field,
        episode: Field,
        dtype: Any,
        block: Field = 0,
    ) -> None:
        self.dimension = dimension
        self._key = (low, high)
        self._episode = episode
        self._dtype = dtype
        self._words: tuple[Field, ...] = ()
        self._block = block
        self._spare: Field = None

    def unit(self) -> Field:
        """Uniform in [0, 1), a multiple of 2^-24 and so the same in float32 and float64."""
        if not self._words:
            low, high = (self._episode * 0 + word for word in self._key)
            self._words = hash4(self._episode, self._episode * 0 + self._block, low, high)
            self._block = self._block + 1
        word = self._words[0]
        self._words = self._words[1:]
        bits = (word >> 8) & 0xFFFFFF
        return real(bits, self._dtype) * 2.0**-24

    def uniform(self, low: float, high: float) -> Field:
        """Uniform between two bounds."""
        return low + (high - low) * self.unit()

    def within(self, values: Range) -> Field:
        """Uniform between the bounds of a range; a number for itself, for which one is drawn in vain."""
        u = self.unit()
        return values[0] + (values[1] - values[0]) * u if isinstance(values, tuple) else values

    def whole(self, values: Range) -> Field:
        """A whole number, each within a range as likely as the next, as a real."""
        u = self.unit()
        return (
            values[0] + floor((values[1] - values[0] + 1.0) * u)
            if isinstance(values, tuple)
            else values
        )

    def normal(self) -> Field:
        """From the standard normal distribution (Box and Muller, 1958)."""
        if self._spare is not None:
            result = self._spare
            self._spare = None
            return result
        radius = sqrt(-2.0 * log(1.0 - self.unit()))
        angle = self.uniform(-math.pi, math.pi)
        self._spare = radius * sin(angle)
        return radius * cos(angle)

    def vector(self, length: Range) -> Vec2 | Vec3:
        """A vector in any direction whose length is within a range."""
        return self.direction().scale(self.within(length))

    def turn(self, size: Range) -> Field:
        """A turn about z either way, or a vector about any axis, whose size is within a range."""
        if self.dimension == 3:
            return self.vector(size)
        side = self.unit()
        return where(side < 0.5, side * 0.0 - 1.0, side * 0.0 + 1.0) * self.within(size)

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
        first = self.uniform(-math.pi, math.pi)
        second = self.uniform(-math.pi, math.pi)
        a = sqrt(1.0 - u)
        b = sqrt(u)
        return Quat(b * cos(second), a * sin(first), a * cos(first), b * sin(second))

    def spin(self, fastest: float) -> Field:
        """An angular velocity up to this rate, rad/s: about z either way, or about any axis of B."""
        if self.dimension == 2:
            return self.uniform(-fastest, fastest)
        return self.direction().scale(self.uniform(0.0, fastest))

    def around(self, low: float, high: float) -> State:
        """A state at rest so far from the origin, m, with any bearing and attitude."""
        direction = self.direction()
        distance = self.uniform(low, high)
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
