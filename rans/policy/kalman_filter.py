"""A Kalman filter within a policy: what it expects to see next, from what it saw and told the thrusters.

Noise in readings hides what a craft is about to do; its mass, its thrust and the commands tell most of it
(Kalman, "A new approach to linear filtering and prediction problems", 1960). It works on the columns of what
is observed, in B, so that any task's may be filtered (docs/decisions/robustness.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np

from rans.model.fields import Field, where
from rans.policy.actuator_response import Response
from rans.policy.frame_rotation import cross, scaled_sum, seen_turned, tilt_between, turned
from rans.policy.kinematic_roles import Share, changing, first_of
from rans.tasks.observation_terms import (
    AngularVelocity,
    Block,
    Columns,
    Layout,
    RelativeRotation,
    Scalar,
    VectorInW,
)

_Covariance = tuple[Field, Field, Field, Field, Field, Field]
"""Of a pose, its velocity and a steady acceleration, by rows without what symmetry tells."""


class _Known(NamedTuple):
    """What one filter knows of N spacecraft."""

    columns: Columns
    """Those of a reading."""
    steady: Columns
    """Accelerations in B that no command explains, m/s^2 and rad/s^2."""
    covariance: _Covariance
    responses: tuple[Response, ...] = ()
    """Of forces and of torques, if they are looked for."""


class Filter(NamedTuple):
    """Of one spacecraft and task; readings of poses and velocities are of equal noise.

    What it remembers, (N, m), is what it knows to expect next. Zeros know nothing.
    """

    drift: float
    """Variance by which velocities, and steady accelerations, wander in a control period, in units of the
    readings' noise."""
    steady: float
    """Variance of the steady accelerations that are looked for, in units of the noise; 0: none are."""
    response: float
    """Variance of the responses that are looked for, see `rans.policy.actuator_response`, in units
    of the noise over what the strongest thruster gives; 0: thrusters give what they are designed to."""
    period: float
    """s."""
    push: tuple[tuple[float, ...], ...]
    """Velocity in B that each thruster gives in a period, m/s."""
    twist: tuple[tuple[float, ...], ...]
    """Angular velocity in B that it gives, rad/s."""
    share: tuple[Share, ...]
    """How much each block of `Layout.body` has of position, velocity and angular velocity."""

    @property
    def axes(self) -> int:
        """Components of the steady accelerations that it tells, of place and turn."""
        return len(self.push[0]) + len(self.twist[0]) if self.steady else 0

    @property
    def extra_columns(self) -> int:
        """Numbers that it tells beside columns: steady accelerations and responses."""
        return self.axes + (4 if self.response else 0)

    @property
    def _units(self) -> tuple[float, float]:
        """What the strongest thruster gives in a period, m/s and rad/s."""
        push, twist = (float(np.abs(gains).max()) or 1.0 for gains in (self.push, self.twist))
        return push, twist

    def width(self, layout: Layout) -> int:
        """Numbers that it remembers of columns of this layout, that of the body."""
        responses = sum(
            Response.width(len(gains[0])) for gains in (self.push, self.twist) if self.response
        )
        return self._known(layout) + responses

    def _known(self, layout: Layout) -> int:
        return layout.width + self.axes + (6 if self.steady else 3)

    def layout(self, layout: Layout) -> Layout:
        """The layout of an estimate: columns of this one, then steady accelerations and responses."""
        extra = (
            (Block(VectorInW, len(self.push[0])), Block(AngularVelocity, len(self.twist[0])))
            if self.steady
            else ()
        )
        return Layout((*layout.blocks, *extra, *(Block(Scalar, 4),) * bool(self.response)))

    def estimate(self, layout: Layout, read: Columns, memory: Columns) -> list[Field]:
        """What it makes of columns as they were read, see `shown`.

        Of steady accelerations it tells what they give in a period, in units of the strongest thruster's; of
        forces, then of torques, how much more comes at once than designed, and how much in the period after.
        """
        one = self._corrected(layout, read, self._unpacked(layout, memory))
        units = [
            self.period / unit
            for unit, gains in zip(self._units, (self.push, self.twist), strict=True)
            for _ in gains[0]
        ]
        return [
            *one.columns,
            *(a * unit for a, unit in zip(one.steady, units, strict=True) if self.steady),
            *(x for response in one.responses for x in (response.more, response.late)),
        ]

    def expected(
        self, layout: Layout, read: Columns, memory: Columns, command: Columns
    ) -> list[Field]:
        """What it remembers after columns were read and answered with this command."""
        one = self._corrected(layout, read, self._unpacked(layout, memory))
        return self._packed(self._moved(layout, one, command))

    def moved_on(
        self, layout: Layout, read: Columns, memory: Columns, command: Columns, noisy: Field
    ) -> Columns:
        """Where columns will be a period after they were read and answered with this command.

        It moves the reading itself, not its own estimate, by what thrusters were found to give. Where
        sensors are not noisy (0), it moves it by that or by what they are designed to give, whichever is
        less, and not at all where these two disagree about the direction: a perfect sensor that rightly
        repeats a number is then seldom contradicted.
        """
        one = self._corrected(layout, read, self._unpacked(layout, memory))
        designed = [_dot(command, gains) for gains in (self.push, self.twist)]
        applied = [
            response.given(mine) for response, mine in zip(one.responses, designed, strict=False)
        ]
        changes = [
            [where(noisy > 0.0, b, _lesser(a, b)) for a, b in zip(*pair, strict=True)]
            for pair in zip(designed, applied, strict=False)
        ] or designed
        return self._carried(layout, read, *changes)[0]

    def begins(self, layout: Layout, memory: Columns) -> Field:
        """Whether it knows nothing yet, as at an episode's first reading."""
        return self._unpacked(layout, memory).covariance[0] == 0.0

    def _packed(self, known: _Known) -> list[Field]:
        responses = [x for response in known.responses for x in response.packed()]
        if self.steady:
            return [*known.columns, *known.steady, *known.covariance, *responses]
        xx, xv, _, vv, *_ = known.covariance
        return [*known.columns, xx, xv, vv, *responses]

    def _unpacked(self, layout: Layout, memory: Columns) -> _Known:
        size = self._known(layout)
        force = Response.width(len(self.push[0]))
        columns = memory[: layout.width]
        rest = memory[layout.width : size]
        responses = memory[size:]
        responses = tuple(
            map(Response.unpacked, (responses[:force], responses[force:]) if responses else ())
        )
        if self.steady:
            xx, xv, xa, vv, va, aa = rest[self.axes :]
            return _Known(columns, rest[: self.axes], (xx, xv, xa, vv, va, aa), responses)
        xx, xv, vv = rest
        none = (0.0,) * (len(self.push[0]) + len(self.twist[0]))
        return _Known(columns, none, (xx, xv, 0.0, vv, 0.0, 0.0), responses)

    def _corrected(self, layout: Layout, read: Columns, expected: _Known) -> _Known:
        """What was expected, moved towards what was read by Kalman's gains."""
        # Gains of poses, velocities and accelerations. A reading's noise is the unit: its variance is 1.
        xx, xv, xa, vv, va, aa = expected.covariance
        scale = 1.0 / ((xx + 1.0) * (vv + 1.0) - xv * xv)
        pose, velocity, steady = (
            ((p * (vv + 1.0) - v * xv) * scale, (v * (xx + 1.0) - p * xv) * scale)
            for p, v in ((xx, xv), (xv, vv), (xa, va))
        )
        left = [
            value - (gain[0] * p + gain[1] * v)
            for value, gain, p, v in (
                (xx, pose, xx, xv),
                (xv, pose, xv, vv),
                (xa, pose, xa, va),
                (vv, velocity, xv, vv),
                (va, velocity, xa, va),
                (aa, steady, xa, va),
            )
        ]

        # How far off what was expected is: how B is turned, then the rest, as seen in the B expected.
        blocks = list(
            zip(layout.split(read), layout.split(expected.columns), self.share, strict=True)
        )
        turns = [
            (now, then)
            for (block, now), (_, then), _ in blocks
            if issubclass(block.kind, RelativeRotation)
        ]
        tilt = tilt_between(*turns[0]) if turns else [0.0] * len(self.twist[0])
        off = [
            self._off(block, now, then, [-0.5 * x for x in tilt])
            for (block, now), (_, then), _ in blocks
        ]
        off_place = first_of(off, self.share, 0)
        off_velocity = first_of(off, self.share, 1)
        off_spin = first_of(off, self.share, 2)

        # Each block by its own error and by that of its derivative or integral; what no motion changes is as
        # it is read.
        half = scaled_sum(0.5 * pose[0], tilt, 0.5 * pose[1], off_spin)
        gains = pose, velocity[::-1], velocity[::-1]
        corrected: list[Field] = []
        for ((block, _), (_, then), share), error in zip(blocks, off, strict=True):
            for k in changing(share):
                other = (off_velocity, off_place, tilt)[k]
                error = scaled_sum(gains[k][0], error, gains[k][1] * share[k], other)
            corrected += seen_turned(block, scaled_sum(1.0, then, 1.0, error), half)
        gained = (
            *scaled_sum(steady[0], off_place, steady[1], off_velocity),
            *scaled_sum(steady[0], tilt, steady[1], off_spin),
        )
        pushed = scaled_sum(1.0, expected.steady, 1.0, gained)
        pushed = [*turned(pushed[: len(self.push[0])], half), *pushed[len(self.push[0]) :]]

        # The first reading of an episode is all there is.
        first = xx == 0.0
        fresh = (1.0, 0.0, 0.0, 1.0, 0.0, self.steady)
        columns, pushed, left = (
            [where(first, a, b) for a, b in zip(*pair, strict=True)]
            for pair in ((read, corrected), ((0.0,) * len(pushed), pushed), (fresh, left))
        )
        responses = self._learnt(expected, (off_velocity, off_spin))
        return _Known(columns, pushed, cast(_Covariance, tuple(left)), responses)

    def _learnt(self, expected: _Known, off: tuple[Columns, Columns]) -> tuple[Response, ...]:
        """Responses, if they are looked for, once velocity and spin are off by so much from the expected."""
        xx, _, _, vv, *_ = expected.covariance
        return tuple(
            response.learnt(error, (vv + 1.0) * unit**2).begun(xx == 0.0, self.response)
            for response, error, unit in zip(expected.responses, off, self._units, strict=False)
        )

    @staticmethod
    def _off(block: Block, now: Columns, then: Columns, half: Columns) -> Columns:
        """The error of a block; one that turns with B has none but its tilt."""
        if issubclass(block.kind, RelativeRotation):
            return [0.0] * len(then)
        return [a - b for a, b in zip(seen_turned(block, now, half), then, strict=True)]

    def _moved(self, layout: Layout, known: _Known, command: Columns) -> _Known:
        """A period later, of a rigid body on which nothing acts but its thrusters and what is steady.

        Forces are constant in B; of its turning within the period the first order is kept.
        """
        axes = len(self.push[0])
        period = self.period
        commanded = [_dot(command, gains) for gains in (self.push, self.twist)]
        responses = known.responses
        applied = (
            commanded
            if not responses
            else [response.given(mine) for response, mine in zip(responses, commanded, strict=True)]
        )
        push, twist = (
            scaled_sum(1.0, mine, period, pushed)
            for mine, pushed in zip(
                applied, (known.steady[:axes], known.steady[axes:]), strict=True
            )
        )
        found, half = self._carried(layout, known.columns, push, twist)
        steady = *turned(known.steady[:axes], half), *known.steady[axes:]
        after = tuple(
            response.after(mine, turn)
            for response, mine, turn in zip(responses, commanded, (half, ()), strict=False)
        )  # torques are constant in B
        aged = _aged(known.covariance, period, self.drift, self.drift if self.steady else 0.0)
        return _Known(found, steady, aged, after)

    def _carried(
        self, layout: Layout, columns: Columns, push: Columns, twist: Columns
    ) -> tuple[list[Field], list[Field]]:
        """Columns a period later, in which thrusters gave these velocities; and half the turn of B."""
        period = self.period
        blocks = list(layout.split(columns))
        velocity = first_of([mine for _, mine in blocks], self.share, 1)
        spin = first_of([mine for _, mine in blocks], self.share, 2)
        half = [(w + 0.5 * more) * (0.5 * period) for w, more in zip(spin, twist, strict=True)]
        # Of tangents the second term: half the angle is no longer small in a fast turn.
        half = [x * (1.0 + sum(y * y for y in half) * (1.0 / 3.0)) for x in half]
        gained = [x + turn for x, turn in zip(push, cross(half, push), strict=True)]
        way = [(v + 0.5 * more) * period for v, more in zip(velocity, push, strict=True)]
        results: list[Field] = []
        for (block, mine), share in zip(blocks, self.share, strict=True):
            for k in changing(share):
                mine = scaled_sum(1.0, mine, share[k], (way, gained, twist)[k])
            results += seen_turned(block, mine, half)
        return results, half


def _aged(covariance: _Covariance, period: float, drift: float, wander: float) -> _Covariance:
    """A period later: a pose moved on by its velocity, that by its acceleration, and both have wandered."""
    t = period
    h = 0.5 * period**2
    xx, xv, xa, vv, va, aa = covariance
    x = xx + t * xv + h * xa, xv + t * vv + h * va, xa + t * va + h * aa
    v = xv + t * xa, vv + t * va, va + t * aa
    return (
        x[0] + t * x[1] + h * x[2] + drift * (0.5 * t) ** 2,
        x[1] + t * x[2],
        x[2],
        v[1] + t * v[2] + drift,
        v[2],
        aa + wander,
    )


def _lesser(a: Field, b: Field) -> Field:
    """The one nearer to zero, and zero where their signs differ."""
    return where(a * b > 0.0, where(a * a > b * b, b, a), a * 0.0)


def _dot(command: Columns, gains: Sequence[Sequence[float]]) -> list[Field]:
    return [
        sum(
            (c * gain for c, gain in zip(command, column, strict=True) if gain),
            start=command[0] * 0.0,
        )
        for column in zip(*gains, strict=True)
    ]
