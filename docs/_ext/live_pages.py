"""Live pages: agents and guidance that fly in the browser, in files of their own and on pages of missions.

They are written into docs/_extra/play before a build. The page of a mission has its frame below its first picture;
readers of the repository see the picture alone.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

import rans

FLOWN = (
    "go-to-pose-2d",
    "go-to-pose-2d-robust",
    "any-craft-2d@pingu",
    "any-craft-2d",
    "track-velocity-2d",
    "any-craft-3d@cubesat-3u",
    "go-to-pose-3d",
    "dock-port-3d",
)
"""Agents that fly in pages of docs/fly.md only."""
MISSIONS = {
    "missions/avoid": "avoid-2d",
    "missions/dock": "mission:dock-3d",
    "missions/dock-port": "dock-port-2d",
    "missions/hold": "mission:hold-3d",
    "missions/inspect": "inspect-3d",
    "missions/land": "land-3d",
    "missions/rendezvous": "mission:rendezvous-3d",
}
"""Who flies in the frame on the page of each mission."""
_FRAME = """
```{{raw}} html
<iframe class="play part" src="{up}play/{file}?part" title="{who} flies" loading="lazy"></iframe>
<p><a href="{up}play/{file}">{who} flies</a> in this frame: click a thruster to make it fail. As a page of its own
it has all controls.</p>
```
"""


def file_name(who: str) -> str:
    """Name of a live page."""
    return f"{who.replace(':', '-').replace('@', '-')}.html"


def _write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / "_extra" / "play"
    folder.mkdir(parents=True, exist_ok=True)
    for who in (*FLOWN, *MISSIONS.values()):
        rans.load_agent(who).playground(folder / file_name(who))


def _framed(app: Sphinx, docname: str, content: list[str]) -> None:
    """Add the frame below the first picture of a mission's page."""
    who = MISSIONS.get(docname)
    if who is None:
        return
    first = re.search(r"^!\[[^\]]*\]\([^)]*\)$", content[0], re.MULTILINE)
    if first is None:
        raise ValueError(
            f"the page {docname} has no picture, below which its live page would stand."
        )
    frame = _FRAME.format(up="../" * docname.count("/"), file=file_name(who), who=who)
    content[0] = content[0][: first.end()] + "\n" + frame + content[0][first.end() :]


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.connect("builder-inited", _write)
    app.connect("source-read", _framed)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
