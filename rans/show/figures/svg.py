"""Matplotlib's figures as SVG that suits light and dark pages."""

from __future__ import annotations

import base64
import io

from rans.show.figures.panels import STYLE
from rans.show.figures.plotting import Figure, rc_context
from rans.show.palette import BLUE, GREY, INK, LINES

_BODY = "#dce6f0"
"""Fill of a craft in `rans.show.figures.layout_figure.draw_layout`."""
_DARK = {INK: "#e4e7eb", LINES: "#3a4552", GREY: "#a3afbd", BLUE: "#2a8fd6", _BODY: "#33475b"}
"""Inks, and what they are where readers like dark pages."""
_GROUND = ":root{color-scheme:light dark}"


def svg(figure: Figure) -> str:
    """The figure as the text of an SVG file: without a ground, with inks that follow the reader's choice.

    Opened by itself its ground follows too.
    """
    buffer = io.StringIO()
    with rc_context(STYLE):
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
