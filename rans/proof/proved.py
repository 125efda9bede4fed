"""What the certificate of a trapping set says of the agent of a folder, for reports and contracts."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from rans.errors import ConfigError
from rans.files import inside, parse_json, read_bytes

FILE = "proof.json"
"""The certificate of a run folder, which `rans prove` writes."""
_LARGEST = 2**30
"""Bytes of a certificate or of weights that are read."""


@dataclass(frozen=True)
class Proved:
    """A trapping set that `rans prove` has proved, as its certificate says."""

    sentence: str
    """What never happens, from which starts."""
    cells: int
    """Number of cells that cover the trapping set."""
    uncertainty: dict[str, float]
    """By how much each quantity may be off in the proof; 0: not at all."""
    sha256: str
    """SHA-256 of the certificate's file, in hexadecimal."""
    same_weights: bool
    """Whether it is of the weights beside it. Of others it says nothing about this agent."""


def proved(folder: Path) -> Proved:
    """The certificate of a run folder; `rans prove --check` judges it again.

    Raises:
        ConfigError: it cannot be read, or is no certificate of an agent's trapping set.
    """
    file = inside(folder, FILE)
    content = read_bytes(file, _LARGEST)
    table = parse_json(content, file)
    weights = hashlib.sha256(read_bytes(inside(folder, "agent.safetensors"), _LARGEST)).hexdigest()
    try:
        keep, start = table["keep"], table["start"]
        return Proved(
            "Proved: with its goal at rest, from every velocity up to "
            f"{start['speed']:g} m/s and every spin up to {start['spin']:g} rad/s, it never exceeds "
            f"{keep['speed']:g} m/s and {keep['spin']:g} rad/s.",
            len(table["cells"]),
            {str(name): float(value) for name, value in table["uncertainty"].items()},
            hashlib.sha256(content).hexdigest(),
            table["agent"]["agent.safetensors"] == weights,
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ConfigError(
            f"{file} is no certificate of an agent's trapping set ({error}): write it anew by rans prove."
        ) from error
