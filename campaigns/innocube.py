"""Manoeuvres of InnoCube in orbit, and flights beside them: ``python -m campaigns.innocube FOLDER``.

InnoCube is a satellite of three units with three reaction wheels, whose learned attitude controller flew from
October to December 2025 (arXiv 2512.19576). FOLDER is a clone of kdjebko/lelar-in-orbit-data. `rans identify` has
its inertia from the same folders.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from rans_robot.identify.log import checked_satellite_log
from rans_robot.identify.telemetry import is_telemetry, read_telemetry
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
from rans.errors import ConfigError
from rans.evaluation.fly.contestants import contestant
from rans.flight import Controller
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.control.lqr import LQR
from rans.tasks.go_to_attitude import GoToAttitude
from rans.terminal import Terminal

_EARLY = 20.0
"""s: beginning of a manoeuvre, in which the satellite turns most of the way."""
_ALIKE = 3.0
"""Degrees: rounding of the time stamps to whole seconds is as much, at the 4 degrees/s of a turn."""


@dataclass(frozen=True)
class InnoCube:
    """Fly InnoCube's manoeuvres beside those of its telemetry."""

    folder: Positional[Path]
    """Clone of kdjebko/lelar-in-orbit-data."""
    agent: str | None = None
    """Agent that flies the manoeuvres too, such as the folder of a training."""

    def run(self) -> int:
        """Print a row for each who flies the manoeuvres."""
        craft = load_spacecraft("innocube")
        folders = sorted(folder for folder in self.folder.rglob("*") if is_telemetry(folder))
        if not folders:
            raise ConfigError(
                f"{self.folder} has no attitudes: give a clone of kdjebko/lelar-in-orbit-data."
            )
        manoeuvres = [
            one
            for folder in folders
            for one in manoeuvres_of(
                folder, checked_satellite_log(read_telemetry(folder, craft), craft)
            )
        ]
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
