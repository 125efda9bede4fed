"""Deprecated names of `rans.tasks.observation_terms`, kept for one version."""

from __future__ import annotations

import warnings
from typing import Any

from rans.tasks import observation_terms

_RENAMED = {
    "Sight": "Observation",
    "Entry": "ObservationTerm",
    "Spin": "AngularVelocity",
    "Turn": "RelativeRotation",
    "OwnAttitude": "OwnRotation",
    "Drawn": "TaskDependent",
    "Knob": "TradeOff",
}


def __getattr__(name: str) -> Any:
    new = _RENAMED.get(name, name)
    if name.startswith("__") or not hasattr(observation_terms, new):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    warnings.warn(
        f"rans.tasks.sight.{name} is deprecated and will be removed in the next version: import {new} from "
        "rans.tasks.observation_terms.",
        DeprecationWarning,
        stacklevel=2,
    )
    return getattr(observation_terms, new)
