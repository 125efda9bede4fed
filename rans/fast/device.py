"""Torch device of a command or a training, and NVIDIA's driver; neither imports torch at once."""

from __future__ import annotations

import os
import sys
import threading
from ctypes import CDLL, byref, c_int, c_void_p

DRIVER = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"
"""Library of NVIDIA's driver."""


def torch_device(device: str = "auto") -> str:
    """Torch device for "auto", "cpu" or "cuda"; "auto" is a GPU if there is one."""
    if device != "auto":
        return device
    import torch  # late: names are checked without it

    return "cuda" if torch.cuda.is_available() else "cpu"


def open_ahead() -> None:
    """Begin to open the GPU that this process will use, if there is one, while torch is imported.

    The driver takes a third of a second, in which it leaves Python alone; torch then finds it open.
    """
    threading.Thread(
        target=_open, args=(int(os.environ.get("LOCAL_RANK", "0")),), daemon=True
    ).start()


def _open(number: int) -> None:
    """Begin the device's context for torch; a failure here is silent, because torch will report it."""
    try:
        driver = CDLL(DRIVER)
    except OSError:
        return
    device = c_int()
    context = c_void_p()
    if not driver.cuInit(0) and not driver.cuDeviceGet(byref(device), number):
        driver.cuDevicePrimaryCtxRetain(byref(context), device)
