"""``rans replay``: repeat the commands of a recorded flight."""

from __future__ import annotations

import shlex
from pathlib import Path

from rans.extend import Options, command_of, word
from rans_robot.functions import replay


@command_of(replay, bag=word("BAG", Path), folder=word("[AGENT]", Path | None))
class Replay(Options):
    """Give the messages of a `rans fly` bag to its agent again, and compare every command bit for bit.

    An agent of RANS is the agent.py next to the bag, code that may come from someone else: --trust runs it.
    """

    group = "Deploy"
    guide = "docs/robot/robots.md"
    examples = ("rans replay runs/flights/first/flight.mcap --trust",)
    following = ("rans list AGENTS",)

    def run(self) -> int:
        """Print the number of equal commands; the exit code is 0 if all are equal."""
        from rans.extend import Terminal

        result = replay(self.bag, self.folder)
        Terminal().say(f"{result.equal} of {result.decisions} commands come out the same.")
        if result.first_difference is not None:
            Terminal().say(f"The first that does not is command {result.first_difference}.")
            return 1
        spacecraft = str(Path(result.folder) / "spacecraft.toml")
        Terminal().suggest(
            shlex.join(["rans", "identify", str(self.bag), "--spacecraft", spacecraft])
        )
        return 0
