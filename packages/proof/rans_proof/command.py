"""``rans prove``: proofs about closed loops of networks and agents, and the check of their certificates.

Exit codes are an interface: 0 proved or accepted, 1 open or refused. The checker judges poses and flights that
refute before they are claimed; cells of a network, which take it minutes, by --check.
"""

from __future__ import annotations

import math
import shlex
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from tyro.conf import arg

from rans.cli.numbers import named_numbers
from rans.extend import (
    ConfigError,
    Options,
    Terminal,
    brief,
    command_of,
    is_installed,
    progress,
    read_bytes,
    require,
    word,
)

if TYPE_CHECKING:
    from rans.extend import LoadedRun
    from rans_proof.prove import Proof

_CHUNK = 4
"""Cells that a process checks between two reports, some seconds."""
_CELLS = 4
"""Cells along each state to begin with, for up to four states, 256 cells; with more states it is 1."""
_SMALLEST = 1.0 / 512
"""Part of the range of a start, below which a network's cells are not split with --resolution 1."""


def prove(
    agent: str | None = None,
    *,
    property: str | None = None,
    start: str | None = None,
    off: str = "",
    resolution: int = 1,
    problem: Path | None = None,
    output: Path | None = None,
    check: Path | None = None,
) -> bool:
    """Prove that an agent or a network keeps a property from every start; returns whether that is proved.

    Args:
        agent: an on/off agent that goes to a pose in the plane: a run folder; or FILE.onnx, a network that takes
            the state and gives the commands.
        property: position (m) and heading (degrees) that every flight of the agent stays within for ever.
        start: starts of the agent: every state up to this position, heading, speed (m/s) and spin (rad/s); those
            beyond its limits, at rest, come into them.
        off: how far mass (with the inertia), thrust, and the readings of position, velocity, heading (rad) and
            spin of the agent may be off, and how much later than commanded each valve opens and shuts (s), by
            itself and each time anew; by default 0.
        resolution: how much finer than 1/512 of the range of a start the smallest cells of a network are along
            each state.
        problem: plant, starts and property, a TOML file (docs/proof/proofs.md); with --check the certificate must
            fit it.
        output: certificate to write; by default NAME.certificate.json, or proof.json in a run folder for
            `rans report`.
        check: certificate to check; nothing is proved then.

    Raises:
        ConfigError: one of these does not exist, or no proof is known for the agent.
    """
    return not Prove(**locals()).run()


_FILE = Annotated[Path | None, arg(metavar="FILE")]


@command_of(
    prove,
    agent=word("AGENT", str | None),
    property=Annotated[str | None, arg(metavar="position=M,heading=DEG")],
    start=Annotated[str | None, arg(name="from", metavar="position=M,heading=DEG,...")],
    off=Annotated[str, arg(metavar="mass=PART,thrust=PART,position=M,opening=S,...")],
    problem=_FILE,
    output=_FILE,
    check=Annotated[Path | None, arg(metavar="CERTIFICATE")],
)
class Prove(Options):
    """Prove that an agent or a network keeps a property from every start, or find a flight that breaks it.

    The set of starts is split into cells, each of which is proved as a whole. The exit code is 0 if the property
    is proved everywhere. The certificate is a file of the cells; --check judges one in ball arithmetic, by a
    program that shares no code with the prover.
    """

    group = "Judge"
    guide = "docs/proof/proofs.md"
    divides_work = True
    examples = (
        "rans prove pulse-agent --property position=0.05,heading=5 --from position=0.02,heading=1.5",
        "rans prove network.onnx --problem docking.toml",
        "rans prove network.onnx --check docking.certificate.json",
    )

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return ("rans list AGENTS",)

    def run(self) -> int:
        """Prove or check what the options name, and print the result.

        The exit code is 1 if it is open or refused.
        """
        if not 1 <= self.resolution <= 8:
            raise ConfigError(f"--resolution must be from 1 to 8, got {self.resolution}.")
        if self.agent is None:
            raise ConfigError("name an agent, or the file of a network that ends in .onnx.")
        if not self.agent.endswith(".onnx"):
            if self.problem is not None or Path(self.agent).is_file():
                raise ConfigError(
                    "a network is a file that ends in .onnx, and an agent is a run folder or pretrained:NAME "
                    f"without a --problem, got {brief(self.agent)}."
                )
            return self._check_pose(self.agent) if self.check else self._prove_pose(self.agent)
        if self.problem is None and self.check is None:
            raise ConfigError("name a --problem to prove, or a certificate to --check.")
        network = Path(self.agent)
        return self._check(self.check, network) if self.check is not None else self._prove(network)

    @staticmethod
    def _file(agent: str) -> Path:
        """The certificate of an agent: beside it or, of a shipped one, in the current folder."""
        from rans.extend import ContestantName

        contestant = ContestantName.parse(agent)
        if contestant.kind == "pretrained":
            return Path(f"{contestant.folder.name}.certificate.json")
        return contestant.folder / "proof.json"

    def _prove_pose(self, agent: str) -> int:
        """Search a trapping set of poses, write its certificate and let the checker judge it; the exit code."""
        require("flint")
        from rans.extend import ContestantName, RunFolder, load_policy
        from rans_proof import pose_trap as poses
        from rans_proof.proved import LARGEST, agent_files

        # Which agents can be proved is said before anything is asked for.
        folder = ContestantName.parse(agent).folder
        task = RunFolder(folder).config().task
        run = load_policy(folder)
        network = run.network.architecture
        if task != "go-to-pose" or network.activation != "relu" or len(network.layers) != 2:
            reason = (
                f"{agent} flies {task}, and no proof is known for its network: rans prove proves on/off agents of "
                "go-to-pose with two layers of ReLU whose first units take one column each, such as that of "
                "examples/proofs/pulse_agent.py, and networks in ONNX files with a --problem."
            )
            _not_proved(agent, run, reason)
            raise ConfigError(reason)
        if self.property is None or self.start is None:
            raise ConfigError(
                "name the --property to keep (m, degrees) and the starts, --from, of an agent that goes to a pose, "
                "as in --property position=0.05,heading=5 --from position=0.015,heading=1.5."
            )
        keep = named_numbers(
            self.property, ("position", "heading"), "--property", are_all_needed=True
        )
        start = named_numbers(self.start, ("position", "heading", "speed", "spin"), "--from")
        off = named_numbers(self.off, tuple(poses.PoseErrors.__dataclass_fields__), "--off")
        errors = poses.PoseErrors(**off)
        limits = keep["position"], keep["heading"]
        begin = poses.PoseStart(**{"position": 0.0, "heading": 0.0} | start)
        is_right = 0.0 < limits[0] <= 1.0 and 0.0 < limits[1] <= 45.0
        if not is_right or min(begin) < 0.0 or begin.heading >= 180.0 or begin.position > 5.0:
            raise ConfigError(
                "--property takes a position up to 1 m and a heading up to 45 degrees, and --from starts up to 5 m "
                f"away and below 180 degrees, got {self.property} and {self.start}."
            )
        # Search, then the independent check of what was found.
        begun = time.monotonic()
        files = agent_files(folder)
        terminal = Terminal()
        # A search proposes cells, and the checker judges all of them.
        radians = limits[0], math.radians(limits[1])
        near = begin._replace(heading=math.radians(begin.heading))
        try:
            trap = poses.pose_trap(run, radians, near, errors)
        except ConfigError as error:
            _not_proved(agent, run, f"no trapping set is found: {error}")
            terminal.say(f"Open: no trapping set is found: {error}")
            return 1
        output = self.output or self._file(agent)
        poses.write_pose_trap(trap, limits, begin, errors, files, run.timing.control_period, output)
        content = read_bytes(output, LARGEST)
        theorem, refusal = _posed(content, files)
        if refusal:
            _not_proved(agent, run, f"the checker refuses {output.name}: {refusal}")
            terminal.say(f"Open: the checker refuses {output}: {refusal}")
            return 1
        _record(content)
        _no_proof(agent).unlink(missing_ok=True)
        terminal.say(
            f"Proved: {folder.name} on {run.craft.name}, {theorem}. {int(trap.place.sum()):,} and "
            f"{int(trap.heading.sum()):,} cells, all checked, {time.monotonic() - begun:.1f} s. The certificate is "
            f"{output}."
        )
        terminal.suggest(shlex.join(["rans", "prove", agent, "--check", str(output)]))
        return 0

    def _check_pose(self, agent: str) -> int:
        """Check the certificate of a trapping set against the agent's files; 0 if it is accepted, else 1."""
        require("flint")
        from rans.extend import ContestantName
        from rans_proof.proved import LARGEST, agent_files

        assert self.check is not None
        folder = ContestantName.parse(agent).folder
        content = read_bytes(self.check, LARGEST)
        theorem, refusal = _posed(content, agent_files(folder))
        if refusal:
            Terminal().say(f"Refused: {refusal}")
            return 1
        Terminal().say(f"Accepted. Proved: {folder.name}, {theorem}.")
        _record(content)
        return 0

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
        begun = time.monotonic()
        terminal = Terminal()
        with progress() as bars:
            task = bars.add_task("proving", total=None)
            proof = prove(
                problem,
                layers,
                torch_device("auto"),
                _SMALLEST / self.resolution,
                [_CELLS if problem.states <= 4 else 1] * problem.states,
                lambda done, left: bars.update(task, completed=done, total=done + left),
            )
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
        from rans.processes import nothing
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
        if claim.flight:
            margin, refusal = _checked(None, *contents, [])
            if refusal:
                terminal.say(f"Refused: {refusal}")
                return 1
            terminal.say(
                f"Accepted: the flight breaks the property by {-margin:.3g}, in ball arithmetic.\n\nRefuted of "
                f"{network} (SHA-256 {claim.network[:16]}): {claim.problem['name']}.\n"
                f"{statement(claim.problem)}\nflight from: {claim.flight[0]}"
            )
            return 0
        # Cells are divided among processes.
        count = len(claim.cells)
        chunks = [range(k, min(k + _CHUNK, count)) for k in range(0, count, _CHUNK)]
        jobs = [(*contents, list(chunk)) for chunk in chunks]
        begun = time.monotonic()
        least = math.inf
        with progress() as bars:
            task = bars.add_task("checking", total=count)
            answers = Workers(nothing, (), None, "checked a certificate")
            for _, (margin, refusal) in answers.finished(_checked, jobs):
                if refusal:
                    terminal.say(f"Refused: {refusal}")
                    return 1
                least = min(least, margin)
                bars.advance(task, _CHUNK)
        terminal.say(
            f"Accepted: {count:,} cells cover the starts, and the least margin is {least:.3g}, in ball arithmetic; "
            f"{time.monotonic() - begun:.1f} s.\nProved of {network} (SHA-256 {claim.network[:16]}): "
            f"{claim.problem['name']}.\n{statement(claim.problem)}"
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
        margin, refusal = _checked(None, read_bytes(output, LARGEST), content, [])
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


def _no_proof(agent: str) -> Path:
    """File, beside an agent's results, that says to reports and dossiers why it is not proved."""
    from rans.extend import ContestantName, inside, ready_folder

    return inside(ready_folder(ContestantName.parse(agent).output_folder), "no-proof.json")


def _not_proved(agent: str, run: LoadedRun, reason: str) -> None:
    """Write why an agent is not proved."""
    from rans.evaluation.fly.evidence import about
    from rans.extend import write_json

    made = about(agent, run.judged, "rans.prove")
    write_json(_no_proof(agent), made | {"reason": reason})


def _record(certificate: bytes) -> None:
    """Keep the verdict that a certificate is checked for pages and contracts, and say so if that is impossible."""
    from rans_proof.proved import stated
    from rans_proof.verdicts import record

    if not record(stated(certificate, "the certificate")):
        Terminal().say(
            "The verdict cannot be written below XDG_STATE_HOME, or ~/.local/state: reports will call the "
            "certificate a claim."
        )


def _posed(certificate: bytes, files: dict[str, bytes]) -> tuple[str, str]:
    """What the certificate of a trapping set of poses states, and why it is refused, or ""."""
    from rans_proof.check_pose import check_pose
    from rans_proof.pose_flights import check_pose_as_flown

    theorem = ""

    def judge() -> float:
        nonlocal theorem
        theorem = check_pose(certificate, files).theorem
        check_pose_as_flown(certificate, files)
        return math.inf

    _, refusal = _verdict(judge)
    return theorem, refusal


def _checked(_: None, certificate: bytes, network: bytes, cells: list[int]) -> tuple[float, str]:
    """Least margin of some cells, and why the certificate is refused, or ""."""
    from rans_proof.check import check

    return _verdict(lambda: check(certificate, network, only=cells))


def _verdict(judge: Callable[[], float]) -> tuple[float, str]:
    """The margin that a judge of a certificate computes, and why it refuses the certificate, or "".

    Whatever a judge raises is a refusal, so that a damaged file can never be accepted.
    """
    from rans_proof.balls import Refused

    try:
        return judge(), ""
    except Refused as refusal:
        return 0.0, str(refusal)
    except (
        *(ValueError, LookupError, TypeError, AttributeError),
        *(ArithmeticError, RecursionError, MemoryError),
    ) as error:
        # What a damaged file raises where a judge does not expect it.
        return 0.0, f"it is damaged: {type(error).__name__} {error}"
