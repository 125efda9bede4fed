"""What a policy for any craft is given: errors in B beside the craft's authority, the same for every craft.

The columns are a formula on fields with constants of the craft: its largest accelerations either way along the axes
of B, and about z or in space about all of them, and its control period. They contain the stopping distance and the
braking curve, so that a network need not learn what a double integrator is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from rans.extend import (
    AngularVelocity,
    Block,
    ConfigError,
    Field,
    Layout,
    RelativeRotation,
    Scalar,
    Vec3,
    VectorInW,
    absolute,
    at_least,
    cos,
    fields,
    sin,
    sqrt,
    where,
    within,
)
from rans.tasks.observation_terms import OwnRotation
from rans_any_craft.frugality import AS_TRAINED, NEAR, Frugality

VECTORS = 6
"""Number of vectors among the columns, which come first: each has a column for every axis."""
TURNS = 6
"""Number of axial vectors, next, each with one column in the plane and three in space; mirrors reverse them."""
SCALARS = 6
"""Number of columns that a turn or a mirror image of B leaves as they are, which come next."""
_BRAKING = 0.7
"""Part of the acceleration that the braking curve counts on: the rest is for steering."""
_PERIODS = 3.0
"""Time in which the braking curve lets a small error vanish, control periods."""
_MORE = math.sqrt(2.0)
"""Largest factor of accelerations by the way that a craft flies, that of thrusters in a square: with a larger one
craft that push much harder one way brake too late."""
_COAST_DISTANCE = 0.9 * 0.05
_COAST_ANGLE = 0.9 * math.radians(5.0)
"""Distance, m, and angle, rad, from the goal within which a craft may coast: nine tenths of the tolerances of
go-to-pose, so that the delay of a command does not carry it out."""


_LARGEST_TURN = 0.35
"""Angle, rad, to which `nearer` brings the goal's attitude."""
_LARGEST_FINER = 2.4
"""Largest angle, rad, that is given where angles are given larger: at a half turn its side gets lost, and of a slow
craft 37 instead of 100 % of the flights within 2 degrees are solved."""

_POSE = {
    dimension: [
        (OwnRotation, rotation),
        (VectorInW, dimension),
        (AngularVelocity, axes),
        (Scalar, 1),
        (VectorInW, dimension),
        (RelativeRotation, rotation),
    ]
    for dimension, rotation, axes in ((2, 2, 1), (3, 6, 3))
}
"""Kinds and widths of the first blocks of observations of go-to-pose."""


def column_count(dimension: int) -> int:
    """Number of columns.

    The last are logarithms of the authority along +x, -x, +y and so on, then about +z, -z or about all axes.
    """
    turning = 2 * dimension - 3
    return (VECTORS + 2) * dimension + (TURNS + 2) * turning + SCALARS


class Authority(NamedTuple):
    """Authority of a craft; numbers, or tensors with an entry for each craft."""

    period: Field
    """Control period, s."""
    linear: Sequence[Field]
    """Largest acceleration along +x, -x, +y, -y (and +z, -z) of B, m/s^2, without turning; in the plane that which
    is possible in all directions within 45 degrees of the axis."""
    angular: Sequence[Field]
    """Largest angular acceleration about +z and -z, in space about +x, -x and so on, rad/s^2, without pushing."""
    least_linear: Field
    """Least of the linear ones."""
    least_angular: Field
    """Least of the angular ones."""
    reach: Sequence[Field] = ()
    """Largest acceleration along each of `WAYS` without turning, m/s^2; empty: it is not known."""

    @classmethod
    def of_numbers(cls, numbers: Sequence[float], reach: Sequence[float] = ()) -> Authority:
        """From the control period, four linear and two angular accelerations, or six of each."""
        period, *ways = numbers
        linear = ways[: 2 * DIMENSIONS[len(ways)]]
        angular = ways[len(linear) :]
        return cls(period, linear, angular, min(linear), min(angular), reach)

    def faster(self, linear: Field, angular: Field) -> Authority:
        """The authority with linear and angular accelerations times factors, fields."""
        return self._replace(
            linear=[linear * x for x in self.linear],
            angular=[angular * x for x in self.angular],
            least_linear=linear * self.least_linear,
            least_angular=angular * self.least_angular,
            reach=[linear * x for x in self.reach],
        )


DIMENSIONS = {6: 2, 12: 3}
"""Dimension by the number of accelerations."""
_HALF = math.sqrt(0.5)
WAYS = (
    (1.0, 0.0),
    (-1.0, 0.0),
    (0.0, 1.0),
    (0.0, -1.0),
    (_HALF, _HALF),
    (_HALF, -_HALF),
    (-_HALF, _HALF),
    (-_HALF, -_HALF),
)
"""Unit vectors in the plane: along the axes and between them."""


class Seen(NamedTuple):
    """State of a craft as its network is given it, in B; vectors of turning have one number in the plane."""

    error: Sequence[Field]
    """Vector to the goal, m."""
    cosine: Field
    """Cosine of the angle to the goal's attitude."""
    sines: Sequence[Field]
    """Sine of the angle to the goal's attitude, times the axis of that turn."""
    velocity: Sequence[Field]
    """Relative to the goal, m/s."""
    spin: Sequence[Field]
    """rad/s."""

    @property
    def angles(self) -> list[Field]:
        """Rotation vector to the goal's attitude, rad.

        It is within 0.2 percent up to 1 rad and 8 percent at a half turn. It comes from the chord 2 sin(angle / 2),
        by a polynomial, because not every executor has an arc tangent.
        """
        half = sqrt(at_least(0.5 + 0.5 * self.cosine, 0.25))
        behind = sqrt(at_least(2.0 - 2.0 * self.cosine, 1e-12))
        chord = [
            where(self.cosine > 0.0, sine / half, behind * way)
            for sine, way in zip(self.sines, _direction(self.sines), strict=True)
        ]
        square = _square(chord)
        factor = 1.0 + square * (1.0 / 24.0 + square * (3.0 / 640.0 + square * 0.0032))
        return [x * factor for x in chord]

    def bounded(self, scale: Field, is_far: Field | bool, angle: float) -> Seen:
        """The state with the error times a scale, and the angle where it is far, a largest angle (rad) there."""
        size = math.sin(angle)
        ways = zip(_direction(self.sines), self.sines, strict=True)
        return self._replace(
            error=[scale * x for x in self.error],
            cosine=where(is_far, math.cos(angle) + 0.0 * self.cosine, self.cosine),
            sines=[where(is_far, size * way, x) for way, x in ways],
        )


def columns(seen: Seen, authority: Authority) -> list[Field]:
    """Columns of a state."""
    error, cosine, sines, velocity, spin = seen
    period, linear, angular, a, alpha, reach = authority
    angles = seen.angles
    distance = _distance(error)
    push = a * period
    kick = alpha * period
    # Vectors: error, speed in periods of thrust, place of rest, missing velocity, error near and at the goal.
    stopping: Field = 1.0
    if reach:
        # Braking is against the velocity.
        stopping = _more_along([-v for v in velocity], linear, reach)
        a_ahead = a * _more_along(error, linear, reach)
    else:
        a_ahead = a
    rest = _place_of_rest(error, velocity, linear, period, stopping)
    approach = braking(distance, a_ahead, period) / distance
    vectors = [
        [_wide(20.0 * e) for e in error],
        [_wide(v / push) for v in velocity],
        [_wide(20.0 * r) for r in rest],
        [
            fields.tanh((approach * e - v) / (3.0 * push))
            for e, v in zip(error, velocity, strict=True)
        ],
        [fields.tanh(0.5 * e) for e in error],
        [fields.tanh(20.0 * e) for e in error],
    ]
    # The same of the turn.
    speed = braking(_length(angles), alpha, period)
    rates = [speed * x for x in _direction(angles)]
    leaning = [
        where(w > 0.0, back + 0.0 * w, forth + 0.0 * w)
        for w, forth, back in zip(spin, angular[::2], angular[1::2], strict=True)
    ]
    turns = [
        [_wide(10.0 * x) for x in angles],
        list(sines),
        [_wide(w / kick) for w in spin],
        [
            _wide(10.0 * (x - 0.5 * w * absolute(w) / lean - w * period))
            for x, w, lean in zip(angles, spin, leaning, strict=True)
        ],
        [fields.tanh((rate - w) / (3.0 * kick)) for rate, w in zip(rates, spin, strict=True)],
        [fields.tanh(12.0 * x) for x in angles],
    ]
    zero = 0.0 * spin[0]
    scalars = [
        cosine,
        _wide(20.0 * distance) - 1.0,
        zero + 0.5 * _log(a / 0.1),
        zero + 0.5 * _log(alpha),
        zero + 1.5 * _log(period / 0.14),
        fields.tanh(_distance(velocity) * period * 4.0),
    ]
    ratios = [zero + _log(x / a) for x in linear] + [zero + _log(x / alpha) for x in angular]
    return [x for vector in (*vectors, *turns) for x in vector] + scalars + ratios


def coasting(seen: Seen, authority: Authority, periods: Field) -> Seen:
    """The state, or rest at the goal where the craft may coast.

    It may if it is within 4.5 cm and 4.5 degrees of the goal, and would come to rest there if it coasted for some
    control periods and then braked. A network demands nothing at rest at the goal, so that the thrusters stay shut:
    on/off thrusters would otherwise push the craft to and fro around it.
    """
    angles = seen.angles
    time = periods * authority.period
    place = _place_of_rest(seen.error, seen.velocity, authority.linear, time)
    attitude = _place_of_rest(angles, seen.spin, authority.angular, time)
    stays = 0.0 * seen.spin[0] + 1.0
    for vector, bound in (
        (seen.error, _COAST_DISTANCE),
        (place, _COAST_DISTANCE),
        (angles, _COAST_ANGLE),
        (attitude, _COAST_ANGLE),
    ):
        stays = where(_square(vector) < bound * bound, stays, 0.0 * stays)
    moves = 1.0 - stays
    error, sines, velocity, spin = (
        [moves * x for x in vector] for vector in (seen.error, seen.sines, seen.velocity, seen.spin)
    )
    return Seen(error, moves * seen.cosine + stays, sines, velocity, spin)


def nearer(seen: Seen, farthest: Field, is_gentle: Field) -> Seen:
    """The state with the goal's place and attitude, or their directions at a largest distance and angle.

    The goal is so near that a craft which brakes in time flies and turns slowly: wheels that balance the torques of
    its thrusters take up momentum with its speed.

    Args:
        seen: the state.
        farthest: largest distance, m.
        is_gentle: 1 if the angle has a bound, else 0.
    """
    distance = _distance(seen.error)
    scale = where(distance > farthest, farthest / distance, 1.0 + 0.0 * distance)
    # No cosine is below -2.
    is_far = seen.cosine < is_gentle * (math.cos(_LARGEST_TURN) + 2.0) - 2.0
    return seen.bounded(scale, is_far, _LARGEST_TURN)


def finer(seen: Seen, frugality: Frugality) -> Seen:
    """The state as seen by a network whose tolerances are 5 cm and 5 degrees.

    By similarity a craft with a tolerance of 2 cm flies as one of 5 cm whose distances, velocities and
    accelerations are 2.5 times as large: times stay.
    """
    length, angle = frugality.finer, frugality.finer_turn
    angles = seen.angles
    size = within(angle * _length(angles), 0.0, _LARGEST_FINER)
    return Seen(
        [length * x for x in seen.error],
        cos(size),
        [sin(size) * way for way in _direction(angles)],
        [length * x for x in seen.velocity],
        [angle * x for x in seen.spin],
    )


def shortened(seen: Seen, frugality: Frugality) -> Seen:
    """The state with the error and the turn to the goal as a frugal network is given them.

    The craft flies and turns more slowly, as braking curves lead to less speed from a smaller distance and angle.

    The browser and compiled steps trace it: choices are `where`, and all ones are computed.
    """
    distance = _distance(seen.error)
    beyond = distance - NEAR
    part: Field = frugality.shortened
    if frugality.growth:
        part = part + frugality.growth * beyond
        part = where(part < 1.0, part, 1.0)
    given = where(distance > NEAR, NEAR + part * beyond, distance + 0.0)
    if frugality.farthest:
        given = where(given > frugality.farthest, frugality.farthest + 0.0 * given, given)
    scale = given / distance
    angle = frugality.largest_angle
    if not angle:
        return seen._replace(error=[scale * x for x in seen.error])
    return seen.bounded(scale, seen.cosine < math.cos(angle), angle)


def away(columns: Sequence[Field], dimension: int) -> Field:
    """1 where the goal is farther than `NEAR`, else 0, by the columns of a network in 2 or 3 dimensions."""
    distance = columns[VECTORS * dimension + TURNS * (2 * dimension - 3) + 1]
    return where(distance > math.log(1.0 + 20.0 * NEAR) / 3.0 - 1.0, 1.0, 0.0)


def braking_distance(speed: float, acceleration: float, period: float) -> float:
    """Distance from which the braking curve (`braking`) leads to a speed."""
    usable = _BRAKING * acceleration
    return speed * (speed + 2.0 * _PERIODS * usable * period) / (2.0 * usable)


def _place_of_rest(
    error: Sequence[Field],
    speed: Sequence[Field],
    ways: Sequence[Field],
    time: Field,
    factor: Field = 1.0,
) -> list[Field]:
    """Error along each axis after a time (s) without thrust and then a braking, by ``factor`` times ``ways``.

    ``ways`` has a pair of accelerations, forth and back, for each axis; trained networks observe the result.
    """
    return [
        e
        - v * time
        - 0.5 * v * absolute(v) / (factor * where(v > 0.0, back + 0.0 * v, forth + 0.0 * v))
        for e, v, forth, back in zip(error, speed, ways[::2], ways[1::2], strict=True)
    ]


def layout(observed: Layout) -> Layout:
    """Layout of the columns, of observations of go-to-pose.

    Raises:
        ConfigError: the observations are those of another task.
    """
    return Layout((Block(Scalar, column_count(_dimension(observed))),))


def _dimension(observed: Layout) -> int:
    """Dimension of an observation of go-to-pose; `ConfigError` for other observations."""
    kinds = [(block.kind, block.width) for block in observed.blocks]
    for dimension, pose in _POSE.items():
        if kinds[: len(pose)] == pose and not any(width for _, width in kinds[len(pose) :]):
            return dimension
    raise ConfigError(
        "a policy for any craft flies to a pose, and the observations are those of another task: give it a "
        "go-to-pose task."
    )


def of_body(
    observed: Layout,
    body: Sequence[Field],
    authority: Authority,
    coast: float,
    farthest: tuple[Field, Field] | None,
    frugality: Frugality,
) -> list[Field]:
    """Columns of an observation; the order of changes is trained.

    Args:
        observed: layout of the observation.
        body: its fields in B.
        authority: of the craft.
        coast: control periods of `coasting`; 0: without it.
        farthest: distance and flag of `nearer`; None: without it.
        frugality: see `shortened`.
    """
    dimension = _dimension(observed)
    axes = 2 * dimension - 3
    velocity, spin = body[:dimension], body[dimension : dimension + axes]
    # Then come the task flag, the vector to the goal and the rotation to its attitude.
    start = dimension + axes + 1
    error, rotation = body[start : start + dimension], body[start + dimension :]
    turn = (rotation[0], [rotation[1]]) if dimension == 2 else _cosine_and_sines(rotation)
    seen = Seen(error, *turn, velocity, spin)
    if (frugality.finer, frugality.finer_turn) != (1.0, 1.0):
        seen = finer(seen, frugality)
        authority = authority.faster(frugality.finer, frugality.finer_turn)
        if farthest is not None:
            farthest = (frugality.finer * farthest[0], farthest[1])
    if coast:
        seen = coasting(seen, authority, coast * frugality.coast)
    if frugality != AS_TRAINED:
        seen = shortened(seen, frugality)
    if farthest is not None:
        seen = nearer(seen, *farthest)
    elif frugality.acceleration != 1.0:
        # Wheels would be full at a higher speed than the one of `nearer`.
        authority = authority.faster(frugality.acceleration, 1.0)
    return columns(seen, authority)


def _cosine_and_sines(rows: Sequence[Field]) -> tuple[Field, list[Field]]:
    """Cosine of the angle, and sine times the axis, of a rotation by the first two rows of its matrix."""
    first, second = Vec3(*rows[:3]), Vec3(*rows[3:])
    third = first.cross(second)
    cosine = 0.5 * (first.x + second.y + third.z) - 0.5
    sines = (third.y - second.z, first.z - third.x, second.x - first.y)
    return cosine, [0.5 * x for x in sines]


def _more_along(vector: Sequence[Field], linear: Sequence[Field], reach: Sequence[Field]) -> Field:
    """Acceleration along a vector in the plane, over the least one within 45 degrees of the axis nearest to it.

    Accelerations that are possible along two neighbours of `WAYS` are so together: that along the vector is of the
    polygon through all eight. A vector of zeros counts as one along +x. The result is from 1 to `_MORE`.

    `linear` and `reach` are ordered as `WAYS`, and the slices rely on that order.
    """
    x, y = vector
    wide, high = absolute(x), absolute(y)
    is_wide = wide >= high
    large = at_least(where(is_wide, wide, high), 1e-6)
    small = where(is_wide, high, wide)
    ways = [way + 0.0 * x for way in (*linear, *reach)]

    def chosen(right: Field, left: Field, up: Field, down: Field) -> Field:
        return where(is_wide, where(x < 0.0, left, right), where(y < 0.0, down, up))

    least, axis = chosen(*ways[:4]), chosen(*ways[4:8])
    upper, lower = (where(x < 0.0, left, right) for right, left in (ways[8::2], ways[9::2]))
    corner = where(y < 0.0, lower, upper)
    length = _distance(vector)
    most = length / ((large - small) / axis + small / (_HALF * corner))
    return within(most / least, 1.0, _MORE)


def _square(vector: Sequence[Field]) -> Field:
    """Sum of squares."""
    first, *others = (x * x for x in vector)
    return sum(others, first)


def _distance(vector: Sequence[Field]) -> Field:
    """Length of a vector, at least 1e-6."""
    return sqrt(at_least(_square(vector), 1e-12))


def _length(vector: Sequence[Field]) -> Field:
    """Length of a vector of one number or three."""
    return absolute(vector[0]) if len(vector) == 1 else _distance(vector)


def _direction(vector: Sequence[Field]) -> list[Field]:
    """Unit vector along a vector of one number or three; a single zero counts as positive."""
    if len(vector) == 1:
        return [_sign(vector[0])]
    length = _length(vector)
    return [x / length for x in vector]


def braking(way: Field, acceleration: Field, period: Field) -> Field:
    """Speed from which the rest of the way is enough to brake, and proportional to it near the goal."""
    usable = _BRAKING * acceleration
    knee = _PERIODS * usable * period
    return sqrt(knee * knee + 2.0 * usable * way) - knee


def _wide(x: Field) -> Field:
    """Signed logarithm, about a third of a decade for each unit."""
    return _sign(x) * fields.log(1.0 + absolute(x)) * (1.0 / 3.0)


def of_wide(column: Field) -> Field:
    """The number of which a column is the signed logarithm."""
    size = fields.exp(3.0 * absolute(column)) - 1.0
    return where(column < 0.0, -size, size)


def _sign(x: Field) -> Field:
    return where(x < 0.0, 0.0 * x - 1.0, 0.0 * x + 1.0)


def _log(x: Field) -> Field:
    return math.log(x) if isinstance(x, int | float) else fields.log(x)
