"""`rans reproduce`."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from rans.cli.options import ExecutorText
from rans.errors import ConfigError
from rans.terminal import Terminal

_CHECKOUT = Path(__file__).parents[2]
"""Folder of the sources, if this package is used from there: campaigns are not installed."""


@dataclass(frozen=True)
class Reproduce:
    """Fly the tables of the pages again, and compare them with what is published.

    Needs a checkout of the sources, which has the list of tables and the evidence. Writes a page of differences,
    with versions, hardware, the time of each table and a hash of each agent; see docs/provenance.md. The exit code
    is 1 if a cell differs by more than accepted.
    """

    group = "Judge"
    guide = "docs/provenance.md"
    examples = (
        "rans reproduce --quick",
        "rans reproduce --only stress",
    )
    following = ("rans validate floating-platform",)

    quick: bool = False
    """Fly fewer flights of every table, and accept what these differ by."""
    only: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME...")] = ()
    """Reproduce these tables only, such as stress "dock with errors"; an unknown name prints all."""
    output: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("runs/reproduce")
    """Folder of differences.md and of all that is flown."""
    executor: ExecutorText = ""
    """Where the tables are flown; each is one job."""

    def run(self) -> int:
        """Run the campaign of the checkout in a process of its own, and return its exit code."""
        if not (_CHECKOUT / "campaigns" / "reproduce.py").is_file():
            raise ConfigError(
                "rans reproduce needs a checkout of the sources, whose folders campaigns and docs/validation "
                "are not installed: run `git clone` and `make setup`, and the command there."
            )
        options = ["--quick"] * self.quick + ["--output", str(self.output.absolute())]
        if self.only:
            options += ["--only", *self.only]
        workers = ["--executor", self.executor] if self.executor else []
        command = [sys.executable, "-m", "campaigns", *workers, "reproduce", *options]
        Terminal(stderr=True).say("Starting the campaign reproduce, whose output follows.")
        begun = time.time()
        try:
            return subprocess.run(command, cwd=_CHECKOUT, check=False).returncode
        except KeyboardInterrupt:
            # The campaign's process writes the page after every row.
            page = self.output / "differences.md"
            has_rows = page.exists() and page.stat().st_mtime >= begun
            kept = f"{page} has the rows until then" if has_rows else "no row was complete"
            Terminal(stderr=True).say(f"rans: interrupted; {kept}. The same command begins anew.")
            return 130
