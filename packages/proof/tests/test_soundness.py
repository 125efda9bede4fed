"""Bounds of prover and checker are sound and tight, and planted errors make them fail."""

from __future__ import annotations

from typing import Any

import pytest

from .planted import ERRORS, planted
from .soundness import CHECKER, OF_CHECKER, OF_PROVER, PROVER, Checker, Prover

pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")
pytest.importorskip("flint")
_SLOW = (pytest.mark.slow,)
"""A motion of the prover takes it some tenths of a second, whatever the number of sets."""


@pytest.mark.parametrize("part", OF_CHECKER)
def test_the_checker_is_sound_and_tight(part):
    OF_CHECKER[part](Checker(planted(CHECKER)))


@pytest.mark.parametrize(
    "part", [pytest.param(part, marks=_SLOW if part == "motions" else ()) for part in OF_PROVER]
)
def test_the_prover_is_sound_and_tight(part):
    OF_PROVER[part](Prover(planted(PROVER)))


def by_turns(name: str) -> list[Any]:
    """The first error of every part by default, and all of them with the slow tests; motions take longer."""
    parts = [error[0] for error in ERRORS[name]]
    return [
        pytest.param(*error, marks=_SLOW if error[0] in ["motions", *parts[:number]] else ())
        for number, error in enumerate(ERRORS[name])
    ]


@pytest.mark.parametrize(("part", "module", "old", "new"), by_turns("bounds_of_checker"))
def test_errors_of_the_checker_are_caught(part, module, old, new):
    wrong = Checker(planted(CHECKER, (f"rans_proof.{module}", old, new)))
    with pytest.raises((AssertionError, pytest.fail.Exception, *wrong.refusals)):
        OF_CHECKER[part](wrong)


@pytest.mark.parametrize(("part", "module", "old", "new"), by_turns("bounds_of_prover"))
def test_errors_of_the_prover_are_caught(part, module, old, new):
    wrong = Prover(planted(PROVER, (f"rans_proof.{module}", old, new)))
    with pytest.raises(AssertionError):
        OF_PROVER[part](wrong)
