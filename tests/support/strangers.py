"""What a stranger may hand on: archives and pickles that run something wherever they are unpickled."""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch


class Code:
    """Makes a folder when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.path),)


def rewritten(file: Path, change: Callable[[str, bytes], bytes | None]) -> None:
    """An archive with every entry as ``change`` has it, by its name; None leaves it out."""
    with zipfile.ZipFile(file) as archive:
        entries = {name: change(name, archive.read(name)) for name in archive.namelist()}
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in entries.items():
            if content is not None:
                archive.writestr(name, content)


def trapped_weights(file: Path, ran: Path) -> None:
    """Code in the place of the weights that torch unpickles."""
    stream = io.BytesIO()
    torch.save({"action_net.bias": Code(ran)}, stream)
    rewritten(file, lambda name, content: stream.getvalue() if name == "policy.pth" else content)
