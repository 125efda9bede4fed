"""``rans prove``: proofs about closed loops of networks, and the check of their certificates.

Exit codes are an interface: 0 proved or accepted, 1 open or refused. The checker judges flights that refute before
they are claimed; cells, which take it minutes, by --check.
"""

from __future__ import annotations

import math
import shlex
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from tyro.conf import arg

from rans.extend import (
    ConfigError,
    Options,
    Terminal,
    brief,
    command_of,
    is_installed,
    progress,
    read_bytes,
    ready_folder,
    require,
    word,
)

if TYPE_CHECKING:
    from rans_proof.prove import Proof

_CHUNK = 4
"""Cells that a process checks between two reports, some seconds."""
_CELLS = 4
"""Cells along each state to begin with, for up to four states, 256 cells; with more states it is 1."""
_SMALLEST = 1.0 / 512
"""Part of the range of a start, below which cells are not split with --resolution 1."""


def prove(
    network: str | None = None,
    *,
    resolution: int = 1,
    problem: Path | None = None,
    output: Path | None = None,
    check: Path | None = None,
) -> bool:
    """Prove that a network keeps a property from every start; returns whether that is proved.

    Args:
        network: FILE.onnx, a network that takes the state and gives the commands.
        resolution: how much finer than 1/512 of the range of a start the smallest cells are along each state.
        problem: plant, starts and property, a TOML file (docs/proof/proofs.md); with --check the certificate must
            fit it.
        output: certificate to write; by default PROBLEM.certificate.json.
        check: certificate to check; nothing is proved then.

    Raises:
        ConfigError: one of these does not exist, or the network is no file that ends in .onnx.
    """
    return not Prove(**locals()).run()


_FILE = Annotated[Path | None, arg(metavar="FILE")]


@command_of(
    prove,
    network=word("NETWORK", str | None),
    problem=_FILE,
    output=_FILE,
    check=Annotated[Path | None, arg(metavar="CERTIFICATE")],
)
class Prove(Options):
    """Prove that a network keeps a property from every start, or find a flight that breaks it.

    The set of starts is split into cells, each of which is proved as a whole. The exit code is 0 if the property
    is proved everywhere. The certificate is a file of the cells; --check judges one in ball arithmetic, by a
    program that shares no code with the prover.
    """

    group = "Judge"
    guide = "docs/proof/proofs.md"
    divides_work = True
    examples = (
        "rans prove network.onnx --problem docking.toml",
        "rans prove network.onnx --check docking.certificate.json",
    )
    following = ("rans list",)

    def run(self) -> int:
        """Prove or check what the options name, and print the result.

        The exit code is 1 if it is open or refused.
        """
        if not 1 <= self.resolution <= 8:
            raise ConfigError(f"--resolution must be from 1 to 8, got {self.resolution}.")
        if self.network is None or not self.network.endswith(".onnx"):
            got = "nothing" if self.network is None else brief(self.network)
            raise ConfigError(
                "rans prove takes the file of a network that ends in .onnx, and a --problem whose plant is "
                f"formulas; no proof is known for agents that RANS trains, got {got}."
            )
        if self.problem is None and self.check is None:
            raise ConfigError("name a --problem to prove, or a certificate to --check.")
        network = Path(self.network)
        return self._check(self.check, network) if self.check is not None else self._prove(network)

    def _prove(self, network: Path) -> int:
        """Prove a property of a network with the plant of a problem's file."""
        from rans.extend import torch_device
        from rans_proof.certificate import write_certificate
        from rans_proof.network import LARGEST, network_of
        from rans_proof.problem import read_problem
        from rans_proof.prove import prove

        assert self.problem is not None
        # Prove: cells are split until each holds or a flight breaks the property.
        problem = read_problem(self.problem)
        content = read_bytes(network, LARGEST)
        layers = network_of(content, network, problem.input_range())
        output = self.output or self.problem.with_suffix(".certificate.json")
        ready_folder(output.parent)
        begun = time.monotonic()
        terminal = Terminal()
        with progress() as bars:
            task = bars.add_task("proving", total=None)
            try:
                proof = prove(
                    problem,
                    layers,
                    torch_device("auto"),
                    _SMALLEST / self.resolution,
                    [_CELLS if problem.states <= 4 else 1] * problem.states,
                    lambda done, left: bars.update(task, completed=done, total=done + left),
                )
            except KeyboardInterrupt:
                (bar,) = bars.tasks
                terminal.say(f"Open: {bar.completed:,.0f} cells are proved, and more are left.")
                raise
        seconds = time.monotonic() - begun
        # False with the flight, open, or proved with the cells.
        if proof.counterexample is not None:
            output = self.output or self.problem.with_suffix(".flight.json")
            return _refuted(proof, content, network, output, seconds)
        if not proof.is_whole:
            terminal.say(
                f"Open: {100 * proof.volume:.2f} % of the starts' volume is proved, and {len(proof.open_low):,} "
                f"cells of the smallest size are neither proved nor refuted, after {seconds:.1f} s. A larger "
                "--resolution may prove them."
            )
            return 1
        digest = write_certificate(proof, content, output)
        terminal.say(
            f"Proved: {problem.name}, from every start and at all times to {problem.steps * problem.period:g} s; "
            f"{len(proof.low):,} cells, least margin {proof.margins.min():.3g}, {seconds:.1f} s. The certificate "
            f"is {output} (SHA-256 {digest[:16]})."
        )
        terminal.suggest(shlex.join(["rans", "prove", str(network), "--check", str(output)]))
        return 0

    def _check(self, certificate: Path, network: Path) -> int:
        """Check the certificate of a network, in parallel over its cells; 0 if it is accepted, else 1."""
        require("onnx")
        require("flint")
        from rans.extend import Workers
        from rans_proof.balls import Refused
        from rans_proof.certificate import LARGEST
        from rans_proof.check_problem import claim_of, difference, problem_table, statement
        from rans_proof.network import LARGEST as LARGEST_NETWORK
        from rans_proof.problem import read_problem

        contents = read_bytes(certificate, LARGEST), read_bytes(network, LARGEST_NETWORK)
        terminal = Terminal()
        try:
            claim = claim_of(contents[0])
            if self.problem is not None:
                asked = problem_table(read_problem(self.problem).text)
                if differing := difference(claim.problem, asked):
                    raise Refused(f"it is of another problem than {self.problem}, by {differing}.")
        except Refused as refusal:
            terminal.say(f"Refused: {refusal}")
            return 1
        # Cells are divided among processes; a flight has none and is judged by one.
        count = len(claim.cells)
        chunks = [range(k, min(k + _CHUNK, count)) for k in range(0, max(count, 1), _CHUNK)]
        begun = time.monotonic()
        least = math.inf
        with progress() as bars:
            task = bars.add_task("checking", total=count)
            answers = Workers(tuple, (contents,), None, "checked a certificate")
            for _, (margin, refusal) in answers.finished(_checked, [(chunk,) for chunk in chunks]):
                if refusal:
                    terminal.say(f"Refused: {refusal}")
                    return 1
                least = min(least, margin)
                bars.advance(task, _CHUNK)
        theorem = (
            f"of {network} (SHA-256 {claim.network[:16]}): {claim.problem['name']}.\n"
            f"{statement(claim.problem)}"
        )
        if claim.flight:
            terminal.say(
                f"Accepted: the flight breaks the property by {-least:.3g}, in ball arithmetic.\n\n"
                f"Refuted {theorem}\nflight from: {claim.flight[0]}"
            )
        else:
            terminal.say(
                f"Accepted: {count:,} cells cover the starts, and the least margin is {least:.3g}, in ball "
                f"arithmetic; {time.monotonic() - begun:.1f} s.\nProved {theorem}"
            )
        return 0


def _refuted(proof: Proof, content: bytes, network: Path, output: Path, seconds: float) -> int:
    """Write the flight that refutes a property, let the checker fly it again, and print both results.

    A flight that the checker does not confirm is "Open", never "False".
    """
    from rans_proof.certificate import LARGEST, write_certificate

    assert proof.counterexample is not None
    write_certificate(proof, content, output)
    terminal = Terminal()
    how = "The checker was not asked, as python-flint is not installed."
    if is_installed("flint"):
        margin, refusal = _checked((read_bytes(output, LARGEST), content), [])
        if refusal:
            terminal.say(
                "Open: a simulated flight breaks the property, and the checker does not confirm it: "
                + refusal
            )
            return 1
        how = f"The checker's flight in ball arithmetic breaks it by {-margin:.3g}."
    start = np.round(proof.counterexample, 6).tolist()
    terminal.say(
        f"False: the flight from {start} breaks the property, after {seconds:.1f} s of search. {how} Its states "
        f"are in {output}."
    )
    terminal.suggest(shlex.join(["rans", "prove", str(network), "--check", str(output)]))
    return 1


def _checked(contents: tuple[bytes, bytes], cells: Sequence[int]) -> tuple[float, str]:
    """Least margin of some cells, and why the certificate is refused, or "".

    The contents are those of certificate and network. Whatever the checker raises is a refusal, so that a damaged
    file can never be accepted.
    """
    from rans_proof.balls import Refused
    from rans_proof.check import check

    try:
        return check(*contents, only=cells), ""
    except Refused as refusal:
        return 0.0, str(refusal)
    except (
        *(ValueError, LookupError, TypeError, AttributeError),
        *(ArithmeticError, RecursionError, MemoryError),
    ) as error:
        # What a damaged file raises where the checker does not expect it.
        return 0.0, f"it is damaged: {type(error).__name__} {error}"
