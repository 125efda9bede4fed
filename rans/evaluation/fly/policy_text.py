"""Texts that name files of flights, and policies of other libraries: of SB3, of ONNX, or any Python function."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rans.base.registry import Registry

if TYPE_CHECKING:
    from rans.episode.flight import Controller
    from rans.episode.step import Setup
    from rans.model.spacecraft import Spacecraft
    from rans.tasks import Task

ForeignPolicy = Callable[[np.ndarray, Any, np.ndarray], tuple[Any, Any]]
"""Function of observations (N, width), float32, of the memory after the step before (None: all episodes begin), and
of where an episode begins, (N,) bool. It gives commands (N, commands), zeros and ones or numbers between, and the
memory after them (None: there is none). It keeps nothing itself, so that many flights may ask it by turns."""

POLICIES: Registry[Callable[[Any, Spacecraft, Task, bool], ForeignPolicy]] = Registry(
    "reader of policies", "rans.policies"
)
"""Makers of policies, of the name of a file ("sb3", "onnx") or of an "object", of craft and task, and whether a
file may run code. They refuse (`ConfigError`) what is no policy for these, or has a part that cannot be flown."""

FLIGHTS: Registry[Callable[[str, Setup], Controller]] = Registry(
    "reader of flights", "rans.flights"
)
"""Readers of files with flights, by the ending of a file: of its name and the setup. What they make flies them."""


def _readers() -> list[str]:
    """Kinds of files of policies, as texts begin with them."""
    return [name for name in POLICIES if name != "object"]


def forms() -> str:
    """Forms of texts that name policies, for messages; each may end in :TASK-2d or -3d, with @SPACECRAFT."""
    return f"{', '.join(f'{kind}:FILE' for kind in _readers())} or python:MODULE:FUNCTION"


def is_user_policy(spec: str) -> bool:
    """Whether a text names a policy of another library (`forms`)."""
    kind, colon, _ = spec.partition(":")
    return bool(colon) and kind in ("python", *_readers())


def is_flights_file(spec: str) -> bool:
    """Whether the text of a contestant names a file of flights."""
    return Path(spec).suffix.lower()[1:] in FLIGHTS


def split_policy(spec: str) -> tuple[str, str]:
    """Split the text of a policy into what `user_policy` opens and its TASK-2d@SPACECRAFT, "" if it has none.

    >>> split_policy("sb3:policy.zip:go-to-pose-2d@atmos")
    ('sb3:policy.zip', 'go-to-pose-2d@atmos')
    >>> split_policy("python:mine:act")
    ('python:mine:act', '')
    """
    kind, _, rest = spec.partition(":")
    if kind == "python":
        module, _, rest = rest.partition(":")
        function, _, setup = rest.partition(":")
        return f"python:{module}:{function}", setup
    # A name may have colons: the longest that a file has is its own.
    parts = rest.split(":")
    for count in range(len(parts), 0, -1):
        if Path(file := ":".join(parts[:count])).is_file():
            return f"{kind}:{file}", ":".join(parts[count:])
    drive, rest = os.path.splitdrive(rest)  # on Windows it has a colon, too
    file, _, setup = rest.partition(":")
    return f"{kind}:{drive}{file}", setup
