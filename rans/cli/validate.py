"""``rans validate``: the dynamics every engine shares, checked against Drake."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Validate:
    """Check a spacecraft's dynamics against Drake, layer by layer; exit code 1 if a check fails."""

    spacecraft: str = "floating-platform"
    """Name of a spacecraft that comes with RANS, or your own TOML file."""
    quick: bool = False
    """Fewer states and flights: about 5 s instead of 15 s."""
    seed: int = 0
    """Of the random states and commands."""
    output: Path | None = None
    """Folder to write validation.json into."""

    def run(self) -> int:
        """Print the table of checks."""
        from rich.console import Console

        from rans.spacecraft_file import load_spacecraft
        from validation.dynamics import study

        console = Console()
        with console.status("comparing with Drake ..."):
            report = study(load_spacecraft(self.spacecraft), self.seed, self.quick)
        console.print(report.table())
        failed = [check for check in report.checks if not check.passed]
        for check in failed:
            console.print(f"[bold red]FAIL[/] {check.name}. Its tolerance: {check.reason}")
        total, seconds = len(report.checks), report.settings["seconds"]
        console.print(f"{total - len(failed)} of {total} checks passed in {seconds} s.")
        if self.output is not None:
            file = self.output / "validation.json"
            report.write(file)
            console.print(f"Written to {file}.")
        return 1 if failed else 0


COMMAND = Validate
