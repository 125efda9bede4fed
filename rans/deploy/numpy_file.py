"""An agent's program as a Python file that needs nothing but NumPy, and its tables as an ``.npz``."""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from rans.base.files import replace_file, write_text
from rans.base.languages import Python
from rans.deploy.forms import Format
from rans.deploy.program import Ports
from rans.model.operations import NUMPY, of_row
from rans.policy.program import Program, RowStep

_OF_TABLES: dict[str, str] = {
    "Concat": "np.concatenate(({0},), axis=-1)",
    "Split": "np.split({0}, {1}, axis=-1)",
    "Reshape": "{0}.reshape({1})",
    "MatMul": "{0} @ {1}",
    "Transpose": "np.transpose({0}, {perm})",
    "Gemm": "{0} @ {1}.T + {2}",
    "ArgMax": "np.argmax({0}, axis=1)",
    "Gather": "{0}[{1}]",
    "GatherElements": "np.take_along_axis({0}, {1}, axis={axis})",
}
"""What operations on whole rows and tables are in NumPy; the others are `rans.model.operations.NUMPY`."""
_PARTS = {"observation": "o", "body": "b", "memory": "m", "filters": "f", "command": "c"}
"""Short names for columns by themselves."""
_ROOM = 100
_LINE = 110
"""Longest operation that is written within another, and longest line; characters."""


def write_numpy(folder: Path, program: Program, ports: Ports, title: str, *_: Any) -> None:
    """Write agent.py, whose class ``Agent`` flies, and agent.npz; `ConfigError` where the disk refuses."""
    frame = (resources.files("rans") / "data/export/agent.py.txt").read_text("utf-8")
    lines, tables = printed(program)
    fillings = {
        "TITLE": Python.word(title)[:_LINE],
        "WIDTH": ports.observation,
        "MEMORY": ports.memory,
        "AFTER": Python("memory_out" if ports.memory else "memory"),
        "STEPS": Python("\n".join(map(_broken, lines)).lstrip()),
    }
    write_text(
        folder / "agent.py",
        re.sub(r"__([A-Z]+)__", lambda match: Python.of(fillings[match[1]]), frame),
    )

    stored = {name: program.constants[name] for name in tables}

    def write(draft: Path) -> None:
        with draft.open(
            "wb"
        ) as stream:  # not a path: NumPy adds ".npz" to one that has another ending
            np.savez_compressed(stream, allow_pickle=False, **stored)

    replace_file(folder / "agent.npz", write)


NUMPY_FILES = Format(write_numpy, ("agent.py", "agent.npz"))
"""The form "numpy"."""


def printed(program: Program) -> tuple[list[str], list[str]]:
    """The program's lines, and the names of the tables in them, each ``w["name"]``.

    A value that is read once stands where it is read; operators around it must bind less tightly.
    """
    uses = Counter(name for step in program.steps for name in step.inputs)
    texts: dict[str, str] = {}
    lines = []
    tables = []
    for name, value in program.constants.items():
        texts[name] = repr(float(value)) if value.ndim == 0 else f'w["{name}"]'
        tables += [name] if value.ndim else []
    for step in program.steps:
        text = _text(step, program, texts)
        (first, *others) = step.outputs
        if not others and uses[first] == 1 and len(text) < _ROOM and re.fullmatch(r"x\d+", first):
            # A call binds tighter than any operator around it.
            is_call = _pattern(step.operation).startswith("np.")
            texts[first] = text if is_call or step.operation == "Gather" else f"({text})"
            continue
        name = first if not others else _PARTS.get(step.inputs[0], f"{step.inputs[0]}_parts")
        texts |= (
            {part: f"{name}[{index}]" for index, part in enumerate(step.outputs)} if others else {}
        )
        lines.append(f"{name} = {text}")
    used = "\n".join(lines)
    return lines, [name for name in tables if f'w["{name}"]' in used]


def _broken(line: str) -> str:
    """The line of a function, over several lines and in parentheses where it is longer than `_LINE`."""
    if len(line) + 4 > _LINE:
        name, _, text = line.partition(" = ")
        line = f"{name} = ({text})"
    return textwrap.fill(
        line,
        _LINE,
        initial_indent=" " * 4,
        subsequent_indent=" " * 8,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _text(step: RowStep, program: Program, texts: Mapping[str, str]) -> str:
    """The operation on its inputs as they are known: by name, or written out."""
    inputs = [texts.get(name, name) for name in step.inputs]
    whole = program.constants.get(step.inputs[-1], np.zeros(()))
    match step.operation:
        case "Concat":
            inputs = [", ".join(inputs)]
        case "Split":
            ends = len(whole) if (whole == 1).all() else np.cumsum(whole)[:-1].tolist()
            inputs = [inputs[0], str(ends)]
        case "Reshape":
            inputs = [inputs[0], ", ".join(map(str, whole))]
    return _pattern(step.operation).format(*inputs, **step.attributes)


def _pattern(operation: str) -> str:
    """What an operation is in NumPy, of operands in braces."""
    return _OF_TABLES.get(operation) or NUMPY.pattern(*of_row(operation))
