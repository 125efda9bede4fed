"""``rans fly``: an agent in closed loop with a robot."""

from __future__ import annotations

from typing import Annotated

from tyro.conf import arg

from rans.extend import POSE, Options, Terminal, command_of, word
from rans_robot.functions import fly_on_robot


@command_of(
    fly_on_robot,
    agent=word("AGENT"),
    bus=Annotated[str, arg(metavar="BUS[:ADDRESS]")],
    goal=Annotated[tuple[str, ...], arg(metavar=POSE)],
    zones=Annotated[tuple[str, ...], arg(metavar="X,Y,R...")],
)
class Fly(Options):
    """Fly an agent on a robot over ROS 2, PX4 or Zenoh, and record the flight as an MCAP bag.

    The agent acts at its control rate. Any fault shuts all valves and is reported: a stale or missing state,
    another control rate or spacecraft, a lost robot. `rans twin` simulates a robot to test with.
    docs/robot/robots.md has a checklist for the first flight.
    """

    group = "Deploy"
    guide = "docs/robot/robots.md"
    examples = ("rans fly pretrained:go-to-pose-2d --goal 1 0 90deg",)
    following = ("rans evaluate {agent}",)

    def run(self) -> int:
        """Fly; the exit code is 0, or 1 after a fault or if no state ever came."""
        report = self.call()
        if not report.fault:
            Terminal().suggest(*report.next_commands)
        return 1 if report.fault else 0
