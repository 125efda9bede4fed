"""Evidence of results: who flew, by SHA-256, with which command and when, for comparison with what a reader has."""

from __future__ import annotations

import contextlib
import hashlib
import inspect
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rans.base.errors import ConfigError
from rans.base.files import environment, inside, made_by, read_bytes
from rans.base.system import PACKAGE_FOLDER
from rans.episode.step import Setup
from rans.evaluation.fly.contestant_name import ContestantName
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.evaluation.fly.make_controller import controller
from rans.evaluation.fly.tuned import tuned
from rans.fast.learn.run_folder import RunFolder
from rans.model.spacecraft_file import to_toml
from rans.randomization.conditions import Conditions
from rans.randomization.conditions_file import conditions_text

_LARGEST = 2**31
"""Largest number of bytes of a file of weights, as for archives."""


def about(spec: str, setup: Setup, function: str) -> dict[str, Any]:
    """What a file of results says of its making: the command or the function, computer and time, and `hashes`."""
    return {
        "command": made_by(function),
        "environment": environment(),
        "hashes": hashes(spec, setup),
    }


def hashes(spec: str, setup: Setup) -> dict[str, str]:
    """SHA-256 of everything that decides how flights end, by name.

    Hashes of an agent's files are those that ``sha256sum`` prints; that of conditions is of the text of
    `conditions_text`; that of the code is of all source files of the package, in the order of names.

    Args:
        spec: text of a contestant; of one that is in memory alone only the setup has hashes.
        setup: setup of its flights.
    """
    code = sorted(file for kind in ("*.py", "*.cuh") for file in PACKAGE_FOLDER.rglob(kind))
    return {
        **question_hashes(spec, setup),
        "conditions": sha256([conditions_text(setup.conditions or Conditions()).encode()]),
        "code of RANS": sha256(
            part
            for file in code
            for part in (
                file.relative_to(PACKAGE_FOLDER).as_posix().encode(),
                read_bytes(file, _LARGEST),
            )
        ),
    }


def question_hashes(spec: str, setup: Setup) -> dict[str, str]:
    """The part of `hashes` that says who flew what, at which trade-off, whatever the options of a command were."""
    known = {"spacecraft": sha256([to_toml(setup.craft).encode()])}
    asked = ""
    with contextlib.suppress(ConfigError):
        name = ContestantName.parse(spec)
        words = name.part, name.frugality, name.asked, name.adapts
        asked = repr(words) * (words != ("", None, (), False))
        files: dict[str, Path | None] = {"policy": name.policy_file}
        if name.kind in ("run folder", "pretrained"):
            run = RunFolder(name.own_folder)
            files = {"weights": run.agent_file, "settings": run.config_file}
            files["policy"] = inside(run.path, "agent.onnx")
            if not name.craft:
                files["spacecraft"] = run.spacecraft_file
        if name.kind == "controller":
            maker: Any = CONTROLLERS[name.name]
            if hasattr(maker, "files"):
                weights = controller(name.name, setup, name.part or None).files  # type: ignore[attr-defined]
                files = {f"weights {k}": file for k, file in enumerate(weights)}
            if not CONTROLLERS.comes_with_rans(name.name):
                files["module"] = Path(inspect.getsourcefile(maker) or "")
            best = tuned(name.name, setup._replace(conditions=None))
            known["settings"] = sha256([repr(best and best.settings).encode()])
        for kind, file in files.items():
            if file is not None and file.is_file():
                known[f"{kind} ({file.name})"] = sha256([read_bytes(file, _LARGEST)])
    return known | {"task and timing": sha256([f"{setup[1:3]!r}{asked}".encode()])}


def sha256(parts: Iterable[bytes]) -> str:
    """SHA-256 of all parts, one after the other."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    return digest.hexdigest()
