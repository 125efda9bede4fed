"""Verdicts about certificates of trapping sets that this user's computer has reached, in a folder of the user.

A run folder may be a stranger's, so that nothing in it says whether its certificate was judged. A verdict lies
under the SHA-256 of the certificate, which has those of network, config and craft, and is of one version of the
checker.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Literal, NamedTuple

from rans.extend import ConfigError, read_json, write_json


class Stated(NamedTuple):
    """What a certificate states, of which only the form is known to be right."""

    theorem: str
    """Starts, property, time and errors, without a full stop."""
    errors: str
    """How far what flies may be from its design; not a sentence."""
    cells: int
    """Number of cells of the set that is not left."""
    sha256: str
    """SHA-256 of the file, in hexadecimal."""
    agent: dict[str, str]
    """SHA-256 of each of the agent's files, in hexadecimal."""


FILES = ("agent.safetensors", "config.json", "spacecraft.toml")
"""Files of an agent that decide its flight, and whose SHA-256 a certificate has."""
Verdict = Literal["checked", ""]
"""checked: the checker accepted every cell; "": it did not."""
CHECKER = 2
"""Version of the checker, raised when it refuses more: verdicts of others do not count."""


def folder() -> Path:
    """Where verdicts lie; any of them may be removed at any time."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "rans" / "proofs"


def record(certificate: Stated) -> bool:
    """Record that the checker accepted every cell of a certificate.

    Returns:
        Whether it could be written.
    """
    with contextlib.suppress(ConfigError, OSError, RuntimeError):  # there may be no home
        write_json(_file(certificate), _table(certificate))
        return True
    return False


def recorded(certificate: Stated) -> Verdict:
    """The verdict about a certificate; of a damaged file none."""
    with contextlib.suppress(ConfigError, OSError, RuntimeError):
        table = read_json(_file(certificate)) if _file(certificate).exists() else None
        if table == _table(certificate):
            return "checked"
    return ""


def _file(certificate: Stated) -> Path:
    return folder() / f"{certificate.sha256}.json"


def _table(certificate: Stated) -> dict[str, object]:
    """Everything that a verdict is about."""
    return {
        "certificate": certificate.sha256,
        "agent": certificate.agent,
        "theorem": certificate.theorem,
        "checker": CHECKER,
        "verdict": "checked",
    }
