"""Where the tables of the pages come from: the list `campaigns.table`, which `campaigns.reproduce` flies again.

``python -m campaigns.provenance`` writes docs/provenance.md from it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

from campaigns.table import ROWS
from rans.base.files import read_text, write_text
from rans.base.structure import read_toml

_TABLE = read_toml(read_text(Path(__file__).with_suffix(".toml")))
PICTURES: dict[str, str] = _TABLE["pictures"]
"""Files in docs/pictures, and what draws them."""
ONCE: list[list[str]] = _TABLE["once"]
"""Pages whose figures were measured by code that left after a commit: evidence, modules and the commit."""
RECORDS: dict[str, list[str]] = _TABLE["records"]
"""Other files in docs/validation: the page of their figures, and what writes them."""
_WRITTEN = {name for source in ROWS.values() for name in source.evidence}


def page() -> str:
    """Text of docs/provenance.md."""
    measured = (*_rows(), _duration(), _TAIL, *_records())
    return "\n".join([_HEAD, *measured, _DRAWN, _ONCE]) + "\n"


_HEAD = """# Provenance

`python -m campaigns reproduce` flies the tables of the pages again, and writes a page of differences. This page
is made from the same list, `campaigns/table.toml`.

![A command writes a JSON file, from which a table of a page is made; two checks compare them]\
(pictures/diagrams/provenance.svg)

```
python -m campaigns reproduce --quick                             # fewer flights of every table
python -m campaigns reproduce --only stress "dock with errors"    # these alone, with every flight
```

Where a name alone measures a table, the command is `python -m campaigns NAME --docs docs`.

| table of | measured by | evidence | flights behind each share; with `--quick` | processor time with `--quick`, s |
|---|---|---|---|---|"""
_TAIL = """
## What agrees

Flights of a seed are deterministic. On the same processor, with the versions of the evidence, every cell is the
same. Elsewhere, and with `--quick`, a share agrees within three standard deviations of both samples (about
three of a thousand are beyond them), and another number within the tolerance of the list. Extremes of fewer
flights, times of a machine, and searches that a limit of time ends are not compared.

The page of differences, `runs/reproduce/differences.md`, has every cell that differs, the time of each row,
versions, processor and GPU, and the SHA-256 of every agent. The exit code is 1 if a cell differs or a command
fails. `--executor` spreads the rows over [many machines](cluster.md).

## Other figures

Figures in sentences come from these files, and figures of speed from the command beside each. They
are not measured again.

| page | evidence | measured by |
|---|---|---|"""
_ONCE = """
## Measured once

Other figures were measured by code that left, since another flight does not change them. The table `once` of
`campaigns/provenance.toml` names the page, the evidence, the module and the commit of each. `git worktree add
../then COMMIT` and `make setup` in that folder bring the code back, and `python -m MODULE` runs it there."""
_DRAWN = """
`python -m campaigns.pictures` draws the pictures, others were drawn once (`campaigns/provenance.toml`)."""


def _rows() -> Iterator[str]:
    for name, source in ROWS.items():
        link = f"[{Path(source.page).stem}]({_in_repository(source.page)})"
        first, *others = map(_short, source.measured_by(name))
        commands = (
            f"{first}<br>and {len(others)} alike"
            if len(others) > 1
            else "<br>".join((first, *others))
        )
        files = ", ".join(f"[{name}](validation/{name})" for name in source.evidence)
        full, quick = source.flights
        counts = f"{full:,}, {quick:,}" if full else "-"
        seconds = source.time(quick=True)
        yield f"| {link} | {commands} | {files} | {counts} | {f'{seconds:.0f}' if seconds else '-'} |"


def _short(command: str) -> str:
    """A command as the table has it: of a campaign that writes into the pages its name alone."""
    named = command.removeprefix("python -m campaigns ").removesuffix(" --docs docs")
    return f"`{named}`" if f"python -m campaigns {named} --docs docs" == command else f"`{command}`"


def _in_repository(page: str) -> str:
    """Path of a page from docs: that of a package, in docs by a symbolic link, is beside the package."""
    docs = Path(__file__).parents[1] / "docs"
    return Path(os.path.relpath((docs / page).resolve(), docs)).as_posix()


def _duration() -> str:
    """Sentence with the time of all quick rows."""
    every = {name: one.time(quick=True) for name, one in ROWS.items()}
    total = sum(every.values())
    missing = [name for name, seconds in every.items() if not seconds]
    rest = f" The sum leaves out what was not measured: {', '.join(missing)}." if missing else ""
    # Shares of more flights take longer in proportion; searches and bounds do not.
    grown = [
        seconds * ROWS[name].flights[0] / ROWS[name].flights[1]
        for name, seconds in every.items()
        if ROWS[name].flights[1]
    ]
    return (
        f"\nWith `--quick` all rows take {total:,.0f} s of one processor together, "
        f"{total / 120.0:.0f} minutes on two (AMD EPYC).{rest} With every flight the {len(grown)} rows whose "
        f"number of flights is stated would take {sum(grown):,.0f} s, if their times grow as the flights do: "
        f"{sum(grown) / 960.0:.0f} minutes on 16 processors; the others search or bound."
    )


def _records() -> Iterator[str]:
    for name, (where, command) in sorted(RECORDS.items()):
        yield f"| [{Path(where).stem}]({_in_repository(where)}) | `{name}` | `{command}` |"


def unlisted(docs: Path) -> set[str]:
    """Files of evidence and pictures of which nothing says what makes them."""
    evidence = (*RECORDS, *(name for _, name, *_ in ONCE))
    files = {file.name for file in (docs / "validation").iterdir()} - _WRITTEN
    pictures = {
        file.relative_to(docs / "pictures").as_posix() for file in (docs / "pictures").rglob("*.*")
    }
    return {
        *(name for name in files if not any(fnmatch(name, known) for known in evidence)),
        *(name for name in pictures if not any(fnmatch(name, known) for known in PICTURES)),
    }


if __name__ == "__main__":
    write_text(Path("docs/provenance.md"), page())
