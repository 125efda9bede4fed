"""Deprecated name of `rans.evaluation.compare.entrants`, for one version."""

from __future__ import annotations

import warnings

from rans.evaluation.compare.entrants import *  # noqa: F403

warnings.warn(
    "rans.evaluation.compare.roster is deprecated and goes with the next version: import from "
    "rans.evaluation.compare.entrants.",
    DeprecationWarning,
    stacklevel=2,
)
