"""A Kalman filter within a policy: it predicts the next reading from past readings and commands.

Noise in readings hides what a craft is about to do; its mass, its thrust and the commands predict most of it
(Kalman, "A new approach to linear filtering and prediction problems", 1960). The state is made of the observed
columns in the body frame B, so that the observation of any task may be filtered (docs/decisions/learning.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np

from rans.extend import (
    AngularVelocity,
    Block,
    Columns,
    Field,
    Layout,
    RelativeRotation,
    Scalar,
    VectorInW,
    cross,
    vector_in_rotated_frame,
    where,
)
from rans_estimation.actuator_response import Response
from rans_estimation.frame_rotation import block_in_rotated_frame, scaled_sum, tilt_between
from rans_estimation.kinematic_roles import (
    POSITION,
    SPIN,
    VELOCITY,
    Sensitivity,
    in_units_of,
    nonzero,
)

_Covariance = tuple[Field, Field, Field, Field, Field, Field]
"""Upper triangle, row by row, of the covariance of a pose x, its velocity v and a steady acceleration a.

All axes share it, in units of the variance of a reading's noise: (xx, xv, xa, vv, va, aa).
"""


class _State(NamedTuple):
    """State estimate of N spacecraft."""

    columns: Columns
    """Observed columns in B."""
    accelerations: Columns
    """Steady accelerations in B that no command explains, m/s^2 and rad/s^2."""
    covariance: _Covariance
    responses: tuple[Response, ...] = ()
    """Responses to forces and to torques; empty if the filter does not estimate them."""


class Filter(NamedTuple):
    """A Kalman filter for one spacecraft and task, whose poses and velocities are read with equal noise.

    Its memory, (N, m), is the prediction of the next reading with its covariance. Zeros are the memory at an
    episode's start, before any reading. Variances are in units of that of a reading's noise.
    """

    drift: float
    """Process noise: variance that velocities and steady accelerations gain in a control period."""
    steady: float
    """Prior variance of the steady accelerations."""
    response: float
    """Prior variance of the responses (`rans_estimation.actuator_response`), in units of the noise over the effect
    of the strongest thruster; 0: thrusters are taken to act as designed, and no accelerations to be steady."""
    period: float
    """Control period, s."""
    push: tuple[tuple[float, ...], ...]
    """Change of velocity in B by each thruster in a period, (thrusters, axes), m/s."""
    twist: tuple[tuple[float, ...], ...]
    """Change of angular velocity in B by each thruster in a period, (thrusters, axes), rad/s."""
    sensitivities: tuple[Sensitivity, ...]
    """Sensitivity of each block of `Layout.body` to position, velocity and angular velocity."""

    # Sizes and layouts.

    @property
    def axes(self) -> int:
        """Components of the estimated steady accelerations, linear and angular together."""
        return len(self.push[0]) + len(self.twist[0]) if self.response else 0

    @property
    def extra_columns(self) -> int:
        """Columns of an estimate beyond those of the observation: steady accelerations and responses."""
        return self.axes + 4 if self.response else 0

    @property
    def _strongest(self) -> tuple[float, float]:
        """Change of velocity by the strongest thruster in a period, m/s and rad/s."""
        push, twist = (float(np.abs(gains).max()) or 1.0 for gains in (self.push, self.twist))
        return push, twist

    def width(self, layout: Layout) -> int:
        """Fields of the memory for columns of this layout, that of the body frame."""
        if not self.response:
            return layout.width + 3
        responses = sum(Response.width(len(gains[0])) for gains in (self.push, self.twist))
        return layout.width + self.axes + 6 + responses

    def layout(self, layout: Layout) -> Layout:
        """Layout of an estimate: these columns, then steady accelerations and responses."""
        if not self.response:
            return layout
        accelerations = (
            Block(VectorInW, len(self.push[0])),
            Block(AngularVelocity, len(self.twist[0])),
        )
        return Layout((*layout.blocks, *accelerations, Block(Scalar, 4)))

    # What a policy asks of a filter.

    def estimate(self, layout: Layout, read: Columns, memory: Columns) -> list[Field]:
        """State estimate after a reading, in columns of `layout`.

        Steady accelerations are scaled to what they change in a period, in units of the strongest thruster's
        effect; then follow the coefficients of `Response`, (more, late), of forces and of torques.

        Args:
            layout: layout of the observed columns in B.
            read: columns of the reading.
            memory: what `next_memory` returned a period ago.
        """
        state = self._updated(layout, read, self._unpacked(layout, memory))
        if not self.response:
            return [*state.columns]
        scales = [
            self.period / strongest
            for strongest, gains in zip(self._strongest, (self.push, self.twist), strict=True)
            for _ in gains[0]
        ]
        return [
            *state.columns,
            *(a * scale for a, scale in zip(state.accelerations, scales, strict=True)),
            *(x for response in state.responses for x in (response.more, response.late)),
        ]

    def next_memory(
        self, layout: Layout, read: Columns, memory: Columns, command: Columns
    ) -> list[Field]:
        """Memory after a reading (`estimate`) and a command (thrusters,) from 0 to 1."""
        state = self._updated(layout, read, self._unpacked(layout, memory))
        return self._packed(self._predicted(layout, state, command))

    def predicted_reading(
        self, layout: Layout, read: Columns, memory: Columns, command: Columns, is_noisy: Field
    ) -> Columns:
        """Columns of the next reading, predicted from this reading itself and the command, not from the estimate.

        Where sensors are noisy, thrusters are taken to act as the estimated responses say. Where they are perfect,
        they are taken to act by that or as designed, whichever is less, and not at all where the two disagree
        about the direction: a perfect sensor that rightly repeats a number is then seldom contradicted.

        Args:
            layout: see `estimate`.
            read: see `estimate`.
            memory: see `estimate`.
            command: (thrusters,) from 0 to 1.
            is_noisy: above 0 where sensors are noisy, (N,).
        """
        state = self._updated(layout, read, self._unpacked(layout, memory))
        designed = [_effect(command, gains) for gains in (self.push, self.twist)]
        applied = [
            response.applied(effect)
            for response, effect in zip(state.responses, designed, strict=False)
        ]
        effects = [
            [where(is_noisy > 0.0, b, _smaller(a, b)) for a, b in zip(*pair, strict=True)]
            for pair in zip(designed, applied, strict=False)
        ] or designed
        return self._propagated(layout, read, *effects)[0]

    def is_first(self, layout: Layout, memory: Columns) -> Field:
        """Whether the next reading is an episode's first, of which nothing is predicted, (N,)."""
        return self._unpacked(layout, memory).covariance[0] == 0.0

    # The memory.

    def _packed(self, state: _State) -> list[Field]:
        """Memory of a state; without steady accelerations their covariance is left out."""
        if self.response:
            responses = [x for response in state.responses for x in response.packed()]
            return [*state.columns, *state.accelerations, *state.covariance, *responses]
        xx, xv, _, vv, *_ = state.covariance
        return [*state.columns, xx, xv, vv]

    def _unpacked(self, layout: Layout, memory: Columns) -> _State:
        """State of a memory, the inverse of `_packed`, whose order is that of trained networks."""
        columns, rest = memory[: layout.width], memory[layout.width :]
        if not self.response:
            xx, xv, vv = rest
            no_accelerations = (0.0,) * (len(self.push[0]) + len(self.twist[0]))
            return _State(columns, no_accelerations, (xx, xv, 0.0, vv, 0.0, 0.0))
        accelerations, rest = rest[: self.axes], rest[self.axes :]
        (xx, xv, xa, vv, va, aa), packed = rest[:6], rest[6:]
        of_forces = Response.width(len(self.push[0]))
        responses = (
            Response.unpacked(packed[:of_forces]),
            Response.unpacked(packed[of_forces:]),
        )
        return _State(columns, accelerations, (xx, xv, xa, vv, va, aa), responses)

    # The update by a reading.

    def _updated(self, layout: Layout, read: Columns, prediction: _State) -> _State:
        """State after a reading: the prediction, corrected by Kalman's gains times the innovation, in B.

        It is traced into kernels and exports: operations on fields alone, and none that depends on a value.
        """
        # Gains of poses, velocities and accelerations, each for the innovations of pose and of velocity.
        # A reading's noise is the unit, so that its variance is 1.
        xx, xv, xa, vv, va, aa = prediction.covariance
        scale = 1.0 / ((xx + 1.0) * (vv + 1.0) - xv * xv)
        pose_gain, velocity_gain, acceleration_gain = (
            ((p * (vv + 1.0) - v * xv) * scale, (v * (xx + 1.0) - p * xv) * scale)
            for p, v in ((xx, xv), (xv, vv), (xa, va))
        )
        covariance = [
            value - (gain[0] * p + gain[1] * v)
            for value, gain, p, v in (
                (xx, pose_gain, xx, xv),
                (xv, pose_gain, xv, vv),
                (xa, pose_gain, xa, va),
                (vv, velocity_gain, xv, vv),
                (va, velocity_gain, xa, va),
                (aa, acceleration_gain, xa, va),
            )
        ]

        # Innovations: first the tilt of B, then all other blocks as they would be read in the predicted B.
        blocks = list(
            zip(
                layout.split(read),
                layout.split(prediction.columns),
                self.sensitivities,
                strict=True,
            )
        )
        rotations = [
            (columns, predicted)
            for (block, columns), (_, predicted), _ in blocks
            if issubclass(block.kind, RelativeRotation)
        ]
        tilt = tilt_between(*rotations[0]) if rotations else [0.0] * len(self.twist[0])
        innovations = [
            self._innovation(block, columns, predicted, [-0.5 * x for x in tilt])
            for (block, columns), (_, predicted), _ in blocks
        ]
        position = in_units_of(POSITION, innovations, self.sensitivities)
        velocity = in_units_of(VELOCITY, innovations, self.sensitivities)
        spin = in_units_of(SPIN, innovations, self.sensitivities)

        # Correct each block by its own innovation and by that of its derivative or integral. Blocks that no motion
        # changes become as they are read.
        half_turn = scaled_sum(0.5 * pose_gain[0], tilt, 0.5 * pose_gain[1], spin)
        gains = pose_gain, velocity_gain[::-1], velocity_gain[::-1]
        coupled = velocity, position, tilt  # with position, velocity and spin
        corrected: list[Field] = []
        for ((block, _), (_, predicted), sensitivity), innovation in zip(
            blocks, innovations, strict=True
        ):
            correction = innovation
            for k in nonzero(sensitivity):
                own, coupled_gain = gains[k]
                correction = scaled_sum(own, correction, coupled_gain * sensitivity[k], coupled[k])
            corrected += block_in_rotated_frame(
                block, scaled_sum(1.0, predicted, 1.0, correction), half_turn
            )

        # Correct the steady accelerations, of which the linear ones turn with B.
        acceleration_changes = (
            *scaled_sum(acceleration_gain[0], position, acceleration_gain[1], velocity),
            *scaled_sum(acceleration_gain[0], tilt, acceleration_gain[1], spin),
        )
        accelerations = scaled_sum(1.0, prediction.accelerations, 1.0, acceleration_changes)
        axes = len(self.push[0])
        accelerations = [
            *vector_in_rotated_frame(accelerations[:axes], half_turn),
            *accelerations[axes:],
        ]

        # An episode's first reading is taken as it is, with the variance of its noise.
        is_first = xx == 0.0
        first_covariance = (1.0, 0.0, 0.0, 1.0, 0.0, self.steady)
        columns, accelerations, covariance = (
            [where(is_first, a, b) for a, b in zip(*pair, strict=True)]
            for pair in (
                (read, corrected),
                ((0.0,) * len(accelerations), accelerations),
                (first_covariance, covariance),
            )
        )
        responses = self._updated_responses(prediction, (velocity, spin))
        return _State(columns, accelerations, cast(_Covariance, tuple(covariance)), responses)

    def _updated_responses(
        self, prediction: _State, innovations: tuple[Columns, Columns]
    ) -> tuple[Response, ...]:
        """Responses after the innovations of velocity and spin (m/s, rad/s); empty if they are not estimated.

        Variances are those of the prediction, before the reading. A covariance of 0 marks the begin of an episode.
        """
        xx, _, _, vv, *_ = prediction.covariance
        return tuple(
            response.updated(innovation, (vv + 1.0) * strongest**2).restarted(
                xx == 0.0, self.response
            )
            for response, innovation, strongest in zip(
                prediction.responses, innovations, self._strongest, strict=False
            )
        )

    @staticmethod
    def _innovation(
        block: Block, columns: Columns, predicted: Columns, half_turn: Columns
    ) -> Columns:
        """Reading less prediction of a block, both in the predicted B; zeros of a rotation, which is the tilt."""
        if issubclass(block.kind, RelativeRotation):
            return [0.0] * len(predicted)
        turned_back = block_in_rotated_frame(block, columns, half_turn)
        return [a - b for a, b in zip(turned_back, predicted, strict=True)]

    # The prediction over a control period.

    def _predicted(self, layout: Layout, state: _State, command: Columns) -> _State:
        """State a period later of a rigid body on which only thrusters and steady accelerations act.

        Forces are constant in B; its rotation within the period is taken into account to first order. Drift and
        responses are those of the filter; `command` has a number (0 to 1) a thruster.
        """
        # Changes of velocity and of spin in B, by thrusters and by steady accelerations.
        axes = len(self.push[0])
        period = self.period
        designed = [_effect(command, gains) for gains in (self.push, self.twist)]
        responses = state.responses
        applied = (
            designed
            if not responses
            else [
                response.applied(effect)
                for response, effect in zip(responses, designed, strict=True)
            ]
        )
        accelerations = state.accelerations[:axes], state.accelerations[axes:]
        push, twist = (
            scaled_sum(1.0, effect, period, acceleration)
            for effect, acceleration in zip(applied, accelerations, strict=True)
        )

        # The state: columns, accelerations, responses and covariance.
        columns, half_turn = self._propagated(layout, state.columns, push, twist)
        steady = *vector_in_rotated_frame(accelerations[0], half_turn), *accelerations[1]
        next_responses = tuple(
            response.predicted(effect, rotation)
            for response, effect, rotation in zip(
                responses, designed, (half_turn, ()), strict=False
            )
        )  # torques are constant in B
        covariance = _predicted_covariance(
            state.covariance, period, self.drift, self.drift if self.response else 0.0
        )
        return _State(columns, steady, covariance, next_responses)

    def _propagated(
        self, layout: Layout, columns: Columns, push: Columns, twist: Columns
    ) -> tuple[list[Field], list[Field]]:
        """Columns a period later, in the B of then, and half of B's rotation in between, rad.

        Args:
            layout: layout of the columns.
            columns: observed columns in B.
            push: change of velocity in the period, m/s in B.
            twist: change of angular velocity, rad/s in B.
        """
        period = self.period
        blocks = list(layout.split(columns))
        velocity = in_units_of(VELOCITY, [part for _, part in blocks], self.sensitivities)
        spin = in_units_of(SPIN, [part for _, part in blocks], self.sensitivities)
        # Half the rotation, by the mean spin. Cayley's transform wants the tangent of half the angle; the second
        # term of its series, x^3 / 3, matters in fast turns.
        half_turn = [(w + 0.5 * dw) * (0.5 * period) for w, dw in zip(spin, twist, strict=True)]
        half_turn = [x * (1.0 + sum(y * y for y in half_turn) * (1.0 / 3.0)) for x in half_turn]
        # Changes of velocity and position: the force turns with B, the velocity is the period's mean.
        velocity_change = [x + turn for x, turn in zip(push, cross(half_turn, push), strict=True)]
        displacement = [(v + 0.5 * dv) * period for v, dv in zip(velocity, push, strict=True)]
        changes = displacement, velocity_change, twist
        results: list[Field] = []
        for (block, part), sensitivity in zip(blocks, self.sensitivities, strict=True):
            moved_part = part
            for k in nonzero(sensitivity):
                moved_part = scaled_sum(1.0, moved_part, sensitivity[k], changes[k])
            results += block_in_rotated_frame(block, moved_part, half_turn)
        return results, half_turn


def _predicted_covariance(
    covariance: _Covariance, period: float, drift: float, acceleration_drift: float
) -> _Covariance:
    """Covariance F P F' + Q a period later, of the model x' = x + t v + t^2/2 a, v' = v + t a.

    Args:
        covariance: P.
        period: t, s.
        drift: process noise of the velocity, which reaches the pose by half a period.
        acceleration_drift: process noise of the acceleration.
    """
    t = period
    h = 0.5 * period**2
    xx, xv, xa, vv, va, aa = covariance
    # Rows x and v of F P, then those of F P F'.
    x = xx + t * xv + h * xa, xv + t * vv + h * va, xa + t * va + h * aa
    v = xv + t * xa, vv + t * va, va + t * aa
    return (
        x[0] + t * x[1] + h * x[2] + drift * (0.5 * t) ** 2,
        x[1] + t * x[2],
        x[2],
        v[1] + t * v[2] + drift,
        v[2],
        aa + acceleration_drift,
    )


def _smaller(a: Field, b: Field) -> Field:
    """The number nearer to zero, and zero where their signs differ."""
    return where(a * b > 0.0, where(a * a > b * b, b, a), a * 0.0)


def _effect(command: Columns, gains: Sequence[Sequence[float]]) -> list[Field]:
    """Change of velocity that a command (thrusters,) is designed to give, by gains (thrusters, axes)."""
    return [
        sum(
            (c * gain for c, gain in zip(command, column, strict=True) if gain),
            start=command[0] * 0.0,
        )
        for column in zip(*gains, strict=True)
    ]
