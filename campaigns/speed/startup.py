"""Where a command's time goes, from Enter to its end: `python -m campaigns.speed.startup train go-to-pose`.

The command runs in a process of its own, as it always does, with a thread beside it that looks every five
milliseconds at what is being done. What a look finds counts towards the first of `PARTS` that names it.
"""

from __future__ import annotations

import atexit
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from pathlib import Path

PARTS = (
    ("import torch", "torch/__init__.py:<module>"),
    ("import torch's compilers", "torch/_dynamo/__init__.py:<module>"),
    ("import torch's compilers", "torch/_inductor/__init__.py:<module>"),
    ("import Stable-Baselines3 and TensorBoard", "stable_baselines3/__init__.py:<module>"),
    ("import Gymnasium and NumPy", "gymnasium/__init__.py:<module>"),
    ("read the command", "rans/cli/__init__.py:_parse"),
    ("look for a GPU", "torch/cuda/__init__.py:is_available"),
    ("compile kernels", "rans/compile/cuda/launch.py:compiled"),
    ("load and record kernels, or compile: warm-up", "rans/fast/learn/trainer.py:_warm_up"),
    ("judge agents", "rans/fast/learn/trainer.py:_report"),
    ("train", "rans/fast/learn/trainer.py:_iterate"),
    ("write checkpoint and agent", "rans/fast/learn/trainer.py:save"),
    ("make engines and network", "rans/fast/learn/trainer.py:__init__"),
    ("begin the run folder", "rans/fast/learn/run_folder.py:begin"),
    ("wait for the learning curve", "rans/show/curve.py:ask"),
    ("import rans", "rans/__init__.py:<module>"),
)
"""What is done, and what stands on Python's stack then: the end of a file's name and a function."""
_START = "start Python"
_REST = "anything else"
_EVERY = 0.005


def main() -> None:
    """Print the table."""
    if sys.argv[1:2] == ["--watch"]:
        _watched(Path(sys.argv[2]), float(sys.argv[3]), sys.argv[4:])
    with tempfile.TemporaryDirectory() as folder:
        found = measured(sys.argv[1:], Path(folder) / "parts.json")
    for part, seconds in [
        *sorted(found.items(), key=lambda row: -row[1]),
        ("in all", sum(found.values())),
    ]:
        sys.stdout.write(f"{seconds:6.2f} s  {part}\n")


def measured(arguments: list[str], file: Path) -> dict[str, float]:
    """Seconds of each part of ``rans`` with these arguments, whose output goes where ours goes."""
    begun = time.time()
    subprocess.run(
        [
            sys.executable,
            "-m",
            "campaigns.speed.startup",
            "--watch",
            str(file),
            repr(begun),
            *arguments,
        ],
        check=False,
    )
    whole = time.time() - begun
    parts = json.loads(file.read_text())
    return parts | {"end Python": whole - sum(parts.values())}


def _watched(file: Path, begun: float, arguments: list[str]) -> None:
    """Be that process; what is not over when the table is written ends Python."""
    parts = defaultdict[str, float](float, {_START: time.time() - begun})
    thread = threading.main_thread().ident or 0
    over = threading.Event()

    def look() -> None:
        last = time.perf_counter()
        while not over.wait(_EVERY):
            now = time.perf_counter()
            parts[_part(thread)] += now - last
            last = now

    threading.Thread(target=look, daemon=True).start()
    from rans_command import run

    def write() -> None:
        over.set()
        file.write_text(json.dumps(parts))

    atexit.register(write)
    sys.argv = ["rans", *arguments]
    run()


def _part(thread: int) -> str:
    frame = sys._current_frames().get(thread)
    names = list[str]()
    while frame is not None:
        names.append(f"{frame.f_code.co_filename}:{frame.f_code.co_name}")
        frame = frame.f_back
    return next(
        (part for part, end in PARTS if any(name.endswith(f"/{end}") for name in names)), _REST
    )


if __name__ == "__main__":
    main()
