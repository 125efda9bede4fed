"""Evidence of an assurance: hashes of the agent, task and conditions, for comparison with those of a reader."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from rans.extend import (
    Conditions,
    ContestantName,
    RunFolder,
    Setup,
    conditions_text,
    read_bytes,
    to_toml,
)
from rans.system import PACKAGE_FOLDER

_LARGEST = 2**31
"""Largest number of bytes of a file of weights, as for archives."""


def hashes(spec: str, setup: Setup, file: Path | None = None) -> dict[str, str]:
    """SHA-256 of everything that decides how flights end, by name.

    Hashes of weights and spacecraft are those of the files, as ``sha256sum`` prints them; that of conditions is of
    the text of `conditions_text`; that of the code is of all source files of the package, in the order of names.

    Args:
        spec: text of a trained agent; "" for another controller.
        setup: setup of its flights.
        file: the file of another controller; None: it has none, and only the setup has hashes.
    """
    if spec:
        run = RunFolder(ContestantName.parse(spec).folder)
        files = {
            f"weights ({run.agent_file.name})": sha256([read_bytes(run.agent_file, _LARGEST)]),
            "spacecraft (spacecraft.toml)": sha256([read_bytes(run.spacecraft_file, _LARGEST)]),
        }
    else:
        files = {"spacecraft": sha256([to_toml(setup.craft).encode()])}
        if file is not None:
            files |= {f"policy ({file.name})": sha256([read_bytes(file, _LARGEST)])}
    code = sorted(file for kind in ("*.py", "*.cuh") for file in PACKAGE_FOLDER.rglob(kind))
    return {
        **files,
        "task and timing": sha256([repr(setup[1:3]).encode()]),
        "conditions": sha256([conditions_text(setup.conditions or Conditions()).encode()]),
        "code of RANS": sha256(
            part
            for file in code
            for part in (
                file.relative_to(PACKAGE_FOLDER).as_posix().encode(),
                read_bytes(file, _LARGEST),
            )
        ),
    }


def sha256(parts: Iterable[bytes]) -> str:
    """SHA-256 of all parts, one after the other."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    return digest.hexdigest()
