"""Safety filters between a policy and the effectors, which an installed package makes."""

from __future__ import annotations

from collections.abc import Callable

from rans.base.registry import Registry
from rans.episode.step import Guard, Setup

_NAME = "constraints"
FILTERS: Registry[Callable[[Setup], Guard]] = Registry("safety filter of", "rans.safety_filters")
"""Functions that make safety filters; `safety_filter` asks that of constraints."""


def safety_filter(setup: Setup) -> Guard:
    """Safety filter for the constraints of a task, with the spacecraft and conditions of a setup.

    Args:
        setup: spacecraft, task, timing and conditions.

    Raises:
        ConfigError: no installed package makes such filters, or there is none for this setup.
    """
    return FILTERS[_NAME](setup)
