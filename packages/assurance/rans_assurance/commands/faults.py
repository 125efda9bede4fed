"""``rans faults``: the thruster faults that a spacecraft can recover from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from rans.cli.next_commands import training
from rans.extend import Options, Table, Terminal, command_of, word
from rans_assurance.functions import FAULT_COLUMNS, faults


@command_of(faults, spacecraft=word("[SPACECRAFT]"))
class Faults(Options):
    """Show which thrusters may fail, alone or in pairs, while every force and torque remains possible.

    A dead thruster never opens, a stuck one is always open. After a fault that is not recoverable, no
    controller can hold a pose; it can only let the craft drift safely.
    """

    group = "Limits"
    guide = "docs/assurance/faults.md"
    examples = ("rans faults floating-platform --picture faults.svg",)

    picture: Annotated[Path | None, arg(metavar="FILE")] = None
    """Save a figure to this file (.png, .svg or .pdf)."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return ("rans list CONDITIONS",)

    def run(self) -> int:
        """Print the faults that the craft can recover from, and write the picture; the exit code is 0."""
        if self.picture is not None:
            from rans.show.figures.picture_file import check_picture

            check_picture(self.picture)
        result = faults(self.spacecraft)
        craft = result.spacecraft
        Terminal().table(
            Table(
                FAULT_COLUMNS,
                result.rows(),
                f"{craft.name}: recoverable faults",
                "Margin: distance of the others from always shut and always open while they balance the craft.",
            )
        )
        if self.picture is not None:
            from rans.show.figures.picture_file import save_picture
            from rans_assurance.figures.faults_figure import faults_figure

            save_picture(faults_figure(craft, result.sets), self.picture)
            Terminal().say(f"Picture: {self.picture}")
        # The conditions "faults" draw recoverable sets of one and of two thrusters, dead or stuck open.
        written = all(
            any(fault_set.recoverable for fault_set in sets) for sets in result.sets.values()
        )
        if written and craft.thruster_count > 2:
            Terminal().suggest(*training(craft, self.spacecraft, "--conditions", "faults"))
        return 0
