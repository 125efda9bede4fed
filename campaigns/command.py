"""How the commands of this package end."""

from __future__ import annotations

import sys
from collections.abc import Callable

from rans.base.errors import RansError, legible


def ended(name: str, run: Callable[[], int]) -> int:
    """A command's exit code: its own, 2 and a sentence for a user's mistake, 130 if it was interrupted."""
    try:
        return run()
    except RansError as error:
        print(legible(f"{name}: {error}"), file=sys.stderr)  # noqa: T201
        return 2
    except KeyboardInterrupt:
        return 130
