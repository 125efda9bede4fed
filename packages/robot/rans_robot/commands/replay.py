"""``rans replay``: repeat the commands of a recorded flight."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg


@dataclass(frozen=True)
class Replay:
    """Give the messages of a `rans fly` bag to its agent again, and compare every command bit for bit.

    This runs the agent.py next to the bag, which may come from someone else: --trust allows it.
    """

    group = "Deploy"
    guide = "docs/robot/robots.md"
    examples = ("rans replay runs/flights/first/flight.mcap --trust",)

    bag: Annotated[Path, Positional, arg(metavar="BAG")]
    """MCAP file that `rans fly` wrote."""
    folder: Annotated[Path | None, Positional, arg(metavar="[AGENT]")] = None
    """Folder of the exported agent; by default the one that flew."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return (shlex.join(["rans", "identify", str(self.bag), "--spacecraft", "SPACECRAFT"]),)

    def run(self) -> int:
        """Print the number of equal commands; the exit code is 0 if all are equal."""
        from rans.extend import Terminal
        from rans_robot.node import replay_bag

        result = replay_bag(self.bag, self.folder)
        Terminal().say(f"{result.equal} of {result.decisions} commands come out the same.")
        if result.first_difference is not None:
            Terminal().say(f"The first that does not is command {result.first_difference}.")
        return 0 if result.equal == result.decisions else 1
