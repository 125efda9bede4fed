"""What is asked of NVRTC, by a compiler that writes down each call; machines with a GPU run the real one."""

from __future__ import annotations

from typing import Any

import pytest
from rans_machine_code.cuda import launch


class Compiler:
    """NVRTC's C functions: every program has the same machine code, or the same log."""

    def __init__(self, fails: bool) -> None:
        self.fails = fails
        self.programs: list[bytes] = []
        self.options: list[bytes] = []
        self.open = 0

    def nvrtcCreateProgram(self, program: Any, text: bytes, *_: Any) -> None:
        program._obj.value = 7
        self.programs.append(text)
        self.open += 1

    def nvrtcCompileProgram(self, program: Any, count: int, options: Any) -> int:
        assert program.value == 7
        self.options += options[:count]
        return int(self.fails)

    def nvrtcDestroyProgram(self, program: Any) -> None:
        assert program._obj.value == 7
        self.open -= 1

    def __getattr__(self, name: str) -> Any:
        """Functions that return the size of a text in bytes, with C's zero at the end of a log, or the text."""
        text = {"CUBIN": b"\x7fELF\0code", "ProgramLog": b"step.cu(1): error\0"}[
            name.removeprefix("nvrtcGet").removesuffix("Size")
        ]

        def answer(_: Any, result: Any) -> None:
            if name.endswith("Size"):
                result._obj.value = len(text)
            else:
                result.raw = text

        return answer


@pytest.mark.parametrize("fails", [False, True])
def test_a_text_becomes_machine_code_or_an_error_with_the_compilers_log(fails, monkeypatch):
    compiler = Compiler(fails)
    monkeypatch.setattr(launch, "_compiler", lambda: compiler)
    # Without the cache of files, and of functions.
    monkeypatch.setattr(launch, "kept", lambda _, make: make())
    if fails:
        with pytest.raises(launch.CudaError, match=r"does not compile: step\.cu\(1\): error$"):
            launch.compiled.__wrapped__("int x;", (9, 0))
    else:
        assert launch.compiled.__wrapped__("int x;", (9, 0)) == b"\x7fELF\0code"
    assert compiler.programs == [b"int x;"]
    assert b"--gpu-architecture=sm_90" in compiler.options
    assert len(compiler.options) == 5
    assert compiler.open == 0
