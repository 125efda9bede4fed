"""Rotations from angular velocities that are power series in time.

A series is a list of vectors, the coefficients of the powers of the share of a step that is gone.
"""

from __future__ import annotations

from collections.abc import Sequence

from rans.model.fields import Field, Quat, Vec3

Series = Sequence[Vec3]


def at(series: Series, share: float) -> Vec3:
    """Value of a series (Horner); an empty one is zero."""
    result = series[-1] if series else Vec3(0.0, 0.0, 0.0)
    for coefficient in reversed(series[:-1]):
        result = result.scale(share) + coefficient
    return result


def last_product(a: Series, b: Series) -> Vec3:
    """The last known coefficient of the vector product of two series of the same length."""
    return total([x.cross(y) for x, y in zip(a, reversed(b), strict=True)])


def total(vectors: Sequence[Vec3]) -> Vec3:
    """Sum of at least one vector."""
    return sum(vectors[1:], start=vectors[0])


class Rotation:
    """The rotation of a body that turns at a given rate, by Magnus' series of order six.

    Blanes, Casas and Ros, "Improved high order integrators based on the Magnus expansion", BIT 40, 2000:
    with C = [a, b] and D = -[a, 2 c + C] / 60, the rotation vector is
    a + c / 12 + [-20 a - c + C, b + D] / 240, where a, b and c stand for the rate's first moments: here
    r0 + r4 / 80, r1 + 3 r3 / 20 and r2 of its Taylor coefficients in the middle of the step, times the
    duration. They multiply from the other side, so that every bracket has its sign changed here. A rate
    that never changes is exact. The rate is the angular velocity in the body's frame, rad/s; the step lasts
    for the duration, s.
    """

    def __init__(self, rate: Series, duration: Field) -> None:
        self._duration = duration
        self._derivatives = [rate]
        """The k-th, over k factorial."""
        for k in range(1, 5):
            rate = [x.scale(j / k) for j, x in enumerate(rate[1:], 1)]
            self._derivatives.append(rate)

    def vector(self, share: float) -> Vec3:
        """Rotation vector from the start until this share of the step is gone, in the frame at the start."""
        r0, r1, r2, r3, r4 = (at(series, 0.5 * share).scale(share**k * self._duration)
                              for k, series in enumerate(self._derivatives, 1))
        slope = r1 + r3.scale(3.0 / 20.0)
        first = slope.cross(r0)
        second = (r2.scale(2.0) + first).cross(r0).scale(-1.0 / 60.0)
        brackets = (slope + second).cross(first - r0.scale(20.0) - r2).scale(1.0 / 240.0)
        return r0 + r2.scale(1.0 / 12.0) + r4.scale(1.0 / 80.0) + brackets


def turned(rotation: Vec3, v: Vec3) -> Vec3:
    """A vector after a rotation (Rodrigues' formula)."""
    sine, cosine = _sine_and_cosine(rotation.dot(rotation))
    across = rotation.cross(v)
    return v + across.scale(sine) + rotation.cross(across).scale(cosine)


def exponential(rotation: Vec3) -> Quat:
    """The quaternion of a rotation vector."""
    square = 0.25 * rotation.dot(rotation)
    sine, cosine = _sine_and_cosine(square)
    vector = rotation.scale(0.5 * sine)
    return Quat(1.0 - square * cosine, vector.x, vector.y, vector.z)


def _sine_and_cosine(square: Field) -> tuple[Field, Field]:
    """sin(x) / x and (1 - cos(x)) / x^2 from the square of x, by Taylor series: 3e-8 off at 1 rad."""
    sine, cosine = (_alternating(square, first) for first in (2, 3))
    return sine, 0.5 * cosine


def _alternating(square: Field, first: int) -> Field:
    """1 - s / (n (n + 1)) (1 - s / ((n + 2) (n + 3)) (1 - ...)), four brackets deep."""
    result = 1.0 - square * (1.0 / ((first + 6) * (first + 7)))
    for n in (first + 4, first + 2, first):
        result = 1.0 - square * result * (1.0 / (n * (n + 1)))
    return result
