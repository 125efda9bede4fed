"""``rans export --format fmu``: an agent as a functional mock-up unit of FMI 2.0 for co-simulation.

The agent's unit is the C export: its inputs are the columns of an observation, its outputs the commands.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rans.deploy.c.files import write_c
from rans.extend import ConfigError, Ports, Program
from rans_robot.fmu.unit import Variable, write_unit


def write_fmu(
    folder: Path,
    program: Program,
    ports: Ports,
    title: str,
    contract: str,
    pairs: Mapping[str, Any] | None = None,
) -> None:
    """Write agent.fmu; see `rans.deploy.forms.ProgramWriter` for the arguments.

    Raises:
        ConfigError: the agent has no contract, the program has an operation that is not known in C, the compiler
            refuses the sources, or the disk refuses.
    """
    if not contract:
        raise ConfigError(
            "an FMU states control period, inputs and outputs, which need a contract."
        )
    about = json.loads(contract)
    with tempfile.TemporaryDirectory() as name:
        build = Path(name)
        write_c(build, program, ports, title, contract, pairs)
        write_unit(
            folder,
            build,
            str(about["agent"]),
            title,
            float(about["control_period"]),
            _variables(about),
            contract.encode(),
        )


def _variables(about: Mapping[str, Any]) -> list[Variable]:
    """Inputs, outputs and notes with the contract's units and meanings; FMI importers rely on names and order."""
    columns = [
        Variable(
            f"observation[{at}]",
            f"{column['name']}, frame {column['frame']}: {column['meaning']}",
            "input",
            str(column["unit"]),
        )
        for at, column in enumerate(about["observation"])
    ]
    commands = [
        Variable(
            f"command[{at}]",
            f"{command['name']}, {command['kind']}",
            "output",
            low=float(command["low"]),
            high=float(command["high"]),
        )
        for at, command in enumerate(about["command"]["ranges"])
    ]
    meaning = "sum of the flags RANS_HELD and others of agent.h; 0 where all is well"
    notes = Variable("notes", meaning, "output", is_integer=True)
    return [*columns, *commands, notes]
