"""An agent's program as a Python file that needs nothing but NumPy, and its tables as an ``.npz``."""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

import numpy as np

from rans.deploy.program import Ports
from rans.files import replace_file, write_text
from rans.policy.program import Program, Step

_PRINTED: dict[str, str] = {
    "Add": "{0} + {1}",
    "Sub": "{0} - {1}",
    "Mul": "{0} * {1}",
    "Div": "{0} / {1}",
    "Neg": "-{0}",
    "Equal": "{0} == {1}",
    "Greater": "{0} > {1}",
    "Where": "np.where({0}, {1}, {2})",
    "Clip": "np.clip({0}, {1}, {2})",
    "Max": "np.maximum({0}, {1})",
    "Min": "np.minimum({0}, {1})",
    "Tanh": "np.tanh({0})",
    "Relu": "np.maximum({0}, 0)",
    "Sigmoid": "0.5 + 0.5 * np.tanh(0.5 * {0})",
    "Elu": "np.where({0} > 0, {0}, np.expm1(np.minimum({0}, 0)))",
    "MatMul": "{0} @ {1}",
    "Transpose": "np.transpose({0}, {perm})",
    "ReduceMax": "np.max({0}, axis=-1, keepdims=True)",
    "ReduceSum": "np.sum({0}, axis=-1, keepdims=True)",
    "Gemm": "{0} @ {1}.T + {2}",
    "ArgMax": "np.argmax({0}, axis=1)",
    "Gather": "{0}[{1}]",
    "GatherElements": "np.take_along_axis({0}, {1}, axis={axis})",
    "Identity": "{0}",
    "Less": "({0} < {1})",
    "Exp": "np.exp({0})",
    "GreaterOrEqual": "({0} >= {1})",
    "LessOrEqual": "({0} <= {1})",
    "And": "np.logical_and({0}, {1})",
    "Or": "np.logical_or({0}, {1})",
    "Abs": "np.abs({0})",
    "Floor": "np.floor({0})",
    "Round": "np.round({0})",
    "Sqrt": "np.sqrt({0})",
    "Sin": "np.sin({0})",
    "Cos": "np.cos({0})",
    "Log": "np.log({0})",
    "Cast": "({0}).astype(np.float32)",
}
"""What each operation is in NumPy."""
_CALLS = {"Concat", "Gather", *(name for name, text in _PRINTED.items() if text.startswith("np."))}
"""Operations that bind tighter than any operator, whatever stands around them."""
_PARTS = {"observation": "o", "body": "b", "memory": "m", "filters": "f", "command": "c"}
"""Short names for columns by themselves."""
_ROOM = 100
_LINE = 110
"""Longest operation that is written within another, and longest line; characters."""


def write_numpy(folder: Path, program: Program, ports: Ports, title: str) -> None:
    """Write agent.py, whose class ``Agent`` flies, and agent.npz; `ConfigError` where the disk refuses."""
    frame = (resources.files("rans") / "data/export/agent.py.txt").read_text("utf-8")
    lines, tables = printed(program)
    # The title has names that strangers may have given, and this is code.
    fillings = {
        "TITLE": re.sub(r"[^\w .,:;()'-]", "?", title)[:_LINE],
        "WIDTH": ports.observation,
        "MEMORY": ports.memory,
        "AFTER": "memory_out" if ports.memory else "memory",
        "STEPS": "\n".join(map(_broken, lines)).lstrip(),
    }
    write_text(
        folder / "agent.py", re.sub(r"__([A-Z]+)__", lambda match: str(fillings[match[1]]), frame)
    )

    stored = {name: program.constants[name] for name in tables}

    def write(draft: Path) -> None:
        with draft.open(
            "wb"
        ) as stream:  # not a path: NumPy adds ".npz" to one that has another ending
            np.savez_compressed(stream, allow_pickle=False, **stored)

    replace_file(folder / "agent.npz", write)


def printed(program: Program) -> tuple[list[str], list[str]]:
    """The program's lines, and the names of the tables in them, each ``w["name"]``."""
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
            texts[first] = text if step.operation in _CALLS else f"({text})"
            continue
        name = first if not others else _PARTS.get(step.inputs[0], f"{step.inputs[0]}_parts")
        texts |= (
            {part: f"{name}[{index}]" for index, part in enumerate(step.outputs)} if others else {}
        )
        lines.append(f"{name} = {text}")
    used = "\n".join(lines)
    return lines, [name for name in tables if f'w["{name}"]' in used]


def _broken(line: str) -> str:
    """The line of a function, over several where it is long."""
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


def _text(step: Step, program: Program, texts: Mapping[str, str]) -> str:
    """The operation on its inputs as they are known: by name, or written out."""
    inputs = [texts.get(name, name) for name in step.inputs]
    whole = program.constants.get(step.inputs[-1], np.zeros(()))
    match step.operation:
        case "Concat":
            return f"np.concatenate(({', '.join(inputs)},), axis=-1)"
        case "Split":
            ends = len(whole) if (whole == 1).all() else np.cumsum(whole)[:-1].tolist()
            return f"np.split({inputs[0]}, {ends}, axis=-1)"
        case "Reshape":
            return f"{inputs[0]}.reshape({', '.join(map(str, whole))})"
    return _PRINTED[step.operation].format(*inputs, **step.attributes)
