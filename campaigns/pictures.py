"""Pictures of the pages: ``python -m campaigns.pictures [NAME ...]``.

Those of `campaigns.charts` go into docs/pictures/diagrams, and thrusters of real craft into docs/pictures/craft.
Pictures that no new measurement changes were drawn once: their code is in git, in 9f8c3a10:campaigns/schemes.py and
9f8c3a10:campaigns/flight_paths.py, in af4f7ac0:campaigns/diagrams.py and af4f7ac0:campaigns/charts.py.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from campaigns.charts import CHARTS
from campaigns.craft import CRAFTS
from rans.base.errors import ConfigError
from rans.base.files import write_text
from rans.model.spacecraft_file import load_spacecraft
from rans.show.figures.layout_figure import draw_layout
from rans.show.figures.plotting import Figure, rc_context
from rans.show.figures.svg import svg

_FONTS = "Verdana, 'DejaVu Sans', sans-serif"
"""Verdana is as wide as DejaVu Sans, which few systems but Linux have."""


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
    """A path with one digit after the point."""
    numbers = re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.1f}", path)
    return " ".join(numbers.replace(".0 ", " ").replace("-0 ", "0 ").split())


@dataclass(frozen=True)
class Pictures:
    """Write pictures of pages."""

    names: Annotated[tuple[str, ...], tyro.conf.Positional] = (*CHARTS, *CRAFTS)
    """Charts and craft; by default all."""
    folder: Path = Path("docs/pictures")
    """Folder of the pictures."""

    def run(self) -> None:
        """Draw.

        Raises:
            ConfigError: there is no such picture.
        """
        for name in self.names:
            if name in CRAFTS:
                file = self.folder / "craft" / f"{name}.svg"
                figure = draw_layout(load_spacecraft(name))
            elif name in CHARTS:
                file = self.folder / "diagrams" / f"{name}.svg"
                figure = CHARTS[name]()
            else:
                known = ", ".join((*CHARTS, *CRAFTS))
                raise ConfigError(f"there is no picture {name!r}; known are {known}.")
            file.parent.mkdir(parents=True, exist_ok=True)
            write_text(file, picture(figure))


if __name__ == "__main__":
    tyro.cli(Pictures).run()
