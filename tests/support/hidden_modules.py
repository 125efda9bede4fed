"""Commands in a process from which modules are hidden, each with its code of exit and what it printed."""

from __future__ import annotations

import re
from pathlib import Path

from tests.support.processes import PATIENCE, python

BLOCK = """
import importlib.abc, sys
import torch._dynamo  # it asks for onnx, and takes a refusal by a finder for an error

class Blocked(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in sys.argv[1].split(","):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocked())
"""
"""Hides modules, named in the first argument, from the process."""
RUN_EACH = (
    BLOCK
    + """
import os, shlex, webbrowser
import rans.base.processes
from rans.cli import main
from rans.evaluation.fly import choice
sys.stdout = sys.stderr
rans.base.processes.processors = lambda: 1  # others take seconds to start
choice.chosen = lambda *_, **__: choice.Choice(0.4, 0.2, 32, 32, 6.0, 17.0)  # flights that choose take seconds
webbrowser.open = lambda *_, **__: True
for line in sys.argv[2:]:
    print("$", line, flush=True)
    in_shell = line.startswith("cd ")  # to an export, whose agent.py runs without RANS
    code = os.system(line.replace("python", sys.executable)) if in_shell else main(shlex.split(line))
    print("code of exit:", code, flush=True)
"""
)
"""Runs commands, and prints each one's code of exit after what it says."""


def ran(lines: list[str], hidden: set[str], folder: Path) -> list[tuple[str, int, str]]:
    """Each command with its code of exit and what it printed, in one process."""
    with python("-c", RUN_EACH, ",".join(sorted(hidden)), *lines, cwd=folder) as process:
        _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, said
    parts = re.split(r"^\$ ", said, flags=re.MULTILINE)[1:]
    found = [re.fullmatch(r"(.*?)\n(.*)code of exit: (\d+)\n", part, re.DOTALL) for part in parts]
    assert len(found) == len(lines)
    return [(one[1], int(one[3]), one[2]) for one in found if one]
