"""What a user asks of a trajectory: the name of an objective, and limits beside its task's own constraints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rans.extend import ConfigError, Field, Scenario, brief, positive, sqrt

ObjectiveName = Literal["fuel", "time", "energy", "reward"]
"""What an optimal trajectory minimizes, see `rans_optimal.objectives`."""


def balls_of(zones: Any) -> tuple[tuple[float, ...], ...]:
    """Balls, each the coordinates of its centre and its radius, m, as numbers or as a word such as "1.5,0.2,0.4".

    Raises:
        ConfigError: they are no list of such balls.
    """
    try:
        return tuple(
            tuple(map(float, zone.split(",") if isinstance(zone, str) else zone)) for zone in zones
        )
    except (TypeError, ValueError) as error:
        raise ConfigError(
            "zones must be a list of zones, as in [(1.5, 0.0, 0.4)] or as words, 1.5,0,0.4, got "
            f"{brief(zones)}."
        ) from error


@dataclass(frozen=True)
class PathLimits:
    """Speed, spin and balls that a trajectory keeps to after its start, with margins as `Task.constraints` has.

    >>> from rans_optimal.limits import PathLimits
    >>> PathLimits(speed=0.3, keep_out=((1.5, 0.0, 0.4),)).checks
    4

    Raises:
        ConfigError: a limit is no finite number > 0, or a ball has no centre and radius.
    """

    speed: float | None = None
    """Largest speed in W, m/s."""
    spin: float | None = None
    """Largest angular speed, rad/s."""
    keep_out: tuple[tuple[float, ...], ...] = ()
    """Balls (m) that the centre of mass stays out of: centre in W, then radius."""
    checks: int = 4
    """Instants of a control period at which they hold, evenly spaced, the last one at its end."""

    def __post_init__(self) -> None:
        for name, value in (("speed", self.speed), ("spin", self.spin)):
            if value is not None:
                positive(f"the largest {name}", value)
        for ball in self.keep_out:
            if len(ball) not in (3, 4) or not all(map(math.isfinite, ball)) or ball[-1] <= 0:
                raise ConfigError(
                    "a ball to keep out of is its centre and a radius > 0, x,y,r or in space x,y,z,r, got "
                    f"{','.join(f'{x:g}' for x in ball)}."
                )

    def margins(self, state: Any) -> dict[str, Field]:
        """How far a state of fields is within each limit, in SI units; negative beyond it.

        Raises:
            ConfigError: a ball is for the other dimension.
        """
        result: dict[str, Field] = {}
        if self.speed is not None:
            result["speed"] = self.speed - state.v.norm()
        if self.spin is not None:
            result["spin"] = self.spin - sqrt(sum(x * x for x in state.spin()))
        where = state.p.columns()
        for number, (*centre, radius) in enumerate(self.keep_out):
            if len(centre) != len(where):
                raise ConfigError(
                    f"a ball to keep out of needs {len(where)} coordinates and a radius here, got "
                    f"{len(centre)} coordinates."
                )
            square = sum((x - c) * (x - c) for x, c in zip(where, centre, strict=True))
            result[f"keep out {number}"] = sqrt(square) - radius
        return result

    def check_ends(self, starts: Scenario) -> None:
        """Refuse starts and goals, fields of arrays (N,), inside a ball to keep out of.

        Raises:
            ConfigError: there is one; or a ball is for the other dimension.
        """
        for what, state in (("start", starts.start), ("goal", starts.goal)):
            for name, margin in PathLimits(keep_out=self.keep_out).margins(state).items():
                margins = np.atleast_1d(np.asarray(margin, float))
                worst = int(margins.argmin())
                if margins[worst] < 0.0:
                    number = int(name.rpartition(" ")[2])
                    *centre, radius = self.keep_out[number]
                    raise ConfigError(
                        f"{what} {worst} is {-margins[worst]:.3g} m inside the ball to keep out of at "
                        f"{', '.join(f'{x:g}' for x in centre)} with a radius of {radius:g} m: no trajectory keeps "
                        "out of it; move the ball, or make it smaller."
                    )
