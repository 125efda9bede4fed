"""``rans prove``: proofs about the closed loop of a network, and the check of their certificates."""

from __future__ import annotations

import shlex
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import arg

from rans.errors import ConfigError, require
from rans.files import read_bytes
from rans.terminal import Terminal, progress

_CHUNK = 4
"""Cells that a process checks between two reports, some seconds."""


@dataclass(frozen=True)
class Prove:
    """Prove that a network keeps a property from every start, at all times, or find a flight that breaks it.

    The set of starts is split into cells, each of which is proved as a whole. The exit code is 0 if the property
    is proved everywhere. The certificate is a file of the cells; --check judges one in ball arithmetic, by a
    program that shares no code with the prover.
    """

    onnx: Annotated[Path, arg(metavar="FILE")]
    """Network that takes the state and gives the commands."""
    problem: Annotated[Path | None, arg(metavar="FILE")] = None
    """Plant, starts and property, a TOML file; see docs/proofs.md."""
    output: Annotated[Path | None, arg(metavar="FILE")] = None
    """Certificate to write; by default beside the problem, as NAME.certificate.json."""
    check: Annotated[Path | None, arg(metavar="CERTIFICATE")] = None
    """Certificate to check; nothing is proved then."""
    cells: int = 4
    """Number of cells along each state to begin with, for up to four states; with more states it is 1."""
    smallest: float = 1.0 / 512
    """Part of the range of a start, below which cells are not split."""
    device: str = "cpu"
    """cpu or cuda."""
    workers: int | None = None
    """Processes of --check; by default one per processor."""

    def run(self) -> int:
        """Prove or check, and print the result."""
        if (self.problem is None) == (self.check is None):
            raise ConfigError("name a --problem to prove, or a certificate to --check.")
        return self._check(self.check) if self.check is not None else self._prove()

    def _prove(self) -> int:
        from rans.proof.certificate import write_certificate
        from rans.proof.network import read_network
        from rans.proof.problem import read_problem
        from rans.proof.prove import lowest_margins, prove

        assert self.problem is not None
        if not (1 <= self.cells <= 1000 and 0.0 < self.smallest <= 1.0):
            raise ConfigError(
                "--cells must be from 1 to 1000 and --smallest above 0 and at most 1, got "
                f"{self.cells} and {self.smallest:g}."
            )
        problem = read_problem(self.problem)
        layers = read_network(self.onnx)
        output = self.output or self.problem.with_suffix(".certificate.json")
        begun = time.monotonic()
        terminal = Terminal()
        with progress() as bars:
            task = bars.add_task("proving", total=None)
            proof = prove(
                problem,
                layers,
                self.device,
                self.smallest,
                [self.cells if problem.states <= 4 else 1] * problem.states,
                lambda done, left: bars.update(task, completed=done, total=done + left),
            )
        seconds = time.monotonic() - begun
        if proof.counterexample is not None:
            start = np.round(proof.counterexample, 6).tolist()
            least = lowest_margins(problem, layers, proof.counterexample[None])[0]
            terminal.say(
                f"False: the flight from {start} breaks the property by {-least:.3g}, after {seconds:.1f} s of "
                "search."
            )
            return 1
        if not proof.is_whole:
            terminal.say(
                f"Open: {100 * proof.volume:.2f} % of the starts' volume is proved, and {len(proof.open_low):,} "
                f"cells of the smallest size are neither proved nor refuted, after {seconds:.1f} s. A smaller "
                "--smallest may prove them."
            )
            return 1
        digest = write_certificate(proof, self.onnx, output)
        terminal.say(
            f"Proved: {problem.name}, from every start and at all times to {problem.steps * problem.period:g} s; "
            f"{len(proof.low):,} cells, least margin {proof.margins.min():.3g}, {seconds:.1f} s. The certificate "
            f"is {output} (SHA-256 {digest[:16]})."
        )
        terminal.suggest(
            shlex.join(["rans", "prove", "--onnx", str(self.onnx), "--check", str(output)])
        )
        return 0

    def _check(self, certificate: Path) -> int:
        require("onnx")
        require("flint")
        from rans.files import parse_json
        from rans.processes import Workers, nothing
        from rans.proof.certificate import LARGEST
        from rans.proof.problem import problem_of

        contents = read_bytes(certificate, LARGEST), read_bytes(self.onnx, LARGEST)
        table = parse_json(contents[0], certificate)
        if not (isinstance(table, dict) and table.keys() >= {"network", "problem", "cells"}):
            raise ConfigError(f"{certificate} is no certificate of rans prove.")
        problem_of(str(table["problem"]), certificate)  # the checker itself reads without bounds
        count = len(table["cells"])
        begun = time.monotonic()
        chunks = [range(k, min(k + _CHUNK, count)) for k in range(0, count, _CHUNK)]
        jobs = [(*contents, list(one)) for one in chunks]
        least = float("inf")
        with progress() as bars:
            task = bars.add_task("checking", total=count)
            answers = Workers(nothing, (), self.workers, "checked a certificate")
            for _, (margin, refusal) in answers.finished(_checked, jobs):
                if refusal:
                    Terminal().say(f"Refused: {refusal}")
                    return 1
                least = min(least, margin)
                bars.advance(task, _CHUNK)
        Terminal().say(
            f"Accepted: {count:,} cells cover the starts, and the least margin is {least:.3g}, in ball arithmetic; "
            f"{time.monotonic() - begun:.1f} s."
        )
        return 0


def _checked(_: None, certificate: bytes, network: bytes, cells: list[int]) -> tuple[float, str]:
    """Least margin of some cells, and why the certificate is refused, or ""."""
    from rans.proof.check import Refused, check

    try:
        return check(certificate, network, only=cells), ""
    except Refused as refusal:
        return 0.0, str(refusal)
    except (ValueError, KeyError, TypeError, IndexError) as error:  # a damaged file
        return 0.0, f"it is damaged: {type(error).__name__} {error}"
