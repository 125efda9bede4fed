"""Fly the tables of the pages again, and write a page of differences: ``python -m campaigns reproduce``.

Every row of `campaigns.table.ROWS` runs in a folder with a copy of docs, so that nothing of the checkout
changes. The cells of its tables are then compared with those of the checkout.
"""

from __future__ import annotations

import hashlib
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, NamedTuple

import tyro

from campaigns.command import ended
from campaigns.markdown import Table, lines
from campaigns.runner import Campaign
from campaigns.table import ROWS
from rans.base.errors import ConfigError, RansError, counted, meant
from rans.base.executors import answers, chosen_executor
from rans.base.files import environment, read_bytes, read_json, write_text
from rans.base.pretrained import pretrained_folder, pretrained_names
from rans.base.processes import nothing, processors
from rans.base.terminal import Terminal
from rans.fast.agent_files.agent import AGENT

ROOT = Path(__file__).parents[1]

_NUMBER = re.compile(r"(?<![\w.])-?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?")
_OF = re.compile(r"(?<![\d.,])(\d+) of (\d+)\b")
_MEAN_OF = re.compile(r"(\.\d+) of \d+\b")
_SIGMAS = 3.0
_LARGEST_AGENT = 2**28
_VERSIONS = ("torch", "numpy", "drake", "casadi", "scipy", "python", "system", "processor", "gpu")
"""What must be the same for cells to be the same."""


class Difference(NamedTuple):
    """A cell that is not the published one."""

    table: str
    row: str
    column: str
    published: str
    found: str
    agrees: bool
    """Whether it is as near as it must be."""


@dataclass
class Result:
    """What became of a row of the list."""

    name: str
    seconds: float = 0.0
    processor_seconds: float = 0.0
    """Processor time of the row, s, summed over all processors; other programs do not lengthen it."""
    cells: int = 0
    differences: list[Difference] = field(default_factory=list)
    failed: str = ""
    """Why there is nothing to compare."""
    same_machine: bool = False
    """Whether processor and versions are those of the evidence."""

    @property
    def beyond(self) -> list[Difference]:
        """Differences larger than accepted."""
        return [one for one in self.differences if not one.agrees]

    def verdict(self) -> str:
        """In words."""
        if self.failed:
            return self.failed
        if self.beyond:
            return f"{len(self.beyond)} of {self.cells} cells differ"
        if self.differences:
            return f"agrees ({self.cells - len(self.differences)} of {self.cells} cells are equal)"
        return f"equal ({self.cells} cells)"


@dataclass(frozen=True)
class Reproduce:
    """Fly tables of the pages again and compare them with what is published."""

    quick: bool = False
    """Fly fewer flights of every table: minutes instead of hours."""
    only: tuple[str, ...] = ()
    """Names of rows of the list, such as stress, dock-port or "dock port"; by default all."""
    output: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("runs/reproduce")
    """Folder of the page of differences and of all that is flown."""

    def run(self) -> int:
        """Run the rows; 1 if a cell differs or a command failed."""
        joined = {name.replace(" ", "-"): name for name in ROWS}
        only = [joined.get(name.replace(" ", "-"), name) for name in self.only]
        for name in only:
            if name not in ROWS:
                raise ConfigError(
                    f"--only must be of {', '.join(ROWS)}; got {name!r}{meant(name, ROWS)}."
                )
        terminal = Terminal()
        results: list[Result] = []
        begun = time.monotonic()
        rows = {name: ROWS[name] for name in only or ROWS}
        planned = [source.time(self.quick) for source in rows.values()]
        measured = sum(1 for seconds in planned if seconds)
        before = f"; {measured} of them took {sum(planned):.0f} s of one processor before"
        terminal.say(f"{counted(len(rows), 'row')}{before if measured else ''}.")
        jobs = [(name, source, self.quick, self.output.absolute()) for name, source in rows.items()]
        # Most commands use one processor, so that as many run at once as there are.
        pool = ThreadPoolExecutor(processors())
        try:
            for _, result in answers(chosen_executor() or pool, nothing, (), _row, jobs, _lost):
                results.append(result)
                terminal.say(f"{result.name}: {result.verdict()}, {result.seconds:.0f} s")
                # After every row, so that an interrupt leaves the page of those until then.
                page = report(results, self.quick, time.monotonic() - begun)
                write_text(self.output / "differences.md", page)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
        terminal.say(f"Written to {self.output / 'differences.md'}.")
        return int(any(one.beyond or one.failed for one in results))


def _row(_: None, name: str, source: Campaign, quick: bool, output: Path) -> Result:
    """`reproduced` as a job of an executor; a fault of one row is not the end of the others."""
    try:
        return reproduced(name, source, quick, output)
    except Exception as error:
        return Result(name, failed=f"{type(error).__name__}: {error}")


def _lost(name: str, *_: object) -> Result:
    """Result of a row whose worker was lost too often."""
    return Result(
        name, failed="its worker was lost; the usual causes are too little memory and a time limit"
    )


def reproduced(name: str, source: Campaign, quick: bool, output: Path) -> Result:
    """Run one row in a folder of its own below ``output``, and compare its tables."""
    result = Result(name)
    folder = output / name.replace(" ", "-")
    _prepare(folder, source)
    begun = time.monotonic()
    log = folder / "log.txt"
    with log.open("a", encoding="utf-8") as file:
        for command in source.measured_by(name, quick):
            # Codes of commands say whether targets were met, or that the page has the mark of another number of
            # flights; evidence that is missing is seen below.
            process = subprocess.Popen(
                _words(command), cwd=folder, env=_environment(), stdout=file, stderr=file
            )
            _, process.returncode, used = os.wait4(process.pid, 0)
            result.processor_seconds += used.ru_utime + used.ru_stime
    result.seconds = time.monotonic() - begun
    for written, evidence in source.moved:
        if (folder / written).exists():
            shutil.copyfile(folder / written, folder / "docs" / "validation" / evidence)
    result.same_machine = _is_same_machine(source, folder / "docs")
    bitwise = result.same_machine and source.deterministic and not quick
    for table in source.tables:
        try:
            found = source.table(folder / "docs", table)
        except (OSError, RansError, LookupError) as error:
            result.failed = f"no evidence of {table}, see {log}: {type(error).__name__}: {error}"
            return result
        published = source.table(ROOT / "docs", table)
        for difference, count in compared(published, found, source, quick, bitwise):
            result.cells += count
            if difference is not None:
                result.differences.append(difference._replace(table=table))
    if not result.cells:
        result.failed = f"nothing was measured, see {log}"
    return result


def _prepare(folder: Path, source: Campaign) -> None:
    """A fresh copy of the pages and of the evidence of others."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    shutil.copytree(
        ROOT / "docs", folder / "docs", ignore=shutil.ignore_patterns("pictures", "tutorials", "_*")
    )
    for name in source.evidence:
        evidence = folder / "docs" / "validation" / name
        shutil.rmtree(evidence) if evidence.is_dir() else evidence.unlink()
        if not evidence.suffix:
            evidence.mkdir()


def _words(command: str) -> list[str]:
    """Arguments of a command of the list, run by this Python."""
    first, *rest = shlex.split(command)
    return [sys.executable, *(["-m", "rans"] if first == "rans" else []), *rest]


def _environment() -> dict[str, str]:
    """Environment variables of the commands: they find the modules of this checkout from any folder."""
    paths = [str(ROOT), str(ROOT / "agents"), os.environ.get("PYTHONPATH", "")]
    return os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}


def _is_same_machine(source: Campaign, docs: Path) -> bool:
    """Whether all evidence says the processor and versions that the new one says."""
    for name in source.evidence:
        files = [folder / "validation" / name for folder in (ROOT / "docs", docs)]
        if not (files[0].suffix and files[1].exists()):
            return False
        before, now = (_environment_of(file) for file in files)
        if not before or any(before.get(key) != now.get(key) for key in _VERSIONS):
            return False
    return bool(source.evidence)


def _environment_of(file: Path) -> dict[str, str]:
    """Versions and hardware that evidence says; some of it says none."""
    evidence = read_json(file)
    return evidence.get("environment", {}) if isinstance(evidence, dict) else {}


def compared(
    published: Table, found: Table, source: Campaign, quick: bool, bitwise: bool
) -> Iterator[tuple[Difference | None, int]]:
    """Compare every cell of two tables: a difference, or None, and 1 for each cell that counts.

    Rows are paired by their first cells if both have the same, each once; else by number if both have as many, else
    by their first texts.
    """
    headings = list(published.headings)
    pairs = _paired(published.rows, found.rows, source.named_by)
    for before, now in pairs:
        if now is None and quick and source.fewer_rows:
            continue
        label = _label(before, source.named_by)
        for heading, old, new in zip(headings, before, now or [""] * len(before), strict=True):
            if any(part and part in heading for part in source.uncompared):
                continue
            if old == new:
                yield None, 1
                continue
            # Fewer flights may leave nobody of whom there is a mean.
            if new in ("-", "none") and quick and source.fewer_rows:
                continue
            share = "%" in heading or any(part in heading for part in source.shares)
            counts = _flights(headings, before, now, source)
            agrees = not bitwise and agree(old, new, share, counts, source.tolerance[quick])
            yield Difference("", label, heading, old, new, agrees), 1


def _paired(
    published: Sequence[Sequence[str]], found: Sequence[Sequence[str]], named_by: int
) -> list[tuple[Sequence[str], Sequence[str] | None]]:
    if len(published) == len(found):
        # A table may be sorted by what was measured, which fewer flights order in another way.
        by_first = {row[0]: row for row in found}
        if len(by_first) == len(found) and by_first.keys() == {row[0] for row in published}:
            return [(row, by_first[row[0]]) for row in published]
        return list(zip(published, found, strict=True))
    by_label = {_label(row, named_by): row for row in found}
    return [(row, by_label.get(_label(row, named_by))) for row in published]


def _label(row: Sequence[str], named_by: int) -> str:
    """The first two of so many cells that are no numbers, which say what a row is about."""
    return ", ".join([cell for cell in row[:named_by] if cell and not _NUMBER.fullmatch(cell)][:2])


def _flights(
    headings: Sequence[str], before: Sequence[str], now: Sequence[str] | None, source: Campaign
) -> tuple[float, float]:
    """Flights behind the shares of a row: those that it says, or those of the list."""
    for name in ("starts", "flights"):
        if name in headings and now is not None:
            column = list(headings).index(name)
            said = [_NUMBER.fullmatch(row[column]) for row in (before, now)]
            if all(said):
                return tuple(float(one[0].replace(",", "")) for one in said if one)  # type: ignore[return-value]
    full, quick = source.flights
    return float(full), float(quick)


def agree(
    published: str, found: str, share: bool, flights: tuple[float, float], tolerance: float
) -> bool:
    """Whether two cells agree: shares in % within three standard deviations, other numbers within a tolerance.

    The proportion of both samples is Agresti and Coull's, so that none of n has a deviation too. A number that was
    rounded for the page may differ by one in its last digit.
    """
    # "1.010 of 32" is a mean that says its flights, and "20 of 32" a share.
    published, found = (_MEAN_OF.sub(r"\1", text) for text in (published, found))
    parts = [_OF.search(text) for text in (published, found)]
    if parts[0] and parts[1]:
        (x, n), (y, m) = (tuple(map(float, part.groups())) for part in parts if part)
        rest = [_OF.sub("", text) for text in (published, found)]
        near = min(n, m) > 0 and abs(x / n - y / m) <= _deviation(x + y, n, m)
        return near and agree(rest[0], rest[1], share, flights, tolerance)
    old, new = ([one[0] for one in _NUMBER.finditer(text)] for text in (published, found))
    if len(old) != len(new) or _NUMBER.sub("", published) != _NUMBER.sub("", found):
        return False
    for one, two in zip(old, new, strict=True):
        x, y = (float(text.replace(",", "")) for text in (one, two))
        last = max(_last_digit(one), _last_digit(two))
        n, m = flights
        if share and min(n, m) > 0 and min(x, y) >= 0.0 and max(x, y) <= 100.0:
            allowed = 100.0 * _deviation((x * n + y * m) / 100.0, n, m)
        else:
            allowed = tolerance * max(abs(x), abs(y))
        if abs(x - y) > allowed + 1.01 * last:
            return False
    return True


def _deviation(hits: float, n: float, m: float) -> float:
    """Three standard deviations of the difference of two shares, of n and m flights with so many hits together."""
    p = (hits + 2.0) / (n + m + 4.0)
    return _SIGMAS * math.sqrt(p * (1.0 - p) * (1.0 / n + 1.0 / m))


def _last_digit(text: str) -> float:
    """Value of 1 in the last digit of a number."""
    mantissa, _, exponent = text.partition("e")
    digits = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - digits)


def report(results: Sequence[Result], quick: bool, seconds: float) -> str:
    """The page of differences, in markdown."""
    text = ["# Differences", ""]
    text += ["Fewer flights than published, by `--quick`.", ""] if quick else []
    headings = "what", "page", "verdict", "seconds", "of processors", "same processor and versions"
    text += lines(
        headings,
        (
            (
                one.name,
                ROWS[one.name].page,
                one.verdict(),
                f"{one.seconds:.0f}",
                f"{one.processor_seconds:.0f}",
                "yes" if one.same_machine else "no",
            )
            for one in results
        ),
    )
    text += ["", f"{seconds:.0f} s in all.", "", "## Cells that differ by more than accepted", ""]
    text += _cells([cell for one in results for cell in one.beyond])
    text += ["", "## Cells that agree, and are not equal", ""]
    text += _cells([cell for one in results for cell in one.differences if cell.agrees])
    text += ["", "## Versions and hardware", ""]
    text += lines(("what", "version"), environment().items())
    text += ["", "## Agents", ""]
    hashes = (
        hashlib.sha256(read_bytes(pretrained_folder(name) / AGENT, _LARGEST_AGENT)).hexdigest()
        for name in pretrained_names()
    )
    text += lines(("agent", f"SHA-256 of {AGENT}"), zip(pretrained_names(), hashes, strict=True))
    return "\n".join(text) + "\n"


def _cells(differences: Sequence[Difference]) -> list[str]:
    headings = "table", "row", "column", "published", "found"
    return [*lines(headings, (one[:5] for one in differences))] if differences else ["None."]


if __name__ == "__main__":
    import torch  # noqa: F401  # the environment names its GPU

    name = "python -m campaigns reproduce"
    raise SystemExit(ended(name, lambda: tyro.cli(Reproduce, prog=name).run()))
