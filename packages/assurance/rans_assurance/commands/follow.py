"""``rans follow``: an agent that tracks velocities around a circle."""

from __future__ import annotations

from rans.extend import (
    EVALUATION_SEED,
    Options,
    Terminal,
    command_of,
    inside,
    ready_folder,
    word,
    write_json,
)
from rans_assurance.functions import follow


@command_of(
    follow,
    without=("seed",),
    agent=word("RUN"),
)
class Follow(Options):
    """Fly an agent that tracks velocities around a circle of 1.5 m, with the paper's look-ahead planner.

    Writes evaluation-circle.json, which a report has too, into the run folder, or for other contestants into
    runs/evaluations/. The speed along the circle is 0.25 m/s.
    """

    group = "Judge"
    guide = "docs/agents.md"
    divides_work = True
    examples = ("rans follow pretrained:track-velocity-2d",)
    following = ("rans view {agent}",)

    def run(self) -> int:
        """Print a table of the tracking errors, and write JSON into the agent's folder.

        The exit code is 0.
        """
        from rans.extend import ContestantName, contestant

        contestant(self.agent)  # reject a wrong name before a folder is created
        folder = ready_folder(ContestantName.parse(self.agent).output_folder)
        file = inside(folder, "evaluation-circle.json")
        found = follow(self.agent, episodes=self.episodes, seed=EVALUATION_SEED)
        about = {"command": self.command_line(), "seed": EVALUATION_SEED}
        write_json(file, {found.engine: found.to_json()} | about, beside=())
        console = Terminal()
        console.table(found.table(console.width))
        console.say(f"Written to {file}.")
        return 0
