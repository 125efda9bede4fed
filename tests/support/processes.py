"""The command and statements in processes of their own, and how long a test waits for one."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PATIENCE = 1800.0
"""s: only a process that hangs takes so long, however busy the machine."""


@contextlib.contextmanager
def command(*arguments: str, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """``rans`` in a process that hears Ctrl-C as in a terminal even if this one does not."""
    code = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
        f"sys.path.insert(0, {str(ROOT)!r}); from rans.cli import main; sys.exit(main())"
    )
    with python(
        "-c", code, *arguments, env=os.environ | {"OMP_NUM_THREADS": "1"} | environment
    ) as process:
        yield process


@contextlib.contextmanager
def python(*arguments: str, **options: Any) -> Iterator[subprocess.Popen[str]]:
    """Another interpreter, whose process is gone when the test goes on."""
    with subprocess.Popen(
        [sys.executable, *arguments],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        **options,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def printed(*arguments: str | Path, cwd: Path = ROOT, **environment: str) -> str:
    """What another interpreter prints, which knows this checkout and must end well."""
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def free_port() -> int:
    """Port of this process, not of processes beside it, and below those that systems give out, from 16,000 on."""
    for port in range(10_000 + os.getpid() % 500 * 10, 16_000):
        with contextlib.suppress(OSError), socket.create_server(("localhost", port)):
            return port
    raise AssertionError("no free port")


def wait_until(holds: Callable[[], bool]) -> None:
    """Look until something holds."""
    deadline = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def loaded(statement: str) -> set[str]:
    """Top-level packages in memory after a statement in a fresh interpreter."""
    return {name.partition(".")[0] for name in modules_loaded(statement)}


def modules_loaded(statement: str) -> set[str]:
    """Full names of all modules in memory after a statement, which may print, in a fresh interpreter."""
    text = printed("-c", f"{statement}\nimport sys; print(); print(*sys.modules)")
    return set(text.splitlines()[-1].split())
