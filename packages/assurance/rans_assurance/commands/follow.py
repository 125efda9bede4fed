"""``rans follow``: an agent that tracks velocities along a path."""

from __future__ import annotations

import shlex

from rans.extend import (
    EVALUATION_SEED,
    Options,
    Terminal,
    check_count,
    command_of,
    ready_folder,
    word,
    write_json,
)
from rans_assurance.functions import follow


@command_of(
    follow,
    without=("speed", "look_ahead", "seed", "engine"),
    agent=word("RUN"),
    path=word("[PATH]", str),
)
class Follow(Options):
    """Fly an agent that tracks velocities along a path, with the paper's look-ahead planner.

    Writes follow-PATH.json into the run folder, or for other contestants into
    runs/evaluations/. The speed along the path is 0.25 m/s.
    """

    group = "Judge"
    guide = "docs/agents.md"
    divides_work = True
    examples = ("rans follow pretrained:track-velocity-2d lemniscate",)

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return (shlex.join(["rans", "view", self.agent]),)

    def run(self) -> int:
        """Print a table of the path errors, and write JSON into the agent's folder.

        The exit code is 0.
        """
        from rans.extend import ContestantName, contestant
        from rans_assurance.follow.paths import LookAhead, find_path

        check_count("--episodes", self.episodes)
        planner = LookAhead(find_path(self.path))
        contestant(self.agent)  # reject a wrong name before a folder is created
        file = ready_folder(ContestantName.parse(self.agent).output_folder)
        file = file / f"follow-{planner.path.name}.json"
        following = follow(self.agent, self.path, episodes=self.episodes, seed=EVALUATION_SEED)
        Terminal().table(following.table())
        write_json(file, following.to_json() | {"seed": EVALUATION_SEED})
        Terminal().say(f"Written to {file}.")
        return 0
