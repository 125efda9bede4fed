"""What a policy for any craft is given: errors in B beside the craft's authority, the same for every craft.

The columns are a formula on fields with constants of the craft: its largest accelerations either way along the
axes of B and about z, and its control period. They contain the stopping distance and the braking curve, so that a
network need not learn what a double integrator is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from rans.errors import ConfigError
from rans.model.fields import Field, absolute, at_least, log, sqrt, tanh, where
from rans.tasks.observation_terms import (
    AngularVelocity,
    Block,
    Layout,
    OwnRotation,
    RelativeRotation,
    Scalar,
    VectorInW,
)

VECTORS = 6
"""Number of vectors among the columns, which come first: each has two columns."""
TURNS = 6
"""Number of columns that a mirror image reverses, which come next."""
SCALARS = 6
"""Number of columns that a turn or a mirror image of B leaves as they are, which come next."""
WIDTH = 2 * VECTORS + TURNS + SCALARS + 6
"""Number of columns. The last are logarithms of the authority along +x, -x, +y, -y and about +z, -z."""
_BRAKING = 0.7
"""Part of the acceleration that the braking curve counts on: the rest is for steering."""
_PERIODS = 3.0
"""Time in which the braking curve lets a small error vanish, control periods."""


_PLANAR_POSE = [
    (OwnRotation, 2),
    (VectorInW, 2),
    (AngularVelocity, 1),
    (Scalar, 1),
    (VectorInW, 2),
    (RelativeRotation, 2),
]


class Authority(NamedTuple):
    """Authority of a craft in the plane; numbers, or tensors with an entry for each craft."""

    period: Field
    """Control period, s."""
    linear: Sequence[Field]
    """Largest acceleration along +x, -x, +y and -y of B, m/s^2, without turning."""
    angular: Sequence[Field]
    """Largest angular acceleration about +z and -z, rad/s^2, without pushing."""
    least_linear: Field
    """Least of the linear ones."""
    least_angular: Field
    """Least of the angular ones."""

    @classmethod
    def of_numbers(cls, numbers: Sequence[float]) -> Authority:
        """From the control period, four linear and two angular accelerations."""
        period, *rest = numbers
        return cls(period, rest[:4], rest[4:], min(rest[:4]), min(rest[4:]))


def columns(
    error: Sequence[Field],
    turn: tuple[Field, Field],
    velocity: Sequence[Field],
    spin: Field,
    authority: Authority,
) -> list[Field]:
    """Columns of a state.

    Args:
        error: vector to the goal in B, m.
        turn: cosine and sine of the angle to the goal's heading.
        velocity: in B, relative to the goal, m/s.
        spin: rad/s.
        authority: of the craft.
    """
    period, linear, angular, a, alpha = authority
    angle = heading_error(*turn)
    distance = sqrt(at_least(error[0] * error[0] + error[1] * error[1], 1e-12))
    push = a * period
    kick = alpha * period
    # Vectors: error, speed in periods of thrust, place of rest, missing velocity, error near and at the goal.
    forth_back = ((linear[0], linear[1]), (linear[2], linear[3]))
    rest = [
        e - 0.5 * v * absolute(v) / where(v > 0.0, back + 0.0 * v, forth + 0.0 * v) - v * period
        for e, v, (forth, back) in zip(error, velocity, forth_back, strict=True)
    ]
    approach = braking(distance, a, period) / distance
    vectors = [
        [_wide(20.0 * e) for e in error],
        [_wide(v / push) for v in velocity],
        [_wide(20.0 * r) for r in rest],
        [tanh((approach * e - v) / (3.0 * push)) for e, v in zip(error, velocity, strict=True)],
        [tanh(0.5 * e) for e in error],
        [tanh(20.0 * e) for e in error],
    ]
    # The same of the turn.
    size = absolute(angle)
    rate = braking(size, alpha, period) * _sign(angle)
    lean = where(spin > 0.0, angular[1] + 0.0 * spin, angular[0] + 0.0 * spin)
    turns = [
        _wide(10.0 * angle),
        turn[1],
        _wide(spin / kick),
        _wide(10.0 * (angle - 0.5 * spin * absolute(spin) / lean - spin * period)),
        tanh((rate - spin) / (3.0 * kick)),
        tanh(12.0 * angle),
    ]
    zero = 0.0 * spin
    scalars = [
        turn[0],
        _wide(20.0 * distance) - 1.0,
        zero + 0.5 * _log(a / 0.1),
        zero + 0.5 * _log(alpha),
        zero + 1.5 * _log(period / 0.14),
        tanh(_speed(velocity) * period * 4.0),
    ]
    ratios = [zero + _log(x / a) for x in linear] + [zero + _log(x / alpha) for x in angular]
    return [x for vector in vectors for x in vector] + turns + scalars + ratios


def layout(observed: Layout) -> Layout:
    """Layout of the columns, of observations of go-to-pose in the plane.

    Raises:
        ConfigError: the observations are those of another task, or of space.
    """
    kinds = [(block.kind, block.width) for block in observed.blocks]
    if kinds[:6] != _PLANAR_POSE or any(width for _, width in kinds[6:]):
        raise ConfigError(
            "a policy for any craft flies to a pose in the plane, and the observations are those of another task: "
            "give it a go-to-pose task and a spacecraft of two dimensions."
        )
    return Layout((Block(Scalar, WIDTH),))


def of_observation(observed: Layout, row: Sequence[Field], authority: Authority) -> list[Field]:
    """Columns of an observation."""
    x, y, spin, _, along, across, cosine, sine = observed.in_body(row)
    return columns((along, across), (cosine, sine), (x, y), spin, authority)


def heading_error(cosine: Field, sine: Field) -> Field:
    """The angle of a cosine and a sine, rad: within 0.2 percent up to 1 rad and 8 percent at a half turn.

    From the chord 2 sin(angle / 2), by a polynomial, because not every executor has an arc tangent.
    """
    ahead = sine / sqrt(at_least(0.5 + 0.5 * cosine, 0.25))
    behind = sqrt(at_least(2.0 - 2.0 * cosine, 1e-12)) * _sign(sine)
    chord = where(cosine > 0.0, ahead, behind)
    square = chord * chord
    return chord * (1.0 + square * (1.0 / 24.0 + square * (3.0 / 640.0 + square * 0.0032)))


def braking(way: Field, acceleration: Field, period: Field) -> Field:
    """Speed from which the rest of the way is enough to brake, and proportional to it near the goal."""
    usable = _BRAKING * acceleration
    knee = _PERIODS * usable * period
    return sqrt(knee * knee + 2.0 * usable * way) - knee


def _wide(x: Field) -> Field:
    """Signed logarithm, about a third of a decade for each unit."""
    return _sign(x) * log(1.0 + absolute(x)) * (1.0 / 3.0)


def _sign(x: Field) -> Field:
    return where(x < 0.0, 0.0 * x - 1.0, 0.0 * x + 1.0)


def _speed(velocity: Sequence[Field]) -> Field:
    return sqrt(at_least(velocity[0] * velocity[0] + velocity[1] * velocity[1], 1e-12))


def _log(x: Field) -> Field:
    return math.log(x) if isinstance(x, int | float) else log(x)
