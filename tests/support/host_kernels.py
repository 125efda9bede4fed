"""Generated kernels on a CPU: their very text, beside what they need of CUDA in ``host.cuh``."""

from __future__ import annotations

import atexit
import functools
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from ctypes import CDLL, c_int, c_uint, c_void_p
from pathlib import Path
from typing import Any

import pytest
import torch
from rans_machine_code.cuda import preprocessor, step, update

from rans import Engine
from rans.compile.step_program import trace_step
from rans.fast.stepping.step import Step
from tests.support.engines import actions

COMPILER = next(filter(None, map(shutil.which, ("c++", "g++", "clang++"))), "")
COMMAND = (COMPILER, "-std=c++17", "-O0", "-fPIC")
needs_compiler = pytest.mark.skipif(not COMPILER, reason="needs a C++ compiler")
TOLERANCE = {torch.float64: 1e-12, torch.float32: 2e-5}
"""Some dozen steps multiply a last place of values up to 4 by a hundred at most."""
SEED = 2**40 + 5
"""Both its words differ from zero."""


class HostFunction:
    """A `rans_machine_code.cuda.launch.Function` made by a C++ compiler, whose threads run one after the other."""

    def __init__(self, text: str, name: str, *_: Any) -> None:
        self._library = _compiled(text)
        self._function = self._library[name]

    def launch(
        self, blocks: int, threads: int, pointers: Sequence[int], numbers: Sequence[int]
    ) -> None:
        """As on a GPU."""
        count, size, block, thread = (
            c_uint.in_dll(self._library, name)
            for name in ("gridDim", "blockDim", "blockIdx", "threadIdx")
        )
        count.value, size.value = blocks, threads
        arguments = (*map(c_void_p, pointers), *map(c_int, numbers))
        for block.value in range(blocks):
            for thread.value in range(threads):
                self._function(*arguments)


def launch_on_host(monkeypatch: pytest.MonkeyPatch) -> None:
    """Launch kernels of tensors on a CPU as `HostFunction`."""
    for module in (preprocessor, step, update):
        monkeypatch.setattr(module, "Function", HostFunction)
    monkeypatch.setattr(torch.cuda, "device", lambda _: nullcontext())
    monkeypatch.setattr(torch.cuda, "get_device_capability", lambda: None)


@functools.cache
def _compiled(text: str) -> CDLL:
    path = Path(tempfile.mkdtemp(dir=_header().parent)) / "kernel.cpp"
    path.write_text(f'#include "{_header()}"\n{text}')
    subprocess.run([*COMMAND, "-shared", "-o", path.with_suffix(".so"), path], check=True)
    return CDLL(str(path.with_suffix(".so")))


@functools.cache
def _header() -> Path:
    """Of every kernel here; GCC reads what it made of it before, another compiler the header itself."""
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    header = Path(shutil.copy(Path(__file__).with_name("host.cuh"), folder.name))
    subprocess.run([*COMMAND, "-x", "c++-header", "-o", f"{header}.gch", header], check=True)
    return header


def compare(
    ours: Engine,
    theirs: Engine,
    steps: int = 25,
    form: torch.dtype = torch.uint8,
    given: torch.Tensor | None = None,
) -> int:
    """Fly the same commands; the number of episodes that ended."""
    ends = 0
    tolerance = TOLERANCE[ours.dtype]
    for action in actions(ours.craft, ours.num_envs, steps) if given is None else given:
        a = ours.step(action)
        b = theirs.step(action.to(form))
        ended = a.terminated | a.truncated
        for name, x, y in zip(Step._fields, a, b, strict=True):
            assert (x.shape, x.dtype) == (y.shape, y.dtype), name
            rows = ended if name == "final_observation" else slice(None)
            torch.testing.assert_close(
                y[rows], x[rows], rtol=0, atol=tolerance, msg=lambda m, n=name: f"{n}: {m}"
            )
        ends += int(ended.sum())
    for x, y in zip(ours.save_state()["buffers"], theirs.save_state()["buffers"], strict=True):
        torch.testing.assert_close(y, x, rtol=0, atol=tolerance)
    return ends


@pytest.fixture(name="on_host")
def engine_on_host(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Engine]]:
    """Makes engines on the CPU that step by their kernel."""
    launch_on_host(monkeypatch)

    def make(*args: Any, **kwargs: Any) -> Engine:
        engine = Engine(*args, compiled=True, **kwargs)
        program = trace_step(engine._world, engine.episode, engine.dtype)
        engine._kernel = step.Kernel(program, engine._draws)
        return engine

    with torch.compiler.set_stance("force_eager"):
        yield make
