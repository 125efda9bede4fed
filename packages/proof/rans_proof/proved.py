"""What is known of the certificate in an agent's folder, for reports and contracts."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from rans.extend import ConfigError, inside, read_bytes
from rans_proof.trap_certificate import FILES, LARGEST, differing, read_certificate
from rans_proof.verdicts import Stated, Verdict, recorded

FILE = "proof.json"
"""The certificate of a run folder, which `rans prove` writes."""
_LARGEST_AGENT = 2**28
"""Bytes of an agent's file that is read."""
_HEADINGS: dict[Verdict, str] = {
    "checked": "Proved, checked here",
    "proved": "Proved here, not every cell checked",
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
        """Whether it is proved, checked or only claimed, in a few words."""
        return _HEADINGS[self.verdict]

    @property
    def sentence(self) -> str:
        """What it states, and whether that is proved, checked or only claimed."""
        return f"{self.heading}: {self.theorem}."


def stated(content: bytes, where: object) -> Stated:
    """What a certificate of an agent states: a trapping set of velocities, or of poses.

    Args:
        content: content of its file.
        where: name of the file in messages.

    Raises:
        ConfigError: it is none.
    """
    if not is_of_poses(content):
        trap = read_certificate(content, where)
        return Stated(trap.theorem, trap.errors, len(trap.cells), trap.sha256, trap.agent)
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


def is_of_poses(content: bytes) -> bool:
    """Whether a certificate, if it is one, is of a trapping set of poses; others have no reach."""
    return b'"reach"' in content


def proved(folder: Path) -> Proved:
    """The certificate of a run folder.

    Raises:
        ConfigError: it cannot be read, or is no certificate of an agent's trapping set.
    """
    file = inside(folder, FILE)
    certificate = stated(read_bytes(file, LARGEST), file)
    files = {name: read_bytes(inside(folder, name), _LARGEST_AGENT) for name in FILES}
    return Proved(
        certificate.theorem,
        certificate.errors,
        certificate.cells,
        certificate.sha256,
        recorded(certificate),
        differing(certificate.agent, files),
    )
