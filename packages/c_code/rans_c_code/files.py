"""An agent's program as one header and one source of C99, without allocation and without a dependency.

The files are those of the folder data, which compile as they stand: what differs between agents lies between the
marks of `filled`, with a sample.
"""

from __future__ import annotations

import json
import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from rans.extend import Ports, Program, write_text
from rans_c_code.compiler import measured_stack
from rans_c_code.printer import Printer
from rans_c_code.text import C, literal, rows_of

_PLACES = re.compile(r"/\*@([A-Z]+)\*/(.*?)/\*@\*/|@([A-Z]+)@", re.DOTALL)


def write_c(
    folder: Path,
    program: Program,
    ports: Ports,
    title: str,
    contract: str = "",
    pairs: Mapping[str, Any] | None = None,
    prefix: str = "",
) -> None:
    """Write agent.h and agent.c, and agent_check.c with golden pairs, where there are some.

    A prefix stands in place of rans_agent and RANS in all public names, so that two agents are
    linked into one program. The marks of the files in data must all be filled.

    Raises:
        ConfigError: the program has an operation that is not known in C, or the disk refuses.
    """
    # What the frame of the source is filled with: sizes, comments from the contract, tables and
    # steps.
    about = json.loads(contract) if contract else {}
    columns = about.get("observation", [])
    commands = about.get("command", {}).get("ranges", [])
    printer = Printer(program, ports)
    body = printer.lines()
    patience = 0
    if about:
        patience = int(about["readings"]["oldest"] / about["control_period"] + 1e-6)
    remembers = ports.memory > 0
    names: dict[str, Any] = {
        "TITLE": title,
        "WIDTH": ports.observation,
        "COMMANDS": ports.command,
        "MEMORY": ports.memory,
        "KEPT": max(ports.memory, 1),
        "PATIENCE": patience,
        "PERIOD": f"{about.get('control_period', 0.0):g}",
        "COLUMNS": _noted(
            f"{column['name']}, {column['unit']}, frame {column['frame']}: {column['meaning']}"
            for column in columns
        ),
        "ORDER": _noted(
            f"{command['name']}, {command['kind']}, {command['low']:g} to {command['high']:g}"
            for command in commands
        ),
        "RANGES": C(
            f"{_ranges(columns, ports.observation)}\nstatic const float pushes[RANS_COMMANDS * 6] = {{\n    "
            f"{rows_of(_pushes(about, ports.command))}}};"
        ),
        "TABLES": C("\n".join(printer.tables())),
        "STEPS": C("\n".join("    " + line for line in body)),
        "FORGET": remembers or "    (void)agent;",
        "CHECKBEFORE": remembers,
        "CHECKAFTER": remembers,
        "KEEP": remembers,
        "FORGOTTEN": remembers,
        "REMEMBERED": remembers or "NULL",
        "AFTER": remembers or "NULL",
        "SCRATCH": remembers,
        "UNUSED": C("" if remembers else "    (void)memory;\n    (void)after;\n"),
        "STACK": C("/* Measure the stack that rans_agent_act needs by gcc -fstack-usage. */"),
    }

    def write(name: str, values: Mapping[str, Any]) -> None:
        text = filled((resources.files("rans_c_code") / "data" / name).read_text("utf-8"), values)
        if prefix:
            text = re.sub(r"\brans_agent(?=\b|_)", prefix, text)
            text = re.sub(r"\bRANS(?=_[A-Z])", prefix.upper(), text)
        write_text(folder / name, text)

    for name in ("agent.h", "agent.c"):
        write(name, names)
    # The stack is measured by compiling what was written; the header then states it.
    if stack := measured_stack(folder):
        note = C(
            f"#define RANS_STACK {stack} /* bytes of stack for rans_agent_act, by the compiler's -O2 on "
            f"{platform.machine()};\n"
            "                          * those of tanhf and its like come on top. Measure yours by "
            "-fstack-usage. */"
        )
        write("agent.h", names | {"STACK": note})
    if pairs is not None:
        write("agent_check.c", _checked(pairs))


def filled(text: str, values: Mapping[str, Any]) -> str:
    """A file with the values of one agent in place of the samples.

    Where code differs, a sample stands between ``/*@NAME*/`` and ``/*@*/``; in a comment there is the name alone,
    ``@NAME@``. True leaves a sample as it is, False leaves it out; a text that is no `C` is escaped.
    """

    def value(match: re.Match[str]) -> str:
        given = values[match[1] or match[3]]
        if isinstance(given, bool):
            return match[2] if given else ""
        return C.of(given)

    return _PLACES.sub(value, text)


def _noted(sentences: Iterable[str]) -> C:
    """Lines of a comment, numbered from 0."""
    lines = [f" * {at:3d}  {C.word(sentence)}" for at, sentence in enumerate(sentences)]
    return C("\n".join(lines) or " * (see contract.json)")


def _ranges(columns: Sequence[Mapping[str, Any]], width: int) -> C:
    """C tables of the valid and refused ranges of ``width`` columns; valid ones get a slack of 1e-5 for float32.

    Firmware checks observations by them, in columns' order.
    """
    texts = []
    for name, slack in (("valid", 1e-5), ("refused", 0.0)):
        for end, side in (("low", 0), ("high", 1)):
            bound = [-3.4e38, 3.4e38][side]
            numbers = [column[name][side] + (2 * side - 1) * slack for column in columns] or [
                bound
            ] * width
            texts.append(
                f"static const float {name}_{end}[RANS_OBSERVATION] = {{\n    "
                f"{rows_of([literal(x) for x in numbers])}}};"
            )
    return C("\n".join(texts))


def _pushes(about: Mapping[str, Any], count: int) -> list[str]:
    """Force and torque, N and N m in B, of each command; of a wheel, and without a contract, zeros."""
    rows = np.zeros((count, 6))
    for row, thruster in zip(rows, about.get("command", {}).get("thrusters", []), strict=False):
        force = np.multiply(thruster["direction"], thruster["force"])
        row[:] = [*force, *np.cross(thruster["position"], force)]
    return [literal(x) for x in rows.ravel().tolist()]


def _checked(pairs: Mapping[str, Any]) -> dict[str, Any]:
    """Golden pairs (`rans.deploy.contract.golden`) as the names that agent_check.c has between its marks."""

    def flat(rows: Sequence[Sequence[float]]) -> C:
        return C(rows_of([literal(float(x)) for row in rows for x in row]))

    return {
        "COUNT": len(pairs["begins"]),
        "TOLERANCE": C(literal(float(pairs["tolerance"]))),
        "BEGINS": C(rows_of([str(int(x)) for x in pairs["begins"]])),
        "OBSERVATIONS": flat(pairs["observation"]),
        "EXPECTED": flat(pairs["command"]),
    }
