"""Matplotlib, loaded without the backend that the environment names: figures take its names from here alone.

Jupyter sets MPLBACKEND to a backend of its kernel, and commands that a notebook starts inherit it. Where RANS has
an environment of its own, that backend is not installed, and matplotlib refuses to be imported. RANS draws into
`matplotlib.figure.Figure` objects and opens no window: the backend does not matter to it.

Raises:
    MissingPackage: when it is imported, where matplotlib is missing.
"""

from __future__ import annotations

import contextlib
import os
import sys

from rans.base.errors import require


def _load() -> None:
    """Load matplotlib; a backend that it knows is the one of pyplot afterwards, as a user's script expects."""
    if "matplotlib" in sys.modules:
        return
    name = os.environ.pop("MPLBACKEND", None)
    try:
        matplotlib = require("matplotlib")
    finally:
        if name is not None:
            os.environ["MPLBACKEND"] = name
    if name:
        with contextlib.suppress(ValueError):
            matplotlib.rcParams["backend"] = name


_load()

from matplotlib import rc_context  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.axis import Axis  # noqa: E402
from matplotlib.collections import LineCollection  # noqa: E402
from matplotlib.colors import LinearSegmentedColormap  # noqa: E402
from matplotlib.figure import Figure, SubFigure  # noqa: E402
from matplotlib.patches import Circle  # noqa: E402
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator  # noqa: E402

__all__ = [
    "Axes",
    "Axis",
    "Circle",
    "Figure",
    "FuncFormatter",
    "LineCollection",
    "LinearSegmentedColormap",
    "LogLocator",
    "MaxNLocator",
    "NullLocator",
    "SubFigure",
    "rc_context",
]
