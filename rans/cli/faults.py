"""``rans faults``: which failed thrusters a spacecraft can do without."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from rans.errors import ConfigError

if TYPE_CHECKING:
    from rans.model.spacecraft import Spacecraft
    from rans.randomization.conditions import FaultKind
    from rans.randomization.faults import FaultSet

_NUMBERS = {1: "one", 2: "two"}


@dataclass(frozen=True)
class Faults:
    """Show which thrusters may fail, alone or two at once, while every push and turn stays possible.

    Dead thrusters never open, stuck ones always push. What cannot be recovered from, no controller can:
    there it can only drift safely.
    """

    craft: Annotated[str, Positional, arg(metavar="SPACECRAFT")]
    """Name of a spacecraft, or the .toml file of your own."""
    picture: Annotated[Path | None, arg(metavar="FILE")] = None
    """Save a figure here (.png, .svg or .pdf)."""

    def run(self) -> int:
        """Print the table; exit code 0 whatever it says."""
        from rans.model.spacecraft_file import load_spacecraft
        from rans.terminal import Terminal, table

        craft = load_spacecraft(self.craft)
        if self.picture is not None:
            from rans.drawing import check_picture

            check_picture(self.picture)
        if len(craft.thrusters) < 2:
            raise ConfigError(f"{craft.name} has one thruster, which it cannot do without.")
        found = _looked_at(craft)
        rows = [(f"{_NUMBERS[count]} {kind}", *_row(sets)) for (kind, count), sets in found.items()]
        columns = "fault", "recoverable", "least margin", "not recoverable"
        Terminal().print(
            table(
                f"{craft.name}: recoverable faults",
                columns,
                rows,
                "Margin: how far the others stay from always shut and always open while they hold still.",
            )
        )
        if self.picture is not None:
            from rans.drawing import save_picture
            from rans.show.figures.faults_figure import faults_figure

            save_picture(faults_figure(craft, found), self.picture)
            Terminal().say(f"Picture: {self.picture}")
        return 0


def _looked_at(craft: Spacecraft) -> dict[tuple[FaultKind, int], list[FaultSet]]:
    """Hundreds of thrusters have tens of thousands of pairs, at some milliseconds each."""
    from rans.randomization.faults import fault_sets
    from rans.terminal import progress

    kinds: tuple[FaultKind, ...] = ("dead", "stuck-open")
    wanted: list[tuple[FaultKind, int]] = [
        (kind, count) for kind in kinds for count in (1, 2) if count < len(craft.thrusters)
    ]
    with progress() as bars:
        return {
            (kind, count): list(
                bars.track(
                    fault_sets(craft, count, kind),
                    math.comb(len(craft.thrusters), count),
                    description=f"{_NUMBERS[count]} {kind}",
                )
            )
            for kind, count in wanted
        }


def _row(sets: list[FaultSet]) -> tuple[str, str, str]:
    good = [one.margin for one in sets if one.recoverable]
    lost = ["+".join(map(str, one.thrusters)) for one in sets if not one.recoverable]
    return (
        f"{len(good)} of {len(sets)}",
        f"{min(good):.1%}" if good else "",
        ", ".join(lost) or "none",
    )
