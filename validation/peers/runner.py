"""Runs the peers' scripts, each in an environment that has it, and reads what they print."""

from __future__ import annotations

import importlib.util
import json
import os
import shlex
import subprocess
import sys
import tempfile
import venv
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rans.files import write_text

_FOLDER = Path(__file__).parent
_INSTALL_SECONDS = 900.0
_RUN_SECONDS = 900.0
"""Longer than that nobody waits: JAX with its libraries is a download of 200 MB."""


@dataclass(frozen=True)
class Peer:
    """A package to be measured beside ours."""

    package: str
    """On PyPI."""
    module: str
    """What it is imported as."""
    script: str
    """In this folder."""
    requirements: tuple[str, ...]
    """What pip is to install, with the versions the script was tested with."""


PEERS = (
    Peer("stable-baselines3", "stable_baselines3", "sb3_ppo.py", ()),
    Peer(
        "rltools",
        "rltools",
        "rltools_ppo.py",
        ("rltools[mkl]==2.2.1", "mkl==2026.2.0", "mkl-include==2026.2.0"),
    ),  # ten times slower without
    Peer(
        "rejax",
        "rejax",
        "rejax_ppo.py",
        ("rejax==0.1.3", "gymnax==0.0.9", "jax==0.10.2", "six==1.17.0"),
    ),  # with newer ones it does not run
    Peer(
        "crazyflow",
        "crazyflow",
        "crazyflow_reach_pos.py",
        ("crazyflow==0.4.0", "jax==0.10.1", "mujoco==4.0.0", "mujoco-mjx==3.17.0"),
    ),
    Peer("l2f", "l2f", "l2f_hover.py", ("l2f==2.0.18", "numpy==2.4.6")),
    Peer("bsk", "Basilisk", "basilisk_thrusters.py", ("bsk==2.12.1", "numpy==2.4.6")),
    Peer(
        "playground",
        "mujoco_playground",
        "playground_point_mass.py",
        (
            "playground==0.2.0",
            "jax==0.10.2",
            "mujoco==4.0.0",
            "mujoco-mjx==3.17.0",
            "warp-lang==1.19.0",
        ),
    ),
    Peer(
        "gymnax", "gymnax", "gymnax_point_robot.py", ("gymnax==1.0.1", "jax==0.10.2", "six==1.17.0")
    ),  # gymnax imports six without asking for it
    Peer(
        "brax",
        "brax",
        "brax_reacher.py",
        ("brax==0.14.2", "jax==0.10.2", "mujoco==4.0.0", "mujoco-mjx==3.17.0"),
    ),
    Peer("envpool", "envpool", "envpool_lunar_lander.py", ("envpool==1.2.5", "numpy==2.4.6")),
)
"""Trainers, then simulators. Stable-Baselines3 is one of our own dependencies, so it is never installed."""


class _Failed(Exception):
    """Why there is nothing to show."""


@dataclass(frozen=True)
class PeerResult:
    """What became of one peer."""

    package: str
    command: str
    """What measured it; type it again to measure again."""
    installed_by: str = ""
    """What installed it before, if anything had to."""
    figures: dict[str, Any] = field(default_factory=dict)
    """What its script printed, see `validation.peers.stopwatch.say`; empty where it failed."""
    reason: str = ""
    """Why it failed."""


def default_folder() -> Path:
    """Where the peers' environments are kept: ``rans/peers`` in the user's cache."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rans" / "peers"


def measure_peer(peer: Peer, device: str, folder: Path, quick: bool = False) -> PeerResult:
    """Install a peer where it is missing, and measure it; whatever goes wrong is in the result.

    A package that this interpreter can import is measured with this interpreter. Others get a virtual
    environment of their own, once.

    Args:
        peer: whom to measure.
        device: cpu or cuda.
        folder: of the virtual environments.
        quick: fewer environments and repeats.
    """
    here = importlib.util.find_spec(peer.module) is not None
    requirements = [
        r.replace("jax", "jax[cuda12]") if device == "cuda" and r.startswith("jax==") else r
        for r in peer.requirements
    ]
    home = folder.resolve() / f"{peer.package}-{device}"
    python = Path(sys.executable) if here else home / "bin" / "python"
    command = [
        str(python),
        str(_FOLDER / peer.script),
        "--device",
        device,
        *(["--quick"] if quick else []),
    ]
    pip = [
        str(python),
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        *requirements,
    ]
    installed_by = "" if here else shlex.join(pip)
    try:
        if not here:
            _install(home, pip)
        figures = json.loads(_output(command, _RUN_SECONDS, _environment(here)).splitlines()[-1])
    except (_Failed, OSError, ValueError, IndexError) as error:
        return PeerResult(peer.package, shlex.join(command), installed_by, reason=str(error))
    return PeerResult(peer.package, shlex.join(command), installed_by, figures)


def _install(home: Path, pip: Sequence[str]) -> None:
    """Make a virtual environment; a note in it says what it holds, once it is complete."""
    note = home / "installed.txt"
    content = shlex.join(pip)
    if note.exists() and note.read_text("utf-8") == content:
        return
    venv.create(home, clear=True, with_pip=True)
    _output(pip, _INSTALL_SECONDS, _environment(here=False))
    write_text(note, content)


def _environment(here: bool) -> dict[str, str]:
    """A peer's own environment must not find our packages; ours must, wherever it was started."""
    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return inherited | ({"PYTHONPATH": str(_FOLDER.parents[1])} if here else {})


def _output(command: Sequence[str], seconds: float, environment: dict[str, str]) -> str:
    """What a command prints."""
    try:
        with tempfile.TemporaryDirectory() as folder:  # MuJoCo logs into the current one
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                timeout=seconds,
                check=False,
                stdin=subprocess.DEVNULL,
                env=environment,
                cwd=folder,
            )
    except subprocess.TimeoutExpired as error:
        raise _Failed(f"not done after {seconds:.0f} s") from error
    if done.returncode != 0:
        raise _Failed(_last_error(done.stderr) or f"exit code {done.returncode}")
    return done.stdout


def _last_error(text: str) -> str:
    """The last line that speaks of an error; pip's very last ones only say that it is not to blame."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    errors = [line for line in lines if "Error: " in line or line.startswith("ERROR: ")]
    return (errors or lines or [""])[-1]
