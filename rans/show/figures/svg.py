"""Matplotlib's figures as SVG that suits light and dark pages, and telephones: a picture for each panel."""

from __future__ import annotations

import base64
import io
import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator

from rans.errors import ConfigError, brief
from rans.show.figures.panels import STYLE
from rans.show.figures.plotting import Axes, Bbox, Figure, SubFigure, rc_context
from rans.show.palette import BLUE, GREY, INK, LINES

_SVG = "http://www.w3.org/2000/svg"
_LINK = "http://www.w3.org/1999/xlink"
_BODY = "#dce6f0"
"""Fill of a craft in `rans.show.figures.layout_figure.draw_layout`."""
_DARK = {INK: "#e4e7eb", LINES: "#3a4552", GREY: "#a3afbd", BLUE: "#2a8fd6", _BODY: "#33475b"}
"""Inks, and what they are where readers like dark pages."""
_GROUND = ":root{color-scheme:light dark}"
_DECLARES = re.compile(r"<!DOCTYPE[^>]*\[")
"""A document type with declarations: entities, which may grow without bounds, and attributes."""
_MOST_PANELS = 64
"""Of a picture: they may lie within each other, so that each of them repeats others."""
_PANEL = re.compile(r"panel((?: -?[\d.]+){4})")


def svg(figure: Figure) -> str:
    """The figure as the text of an SVG file: without a ground, with inks that follow the reader's choice.

    Opened by itself its ground follows too.
    """
    buffer = io.StringIO()
    with rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", "Creating legend with loc"
        )  # only says that this machine is busy
        _mark_panels(figure)
        figure.savefig(buffer, format="svg", metadata={"Date": None}, transparent=True)
    rules = "".join(
        f'[style*="{what}: {ink.lower()}"]{{{what}:{dark}!important}}'
        for ink, dark in _DARK.items()
        for what in ("fill", "stroke")
    )
    return buffer.getvalue().replace(
        "</style>", f"{_GROUND}@media screen and (prefers-color-scheme: dark){{{rules}}}</style>", 1
    )


def data_uri(picture: str | bytes) -> str:
    """A picture, text of an SVG file or bytes of a PNG file, as the source of an HTML ``img``."""
    kind, data = ("svg+xml", picture.encode()) if isinstance(picture, str) else ("png", picture)
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def _name_spaces() -> None:
    """Let elements be written as they are usually read, without made-up prefixes."""
    ET.register_namespace("", _SVG)
    ET.register_namespace("xlink", _LINK)


def panels(picture: str) -> list[str]:
    """The text of an SVG file by `svg` as one for each panel, in order; others, or one panel, as they are.

    It may be a stranger's: pages have it as an ``img``, whose scripts no browser runs and whose links none follows.

    Raises:
        ConfigError: it is no SVG.
    """
    _name_spaces()
    try:
        if _DECLARES.search(picture):
            raise ValueError("it declares entities or attributes")
        root = ET.fromstring(picture)
        if root.tag != f"{{{_SVG}}}svg":
            raise ValueError(f"it begins with the element {brief(root.tag)}")
    except (ET.ParseError, RecursionError, ValueError) as error:
        raise ConfigError(f"it is no SVG: {error}.") from error
    marked = [(group, _PANEL.fullmatch(group.get("id", ""))) for group in root.iter(f"{{{_SVG}}}g")]
    results = [(group, match[1].split()) for group, match in marked if match]
    if not 2 <= len(results) <= _MOST_PANELS:
        return [picture]
    shared = {
        element.get("id", ""): element
        for group in root.iter(f"{{{_SVG}}}defs")
        for element in group
    }
    style = root.find(f".//{{{_SVG}}}style")
    return [_document(group, box, shared, style) for group, box in results]


def _mark_panels(figure: Figure) -> None:
    """Give every panel, parts of the figure or else axes, its place in points as the name of its group."""
    figure.set_dpi(72.0)
    figure.draw_without_rendering()
    figure.set_layout_engine(
        "none"
    )  # done: laid out again, the panels would be elsewhere, and it takes long
    width, height = 72.0 * figure.get_size_inches()
    for part in figure.subfigs or figure.axes:
        inner = [axes for axes in _inside(part) if _drawn(axes)]
        if inner:
            box = Bbox.union([*map(_extent, inner)]).transformed(figure.transFigure.inverted())
            x0 = width * box.x0 - 4.0
            y0 = height * (1.0 - box.y1) - 4.0
            x1 = width * box.x1 + 4.0
            y1 = height * (1.0 - box.y0) + 4.0
            part.set_gid(f"panel {x0:.1f} {y0:.1f} {x1 - x0:.1f} {y1 - y0:.1f}")


def _inside(part: SubFigure | Axes) -> list[Axes]:
    if isinstance(part, Axes):
        return [part]
    return [*part.axes, *(axes for subfigure in part.subfigs for axes in _inside(subfigure))]


def _drawn(axes: Axes) -> bool:
    return axes.axison or axes.get_legend() is not None


def _extent(axes: Axes) -> Bbox:
    """Extent of all artists, or of a legend without axes, in pixels."""
    artist = axes if axes.axison else axes.get_legend()
    return (artist and artist.get_tightbbox()) or axes.bbox


def _document(
    group: ET.Element, box: list[str], shared: dict[str, ET.Element], style: ET.Element | None
) -> str:
    """A file of one group, with the definitions, styles and gradients that it refers to."""
    sizes = {"viewBox": " ".join(box), "width": f"{box[2]}pt", "height": f"{box[3]}pt"}
    root = ET.Element(f"{{{_SVG}}}svg", sizes)
    if style is not None:
        root.append(style)
    own = {element.get("id") for element in group.iter()}
    ET.SubElement(root, f"{{{_SVG}}}defs").extend(
        shared[name]
        for name in dict.fromkeys(_references(group))
        if name in shared and name not in own
    )
    root.append(group)
    return ET.tostring(root, "unicode")


def _references(group: ET.Element) -> Iterator[str]:
    for element in group.iter():
        for value in element.attrib.values():
            yield from re.findall(r"#([\w-]+)", value)
