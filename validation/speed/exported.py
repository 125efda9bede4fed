"""Exported agents as functions: each form of `rans export`, loaded by what runs it on board.

A form answers batches of observations and memories, one row each, with commands and the next memories.
"""

from __future__ import annotations

import ctypes
import importlib.util
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rans.base.errors import ConfigError

Answer = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Of observations (N, width) and memories (N, m): commands (N, thrusters) and the next memories."""


def numpy_answer(folder: Path) -> Answer:
    """What agent.py answers."""
    spec = importlib.util.spec_from_file_location("exported_agent", folder / "agent.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    tables = module.Agent().tables
    return lambda observation, memory: module.answer(tables, observation, memory)


def onnx_answer(folder: Path) -> Answer:
    """What agent.onnx answers on one thread; ImportError without onnxruntime."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(
        str(folder / "agent.onnx"), options, ["CPUExecutionProvider"]
    )
    remembers = len(session.get_inputs()) == 2

    def answer(observation: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        given = {"observation": observation} | ({"memory": memory} if remembers else {})
        found: list[Any] = list(session.run(None, given))
        return found[0], found[1] if remembers else memory

    return answer


def c_compilers() -> dict[str, list[str]]:
    """The C compilers of this machine, as the words that begin their commands, by name.

    Clang may also be the one of the Python package ziglang, where that can be imported.
    """
    found = {name: [path] for name in ("gcc", "clang") if (path := shutil.which(name))}
    if "clang" not in found and importlib.util.find_spec("ziglang") is not None:
        found["clang"] = [sys.executable, "-m", "ziglang", "cc"]
    return found


def c_answer(folder: Path, compiler: Sequence[str] | None = None) -> Answer:
    """What agent.c answers, called row by row; `ConfigError` without a compiler or where it refuses the file.

    Args:
        folder: of agent.c.
        compiler: one of `c_compilers`; by default the first.
    """
    compiler = compiler or next(iter(c_compilers().values()), None)
    if compiler is None:
        raise ConfigError("agent.c needs gcc or clang, and neither is on the PATH.")
    library = folder / "agent.so"
    flags = ["-O2", "-std=c99", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
    made = [*compiler, *flags, folder / "agent.c", "-o", library, "-lm"]
    done = subprocess.run(made, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ConfigError(f"{' '.join(compiler)} refuses agent.c: {done.stderr}")
    call = ctypes.CDLL(str(library)).rans_agent_answer
    call.restype = None
    header = (folder / "agent.h").read_text("utf-8")
    commands = int(header.partition("#define RANS_COMMANDS ")[2].split()[0])

    def answer(observation: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        given = np.ascontiguousarray(observation, np.float32)
        before = np.ascontiguousarray(memory, np.float32)
        command = np.empty((len(given), commands), np.float32)
        after = np.empty_like(before)
        for one in zip(given, before, command, after, strict=True):
            call(*(ctypes.c_void_p(row.ctypes.data) for row in one))
        return command, after

    return answer


ANSWERS: dict[str, Callable[[Path], Answer]] = {
    "onnx": onnx_answer,
    "numpy": numpy_answer,
    "c": c_answer,
}


def answers() -> dict[str, tuple[str, Callable[[Path], Answer]]]:
    """Every form of an export and what answers for it, the C form once for each compiler, by a table's name."""
    found: dict[str, tuple[str, Callable[[Path], Answer]]] = {
        form: (form, answer) for form, answer in ANSWERS.items() if form != "c"
    }
    for name, command in c_compilers().items():
        found[f"c, {name}"] = ("c", partial(c_answer, compiler=command))
    return found
