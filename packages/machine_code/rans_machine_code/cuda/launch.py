"""The kernel as the step of an engine, by NVIDIA's runtime compiler and driver."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Sequence
from ctypes import CDLL, byref, c_char_p, c_int, c_size_t, c_uint, c_void_p
from functools import cache
from pathlib import Path

import torch

from rans.fast.device import DRIVER
from rans_machine_code.cuda.kernel_cache import kept

_OPTIONS = ("--std=c++17", "--ftz=true", "--prec-div=false", "--prec-sqrt=false")
"""float32 divisions and roots may be two units in the last place off; float64 is not affected."""
_SHARED_BYTES = 8
"""CU_FUNC_ATTRIBUTE_MAX_DYNAMIC_SHARED_SIZE_BYTES."""


class CudaError(OSError):
    """The compiler or the driver refused."""


class Function:
    """A kernel on the current device, from CUDA C++ that defines it by this name as ``extern "C"``.

    Its blocks have so many bytes of shared memory beside what the text asks for.

    Raises:
        OSError: there is no runtime compiler or no driver.
        CudaError: the text does not compile; the message is the compiler's.
    """

    def __init__(self, text: str, name: str, capability: tuple[int, int], shared: int = 0) -> None:
        self._driver = CDLL(DRIVER)
        self._module = c_void_p()
        self._function = c_void_p()
        self._check(self._driver.cuModuleLoadData(byref(self._module), compiled(text, capability)))
        self._check(
            self._driver.cuModuleGetFunction(byref(self._function), self._module, name.encode())
        )
        self._shared = shared
        if shared:
            self._check(
                self._driver.cuFuncSetAttribute(self._function, _SHARED_BYTES, c_int(shared))
            )

    def launch(
        self,
        blocks: int,
        threads: int,
        pointers: Sequence[int],
        numbers: Sequence[int],
    ) -> None:
        """Queue the kernel on torch's stream; arguments are device addresses, then 32-bit numbers, in its order.

        Queued work is not waited for, and no type is checked: a wrong order reads or writes foreign memory.
        """
        values = (*map(c_void_p, pointers), *map(c_int, numbers))
        places = (c_void_p * len(values))(*map(ctypes.addressof, values))
        one = c_uint(1)
        shared_bytes = c_uint(self._shared)
        self._check(
            self._driver.cuLaunchKernel(
                self._function,
                c_uint(blocks),
                one,
                one,
                c_uint(threads),
                one,
                one,
                shared_bytes,
                c_void_p(torch.cuda.current_stream().cuda_stream),
                places,
                None,
            )
        )

    def _check(self, error: int) -> None:
        if error:
            text = c_char_p()
            self._driver.cuGetErrorString(error, byref(text))
            raise CudaError(
                f"the CUDA driver says: {(text.value or b'unknown error').decode()} ({error})."
            )


@cache
def compiled(text: str, capability: tuple[int, int]) -> bytes:
    """Machine code of CUDA C++ for a device of this capability (major, minor); needs none."""
    options = [f"--gpu-architecture=sm_{capability[0]}{capability[1]}", *_OPTIONS]
    return kept(f"{torch.version.cuda} {options} {text}", lambda: _compiled(text, options))


def _compiled(text: str, options: Sequence[str]) -> bytes:
    """CUBIN that NVRTC makes of CUDA C++ with these options.

    Raises:
        CudaError: the text does not compile; the message has the compiler's log.
    """
    compiler = _compiler()
    program = c_void_p()
    array = (c_char_p * len(options))(*(option.encode() for option in options))
    compiler.nvrtcCreateProgram(byref(program), text.encode(), b"step.cu", 0, None, None)
    failed = compiler.nvrtcCompileProgram(program, len(options), array)
    kind = "ProgramLog" if failed else "CUBIN"
    size = c_size_t()
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
    major = (torch.version.cuda or "12").partition(".")[0]
    name = f"libnvrtc.so.{major}" if sys.platform != "win32" else f"nvrtc64_{major}0_0.dll"
    for path in (path for folder in sys.path for path in Path(folder).glob(f"nvidia/*/lib/{name}")):
        for needed in path.parent.glob("libnvrtc-builtins.so*"):
            CDLL(str(needed))  # it would be looked for among the system's libraries
        return CDLL(str(path))
    return CDLL(name)
