"""InnoCube from its telemetry in orbit: inertia, and manoeuvres: ``python -m campaigns.innocube FOLDER``.

InnoCube is a satellite of three units with three reaction wheels, whose learned attitude controller flew from
October to December 2025 (arXiv 2512.19576). FOLDER is a clone of kdjebko/lelar-in-orbit-data
(`campaigns.innocube_telemetry`).

Wheels do not change the angular momentum of the whole, R (J w - s) in units of a wheel's inertia, with the speeds s
of the wheels. In the frame of one goal it is constant but for external torques. The inertia J, the momentum of each
goal and a constant torque during each goal, which stands for gravity gradient, drag and magnetic torques, enter
linearly. The time by which speeds are read after rates is linear too. Errors are those of readings, and of their
times, which the rounded stamps and a row every 2 s leave: in proportion to the acceleration of the wheels.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from tyro.conf import Positional

from campaigns.command import ended
from campaigns.innocube_flights import (
    InnoCubePD,
    Manoeuvre,
    apart,
    figures,
    manoeuvres_of,
    simulated,
)
from campaigns.innocube_telemetry import Telemetry, manoeuvre_folders, read_manoeuvre
from rans.errors import ConfigError
from rans.evaluation.fly.contestants import contestant
from rans.flight import Controller
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.control.lqr import LQR
from rans.tasks.go_to_attitude import GoToAttitude
from rans.terminal import Terminal

_COMPONENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_GAP = 4.5
"""s: rows farther apart are not neighbours; most are 2 s apart."""
_LEAST_ERROR = 0.2
"""rad/s of a wheel: least standard deviation of a row, two revolutions a minute, so that weights stay finite."""
_FITS = 3
"""Fits, between which the weights follow the residuals; more change nothing in three digits."""
_EARLY = 20.0
"""s: beginning of a manoeuvre, in which the satellite turns most of the way."""
_ALIKE = 3.0
"""Degrees: rounding of the time stamps to whole seconds is as much, at the 4 degrees/s of a turn."""
MODELS = {"conserved": False, "torque": True}
"""Models of the external torque: whether there is a constant one during each goal."""


@dataclass(frozen=True)
class Inertia:
    """Inertia and residuals of one manoeuvre under one model."""

    moments: np.ndarray
    """(3,), moments of inertia about the body's axes over the inertia of a wheel."""
    residual: float
    """Root mean square of the momentum that the model leaves, over the inertia of a wheel, rad/s."""
    correlation: float
    """Correlation of successive weighted residuals; 0 for white ones."""
    bound: float
    """Absolute correlation that white residuals exceed once in a thousand manoeuvres."""
    timing: float
    """Standard deviation of the times of readings, s, by which residuals grow with acceleration."""
    late: float
    """Time by which wheel speeds are older than rates, s."""


def identified(telemetry: Telemetry, torque: bool) -> Inertia:
    """Weighted least squares for inertia, momenta, external torques and lateness of the speeds.

    Args:
        telemetry: readings.
        torque: whether there is a constant torque during each goal, in its frame.
    """
    t = telemetry.times
    R = telemetry.attitude
    count = len(t)
    columns = []

    # Momentum of the body, of each component of its inertia.
    for i, j in _COMPONENTS:
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        columns.append(np.einsum("nij,jk,nk->ni", R, unit, telemetry.rates))

    # Speeds read late, and what the whole has in the frame of each goal.
    acceleration = np.gradient(telemetry.speeds, t, axis=0)
    columns.append(-np.einsum("nij,nj->ni", R, acceleration))
    for goal in range(telemetry.goals[-1] + 1):
        during = (telemetry.goals == goal).astype(float)
        since = during * (t - t[telemetry.goals == goal][0])
        for axis in np.eye(3):
            columns.append(np.outer(during, axis))
            if torque:
                columns.append(np.outer(since, axis))

    # Fit, with the variance of each row from the residuals: of the readings, and of their times.
    matrix = np.stack(columns, axis=-1)
    wheels = np.einsum("nij,nj->ni", R, telemetry.speeds)
    change = np.sum(acceleration**2, axis=1) / 3.0
    weights = np.ones(count)
    residual = wheels
    values = np.zeros(matrix.shape[-1])
    variances = np.zeros(2)
    for _ in range(_FITS):
        weighed = (matrix * weights[:, None, None]).reshape(3 * count, -1)
        values = np.linalg.lstsq(weighed, (wheels * weights[:, None]).ravel(), rcond=None)[0]
        residual = wheels - matrix @ values
        square = np.mean(residual**2, axis=1)
        both = np.stack([np.ones(count), change], axis=1)
        variances = np.linalg.lstsq(both, square, rcond=None)[0]
        variances = np.maximum(variances, [_LEAST_ERROR**2, 0.0])
        weights = 1.0 / np.sqrt(both @ variances)

    # Whether what is left is white: successive rows.
    white = residual * weights[:, None]
    near = np.diff(t) < _GAP
    product = (white[1:] * white[:-1])[near]
    return Inertia(
        values[:3],
        float(np.sqrt(np.mean(residual**2))),
        float(np.mean(product) / np.mean(white**2)),
        # 3.29 standard deviations: two-sided, once in a thousand.
        3.29 / np.sqrt(product.size),
        float(np.sqrt(variances[1])),
        float(values[6]),
    )


@dataclass(frozen=True)
class InnoCube:
    """Identify the inertia of InnoCube from its telemetry."""

    folder: Positional[Path]
    """Clone of kdjebko/lelar-in-orbit-data."""
    agent: str | None = None
    """Agent that flies the manoeuvres too, such as the folder of a training."""

    def run(self) -> int:
        """Print a row for each manoeuvre and model, and one for each who flies the manoeuvres."""
        rows = []
        manoeuvres: list[Manoeuvre] = []
        for folder in manoeuvre_folders(self.folder):
            try:
                telemetry = read_manoeuvre(folder)
            except ConfigError as error:
                Terminal().say(str(error))
                continue
            manoeuvres += manoeuvres_of(folder, telemetry)
            for name, model in MODELS.items():
                result = identified(telemetry, model)
                rows.append(
                    (
                        "/".join(folder.parts[-2:]),
                        str(telemetry.goals[-1] + 1),
                        name,
                        ", ".join(f"{x:.0f}" for x in result.moments),
                        f"{result.residual:.1f}",
                        f"{result.correlation:+.2f} ({result.bound:.2f})",
                        f"{result.timing:.2f}",
                    )
                )
        headings = (
            "manoeuvre",
            "goals",
            "external torque",
            "Jxx, Jyy, Jzz over a wheel's inertia",
            "residual, rad/s of a wheel",
            "correlation (bound)",
            "timing, s",
        )
        Terminal().show("InnoCube", headings, rows)
        self._fly(manoeuvres)
        return 0

    def _fly(self, manoeuvres: list[Manoeuvre]) -> None:
        """Print what was flown in orbit beside simulations from the same starts."""
        craft = load_spacecraft("innocube")
        controllers: list[Controller] = [InnoCubePD(), LQR(craft, GoToAttitude())]
        if self.agent is not None:
            controllers.append(contestant(self.agent).controller)
        rows = []
        for by in ("learned", "PD"):
            flown = [one for one in manoeuvres if one.flown_by == by]
            rows.append(_row(by, "in orbit", flown))
            for controller in controllers:
                flights = simulated(craft, flown, controller)
                rows.append(_row(by, f"simulated: {controller.name}", flights))
                if by == controller.name.split()[0]:
                    angles = np.rad2deg(apart(flown, flights, _EARLY))
                    Terminal().say(
                        f"In the first {_EARLY:g} s of {np.sum(angles < _ALIKE)} of {len(angles)} manoeuvres that "
                        f"PD flew in orbit, its simulation is within {_ALIKE:g} degrees of it, in the median of "
                        f"the readings; in the median of all manoeuvres {np.median(angles):.1f} degrees."
                    )
        headings = (
            "manoeuvres",
            "who",
            "settled within 1 degree",
            "settling time, s",
            "error at rest, degrees",
            "change of wheel speeds, rpm",
            "fastest wheel, rpm",
        )
        Terminal().show("Manoeuvres", headings, rows)


def _row(by: str, who: str, flights: list[Manoeuvre]) -> tuple[str, ...]:
    """Row of a table, of `figures`."""
    of = figures(flights)
    return (
        by,
        who,
        f"{of['settled']:.0f} of {of['count']:.0f}",
        f"{of['time']:.0f}",
        f"{of['rest']:.2f}",
        f"{of['travel']:,.0f}",
        f"{of['fastest']:,.0f}",
    )


if __name__ == "__main__":
    raise SystemExit(ended("innocube", lambda: tyro.cli(InnoCube).run()))
