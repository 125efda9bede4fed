"""Pictures of the pages: ``python -m campaigns.pictures [NAME ...]``.

Those of missions are of flights from held-out starts by guidance or by the agent that comes with RANS, and are
written to docs/pictures/missions/MISSION.svg. Those of `campaigns.schemes` and `campaigns.charts` go into
docs/pictures/diagrams, and thrusters of real craft into docs/pictures/craft. Pictures that no new measurement
changes were drawn once: their code is in git, in af4f7ac0:campaigns/diagrams.py and af4f7ac0:campaigns/charts.py.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import tyro

from campaigns.charts import CHARTS
from campaigns.craft import CRAFTS
from campaigns.flight_paths import paths_figure
from campaigns.schemes import SCHEMES
from rans.errors import ConfigError
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.files import write_text
from rans.flight import Flight
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import EVALUATION_SEED
from rans.show.figures.layout_figure import draw_layout
from rans.show.figures.plotting import Figure, rc_context
from rans.show.figures.svg import svg


class _Subject(NamedTuple):
    """Who flies a mission, and how often."""

    who: str
    episodes: int


DRAWN = {**SCHEMES, **CHARTS}
"""Functions of all figures but those of missions."""
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


_FONTS = "Verdana, 'DejaVu Sans', sans-serif"
"""Verdana is as wide as DejaVu Sans, which few systems but Linux have."""


_LONG = 60
"""Words of a path from which it is a curve of a flight."""


def flown(subject: _Subject) -> Flight:
    """Flights of a subject from the first held-out starts."""
    run = contestant(subject.who)
    return fly_episodes(run.controller, run.judged, EVALUATION_SEED, subject.episodes)


def picture(figure: Figure) -> str:
    """The text of an SVG file in a quarter of Matplotlib's bytes: the repository keeps every version.

    Text stays text, in fonts as wide as those that Matplotlib measured; a tenth of a point is a seventh of a
    millimetre on a screen.
    """
    with rc_context({"svg.fonttype": "none"}):
        text = svg(figure)
    text = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"'DejaVu Sans', 'Bitstream Vera Sans'[^;\"]*", _FONTS, text)
    text = re.sub(r'(?<= d=")[^"]*', lambda path: _rounded(path[0]), text)
    return re.sub(r"\s*\n\s*", "\n", text)


def _rounded(path: str) -> str:
    """A path with one digit after the point; a long line without points within a point of the one before."""
    numbers = re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.1f}", path)
    words = numbers.replace(".0 ", " ").replace("-0 ", "0 ").split()
    if len(words) < _LONG or set(re.findall("[A-Za-z]", path)) != {"M", "L"}:
        return " ".join(words)
    points = [tuple(words[k : k + 3]) for k in range(0, len(words), 3)]
    kept = points[:1]
    for point in points[1:-1]:
        way = [float(x) - float(y) for x, y in zip(point[1:], kept[-1][1:], strict=True)]
        if point[0] == "M" or abs(way[0]) + abs(way[1]) > 1.0:
            kept.append(point)
    return " ".join(" ".join(point) for point in (*kept, points[-1]))


@dataclass(frozen=True)
class Pictures:
    """Write pictures of pages."""

    names: Annotated[tuple[str, ...], tyro.conf.Positional] = (*SUBJECTS, *DRAWN, *CRAFTS)
    """Missions, diagrams and craft; by default all."""
    folder: Path = Path("docs/pictures")
    """Folder of the pictures."""

    def run(self) -> None:
        """Fly and draw.

        Raises:
            ConfigError: there is no such picture.
        """
        for name in self.names:
            if name in CRAFTS:
                file = self.folder / "craft" / f"{name}.svg"
                figure = draw_layout(load_spacecraft(name))
            elif name in DRAWN:
                file = self.folder / "diagrams" / f"{name}.svg"
                figure = DRAWN[name]()
            elif name in SUBJECTS:
                file = self.folder / "missions" / f"{name}.svg"
                figure = paths_figure(flown(SUBJECTS[name]))
            else:
                known = ", ".join((*SUBJECTS, *DRAWN, *CRAFTS))
                raise ConfigError(f"there is no picture {name!r}; known are {known}.")
            file.parent.mkdir(parents=True, exist_ok=True)
            write_text(file, picture(figure))


if __name__ == "__main__":
    tyro.cli(Pictures).run()
