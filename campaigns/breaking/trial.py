"""One command in a process of its own, and whether it ended as a command should.

Most are forks of the campaign, which has loaded what they need and run nothing: they have arguments, folder,
output, limits and signals of their own, and spare the second of loading. A fork cannot find what goes wrong
while modules are loaded, with several threads of torch before a command has set their number, with another
order of sets (Python draws one for each process), with output that is not UTF-8, on the way out of the
process (`rans_command.run`), or in the seconds that a command says it took. Processes started from nothing
can: a share of all cases, and every training that is killed or runs out of disk.
"""

from __future__ import annotations

import multiprocessing
import os
import resource
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import rans_command
from rans_command import main

_MEMORY = 8 * 2**30
"""Bytes of address space a command may take, so that what asks for more is told and not killed."""
_LONGEST = 30_000
"""Characters of an error: more is no sentence."""
LEAVE = 90.0
"""Time to end after Ctrl-C, s: processes beside the command finish the job that they are at."""
_START = "import sys, rans_command; sys.argv[0] = 'rans'; rans_command.run()"
"""What the installed command does."""
_CODES = {0: "done", 1: "failed", 2: "refused", 130: "interrupted", -signal.SIGINT: "interrupted"}

Command = Sequence[str]
Limit = Callable[[], None]
"""Called in the child before the command, to take something away from it."""


@dataclass(frozen=True)
class Outcome:
    """How a command ended."""

    command: Command
    ended: str
    """One of `_CODES`, or what no command may do: "traceback", "hang", "died"."""
    seconds: float
    out: str
    err: str
    fresh: bool = False
    """Whether its process was started from nothing."""

    @property
    def faults(self) -> list[str]:
        """What is wrong with the way it ended."""
        odd = [self.ended] if self.ended not in _CODES.values() else []
        if "\x1b" in self.out + self.err:
            odd.append("escape codes")
        if len(self.err) > _LONGEST:
            odd.append("endless error")
        if self.ended == "refused" and not self.err.strip():
            odd.append("refused without a word")
        return odd


def ran(
    command: Command,
    folder: Path,
    patience: float = 20.0,
    limit: Limit = lambda: None,
    kill_after: float | None = None,
    fresh: str | None = None,
) -> Outcome:
    """Run a command in a folder, in a fork or, after the Python source ``fresh``, started from nothing.

    After so much patience, s, it hears Ctrl-C, as from somebody who has seen enough; one that has not ended
    `LEAVE` later hangs. With ``kill_after`` it is killed (SIGKILL) after so many seconds instead.
    """
    # beside a disk that is full, not on it
    out = folder.parent / ".out"
    err = folder.parent / ".err"
    started = time.monotonic()
    with warnings.catch_warnings(action="ignore"):  # Python 3.12 warns of threads beside a fork
        child = os.fork()
    if child == 0:
        _child(command, folder, out, err, limit, fresh)
    ended = _waited(child, patience if kill_after is None else kill_after)
    if ended is None and kill_after is None:
        _signal(child, signal.SIGINT)
        ended = _waited(child, LEAVE)
    hung = ended is None
    _signal(child, signal.SIGKILL)
    if ended is None:
        _, status = os.waitpid(child, 0)
        ended = os.waitstatus_to_exitcode(status)
    said, wrong = (
        file.read_text("utf-8", "replace") if file.exists() else "" for file in (out, err)
    )
    name = _named(ended, hung and kill_after is None, wrong)
    return Outcome(command, name, time.monotonic() - started, said, wrong, fresh is not None)


def apart(function: Callable[..., object], *arguments: object) -> None:
    """Call a function in a fork, so that this process has done nothing that later ones would inherit."""
    process = multiprocessing.get_context("fork").Process(target=function, args=arguments)
    with warnings.catch_warnings(action="ignore"):
        process.start()
    process.join()
    assert process.exitcode == 0, f"{function.__name__} ended with {process.exitcode}"


def _named(code: int, hung: bool, err: str) -> str:
    if hung:
        return "hang"
    if "Traceback (most recent call last)" in err:
        return "traceback"
    return _CODES.get(code, "died")


def _child(
    command: Command, folder: Path, out: Path, err: Path, limit: Limit, fresh: str | None
) -> None:
    """Never returns."""
    code = 70
    try:
        os.setsid()
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        for number, file in ((1, out), (2, err)):
            os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        sys.stdout, sys.stderr = (os.fdopen(number, "w", encoding="utf-8") for number in (1, 2))
        os.chdir(folder)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
        limit()
        if fresh is not None:
            _start(command, fresh)
        sys.argv = ["rans", *command]
        code = main()
    except SystemExit as end:  # of a command line that is none
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        finally:  # where nothing can be written either: this process must not go on as its parent
            os._exit(code)


def _start(command: Command, before: str) -> None:
    """Become a process that has loaded nothing yet, and looks for modules where this one found the command.

    What limits this one limits that one too.
    """
    places = [
        str(Path(rans_command.__file__).parent),
        *filter(None, [os.environ.get("PYTHONPATH")]),
    ]
    os.execve(
        sys.executable,
        [sys.executable, "-P", "-c", f"{before}\n{_START}", *command],
        os.environ | {"PYTHONPATH": os.pathsep.join(places)},
    )


def _waited(child: int, seconds: float) -> int | None:
    """The child's exit code, negative for a signal, or None if it runs on."""
    deadline = time.monotonic() + seconds
    while True:
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > deadline:
            return None
        time.sleep(0.005)


def _signal(child: int, number: int) -> None:
    """To the whole group, as a terminal does; nothing is left of it after SIGKILL."""
    try:
        os.killpg(child, number)
    except (ProcessLookupError, PermissionError):
        return
