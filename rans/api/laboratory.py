"""Where `rans validate` and `rans benchmark` find `validation`, which nobody else should."""

from __future__ import annotations

import sys

from rans.system import PACKAGE_FOLDER


def enter() -> None:
    """Let ``validation`` be ours from here on, whatever has this name where the user stands.

    In a wheel it lies in ``rans/laboratory``, so that the name is not installed; in a working copy
    beside ``rans`` (docs/decisions/security.md).
    """
    package = PACKAGE_FOLDER
    checkout = str(
        next(
            folder
            for folder in (package / "laboratory", package.parent)
            if (folder / "validation").is_dir()
        )
    )
    if sys.path[:1] != [checkout]:
        sys.path.insert(0, checkout)
