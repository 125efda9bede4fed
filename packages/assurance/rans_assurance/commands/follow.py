"""``rans follow``: an agent that tracks velocities along a path."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from typing import Annotated

from tyro.conf import Positional, arg

from rans.extend import EVALUATION_SEED, Terminal, check_count, ready_folder, write_json, write_text


@dataclass(frozen=True)
class Follow:
    """Fly an agent that tracks velocities along a path, with the paper's look-ahead planner.

    Writes follow-PATH.json and the figure follow-PATH.svg into the run folder, or for other contestants into
    runs/evaluations/.
    """

    group = "Judge"
    guide = "docs/agents.md"
    divides_work = True
    examples = ("rans follow pretrained:track-velocity-2d lemniscate",)

    contestant: Annotated[str, Positional, arg(metavar="RUN")]
    """Run folder of an agent for track-velocity, pretrained:NAME, or CONTROLLER:track-velocity-2d or -3d,
    with @SPACECRAFT if you like."""
    course: Annotated[str, Positional, arg(metavar="[PATH]")] = "circle"
    """Path: circle, spiral, square, lemniscate, helix (in space), or a CSV file of points x,y[,z] in m. The speed
    along it is 0.25 m/s."""
    episodes: int = 16
    """Number of flights; each starts at rest near the first point of the path, with another attitude."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return (shlex.join(["rans", "view", self.contestant]),)

    def run(self) -> int:
        """Print a table of the path errors."""
        from rans.extend import ContestantName, contestant
        from rans.show.figures.svg import svg
        from rans_assurance.figures.path_figures import following_figure
        from rans_assurance.follow.paths import LookAhead, find_path
        from rans_assurance.functions import follow

        check_count("--episodes", self.episodes)
        planner = LookAhead(find_path(self.course))
        contestant(self.contestant)  # reject a wrong name before a folder is created
        file = ready_folder(ContestantName.parse(self.contestant).output_folder)
        file = file / f"follow-{planner.path.label}.json"
        following = follow(
            self.contestant, self.course, flights=self.episodes, seed=EVALUATION_SEED
        )
        Terminal().table(following.table())
        write_json(file, following.to_json() | {"seed": EVALUATION_SEED})
        write_text(file.with_suffix(".svg"), svg(following_figure(following)))
        Terminal().say(f"Written to {file}.")
        return 0
