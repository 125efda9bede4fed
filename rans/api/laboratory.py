"""Where `rans validate` and `rans benchmark` find `validation`, which nobody else should."""

from __future__ import annotations

import sys

from rans.system import PACKAGE_FOLDER


def enter() -> None:
    """Let ``validation`` be ours from here on, whatever has this name where the user stands.

    In a wheel it lies in ``rans/laboratory``, so that the name is not installed; in a working copy
    beside ``rans`` (docs/decisions/security.md).
    """
    here = PACKAGE_FOLDER
    place = str(
        next(one for one in (here / "laboratory", here.parent) if (one / "validation").is_dir())
    )
    if sys.path[:1] != [place]:
        sys.path.insert(0, place)
