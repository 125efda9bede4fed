"""Overlay of a page in three dimensions: title, time, names, errors and the legend of colours."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib import resources
from typing import Any

from pydrake.geometry import Rgba

from rans.flight import Flight
from rans.show import markup
from rans.show.scene.scene import BODIES, SceneMotion
from rans.tasks.quantities import QUANTITIES

_ENDS = "</body>"


def html(
    flights: Sequence[Flight],
    rows: Sequence[Sequence[SceneMotion]],
    paths: Sequence[str],
    colours: Sequence[str],
    title: str,
    aspect: float,
) -> str:
    """The part of the page that says all this, with the data that its script reads.

    Args:
        flights: one an agent.
        rows: of each, its episodes.
        paths: where each of these stands in Meshcat's tree, row by row.
        colours: of each agent, keys of `BODIES`.
        title: of the page; by default who flies.
        aspect: width over height for which the camera was placed.
    """
    remaining = iter(paths)
    agents = [
        {
            "name": flight.controller,
            "colour": css(BODIES[colour]),
            "errors": [
                [name, QUANTITIES[name].display[1], QUANTITIES[name].display[0] * bound]
                for name, bound in flight.task.tolerances().items()
            ],
            "flights": [{"path": next(remaining), **_series(motion)} for motion in row],
        }
        for flight, row, colour in zip(flights, rows, colours, strict=True)
    ]
    bounded = frozenset[str]().union(*(motion.wanted for row in rows for motion in row))
    planar, space = ({flight.craft.dimension for flight in flights} >= {axes} for axes in (2, 3))
    data = {
        "title": title or " and ".join(dict.fromkeys(flight.controller for flight in flights)),
        "agents": agents,
        "legend": [
            [css_class, text]
            for css_class, text, visible in (
                ("goal", "goal", bool(bounded & {"position", "attitude"})),
                ("goal", "velocity to fly", "velocity" in bounded),
                ("way", "velocity flown, way of 2 s", "velocity" in bounded),
                ("plume", "open thruster, as long as its command", True),
                ("way", "way flown", True),
                ("x", "x axis" if space else "x axis, the heading", True),
                ("y", "y axis", space),
                ("z", "z axis", space),
                ("grid", "lines 1 m apart", planar),
            )
            if visible
        ],
        "aspect": aspect,
        "dark": not planar,
    }
    template = resources.files("rans.show.scene").joinpath("overlay.html").read_text("utf-8")
    return template.replace("{{ data }}", markup.data(data))


def laid_over(page: str, overlay: str) -> str:
    """Meshcat's page with this on top, and the title that it begins with."""
    head, _, tail = page.rpartition(_ENDS)
    title = overlay.partition('"title":')[2]
    name = json.JSONDecoder().raw_decode(title)[0] if title else "RANS"
    return (
        head.replace("<title>Drake MeshCat</title>", f"<title>{markup.text(name)}</title>", 1)
        + overlay
        + _ENDS
        + tail
    )


def css(colour: Rgba) -> str:
    """A colour for style sheets."""
    return f"rgb({', '.join(str(round(255.0 * x)) for x in (colour.r(), colour.g(), colour.b()))})"


def _series(motion: SceneMotion) -> dict[str, Any]:
    return {
        "radius": motion.craft.radius,
        "times": [round(float(t), 4) for t in motion.times],
        "errors": [
            [float(f"{QUANTITIES[name].display[0] * x:.3g}") for x in error]
            for name, error in motion.errors.items()
        ],
    }
