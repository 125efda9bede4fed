"""Where the command ``rans`` starts: Ctrl-C ends it without a traceback, also while its parts are loaded."""

from __future__ import annotations

import gc
import signal
from types import FrameType

_NEW_OBJECTS = 50_000
"""Between looks for garbage; Python's default is 700 to 2,000."""


def main() -> int:
    """Run the command line; see `rans.cli.main`.

    While torch is imported and compiles, Python would look through its objects for garbage again and again,
    and through all of them once more at its end: up to a third of a command's time (docs/speed.md).
    """
    gc.set_threshold(_NEW_OBJECTS)
    try:
        return _interruptible()
    finally:
        gc.freeze()


def _interruptible() -> int:
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        return _run()  # interrupts are ignored, as in a shell script's `rans ... &`
    signal.signal(signal.SIGINT, _interrupt)
    try:
        return _run()
    finally:  # Python's way out: nothing is left to lose
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def _run() -> int:
    from rans.cli import main as run

    return run()


def _interrupt(_: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, but end the process at once in the middle of an import.

    Libraries in C++ turn an exception in their initialisation into an ImportError, or abort.
    """
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            signal.raise_signal(signal.SIGINT)
        frame = frame.f_back
    raise KeyboardInterrupt
