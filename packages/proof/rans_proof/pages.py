"""What a report and a contract say of a run's certificate."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rans.extend import ConfigError, Fact, Finding, Section, Table
from rans_proof.proved import FILE, proved


def proof_section(file: Path, _: Mapping[str, Any]) -> Section:
    """Section of the certificate of an agent: proved and checked on this computer, or only claimed.

    A certificate of other files is a failed finding.
    """
    run = file.parent
    try:
        proof = proved(run)
    except ConfigError as error:  # the rest of the run is not the worse for it
        return Section("Proof", findings=[Finding(str(error), False)])
    rows = [
        ["verdict", proof.heading],
        ["cells", f"{proof.cells:,}"],
        ["may be off", proof.errors],
        ["certificate, SHA-256", proof.sha256],
    ]
    finding = Finding(f"The certificate is of another agent: its {proof.differs} differs.", False)
    summary: list[Fact] = []
    if not proof.differs:
        finding = Finding(proof.sentence, True if proof.verdict == "checked" else None)
        # The verdict of a dossier is that of no single computer: its command checks the certificate again.
        summary = [Fact("certificate", f"{proof.theorem}.")]
    command = shlex.join(["rans", "prove", str(run), "--check", str(run / "proof.json")])
    text = f"Judge the certificate with {command}."
    tables = [Table(("", "value"), rows)]
    return Section("Proof", text, tables, findings=[finding], summary=summary)


def no_proof_section(_: Path, result: Mapping[str, Any]) -> Section:
    """Why there is no proof, as `rans prove` has said."""
    fact = Fact("no proof", str(result["reason"]))
    return Section("No proof", tables=[Table(("", "why"), [fact[:2]])], summary=[fact])


def proof_entry(run: Path) -> dict[str, Any]:
    """What a contract says of a run's certificate: "proved" if that was done here, or "claimed"; {}: none.

    Raises:
        ConfigError: the certificate is damaged.
    """
    if not (run / FILE).exists() or (proof := proved(run)).differs:
        return {}
    entry = {
        "property": proof.sentence,
        "errors": proof.errors,
        "cells": proof.cells,
        "sha256": proof.sha256,
        "meaning": "of the certificate, which rans prove --check judges; here: where the export was made",
    }
    return {"proved" if proof.verdict else "claimed": entry}
