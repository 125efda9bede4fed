"""Ctrl-C at any moment of a command: no traceback, and nothing that drops it for good."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable

import pytest

import rans_command

INTERRUPTED = """
import os, signal, sys
import rans_command

def interrupt(*_):
    os.kill(os.getpid(), signal.{signal})

signal.signal(signal.SIGINT, signal.default_int_handler)  # as in a terminal
sys.argv = ["rans", "--version"]
match {moment!r}:
    case "loading":
        sys.meta_path.insert(0, type("Finder", (), {{"find_spec": interrupt}})())
    case "running":
        import rans.cli
        rans.cli._run = interrupt
    case "drawing":  # in C++ of matplotlib, which makes an error of its own of it
        import rans.cli

        def draw(*_):
            try:
                interrupt()
            except KeyboardInterrupt:
                raise ValueError("Invalid affine transformation matrix") from None

        rans.cli._run = draw
code = rans_command.main()
interrupt() if {moment!r} == "leaving" else sys.exit(code)
"""


@pytest.mark.parametrize(
    ("by", "moment", "end", "said"),
    [
        ("SIGINT", "loading", "signal", "\nrans: interrupted.\n"),
        ("SIGTERM", "running", "code", "\nrans: interrupted; nothing was written.\n"),
        ("SIGINT", "drawing", "code", "\nrans: interrupted; what was written is kept.\n"),
        ("SIGINT", "leaving", "signal", ""),
        ("SIGINT", "never", "none", ""),
    ],
)
def test_an_interrupt_shows_no_traceback(moment, end, said, by):
    """SIGTERM is how the time limit of a cluster's queue interrupts."""
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED.format(moment=moment, signal=by)],
        capture_output=True,
        text=True,
        check=False,
    )
    number = signal.Signals[by]  # shells make 128 and the number of both ways to end
    code = {"signal": -number, "code": 128 + number, "none": 0}[end]
    assert (done.returncode, done.stderr) == (code, said)


@pytest.mark.parametrize("busy", [False, True])
def test_an_interrupt_in_a_callback_is_not_lost(monkeypatch, busy):
    """Python drops what a weak reference's callback raises; torch's compiler has many of these.

    On a busy machine the moment is over before Python is done with dropping.
    """
    drop = rans_command._again

    def _again(lost):
        drop(lost)
        end = time.perf_counter() + 3e-3  # thirty moments
        while time.perf_counter() < end:
            pass

    if busy:
        monkeypatch.setattr(rans_command, "_MOMENT", 1e-4)
        monkeypatch.setattr(rans_command, "_again", _again)

    class Held:
        pass

    def runs():
        held = Held()
        kept = weakref.ref(held, lambda _: os.kill(os.getpid(), signal.SIGINT))
        del held
        assert kept() is None
        return waits()

    _interrupted(runs, monkeypatch)


def test_a_second_interrupt_leaves_locks_as_they_are(monkeypatch):
    """Python takes a condition's lock back on its way out of a wait, and fails if that is interrupted."""

    def strike(frame, *_):
        if frame.f_code.co_name == "_acquire_restore":
            os.kill(os.getpid(), signal.SIGINT)

    def runs():
        ready = threading.Condition(threading.Lock())
        with ready:
            sys.settrace(strike)
            try:
                ready.wait(0.01)
            finally:
                sys.settrace(None)
        return waits()

    _interrupted(runs, monkeypatch)


def waits() -> int:
    """A command that ends well if nothing interrupts it for minutes."""
    for _ in range(60_000):  # a signal just before a long sleep would wait for its end
        time.sleep(0.01)
    return 0


def _interrupted(runs: Callable[[], int], monkeypatch: pytest.MonkeyPatch) -> None:
    """The command that does this ends with an interrupt."""
    monkeypatch.setattr(rans_command, "_run", runs)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # pytest may run without one
    try:
        with pytest.raises(KeyboardInterrupt):
            rans_command._interruptible()
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
