"""Signals that end a process end a flight instead, so that its valves are shut first."""

from __future__ import annotations

import os
import signal
import socket
import threading

_NOT_CAUGHT = {"SIGKILL", "SIGSTOP"}
"""The system lets no process catch these: against them a robot needs a watchdog of its own."""
_FAULTS = {"SIGSEGV", "SIGBUS", "SIGFPE", "SIGILL"}
"""A faulty instruction, which would be repeated without end if Python caught these."""
_HARMLESS = {"SIGCHLD", "SIGCONT", "SIGURG", "SIGWINCH", "SIGPIPE", "SIGXFSZ"}
"""These end no Python process: the system or Python ignores them."""
_OF_THE_TERMINAL = {"SIGTTIN", "SIGTTOU"}
"""These stop a process in the background that uses its terminal, with the valves as they are."""


def stop_on_signals() -> threading.Event:
    """Event that is set when the process receives a signal that would end or suspend it, such as SIGINT (Ctrl-C).

    That is every signal that can be caught: SIGTERM, SIGHUP of a lost terminal or ssh session, SIGQUIT, SIGTSTP
    (Ctrl-Z), SIGUSR1, SIGXCPU, ... A signal that the process was begun to ignore, as ``nohup`` does with SIGHUP,
    stays ignored, except for SIGINT, which shells ignore for commands in the background. Only the main thread of
    a process can catch signals: elsewhere the event is never set.

    It is set at once, also while the main thread computes in a library, which keeps Python's handlers waiting. A
    second signal ends the process where it is.
    """
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        return stop
    for valid_signal in signal.valid_signals():
        name = (
            valid_signal.name if isinstance(valid_signal, signal.Signals) else ""
        )  # real-time signals have none
        if name in _NOT_CAUGHT | _FAULTS | _HARMLESS:
            continue
        if name in _OF_THE_TERMINAL:
            signal.signal(valid_signal, signal.SIG_IGN)
        elif name == "SIGINT" or signal.getsignal(valid_signal) != signal.SIG_IGN:
            signal.signal(valid_signal, lambda *_: stop.set())
    # The system's own handler writes the number of a signal, which a thread reads.
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    os.register_at_fork(after_in_child=lambda: signal.set_wakeup_fd(-1))

    def listen() -> None:
        while reader.recv(1) and writer:
            if heard.is_set():
                os._exit(1)
            heard.set()
            stop.set()

    heard = threading.Event()
    threading.Thread(target=listen, daemon=True, name="signals").start()
    return stop
