"""NVIDIA's runtime compiler and driver: CUDA C++ in, a function to launch out."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Sequence
from ctypes import CDLL, byref, c_char_p, c_int, c_size_t, c_uint, c_void_p
from functools import cache
from pathlib import Path

_OPTIONS = ("--std=c++17", "--ftz=true", "--prec-div=false", "--prec-sqrt=false")
"""float32 divisions and roots may be two units in the last place off; float64 is not affected."""


class CudaError(RuntimeError):
    """The compiler or the driver refused."""


class Function:
    """A kernel on the current device, from CUDA C++ that defines it by this name as ``extern "C"``.

    Raises:
        OSError: there is no runtime compiler or no driver.
        CudaError: the text does not compile; the message is the compiler's.
    """

    def __init__(self, text: str, name: str, capability: tuple[int, int]) -> None:
        self._driver = CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1")
        self._module, self._function = c_void_p(), c_void_p()
        self._check(self._driver.cuModuleLoadData(byref(self._module), compiled(text, capability)))
        self._check(self._driver.cuModuleGetFunction(byref(self._function), self._module, name.encode()))

    def launch(self, blocks: int, threads: int, stream: int, pointers: Sequence[int],
               numbers: Sequence[int]) -> None:
        """Queue the kernel; all its pointers come before its 32-bit numbers."""
        values = (*map(c_void_p, pointers), *map(c_int, numbers))
        places = (c_void_p * len(values))(*map(ctypes.addressof, values))
        one, shared_bytes = c_uint(1), c_uint(0)
        self._check(self._driver.cuLaunchKernel(
            self._function, c_uint(blocks), one, one, c_uint(threads), one, one, shared_bytes,
            c_void_p(stream), places, None))

    def _check(self, error: int) -> None:
        if error:
            text = c_char_p()
            self._driver.cuGetErrorString(error, byref(text))
            raise CudaError(f"the CUDA driver says: {(text.value or b'unknown error').decode()} ({error}).")


@cache
def compiled(text: str, capability: tuple[int, int]) -> bytes:
    """Machine code of CUDA C++ for a device of this capability (major, minor); needs none.

    Raises:
        OSError: there is no runtime compiler.
        CudaError: the text does not compile.
    """
    compiler, program = _compiler(), c_void_p()
    options = [f"--gpu-architecture=sm_{capability[0]}{capability[1]}", *_OPTIONS]
    array = (c_char_p * len(options))(*(option.encode() for option in options))
    compiler.nvrtcCreateProgram(byref(program), text.encode(), b"step.cu", 0, None, None)
    failed = compiler.nvrtcCompileProgram(program, len(options), array)
    kind, size = "ProgramLog" if failed else "CUBIN", c_size_t()
    getattr(compiler, f"nvrtcGet{kind}Size")(program, byref(size))
    result = ctypes.create_string_buffer(size.value)
    getattr(compiler, f"nvrtcGet{kind}")(program, result)
    compiler.nvrtcDestroyProgram(byref(program))
    if failed:
        raise CudaError(f"a generated kernel does not compile: {result.value.decode()}")
    return result.raw


@cache
def _compiler() -> CDLL:
    """NVRTC: as torch's packages install it, or as the system has it."""
    import torch

    major = (torch.version.cuda or "12").partition(".")[0]
    name = f"libnvrtc.so.{major}" if sys.platform != "win32" else f"nvrtc64_{major}0_0.dll"
    for path in (path for folder in sys.path for path in Path(folder).glob(f"nvidia/*/lib/{name}")):
        for needed in path.parent.glob("libnvrtc-builtins.so*"):
            CDLL(str(needed))  # it would be looked for among the system's libraries
        return CDLL(str(path))
    return CDLL(name)
