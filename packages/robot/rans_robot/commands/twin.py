"""``rans twin``: a simulated robot for tests of `rans fly`."""

from __future__ import annotations

from typing import Annotated

from tyro.conf import arg

from rans import load_spacecraft
from rans.extend import POSE, Options, Terminal, command_of, word
from rans_robot.functions import twin


@command_of(
    twin,
    spacecraft=word("CRAFT"),
    bus=Annotated[str, arg(metavar="BUS[:ADDRESS]")],
    start=Annotated[tuple[str, ...], arg(metavar=POSE)],
)
class Twin(Options):
    """Simulate a robot for `rans fly`, which publishes its state on a bus and takes commands.

    Its valves shut two and a half control periods after the last command.
    """

    group = "Deploy"
    guide = "docs/robot/robots.md"
    examples = ("rans twin floating-platform",)
    following = ("rans list AGENTS",)

    def run(self) -> int:
        """Simulate until the time is up or an interrupt, and print where it ended; the exit code is 0."""
        motion = self.call()
        where = ", ".join(
            f"{x:.3f}" for x in motion.position[: load_spacecraft(self.spacecraft).dimension]
        )
        speed = float((motion.velocity**2).sum()) ** 0.5
        Terminal().say(f"Ended at ({where}) m, at {speed:.3f} m/s.")
        return 0
