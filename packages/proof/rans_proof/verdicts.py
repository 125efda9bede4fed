"""Verdicts about certificates of trapping sets that this user's computer has reached, in a folder of the user.

A run folder may be a stranger's, so that nothing in it says whether its certificate was judged. A verdict lies
under the SHA-256 of the certificate, which has those of network, config and craft, and is of one version of the
checker.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Literal

from rans.extend import ConfigError, read_json, write_json
from rans_proof.trap_certificate import TrapCertificate

Verdict = Literal["checked", "proved", ""]
"""checked: the checker accepted every cell; proved: `rans prove` wrote it, and the checker has looked at a part;
"": neither."""
CHECKER = 1
"""Version of the checker, raised when it refuses more: verdicts of others do not count."""


def folder() -> Path:
    """Where verdicts lie; any of them may be removed at any time."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "rans" / "proofs"


def record(certificate: TrapCertificate, verdict: Verdict) -> bool:
    """Record a verdict, unless a certificate that was checked would count as proved only.

    Returns:
        Whether it could be written.
    """
    if recorded(certificate) == "checked":
        return True
    with contextlib.suppress(ConfigError, OSError, RuntimeError):  # there may be no home
        write_json(_file(certificate), _table(certificate) | {"verdict": verdict})
        return True
    return False


def recorded(certificate: TrapCertificate) -> Verdict:
    """The verdict about a certificate; of a damaged file none."""
    with contextlib.suppress(ConfigError, OSError, RuntimeError):
        table = read_json(_file(certificate)) if _file(certificate).exists() else None
        for verdict in ("checked", "proved"):
            if table == _table(certificate) | {"verdict": verdict}:
                return verdict
    return ""


def _file(certificate: TrapCertificate) -> Path:
    return folder() / f"{certificate.sha256}.json"


def _table(certificate: TrapCertificate) -> dict[str, object]:
    """Everything that a verdict is about."""
    return {
        "certificate": certificate.sha256,
        "agent": certificate.agent,
        "theorem": certificate.theorem,
        "checker": CHECKER,
    }
