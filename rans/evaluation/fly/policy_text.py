"""Texts that name files of flights, and policies of other libraries: of SB3, of ONNX, or any Python function."""

from __future__ import annotations

import os
from pathlib import Path

USER_POLICIES = "sb3:FILE.zip, onnx:FILE or python:MODULE:FUNCTION"
"""Forms of names that `user_policy` accepts, for messages and help.

Each may end in :TASK-2d or -3d, with @SPACECRAFT, see `split_policy`.
"""


def is_user_policy(spec: str) -> bool:
    """Whether a text names a policy of `USER_POLICIES`."""
    return spec.startswith(("sb3:", "onnx:", "python:"))


def is_flights_file(spec: str) -> bool:
    """Whether the text of a contestant names a file of flights."""
    return spec.lower().endswith(".csv")


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
