"""Response of a craft to its thrusters: more or less than designed, and how much of it a period late.

Mass, inertia and thrust decide how much comes at once; slow valves and delayed commands, how much comes in the
period after. Recursive least squares estimate both in flight (Plackett, "Some theorems in least squares", 1950):
the innovations of a filter are regressed on what the last two commands are designed to give.
"""

from __future__ import annotations

from typing import NamedTuple

from rans.extend import Columns, Field, at_least, cross, vector_in_rotated_frame, where
from rans_estimation.frame_rotation import scaled_sum

_WANDER = 1e-4
"""Variance that the coefficients gain in every period: a converged estimate still follows a later change."""
_LARGEST = 2.0
"""Largest coefficient: a reading that asks for more comes from a broken sensor."""


class Response(NamedTuple):
    """Response coefficients of N spacecraft to forces, or to torques; all zeros before the first reading."""

    more: Field
    """Part of a command's designed effect that comes at once beyond it; 0 is as designed."""
    late: Field
    """Part of a command's designed effect that comes in the next period."""
    covariance: tuple[Field, Field, Field]
    """Covariance of (more, late): its entries (1, 1), (1, 2) and (2, 2)."""
    last: Columns
    """Designed effect of the last command: change of velocity, m/s or rad/s, in the B expected now."""
    previous: Columns
    """Designed effect of the command before the last."""

    @staticmethod
    def width(axes: int) -> int:
        """Fields of a response to vectors with so many components, as `packed` lists them."""
        return 5 + 2 * axes

    @classmethod
    def unpacked(cls, memory: Columns) -> Response:
        """Response from the fields that `packed` lists."""
        more, late, xx, xy, yy, *effects = memory
        half = len(effects) // 2
        return cls(more, late, (xx, xy, yy), effects[:half], effects[half:])

    def packed(self) -> list[Field]:
        """All fields in a row, for a policy's memory."""
        return [self.more, self.late, *self.covariance, *self.last, *self.previous]

    def applied(self, designed: Columns) -> list[Field]:
        """Change of velocity in a period whose command is designed to give ``designed``, m/s or rad/s."""
        return scaled_sum(1.0 + self.more, designed, self.late, self.last)

    def predicted(self, designed: Columns, half_turn: Columns) -> Response:
        """Response one period later.

        Args:
            designed: designed effect of the period's command, m/s or rad/s in B.
            half_turn: half the rotation of B in the period, rad; empty for effects that do not turn with B.
        """
        last, previous = (
            vector_in_rotated_frame(scaled_sum(1.0, x, 1.0, cross(half_turn, x)), half_turn)
            if half_turn
            else x
            for x in (designed, self.last)
        )
        xx, xy, yy = self.covariance
        return self._replace(
            last=last, previous=previous, covariance=(xx + _WANDER, xy, yy + _WANDER)
        )

    def updated(self, innovation: Columns, variance: Field) -> Response:
        """Response after a reading's innovation, by recursive least squares.

        It is traced for compiled steps: no decision by the value of a number but `where`.

        Args:
            innovation: velocity as read less velocity as predicted, m/s or rad/s in B.
            variance: of the innovation's components, the sum of that of the reading and of the prediction.
        """
        # Information of this reading: its matrix [[aa, ab], [ab, bb]] and its vector (a, b).
        weight = 1.0 / variance
        aa, ab, bb, a, b = (
            weight * sum(x * y for x, y in zip(*pair, strict=True))
            for pair in (
                (self.last, self.last),
                (self.last, self.previous),
                (self.previous, self.previous),
                (self.last, innovation),
                (self.previous, innovation),
            )
        )

        # New covariance (I + P A)^-1 P, with P the covariance and A the information matrix.
        xx, xy, yy = self.covariance
        p = 1.0 + xx * aa + xy * ab
        q = xx * ab + xy * bb
        r = xy * aa + yy * ab
        s = 1.0 + xy * ab + yy * bb
        scale = 1.0 / (p * s - q * r)
        xx, xy, yy = (s * xx - q * xy) * scale, (s * xy - q * yy) * scale, (p * yy - r * xy) * scale

        # New coefficients.
        more = self.more + xx * a + xy * b
        late = self.late + xy * a + yy * b
        return self._replace(more=_limited(more), late=_limited(late), covariance=(xx, xy, yy))

    def restarted(self, is_first: Field, variance: float) -> Response:
        """This response; where an episode begins, the designed one with this prior variance.

        Args:
            is_first: whether the reading is an episode's first, (N,).
            variance: prior variance of each coefficient.
        """
        prior = (0.0, 0.0, variance, 0.0, variance)
        more, late, *covariance = (
            where(is_first, before, x)
            for before, x in zip(prior, (self.more, self.late, *self.covariance), strict=True)
        )
        xx, xy, yy = covariance
        return self._replace(more=more, late=late, covariance=(xx, xy, yy))


def _limited(x: Field) -> Field:
    """The nearest number from -`_LARGEST` to `_LARGEST`."""
    return -at_least(-at_least(x, -_LARGEST), -_LARGEST)
