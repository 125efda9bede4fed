"""Replays of flights in the browser: Drake's shaded scene where Drake is installed, else a drawing of our own."""

from __future__ import annotations

from collections.abc import Sequence

from rans.errors import is_installed
from rans.flight import Flight


def replay_html(flights: Sequence[Flight], title: str) -> tuple[str, list[str]]:
    """The text of a page that replays flights, complete and offline; and the names of their colours, if any."""
    if is_installed("pydrake"):
        from rans.show.scene.view import View

        view = View()
        colours = view.show(flights, title)
        return view.html(), colours
    from rans.show.pages.replay import replay_page

    return replay_page(flights, title).html(), []
