"""Certificates of proofs: a JSON file with problem, SHA-256 of the network, cells and margins."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from rans.extend import read_bytes, write_json
from rans_proof.prove import Proof

LARGEST = 2**28
"""Bytes of a certificate that is read; a million cells of four states have 10^8."""


def write_certificate(proof: Proof, network: bytes, file: Path) -> str:
    """Write the certificate of a proof, or of the flight that refutes it, and return its SHA-256.

    Numbers are written with all their digits, so that edges of cells are the same when they are read.

    Args:
        proof: a whole proof, or one that ended with a flight.
        network: content of the ONNX file of which the proof is, as it was read for the proof.
        file: file to write.

    Raises:
        ConfigError: the file cannot be written.
    """
    write_json(file, table(proof, network))
    return hashlib.sha256(read_bytes(file, LARGEST)).hexdigest()


def table(proof: Proof, network: bytes) -> dict[str, Any]:
    """Table of the certificate of a proof or of a flight that refutes it; arguments as for `write_certificate`.

    The checker reads these keys and no others (`rans_proof.check_problem`); a stored certificate must stay
    readable.
    """
    head = {
        "format": 1,
        "network": hashlib.sha256(network).hexdigest(),
        "problem": proof.problem.text,
    }
    if proof.flight is not None:
        return head | {"flight": proof.flight.tolist()}
    cells = [[a.tolist(), b.tolist()] for a, b in zip(proof.low, proof.high, strict=True)]
    return head | {"cells": cells, "margins": proof.margins.tolist()}
