"""Functions of numbers and arrays as machine code, kept for the next process.

Raises:
    ConfigError: when it is imported, where numba is missing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rans.errors import ConfigError

try:
    from numba import njit
except ImportError as error:
    raise ConfigError(f"on/off certificates need the package numba, which could not be loaded ({error}); "
                      "install it with: pip install numba") from None


def compiled(function: Callable[..., Any]) -> Any:
    """By numba, without Python's lock; anew in every process only where nothing may be written.

    Compiling takes seconds, and every process of a pool would.
    """
    try:
        return njit(nogil=True, cache=True)(function)
    except RuntimeError:  # neither beside the source nor in the user's cache
        return njit(nogil=True)(function)
