"""``rans export --format basilisk``: an agent as a module of the simulator Basilisk, beside its NumPy file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from rans.extend import FORMATS, ConfigError, Ports, Program, write_text, written_columns

_MOST = 36
"""Thrusters of Basilisk's messages, MAX_EFF_CNT."""


def write_basilisk(
    folder: Path,
    program: Program,
    ports: Ports,
    title: str,
    contract: str,
    pairs: Mapping[str, Any] | None = None,
) -> None:
    """Write agent.py, agent.npz and agent_basilisk.py; see `rans.deploy.forms.ProgramWriter` for the arguments.

    Raises:
        ConfigError: on-times are not what the spacecraft takes, Basilisk's messages do not hold what the agent
            observes, or the disk refuses.
    """
    about = json.loads(contract)
    ranges = about["command"]["ranges"]
    if about["command"]["wheels"] or len(ranges) > _MOST or any(one["low"] < 0.0 for one in ranges):
        raise ConfigError(
            f"the module for Basilisk gives on-times of up to {_MOST} thrusters that push one way, and this "
            "spacecraft has wheels, more thrusters, or commands either way: export with --format numpy, and hand "
            "its commands to Basilisk's devices."
        )
    columns = ",\n            ".join(written_columns(about))
    frame = (resources.files("rans_missions") / "data/agent_basilisk.py.txt").read_text("utf-8")
    FORMATS["numpy"].write(folder, program, ports, title)
    write_text(folder / "agent_basilisk.py", frame.replace("@COLUMNS@", f"{columns},"))
