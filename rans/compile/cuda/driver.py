"""NVIDIA's driver, without torch."""

from __future__ import annotations

import os
import sys
import threading
from ctypes import CDLL, byref, c_int, c_void_p

LIBRARY = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"


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
        driver = CDLL(LIBRARY)
    except OSError:
        return
    device = c_int()
    context = c_void_p()
    if not driver.cuInit(0) and not driver.cuDeviceGet(byref(device), number):
        driver.cuDevicePrimaryCtxRetain(byref(context), device)
