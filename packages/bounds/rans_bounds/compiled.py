"""Functions of numbers and arrays as machine code, kept for the next process.

Raises:
    ConfigError: when it is imported, where numba is missing.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

from rans.extend import ConfigError, require

require("numba")
try:
    from numba import njit
    from numba.core import config
except Exception as error:  # a wrong value in a file of settings
    raise ConfigError(
        f"on/off certificates need the package numba, which could not be loaded: {error}."
    ) from None


def _settings_of_the_environment_alone() -> None:
    """Have numba not take settings from ``.numba_config.yaml`` of the current folder, maybe a stranger's.

    They say where its cache is, whose files are pickles, and which classes it imports to find that.
    """
    config._config_fname = os.devnull  # which is no file
    config.reload_config()


_settings_of_the_environment_alone()


def compiled(function: Callable[..., Any]) -> Any:
    """Function compiled by numba, without Python's lock; anew in every process where nothing may be written.

    Compiling takes seconds, and every process of a pool would.
    """
    try:
        return njit(nogil=True, cache=True)(function)
    except RuntimeError:  # neither beside the source nor in the user's cache
        return njit(nogil=True)(function)
