"""Differences of operating systems: calls of Linux and macOS that Windows lacks or does in another way.

Nothing else in this package uses the module ``fcntl``, or flags of `os.open` and signals that Windows lacks; the
command's start, ``rans_command``, comes before the package and guards its alarm itself.
"""

from __future__ import annotations

import errno
import importlib
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

try:
    import fcntl
except ModuleNotFoundError:  # Windows
    fcntl = None

PACKAGE_FOLDER = Path(__file__).parents[1]
"""Folder of this package; modules read it here, because `rans` itself imports from every room."""
_POLL = 0.01
"""Time between two attempts to take a lock on Windows, s; the locks of Python's library give up after 10 s."""

_SAFE = ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY")
"""Flags without which `os.open` follows a symbolic link, waits at a pipe, or (Windows) changes line ends."""

ALARMS = (signal.SIGALRM,) if hasattr(signal, "SIGALRM") else ()
"""Signals that `set_alarm` sends: none on Windows."""


ENDS = tuple(
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1")
    if hasattr(signal, name)
)
"""Signals that ask a training to end: Ctrl-C, a queue's end and its warning, and a session that closes."""


def open_safely(file: Path, flags: int, follow: bool = False) -> int:
    """Descriptor of an opened file, in binary mode and without waiting for the other end of a pipe.

    Args:
        file: file to open.
        flags: flags of `os.open` that every system has.
        follow: whether a symbolic link is followed.

    Raises:
        OSError: the file cannot be opened, or is a symbolic link that is not to be followed.
    """
    if not follow and not hasattr(os, "O_NOFOLLOW") and file.is_symlink():
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(file))
    for name in _SAFE:
        if not (follow and name == "O_NOFOLLOW"):
            flags |= getattr(os, name, 0)
    return os.open(file, flags, 0o666)


def open_for_lock(folder: Path) -> int:
    """Descriptor whose lock (`lock`) stands for a folder: the folder's own, on Windows that of a file in it."""
    if hasattr(os, "O_DIRECTORY"):
        return os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    return open_safely(folder / ".writing", os.O_RDWR | os.O_CREAT)  # Windows opens no folders


def lock(descriptor: int, wait: bool) -> None:
    """Lock an opened file against other openings of it, until the descriptor is closed.

    Args:
        descriptor: descriptor of the file.
        wait: whether to wait until the lock is free.

    Raises:
        BlockingIOError: the lock is not free, and ``wait`` is false.
        OSError: the file system has no locks.
    """
    if fcntl is not None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        return
    msvcrt: Any = importlib.import_module("msvcrt")
    while True:
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
            return
        except PermissionError as error:
            if not wait:
                raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN)) from error
        time.sleep(_POLL)


def is_alive(process: int) -> bool:
    """Whether a process of this machine exists; always false on Windows.

    There `os.kill` would send Ctrl-C. The answer guards files against removal, and Windows removes no open file.
    """
    if fcntl is None:
        return False
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # a process of another user
        return True
    return True


def is_terminal(stream: Any) -> bool:
    """Whether a standard stream is a terminal; programs without a console have None, and loggers no `isatty`."""
    return bool(getattr(stream, "isatty", bool)())


def to_stderr(line: str) -> None:
    """Print a line on standard error, where there is one."""
    if sys.stderr is not None:
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


def set_alarm(seconds: float) -> None:
    """Send SIGALRM to this process after a time, s, or with 0 no more; without effect on Windows."""
    if ALARMS:
        signal.setitimer(signal.ITIMER_REAL, seconds)
