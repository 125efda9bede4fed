"""``rans validate``: checks of the fast engine against Drake and the laws of mechanics."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from rich.text import Text

from rans.base.errors import ConfigError, brief
from rans.base.files import environment, made_by, ready_folder, write_json
from rans.base.registry import typed
from rans.base.terminal import Terminal, verdict
from rans.cli.door import Options, command_of, word
from rans.cli.next_commands import training
from rans.model.spacecraft_file import load_spacecraft
from validation.functions import validate

if TYPE_CHECKING:
    from validation.study.checks import Study


@command_of(validate, without=("seed",), spacecraft=word("[SPACECRAFT]"))
class Validate(Options):
    """Check a spacecraft's dynamics against Drake and the laws of mechanics, layer by layer.

    The exit code is 1 if a check fails or cannot be made.
    """

    group = "Check"
    guide = "docs/validation.md"
    examples = ("rans validate mine.toml --quick", "rans validate --judges")

    judges: bool = False
    """Compare with figures that others computed instead, such as NASA's JEOD (docs/missions/judges.md)."""
    output: Path | None = None
    """Folder for validation.json, of which rans report makes a page; with --judges for judges.json."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        if self.judges:
            return (shlex.join(["rans", "validate", self.spacecraft]),)
        return training(load_spacecraft(typed(self.spacecraft)), self.spacecraft)

    def run(self) -> int:
        """Print a table of layers or checks, write the report, and return 1 if a check failed."""
        if self.judges:
            return self._judge()
        console = Terminal()
        if self.output is not None:
            ready_folder(self.output)
        report: Study = self.call()
        if self.output is not None:
            report.write(self.output / "validation.json")
            console.print(f"Written to {self.output / 'validation.json'}.")
        console.table(report.layers() if self.layer is None else report.table())
        failed = [check for check in report.checks if not check.passed]
        for check in failed:
            console.print(
                verdict(False), f"{check.name} ({check.worst}). Its tolerance: {check.reason}"
            )
        for skipped in report.skipped:
            console.print(Text("not run", "yellow"), f"{skipped.name}: {skipped.reason}")
        total = len(report.checks)
        seconds = report.settings["seconds"]["all"]
        console.print(f"{total - len(failed)} of {total} checks passed in {seconds} s.")
        if report.is_partial:
            raise KeyboardInterrupt
        nothing = not total and report.skipped
        if nothing:
            console.print("Nothing could be checked here.")
        return 1 if failed or nothing else 0

    def _judge(self) -> int:
        """Print how other software's logs of the same flights agree; 1 if one is beyond its bound."""
        from validation.judges.table import judged, table

        of_checks = {
            "--layer": self.layer is not None,
            "--conditions": self.conditions is not None,
            f"the name {brief(self.spacecraft)}": self.spacecraft != vars(Validate)["spacecraft"],
        }
        for what, is_asked in of_checks.items():
            if is_asked:
                raise ConfigError(f"{what} is of checks against Drake: leave it out with --judges.")
        console = Terminal()
        if self.output is not None:
            ready_folder(self.output)
        rows = judged()
        if self.output is not None:
            made = {"command": made_by("rans.validate"), "environment": environment()}
            cases = [row.to_json() for row in rows]
            write_json(self.output / "judges.json", made | {"cases": cases})
            console.print(f"Written to {self.output / 'judges.json'}.")
        console.table(table(rows))
        agreed = sum(row.passed for row in rows)
        console.print(f"{agreed} of {len(rows)} judges agree within their bounds.")
        return 0 if agreed == len(rows) else 1
