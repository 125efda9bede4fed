"""A checker loads nothing of a prover, and nothing of RANS: no reader, no formula and no code is shared."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip("onnx")
pytest.importorskip("flint")


def loaded(module: str) -> set[str]:
    """Names of modules of RANS, and torch, that a process has loaded after a module of the package."""
    code = f"import sys, rans_proof.{module}; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    beginnings = ("rans.", "rans_proof.", "torch")
    return {name for name in run.stdout.split() if name.startswith(beginnings)}


def test_checkers_load_no_module_of_rans():
    found = loaded("check")
    assert {"rans_proof.balls", "rans_proof.claims"} < found
    assert all(name.startswith("rans_proof.") for name in found)


@pytest.mark.slow
def test_no_module_is_of_a_checker_and_of_a_prover():
    of_provers = loaded("prove")
    assert {"rans_proof.network", "torch"} < of_provers
    assert not loaded("check") & of_provers
