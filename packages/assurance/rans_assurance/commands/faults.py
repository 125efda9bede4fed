"""``rans faults``: the thruster faults that a spacecraft can recover from."""

from __future__ import annotations

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
    examples = ("rans faults floating-platform",)
    following = ("rans list CONDITIONS",)

    def run(self) -> int:
        """Print the faults that the craft can recover from; the exit code is 0."""
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
        # The conditions "faults" draw recoverable sets of one and of two thrusters, dead or stuck open.
        written = all(
            any(fault_set.recoverable for fault_set in sets) for sets in result.sets.values()
        )
        if written and craft.thruster_count > 2:
            Terminal().suggest(*training(craft, self.spacecraft, "--conditions", "faults"))
        return 0
