"""Certificates of proofs: a JSON file with problem, SHA-256 of the network, cells and margins."""

from __future__ import annotations

import hashlib
from pathlib import Path

from rans.files import read_bytes, write_json
from rans.proof.prove import Proof

LARGEST = 2**30
"""Bytes of a certificate that is read; a million cells of four states have 10^8."""


def write_certificate(proof: Proof, network: Path, file: Path) -> str:
    """Write the certificate of a proof and return its SHA-256.

    Numbers are written with all their digits, so that edges of cells are the same when they are read.

    Raises:
        ConfigError: a file cannot be read or written.
    """
    content = read_bytes(network, LARGEST)
    write_json(
        file,
        {
            "format": 1,
            "network": hashlib.sha256(content).hexdigest(),
            "problem": proof.problem.text,
            "cells": [
                [low.tolist(), high.tolist()]
                for low, high in zip(proof.low, proof.high, strict=True)
            ],
            "margins": proof.margins.tolist(),
        },
    )
    return hashlib.sha256(read_bytes(file, LARGEST)).hexdigest()
