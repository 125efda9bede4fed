"""A checker loads nothing of a prover, and nothing of RANS: no reader, no formula and no code is shared."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip("onnx")
pytest.importorskip("flint")
CHECKERS = ("check", "check_pose")
PROVERS = ("prove", "pose_trap")


def loaded(*modules: str) -> set[str]:
    """Names of modules of RANS, and torch, that a process has loaded after modules of the package."""
    names = ", ".join(f"rans_proof.{module}" for module in modules)
    code = f"import sys, {names}; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    beginnings = ("rans.", "rans_proof.", "torch")
    return {name for name in run.stdout.split() if name.startswith(beginnings)}


def test_checkers_load_no_module_of_rans() -> None:
    found = loaded(*CHECKERS)
    assert {"rans_proof.balls", "rans_proof.claims"} < found
    assert all(name.startswith("rans_proof.") for name in found)


@pytest.mark.slow
def test_no_module_is_of_a_checker_and_of_a_prover() -> None:
    of_provers = loaded(*PROVERS)
    assert {"rans_proof.network", "rans_proof.verdicts", "torch"} < of_provers
    assert not loaded(*CHECKERS) & of_provers
