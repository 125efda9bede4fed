"""``rans dossier``: what is known of an agent, row by row, with the command that repeats each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from tyro import conf

from rans.extend import Table, Terminal, counted, doing

if TYPE_CHECKING:
    from rans_assurance.dossier import Dossier


_SCREEN = 12
"""Lines of what differs."""


@dataclass(frozen=True)
class DossierCommand:
    """Gather what is known of an agent: operational domain, requirement, evidence, limits, row by row.

    Writes dossier.html and dossier.json beside the results of the agent. A question without a result of this very
    agent is an empty row, with the command that would answer it. With --check every command of the dossier runs
    again, beside a copy of the agent alone, and the exit code is 1 if a row says something else.
    """

    group = "Judge"
    guide = "docs/assurance/dossier.md"
    examples = (
        "rans dossier go-to-pose-2d-robust",
        "rans dossier go-to-pose-2d-robust --check",
    )
    following = ("rans dossier {agent} --check",)

    agent: Annotated[str, conf.Positional, conf.arg(metavar="AGENT")]
    """Run folder of the agent, or the name of one that comes with RANS."""
    check: bool = False
    """Compare the dossier that was written with the agent, with its files, and with its commands run again."""

    def run(self) -> int:
        """Write the dossier and print its rows, or check the one that is there; 1 if it says what is not so."""
        from rans_assurance.dossier import Dossier

        dossier = Dossier(self.agent)
        if self.check:
            return _check(dossier)
        with doing(f"writing {dossier.file}"):
            dossier.write()
        terminal = Terminal(room=100)
        for part in dossier.parts():
            rows = [row[:3] for row in part.tables[0].rows if row[1] is not None]
            if rows:
                terminal.table(Table(part.tables[0].columns[:3], rows, part.title))
        empty = [row for row in dossier.rows if not row.value]
        for command in dict.fromkeys(row.command for row in empty):
            asked = [row for row in empty if row.command == command]
            whats = "; ".join(row.what for row in asked)
            terminal.say(f"No evidence for {whats}{':' if command else '.'}")
            if command:
                terminal.command(dossier.command(asked[0]))
        terminal.say(dossier.verdict)
        terminal.say(f"Written to {dossier.file.with_suffix('.html')}, {dossier.file.name}.")
        return 0


def _check(dossier: Dossier) -> int:
    """Print what is false in a dossier; its commands run only where its files agree with it."""
    terminal = Terminal()
    found = [*dossier.falsehoods()]
    by_file = {row.file: row for row in dossier.rows if row.file and row.value}
    if not found:
        for row in by_file.values():
            with doing(row.command):
                found += dossier.repeated(row)
            if elsewhere := dossier.made_elsewhere(row):
                terminal.say(f"{row.file} was made with {elsewhere}.")
    for sentence in found[:_SCREEN]:
        terminal.say(f"FALSE: {sentence}.")
    if len(found) > _SCREEN:
        terminal.say(f"And {counted(len(found) - _SCREEN, 'further value')}.")
    if not found:
        terminal.say(
            f"{counted(len(dossier.rows), 'row')} agree with their files, the page with the rows, and "
            f"{counted(len(by_file), 'file')} with their commands, apart from dates and times."
        )
    return 1 if found else 0
