"""``rans prove``: proofs about closed loops of networks and agents, and the check of their certificates.

Exit codes are an interface: 0 proved or accepted, 1 open or refused; every proof is judged by the checkers before
it is claimed.
"""

from __future__ import annotations

import importlib.util
import math
import shlex
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from tyro.conf import arg

from rans.cli.door import Options, command_of, word
from rans.cli.numbers import named_numbers
from rans.extend import ConfigError, Terminal, brief, is_installed, progress, read_bytes, require

if TYPE_CHECKING:
    from rans_proof.prove import Proof
    from rans_proof.verdicts import Verdict

_CHUNK = 4
"""Cells that a process checks between two reports, some seconds."""
_SAMPLE = 16
"""Cells of an agent's certificate that are checked at once when it is proved, in about a second."""
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
        agent: an on/off agent that tracks velocities in the plane, whose goal is at rest: a run folder or
            pretrained:NAME; or FILE.onnx, a network that takes the state and gives the commands.
        property: limits that every flight of the agent keeps for ever: of one that goes to a pose, position and
            heading.
        start: starts of the agent: every state up to this speed and this spin; for one that goes to a pose also
            position (m) and heading (degrees), and those beyond its limits, at rest, come into them.
        off: how far mass (with the inertia), thrust, and the readings of velocity and spin may be off, and the
            delay of all thrusters, which is one constant, the same to open and to shut; by default 0. Of an agent
            that goes to a pose mass, thrust, the readings of position, velocity, heading (rad) and spin, and
            opening and shutting (s): how much later each valve does either, by itself and each time anew.
        resolution: how much finer cells are along each coordinate: those of an agent, and the smallest ones of a
            network, which are 1/512 of the range of a start by default.
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
    property=Annotated[str | None, arg(metavar="speed=M/S,spin=RAD/S or position=M,heading=DEG")],
    start=Annotated[str | None, arg(name="from", metavar="speed=M/S,spin=RAD/S,...")],
    off=Annotated[str, arg(metavar="mass=PART,thrust=PART,velocity=M/S,spin=RAD/S,delay=S,...")],
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
        "rans prove pretrained:track-velocity-2d --property speed=0.16,spin=1.52 --from speed=0.14,spin=0.15",
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
            return (
                self._check_trap(self.agent, self.check) if self.check else self._trap(self.agent)
            )
        if self.problem is None and self.check is None:
            raise ConfigError("name a --problem to prove, or a certificate to --check.")
        network = Path(self.agent)
        return self._check(self.check, network) if self.check is not None else self._prove(network)

    def _trap(self, agent: str) -> int:
        """Prove a trapping set of velocities, write its certificate and judge it; the exit code."""
        from rans.extend import ContestantName, RunFolder, load_policy
        from rans_proof import trap as traps
        from rans_proof.trap_certificate import LARGEST

        # Which agents can be proved is said before anything is asked for.
        folder = ContestantName.parse(agent).folder
        task = RunFolder(folder).config().task
        if task == "go-to-pose":
            return self._pose(agent, folder)
        if task != "track-velocity":
            raise ConfigError(
                f"{agent} flies {task}, and no proof is known for that: rans prove proves on/off agents that track "
                "velocities in the plane, such as track-velocity-2d, or go to a pose by units of one column, "
                "and networks in ONNX files with a --problem."
            )
        run = load_policy(folder)
        files = _files(folder)
        loop = traps.velocity_loop(run.network, run.craft, run.timing.control_period)
        # Property, starts and errors.
        if self.property is None or self.start is None:
            raise ConfigError(
                "name the --property to keep and the starts, --from, of an agent, as in "
                "--property speed=0.16,spin=1.52 --from speed=0.14,spin=0.15."
            )
        keep = named_numbers(self.property, ("speed", "spin"), "--property", are_all_needed=True)
        start = named_numbers(self.start, ("speed", "spin"), "--from", are_all_needed=True)
        off = named_numbers(self.off, ("mass", "thrust", "velocity", "spin", "delay"), "--off")
        for key, limit in keep.items():
            if not 0.0 < limit <= 10.0:
                raise ConfigError(
                    f"--property {key} must be above 0 and at most 10, got {limit:g}."
                )
            if not 0.0 <= start[key] <= limit:
                raise ConfigError(
                    f"--from {key} must be from 0 to the {limit:g} of --property, got {start[key]:g}."
                )
        begun = time.monotonic()
        terminal = Terminal()
        limits = keep["speed"], keep["spin"]
        begin = start["speed"], start["spin"]
        uncertainty = traps.Uncertainty(**off)
        # A flight that breaks the property is found sooner than a proof.
        broken = traps.broken_flight(loop, limits, begin, uncertainty)
        if broken is not None:
            state, speed, spin = broken
            flown = "" if any(off.values()) else _flown(agent, state)
            terminal.say(
                f"False: the flight from {np.round(state[:2], 5).tolist()} m/s in the body frame and the spin "
                f"{state[2]:.5f} rad/s reaches {speed:.4g} m/s and {spin:.4g} rad/s.{flown}"
            )
            return 1
        # The largest set of cells that no flight leaves; the property is proved if all starts lie in it.
        with progress() as bars:
            task = bars.add_task("proving", total=None)
            trap = traps.trapping_set(
                loop,
                *limits,
                uncertainty,
                traps.GRID.finer(self.resolution),
                report=lambda done, left: bars.update(task, completed=done, total=done + left),
            )
        seconds = time.monotonic() - begun
        if not trap.contains(loop, *begin):
            largest = traps.largest_start(trap, loop, start["spin"])
            terminal.say(
                f"Open: neither proved nor refuted, after {seconds:.1f} s. With this spin starts up to "
                f"{largest:.4g} m/s are proved. A finer --resolution, or wider limits, may prove it."
            )
            return 1
        output = self.output or self._file(agent)
        certificate = traps.write_trap(trap, keep["spin"], begin, files, output)
        # A part of the check, which finds an agent that prover and checker take for different ones.
        how = "not checked"
        if is_installed("flint"):
            count = min(_SAMPLE, len(trap.cells))
            some = np.random.default_rng(0).choice(len(trap.cells), count, replace=False)
            content = read_bytes(output, LARGEST)
            _, refusal = _trapped(None, content, files, some.tolist(), is_flown=True)
            if refusal:
                terminal.say(
                    f"Not proved: the checker refuses {output}: {refusal} Please report it."
                )
                return 1
            how = f"{count} of them checked"
        _record(read_bytes(output, LARGEST), "proved")
        terminal.say(
            f"Proved: {folder.name} on {run.craft.name}, {certificate.theorem}. {len(trap.cells):,} cells, "
            f"{how}, {seconds:.1f} s. The certificate is {output} (SHA-256 {certificate.sha256[:16]})."
        )
        terminal.suggest(shlex.join(["rans", "prove", agent, "--check", str(output)]))
        return 0

    @staticmethod
    def _file(agent: str) -> Path:
        """The certificate of an agent: beside it or, of a shipped one, in the current folder."""
        from rans.extend import ContestantName

        contestant = ContestantName.parse(agent)
        if contestant.kind == "pretrained":
            return Path(f"{contestant.folder.name}.certificate.json")
        return contestant.folder / "proof.json"

    def _pose(self, agent: str, folder: Path) -> int:
        """Prove a trapping set of poses, write its certificate and judge it; the exit code."""
        require("flint")
        from rans.extend import load_policy
        from rans_proof import pose_trap as poses
        from rans_proof.trap_certificate import LARGEST

        run = load_policy(folder)
        network = run.network.architecture
        if network.activation != "relu" or len(network.layers) != 2:
            raise ConfigError(
                f"{agent} flies go-to-pose, and no proof is known for its network: rans prove proves on/off "
                "agents that track velocities in the plane, such as track-velocity-2d, agents of go-to-pose with "
                "two layers of ReLU whose first units take one column each, and ONNX files with a --problem."
            )
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
        limits = keep["position"], keep["heading"]
        begin = poses.PoseStart(
            start.get("position", 0.0),
            start.get("heading", 0.0),
            start.get("speed", 0.0),
            start.get("spin", 0.0),
        )
        is_right = 0.0 < limits[0] <= 1.0 and 0.0 < limits[1] <= 45.0
        if not is_right or min(begin) < 0.0 or begin.heading >= 180.0 or begin.position > 5.0:
            raise ConfigError(
                "--property takes a position up to 1 m and a heading up to 45 degrees, and --from starts up to 5 m "
                f"away and below 180 degrees, got {self.property} and {self.start}."
            )
        # Search, then the independent check of what was found.
        begun = time.monotonic()
        files = _files(folder)
        terminal = Terminal()
        # A search proposes cells, and the checker judges all of them.
        radians = limits[0], math.radians(limits[1])
        near = begin._replace(heading=math.radians(begin.heading))
        try:
            trap = poses.pose_trap(run, radians, near, poses.PoseErrors(**off))
        except ConfigError as error:
            terminal.say(f"Open: no trapping set is found: {error}")
            return 1
        output = self.output or self._file(agent)
        errors = poses.PoseErrors(**off)
        poses.write_pose_trap(trap, limits, begin, errors, files, run.timing.control_period, output)
        content = read_bytes(output, LARGEST)
        theorem, refusal = _posed(content, files)
        if refusal:
            terminal.say(f"Open: the checker refuses {output}: {refusal}")
            return 1
        _record(content, "checked")
        terminal.say(
            f"Proved: {folder.name} on {run.craft.name}, {theorem}. {int(trap.place.sum()):,} and "
            f"{int(trap.heading.sum()):,} cells, all checked, {time.monotonic() - begun:.1f} s. The certificate is "
            f"{output}."
        )
        terminal.suggest(shlex.join(["rans", "prove", agent, "--check", str(output)]))
        return 0

    def _check_trap(self, agent: str, certificate: Path) -> int:
        """Check the certificate of a trapping set against the agent's files; 0 if it is accepted, else 1."""
        require("flint")
        from rans.extend import ContestantName
        from rans_proof.proved import is_of_poses
        from rans_proof.trap_certificate import LARGEST, read_certificate

        # The certificate, the agent and the cover, before other processes begin with the cells.
        folder = ContestantName.parse(agent).folder
        content, files = read_bytes(certificate, LARGEST), _files(folder)
        if is_of_poses(content):
            theorem, refusal = _posed(content, files)
            if refusal:
                Terminal().say(f"Refused: {refusal}")
                return 1
            Terminal().say(f"Accepted. Proved: {folder.name}, {theorem}.")
            _record(content, "checked")
            return 0
        _, refusal = _trapped(None, content, files, [], is_flown=True)
        if refusal:
            Terminal().say(f"Refused: {refusal}")
            return 1
        table = read_certificate(content, certificate)
        count = len(table.cells)
        chunks = [range(k, min(k + 64, count)) for k in range(0, count, 64)]
        jobs = [(content, files, list(chunk)) for chunk in chunks]
        statement = f" Proved: {folder.name}, {table.theorem}."
        code = self._judged(_trapped, jobs, count, 64, statement)
        if code == 0:
            _record(content, "checked")
        return code

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
        from rans_proof.balls import Refused
        from rans_proof.certificate import LARGEST
        from rans_proof.check_problem import claim_of, difference, problem_table, statement
        from rans_proof.network import LARGEST as LARGEST_NETWORK
        from rans_proof.problem import read_problem

        contents = read_bytes(certificate, LARGEST), read_bytes(network, LARGEST_NETWORK)
        differing = ""
        try:
            claim = claim_of(contents[0])
            if self.problem is not None:
                differing = difference(
                    claim.problem, problem_table(read_problem(self.problem).text)
                )
        except Refused as refusal:
            Terminal().say(f"Refused: {refusal}")
            return 1
        if differing:
            Terminal().say(
                f"Refused: it is of another problem than {self.problem}, by {differing}."
            )
            return 1
        if claim.flight:
            margin, refusal = _checked(None, *contents, [])
            if refusal:
                Terminal().say(f"Refused: {refusal}")
                return 1
            Terminal().say(
                f"Accepted: the flight breaks the property by {-margin:.3g}, in ball arithmetic.\n\nRefuted of "
                f"{network} (SHA-256 {claim.network[:16]}): {claim.problem['name']}.\n"
                f"{statement(claim.problem)}\nflight from: {claim.flight[0]}"
            )
            return 0
        # Cells are divided among processes.
        count = len(claim.cells)
        chunks = [range(k, min(k + _CHUNK, count)) for k in range(0, count, _CHUNK)]
        return self._judged(
            _checked,
            [(*contents, list(chunk)) for chunk in chunks],
            count,
            _CHUNK,
            f"\nProved of {network} (SHA-256 {claim.network[:16]}): {claim.problem['name']}.\n"
            + statement(claim.problem),
        )

    def _judged(
        self,
        judge: Callable[..., Any],
        jobs: list[Any],
        count: int,
        chunk: int,
        statement: str = "",
    ) -> int:
        """Judge cells in several processes, and print the result, with the statement that is proved.

        One refusal ends it. Cells are divided among processes, and all of them must have been judged for
        "Accepted".
        """
        from rans.extend import Workers
        from rans.processes import nothing

        begun = time.monotonic()
        least = math.inf
        with progress() as bars:
            task = bars.add_task("checking", total=count)
            answers = Workers(nothing, (), None, "checked a certificate")
            for _, (margin, refusal) in answers.finished(judge, jobs):
                if refusal:
                    Terminal().say(f"Refused: {refusal}")
                    return 1
                least = min(least, margin)
                bars.advance(task, chunk)
        margins = f", and the least margin is {least:.3g}" if np.isfinite(least) else ""
        Terminal().say(
            f"Accepted: {count:,} cells cover the starts{margins}, in ball arithmetic; "
            f"{time.monotonic() - begun:.1f} s.{statement}"
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


def _flown(agent: str, start: np.ndarray) -> str:
    """What a flight from a velocity and a spin reaches in the fast engine, and in Drake if it is installed.

    The start is (3,): velocity, m/s, and spin, rad/s.
    """
    from rans.api.agent import load_agent
    from rans.api.limits import state

    pilot = load_agent(agent)
    at_rest = state((0.0, 0.0))
    first = state((0.0, 0.0), 0.0, start[:2].tolist(), float(start[2]))
    results = ""
    for name in ("fast", "drake") if importlib.util.find_spec("pydrake") else ("fast",):
        states = pilot.fly(engine=name, start=first, goal=at_rest).states
        speed = np.hypot(states.v.x, states.v.y).max()
        spin = np.abs(states.w).max()
        engine = "Drake" if name == "drake" else "the fast engine"
        results += f" In {engine} it reaches {speed:.4g} m/s and {spin:.4g} rad/s."
    return results


def _files(folder: Path) -> dict[str, bytes]:
    """Files of an agent that a certificate is about."""
    from rans_proof.trap_certificate import FILES

    return {name: read_bytes(folder / name, 2**28) for name in FILES}


def _record(certificate: bytes, verdict: Verdict) -> None:
    """Keep a verdict for pages and contracts, and say so if that is impossible."""
    from rans_proof.proved import stated
    from rans_proof.verdicts import record

    if not record(stated(certificate, "the certificate"), verdict):
        Terminal().say(
            "The verdict cannot be written below XDG_STATE_HOME, or ~/.local/state: reports will call the "
            "certificate a claim."
        )


def _trapped(
    _: None,
    certificate: bytes,
    files: dict[str, bytes],
    cells: list[int],
    is_flown: bool = False,
) -> tuple[float, str]:
    """Infinity, as a trapping set has no margins, and why its certificate is refused, or "".

    Only these cells are checked.
    """
    from rans_proof.check_trap import check_trap
    from rans_proof.flown import check_as_flown

    def judge() -> float:
        check_trap(certificate, files, cells)
        if is_flown:
            check_as_flown(certificate, files)
        return math.inf

    return _verdict(judge)


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
