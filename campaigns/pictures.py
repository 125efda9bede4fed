"""Pictures of the pages: ``python -m campaigns.pictures [NAME ...]``.

Those of missions are of flights from held-out starts by guidance or by the agent that comes with RANS, and are
written to docs/pictures/missions/MISSION.svg. Those of `campaigns.diagrams` go into
docs/pictures/diagrams.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import tyro

from campaigns.diagrams import DIAGRAMS
from rans.errors import ConfigError
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.files import write_text
from rans.flight import Flight
from rans.scenario import EVALUATION_SEED
from rans.show.figures.flight_paths import paths_figure
from rans.show.figures.svg import svg


class _Subject(NamedTuple):
    """Who flies a mission, and how often."""

    who: str
    episodes: int


SUBJECTS = {
    "avoid": _Subject("pretrained:avoid-2d", 3),
    "dock": _Subject("mission:dock-3d", 6),
    "dock-port": _Subject("pretrained:dock-port-2d", 3),
    "hold": _Subject("mission:hold-3d", 6),
    "inspect": _Subject("circumnavigation:inspect-3d", 3),
    "land": _Subject("pretrained:land-3d", 8),
    "rendezvous": _Subject("mission:rendezvous-3d", 6),
}
"""Few enough flights that each path can be followed."""


def flown(subject: _Subject) -> Flight:
    """Flights of a subject from the first held-out starts."""
    run = contestant(subject.who)
    return fly_episodes(run.controller, run.judged, EVALUATION_SEED, subject.episodes).flight


@dataclass(frozen=True)
class Pictures:
    """Write pictures of pages."""

    names: Annotated[tuple[str, ...], tyro.conf.Positional] = (*SUBJECTS, *DIAGRAMS)
    """Missions and diagrams; by default all."""
    folder: Path = Path("docs/pictures")
    """Folder of the pictures."""

    def run(self) -> None:
        """Fly and draw.

        Raises:
            ConfigError: there is no such picture.
        """
        for name in self.names:
            if name in DIAGRAMS:
                file = self.folder / "diagrams" / f"{name}.svg"
                figure = DIAGRAMS[name]()
            elif name in SUBJECTS:
                file = self.folder / "missions" / f"{name}.svg"
                figure = paths_figure(flown(SUBJECTS[name]))
            else:
                known = ", ".join((*SUBJECTS, *DIAGRAMS))
                raise ConfigError(f"there is no picture {name!r}; known are {known}.")
            file.parent.mkdir(parents=True, exist_ok=True)
            write_text(file, svg(figure))


if __name__ == "__main__":
    tyro.cli(Pictures).run()
