"""Where the command ``rans`` starts: Ctrl-C ends it without a traceback, also while its parts are loaded."""

from __future__ import annotations

import _thread
import atexit
import ctypes
import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from types import FrameType
from typing import NoReturn, TextIO

_NEW_OBJECTS = 50_000
"""Between looks for garbage; Python's default is 700 to 2,000."""
_MOMENT = 0.05
"""Until an interrupt that was lost comes again, s."""
_ALARMS = (signal.SIGALRM,) if hasattr(signal, "SIGALRM") else ()
"""Signals by which an interrupt comes again; on Windows, which has none, a thread repeats it."""
_ENDS = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1")
    if hasattr(signal, name)
]
"""Signals that interrupt: Ctrl-C, a queue's end and its warning, and a terminal or ssh session that closes."""
_HELD_BACK = ("_again", "_acquire_restore")
"""Functions, here and of threading.Condition, in which an interrupt would be lost or break what it meets."""


def run() -> NoReturn:
    """What the command is: `main`, and the process's end without half a second of clearing up.

    Python would free millions of objects of torch one by one, and the driver a GPU's memory piece by piece.
    What was registered for the end is done, and what was printed is on its way, also by libraries in C.
    """
    fill_closed_streams()
    restart_in_utf8()
    os.environ.setdefault(
        "PYTHONSAFEPATH", "1"
    )  # no process of ours looks for modules in this folder first
    with says_that_it_loads(sys.argv[1:]):
        code = main()
    if any(
        not thread.daemon
        for thread in threading.enumerate()
        if thread is not threading.main_thread()
    ):
        sys.exit(code)  # which waits for it
    atexit._run_exitfuncs()
    sys.stderr.flush()
    ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None).fflush(None)
    os._exit(code)


def fill_closed_streams() -> None:
    """Let standard streams that were closed, as in ``rans list >&-``, lead nowhere.

    Else the first file that is opened would take their place, and what is printed would be written into it.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free
            assert nowhere == number
        if getattr(sys, name) is None:
            mode = "r" if number == 0 else "w"
            setattr(sys, name, os.fdopen(number, mode, encoding="utf-8", closefd=False))


@contextmanager
def says_that_it_loads(words: list[str]) -> Iterator[None]:
    """Context with a line on the terminal, as "rans train: loading ...", until anything else is printed.

    Torch and the other libraries of a command take seconds to import. Nothing is printed in a pipe or log,
    nor for help, versions and processes of torchrun.

    Args:
        words: that follow ``rans``.
    """
    if (
        not sys.stderr.isatty()
        or not words
        or not (words[0].isascii() and words[0].isalpha())
        or words[0] in ("help", "version")
        or not {"-h", "--help"}.isdisjoint(words)
        or "WORLD_SIZE" in os.environ
    ):
        yield
        return
    line = f"rans {words[0][:20]}: loading ..."
    streams = (sys.stdout, sys.stderr)

    def erase() -> None:
        for stream in streams:
            vars(stream).pop("write", None)
        sys.stderr.write(f"\r{' ' * len(line)}\r")
        sys.stderr.flush()

    def first_write(stream: TextIO, text: str) -> int:
        erase()
        return stream.write(text)

    sys.stderr.write(line)
    sys.stderr.flush()
    for stream in streams:
        vars(stream)["write"] = partial(first_write, stream)
    try:
        yield
    finally:
        if "write" in vars(sys.stderr):
            erase()


def restart_in_utf8() -> None:
    """Where file names and texts are not UTF-8 by default (``PYTHONUTF8=0 LC_ALL=C``), begin anew so.

    Else Drake does not load, and TensorBoard writes into no folder whose name has other letters.
    """
    if sys.getfilesystemencoding() == "utf-8" or os.environ.get("PYTHONUTF8") == "1":
        return
    os.environ["PYTHONUTF8"] = "1"  # also for processes that are started from here
    os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])


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


_ended_by: list[signal.Signals] = []
"""Signals that have interrupted the command."""


def _interruptible() -> int:
    """Every signal of `_ENDS` interrupts, unless ignored, as in a script's `rans ... &` or by nohup."""
    heard = [
        number
        for number in _ENDS
        if signal.getsignal(number) in (signal.default_int_handler, signal.SIG_DFL)
    ]
    for number in (*heard, *_ALARMS):
        signal.signal(number, _interrupt)
    sys.unraisablehook, before = _again, sys.unraisablehook
    try:
        try:
            code = _run()
        except Exception:
            if not _ended_by:
                raise
            # Libraries in C++ that are interrupted, such as matplotlib's, raise an error of their own.
            os.write(2, b"\nrans: interrupted; what was written is kept.\n")
            code = 130
        return 128 + _ended_by[0] if code == 130 and _ended_by else code
    finally:  # Python's way out: nothing is left to lose
        sys.unraisablehook = before
        for number in heard:
            signal.signal(number, signal.SIG_DFL)


def _run() -> int:
    from rans.cli import main as run

    return run()


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, but end the process at once in the middle of an import.

    Libraries in C++ turn an exception in their initialisation into an ImportError, or abort. While a lost
    one is seen to (`_again`) another would be lost as well: it waits, as does a second one while the first
    takes a lock of Python's back, which is released by who finds it lost.
    """
    if number not in _ALARMS:  # which repeat another
        _ended_by.append(signal.Signals(number))
    while frame is not None:
        if frame.f_code.co_name in _HELD_BACK:
            _in_a_moment()
            return
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            if "WORLD_SIZE" not in os.environ:  # one of several processes of torchrun
                os.write(2, b"\nrans: interrupted.\n")
            by = _ended_by[0] if _ended_by else signal.SIGINT
            signal.signal(by, signal.SIG_DFL)
            signal.raise_signal(by)
        frame = frame.f_back
    raise KeyboardInterrupt


def _again(lost: sys.UnraisableHookArgs) -> None:
    """Interrupt once more, a moment later, where Python drops what is raised, as in callbacks of torch."""
    if lost.exc_type is KeyboardInterrupt:
        _in_a_moment()
    else:
        sys.__unraisablehook__(lost)


def _in_a_moment() -> None:
    """Call `_interrupt` once more after `_MOMENT`."""
    if _ALARMS:
        signal.setitimer(signal.ITIMER_REAL, _MOMENT)
    else:
        _thread.start_new_thread(_interrupt_later, ())  # threading's locks may be held here


def _interrupt_later() -> None:
    time.sleep(_MOMENT)
    _thread.interrupt_main()
