"""What is known of the certificate in an agent's folder, for reports and contracts."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rans.extend import ConfigError, inside, read_bytes, require
from rans_proof.verdicts import FILES, Stated, Verdict, recorded

FILE = "proof.json"
"""The certificate of a run folder, which `rans prove` writes."""
LARGEST = 2**24
"""Bytes of a certificate of poses that is read; 17,000 cells have some 10^4."""
_LARGEST_AGENT = 2**28
"""Bytes of an agent's file that is read."""
_HEADINGS: dict[Verdict, str] = {
    "checked": "Proved, checked here",
    "": "Claimed, not checked here",
}
"""What a sentence begins with. "here" is the computer whose user reads it, as in `rans_proof.verdicts`."""


@dataclass(frozen=True)
class Proved:
    """What a certificate states, and what this computer knows of it."""

    theorem: str
    """What never happens, from which starts, with which errors; not a sentence."""
    errors: str
    """How far what flies may be from its design; not a sentence."""
    cells: int
    """Number of cells that cover the trapping set."""
    sha256: str
    """SHA-256 of the certificate's file, in hexadecimal."""
    verdict: Verdict
    differs: str
    """Name of a file of the agent that is another than the certificate's, which says nothing about this agent then;
    "": none."""

    @property
    def heading(self) -> str:
        """Whether it is proved and checked or only claimed, in a few words."""
        return _HEADINGS[self.verdict]

    @property
    def sentence(self) -> str:
        """What it states, and whether that is checked or only claimed."""
        return f"{self.heading}: {self.theorem}."


def stated(content: bytes, where: object) -> Stated:
    """What the certificate of a trapping set of poses states.

    Args:
        content: content of its file.
        where: name of the file in messages.

    Raises:
        ConfigError: it is none.
        MissingPackage: the package flint is not installed, which the checker's reader needs.
    """
    require("flint")
    # The checker's reader, which loads nothing of a prover.
    from rans_proof.balls import Refused
    from rans_proof.check_pose import read_pose_certificate

    try:
        pose = read_pose_certificate(content)
    except Refused as refusal:
        raise ConfigError(f"{where} is no certificate that rans prove writes: {refusal}") from None
    cells = sum(last - first for runs in pose.table["cells"].values() for _, first, last in runs)
    digest = hashlib.sha256(content).hexdigest()
    return Stated(pose.theorem, pose.errors, cells, digest, pose.table["agent"])


def agent_files(folder: Path) -> dict[str, bytes]:
    """Contents of the files of an agent that a certificate is about, by their names.

    Raises:
        ConfigError: one of them cannot be read, or leads out of the folder.
    """
    return {name: read_bytes(inside(folder, name), _LARGEST_AGENT) for name in FILES}


def proved(folder: Path) -> Proved:
    """The certificate of a run folder.

    Raises:
        ConfigError: it cannot be read, or is no certificate of an agent's trapping set.
    """
    file = inside(folder, FILE)
    certificate = stated(read_bytes(file, LARGEST), file)
    return Proved(
        certificate.theorem,
        certificate.errors,
        certificate.cells,
        certificate.sha256,
        recorded(certificate),
        _differing(certificate.agent, agent_files(folder)),
    )


def _differing(agent: Mapping[str, str], files: Mapping[str, bytes]) -> str:
    """Name of the first of an agent's files whose SHA-256 is another than a certificate's, or ""."""
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    return next((name for name in FILES if agent[name] != digests[name]), "")
