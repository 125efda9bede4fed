"""The first screen of a result as a file: what `rans report` shows of a comparison or an evaluation.

A comparison's flights are in no file of results. The sentence, tiles, replay, charts and pictures of its page are,
as plain values, so that the report of the folder begins with them. The folder may be a stranger's: whatever is
read is checked and made anew, and pictures are only shown as images, in which no script runs.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rans.files import number
from rans.show.pages.chart import Chart, Mark, Series
from rans.show.pages.page import Page, Picture, Tile
from rans.show.pages.race import Race

_COLOUR = re.compile(r"#[0-9a-fA-F]{6}|var\(--[a-z]+\)")
_IMAGE = "data:image/svg+xml"
_PICTURES = 2
"""Pictures of a page that the report shows too: of the mission or the paths, and of the spacecraft."""


@dataclass(frozen=True)
class Screen:
    """Answers to how good, against what and how sure."""

    hero: str = ""
    """The result in a sentence."""
    tiles: Sequence[Tile] = ()
    race: Race | None = None
    charts: Sequence[Chart] = ()
    pictures: Sequence[Picture] = ()

    @classmethod
    def of(cls, page: Page) -> Screen:
        """The parts of a page that answer first: sentence, tiles, first replay, charts, two pictures at most."""
        races = [section.race for section in page.sections if section.race is not None]
        charts = [chart for section in page.sections for chart in section.charts]
        pictures = [
            picture
            for section in page.sections
            if section.title in ("Mission", "Paths", "Spacecraft")
            for picture in section.pictures[:1]
        ]
        chosen = [*pictures[:1], *pictures[-1:]] if len(pictures) > _PICTURES else pictures
        return cls(page.hero, page.tiles, next(iter(races), None), charts, chosen)

    def to_json(self) -> dict[str, Any]:
        """Plain values for a JSON file, which `_chart` and its like read back and check."""
        return {
            "hero": self.hero,
            "tiles": [asdict(tile) for tile in self.tiles],
            "race": None
            if self.race is None
            else {"data": self.race.data, "caption": self.race.caption},
            "charts": [
                asdict(chart)
                | {"series": [asdict(s) | {"marks": [*map(list, s.marks)]} for s in chart.series]}
                for chart in self.charts
            ],
            "pictures": [asdict(picture) for picture in self.pictures],
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Screen:
        """What `to_json` wrote.

        Raises:
            LookupError, TypeError, ValueError: it did not write this.
        """
        race = content["race"]
        return cls(
            str(content["hero"]),
            [Tile(str(t["label"]), str(t["value"]), str(t["note"])) for t in content["tiles"]],
            race and Race(_race(race["data"]), str(race["caption"])),
            [*map(_chart, content["charts"])],
            [*map(_picture, content["pictures"])],
        )


def _chart(content: Mapping[str, Any]) -> Chart:
    """A chart of a stranger's JSON file, whose values become numbers and texts or are refused."""
    low_high = content["y_range"]
    return Chart(
        str(content["x_label"]),
        str(content["y_label"]),
        [*map(_series, content["series"])],
        str(content["caption"]),
        [(number(low), number(high), str(text)) for low, high, text in content["shaded"]],
        bool(content["logarithmic"]),
        low_high and _pair(low_high),
    )


def _series(content: Mapping[str, Any]) -> Series:
    """A series of a chart of the JSON file, whose values are checked."""
    marks = [
        Mark(number(x), number(y), str(text), along and _pair(along), across and _pair(across))
        for x, y, text, along, across in content["marks"]
    ]
    colour = _colour(content["colour"])
    return Series(str(content["name"]), marks, colour, str(content["marker"]), str(content["line"]))


def _pair(values: Any) -> tuple[float, float]:
    low, high = values
    return number(low), number(high)


def _colour(text: Any) -> str:
    if not _COLOUR.fullmatch(text):
        raise ValueError(f"{text!r} is no colour")
    return text


def _picture(content: Mapping[str, Any]) -> Picture:
    sources = [str(source) for source in content["sources"]]
    if not all(source.startswith(_IMAGE) for source in sources):
        raise ValueError("a picture is not an image inside the page")
    return Picture(sources, str(content["caption"]))


def _race(content: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a replay, as `rans.show.pages.race.race` makes them."""
    return {
        "planar": bool(content["planar"]),
        "radius": float(content["radius"]),
        "plays": bool(content.get("plays")),
        "thrusters": [
            {name: [*map(float, thruster[name])] for name in ("at", "along")}
            for thruster in content["thrusters"]
        ],
        "starts": [_start(start) for start in content["starts"]],
    }


def _start(content: Mapping[str, Any]) -> dict[str, Any]:
    """Tracks of one start as the page draws them, of a JSON file whose values are checked."""
    tracks = [
        {
            "name": str(track["name"]),
            "colour": _colour(track["colour"]),
            "arrival": None if track["arrival"] is None else float(track["arrival"]),
            "u": [str(text) for text in track["u"]],
            **_rows(track),
        }
        for track in content["tracks"]
    ]
    return {
        "label": str(content["label"]),
        "period": float(content["period"]),
        "goal": _rows(content["goal"]),
        "turned": bool(content["turned"]),
        # Files of former versions have none of these.
        "follows": bool(content.get("follows")),
        "shapes": [
            {"kind": str(shape["kind"]), "rows": [[*map(float, row)] for row in shape["rows"]]}
            for shape in content.get("shapes", ())
        ],
        "markers": [[*map(float, row)] for row in content.get("markers", ())],
        "tracks": tracks,
    }


def _rows(content: Mapping[str, Any]) -> dict[str, list[list[float]]]:
    names = ("p", "e", "v") if "v" in content else ("p", "e")
    return {name: [[*map(float, row)] for row in content[name]] for name in names}
