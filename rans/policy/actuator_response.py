"""How a craft answers its thrusters: more or less than designed, and how much of it a control period later.

Its mass, its inertia and its thrust decide the one, what valves and commands are late by the other. Least
squares find both, as they go along (Plackett, "Some theorems in least squares", 1950): of what readings say
beyond what was expected, on what the last two commands are designed to give.
"""

from __future__ import annotations

from typing import NamedTuple

from rans.model.fields import Field, at_least, where
from rans.policy.frame_rotation import cross, scaled_sum, turned
from rans.tasks.observation_terms import Columns

_WANDER = 1e-4
"""Variance that answers gain in a period: what is sure stays open to doubt."""
_MOST = 2.0
"""Of an answer's size: what readings say beyond is a broken sensor."""


class Response(NamedTuple):
    """Of N spacecraft to forces, or to torques; zeros know nothing."""

    more: Field
    """Share of what a command is designed to give that comes beyond it, at once."""
    late: Field
    """Share that comes in the period after."""
    spread: tuple[Field, Field, Field]
    """Their covariance, by rows without what symmetry tells."""
    now: Columns
    """Velocity that the last command is designed to give, m/s or rad/s in B as it is expected."""
    then: Columns
    """That of the one before."""

    @staticmethod
    def width(axes: int) -> int:
        """Numbers of one of vectors with so many components."""
        return 5 + 2 * axes

    @classmethod
    def unpacked(cls, memory: Columns) -> Response:
        """Of what `packed` gave."""
        more, late, xx, xy, yy, *rest = memory
        half = len(rest) // 2
        return cls(more, late, (xx, xy, yy), rest[:half], rest[half:])

    def packed(self) -> list[Field]:
        """Numbers to remember."""
        return [self.more, self.late, *self.spread, *self.now, *self.then]

    def given(self, command: Columns) -> list[Field]:
        """What comes in a period that begins with a command which is designed to give this."""
        return scaled_sum(1.0 + self.more, command, self.late, self.now)

    def after(self, command: Columns, half: Columns) -> Response:
        """A period later, in a B that has turned by twice this since; without it, one that has not."""
        now, then = (
            turned(scaled_sum(1.0, x, 1.0, cross(half, x)), half) if half else x
            for x in (command, self.now)
        )
        xx, xy, yy = self.spread
        return self._replace(now=now, then=then, spread=(xx + _WANDER, xy, yy + _WANDER))

    def learnt(self, off: Columns, variance: Field) -> Response:
        """Once a reading, and what was expected, of this variance together, are off by so much."""
        weight = 1.0 / variance
        aa, ab, bb, a, b = (
            weight * sum(x * y for x, y in zip(*pair, strict=True))
            for pair in (
                (self.now, self.now),
                (self.now, self.then),
                (self.then, self.then),
                (self.now, off),
                (self.then, off),
            )
        )

        # What information A leaves of the covariance P: (I + P A)^-1 P.
        xx, xy, yy = self.spread
        p = 1.0 + xx * aa + xy * ab
        q = xx * ab + xy * bb
        r = xy * aa + yy * ab
        s = 1.0 + xy * ab + yy * bb
        scale = 1.0 / (p * s - q * r)
        xx, xy, yy = (s * xx - q * xy) * scale, (s * xy - q * yy) * scale, (p * yy - r * xy) * scale
        more = self.more + xx * a + xy * b
        late = self.late + xy * a + yy * b
        return self._replace(more=_held(more), late=_held(late), spread=(xx, xy, yy))

    def begun(self, first: Field, spread: float) -> Response:
        """This, or where an episode's first reading is all there is, what is known before any other."""
        more, late, *rest = (
            where(first, before, x)
            for before, x in zip(
                (0.0, 0.0, spread, 0.0, spread), (self.more, self.late, *self.spread), strict=True
            )
        )
        xx, xy, yy = rest
        return self._replace(more=more, late=late, spread=(xx, xy, yy))


def _held(x: Field) -> Field:
    return -at_least(-at_least(x, -_MOST), -_MOST)
