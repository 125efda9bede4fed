"""The dossier of an agent: what is known of it, row by row, each with its evidence and the command that repeats it.

Its questions are those of ESA's handbook on qualifying machine learning (ECSS-E-HB-40-02A): operational domain,
requirement, evidence, limits. Rows come from the files of results in the agent's folder, and a question without a
file of this very agent is an empty row.
"""

from __future__ import annotations

import hashlib
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from os.path import normpath
from pathlib import Path
from typing import Any, Literal, get_args

from rans.evaluation.fly.evidence import agent_hashes
from rans.extend import (
    ConfigError,
    ContestantName,
    Fact,
    Page,
    Part,
    RunFolder,
    Section,
    Table,
    contestant,
    counted,
    environment,
    inside,
    read_bytes,
    reading,
    structure,
    write_json,
)
from rans.show.pages.page import header
from rans.show.pages.report import sections_of

_LARGEST = 2**28
"""Bytes of a file of results that is read."""
_TITLES: dict[Part, str] = {
    "domain": "Operational domain",
    "requirement": "Requirement",
    "evidence": "Evidence",
    "limits": "Limits",
}
_ALIKE = 0.05
"""How far a number may be from that of another computer, relative: processors round differently, and a flight or
two of some hundreds end otherwise."""
_MACHINE = ("processor", "torch", "numpy", "drake", "revision")
"""What decides, beside agent and command, whether a result comes out equal bit by bit."""


@dataclass(frozen=True)
class Source:
    """A file of results that answers some questions."""

    files: str
    """Pattern of its name, below the agent's folder."""
    command: str
    """Command that writes it, with {agent}, {craft} and {folder}."""
    of: Literal["agent", "spacecraft", "simulation"]
    """What its file must be of, by SHA-256."""
    questions: tuple[tuple[Part, str], ...]
    """Rows that stand empty without it."""


SOURCES = (
    Source(
        "export/contract.json",
        "rans export {agent} --format c --output {folder}/export",
        "agent",
        (
            ("domain", "contract: spacecraft, observation, commands, conditions"),
            ("evidence", "export equal to the network, time and stack"),
        ),
    ),
    Source(
        "assurance*.json",
        "rans assure {agent} --episodes 10000",
        "agent",
        (
            ("requirement", "requirement, and bound on the failure probability"),
            ("limits", "worst flights with their replay"),
        ),
    ),
    Source(
        "evaluation-drake.json",
        "rans evaluate {agent} --engine drake --episodes 64",
        "agent",
        (("evidence", "flights in Drake"),),
    ),
    Source(
        "validation.json",
        "rans validate {craft} --quick --output {folder}",
        "spacecraft",
        (("evidence", "dynamics of the spacecraft against Drake"),),
    ),
    Source(
        "judges.json",
        "rans validate --judges --output {folder}",
        "simulation",
        (("evidence", "the simulation against other software"),),
    ),
    Source(
        "stress.json",
        "rans stress {agent} --episodes 32",
        "agent",
        (("limits", "disturbances and faults that are tolerated"),),
    ),
    Source(
        "compare.json",
        "rans compare {agent} --with lqr optimal --conditions perfect --episodes 16 --certified 2",
        "agent",
        (("limits", "gap to what is certified as possible"),),
    ),
)


@dataclass(frozen=True)
class Row:
    """A question and its answer."""

    part: Part
    what: str
    value: str
    """Empty: there is no evidence, and `command` would make it."""
    passed: bool | None
    command: str
    """Empty: nothing answers the question."""
    file: str = ""
    """File of the evidence, below the agent's folder."""
    date: str = ""
    agent: str = ""
    """SHA-256 of the agent's weights that the evidence is of."""
    data: str = ""
    """SHA-256 of the file."""
    machine: str = ""
    """Processor and versions that made it."""
    measured: bool = False
    """See `Fact`."""


@dataclass(frozen=True)
class _Written:
    """Content of dossier.json."""

    agent: str
    hashes: dict[str, str]
    rows: tuple[Row, ...]
    environment: dict[str, str]

    @classmethod
    def read(cls, file: Path) -> _Written:
        """Read what `Dossier.write` wrote; `ConfigError` if it is damaged."""
        with reading(file) as table:
            return structure(table, cls, str(file))


UNPROVED = Row(
    "evidence",
    "proof: none is known for agents, rans prove takes networks of ONNX files with plants of formulas",
    "",
    None,
    "",
)
"""The row of proof, which no command can fill."""


class Dossier:
    """The rows of an agent, collected from its folder.

    Args:
        name: the agent.

    Raises:
        ConfigError: there is no such agent, or a file of its folder is damaged.
    """

    def __init__(self, name: str) -> None:
        parsed = ContestantName.parse(name)
        run = contestant(parsed)
        self.name = parsed.in_full or parsed.text
        self.folder = parsed.output_folder
        self.hashes = agent_hashes(self.name, run.judged)
        self._weights = next(
            (value for key, value in self.hashes.items() if not key.startswith("spacecraft")), ""
        )
        craft = parsed.craft or run.craft.name
        if parsed.kind == "run folder" and not parsed.craft:
            craft = str(RunFolder(parsed.own_folder).spacecraft_file)
        self._craft = craft
        self.sections: list[Section] = []
        """Sections of the files that are evidence."""
        self.rows = [*(row for source in SOURCES for row in self._rows(source)), UNPROVED]

    @property
    def file(self) -> Path:
        """File of the rows, beside which the page is."""
        return inside(self.folder, "dossier.json")

    def _rows(self, source: Source) -> Iterator[Row]:
        """Rows of a source: the facts of its files, or its questions."""
        command = source.command.format(
            agent=shlex.quote(self.name),
            craft=shlex.quote(self._craft),
            folder=shlex.quote(str(self.folder)),
        )
        others = []
        answered = set[Part]()
        for file in sorted(self.folder.glob(source.files)):
            if other := self._other(source, file):
                others.append(other)
                continue
            for found, section in sections_of(file.parent):
                if found == file:
                    self.sections.append(section)
                    for fact in section.facts:
                        answered.add(fact.part)
                        yield self._row(fact, file)
        for part, what in source.questions:
            if part not in answered:
                yield Row(part, "; ".join([what, *others]), "", None, command)

    def _other(self, source: Source, file: Path) -> str:
        """Why a file is no evidence of this agent; "": it is."""
        about = _about(file)
        if about.get("is_partial"):
            return f"{file.name} is of an interrupted command"
        recorded = about["hashes"]
        wanted = self.hashes if source.of == "agent" else {}
        if source.of == "spacecraft":
            wanted = {"spacecraft": self.hashes["spacecraft"]}
        for key, value in wanted.items():
            if recorded.get(key) != value:
                what = "is of another" if key in recorded else "says nothing of its"
                return f"{file.name} {what} {key}"
        return ""

    def _row(self, fact: Fact, file: Path) -> Row:
        about = _about(file)
        made = about["environment"]
        return Row(
            fact.part,
            fact.what,
            fact.amount,
            fact.passed,
            str(about.get("command", "")),
            file.relative_to(self.folder).as_posix(),
            str(made.get("date", "")),
            self._weights,
            hashlib.sha256(read_bytes(file, _LARGEST)).hexdigest(),
            ", ".join(str(made.get(key, "")) for key in _MACHINE),
            fact.measured,
        )

    def parts(self) -> list[Section]:
        """A section a question, in the order in which an engineer asks, with the rows that answer it."""
        sections = []
        for part in get_args(Part):
            rows = [row for row in self.rows if row.part == part]
            columns = ("what", "value", "verdict", "command", "date", "agent", "data")
            cells = [
                (
                    row.what,
                    row.value or None,
                    row.passed,
                    row.command,
                    row.date,
                    row.agent[:8],
                    f"{row.file} {row.data[:8]}",
                )
                for row in rows
            ]
            empty = sum(not row.value for row in rows)
            text = f"{counted(empty, 'row')} without evidence." if empty else ""
            sections.append(Section(_TITLES[part], text, [Table(columns, cells)]))
        return sections

    @property
    def verdict(self) -> str:
        """How many rows have evidence, and how many of their bounds are kept."""
        answered = [row for row in self.rows if row.value]
        judged = [row for row in answered if row.passed is not None]
        kept = sum(bool(row.passed) for row in judged)
        return (
            f"{len(answered)} of {counted(len(self.rows), 'row')} have evidence; "
            f"kept: {kept} of {counted(len(judged), 'bound')}."
        )

    def write(self) -> None:
        """Write dossier.json and dossier.html, with the sections of all evidence below the rows."""
        written = _Written(self.name, self.hashes, (*self.rows,), environment())
        write_json(self.file, asdict(written))
        hashes = Table(("what", "SHA-256"), [*self.hashes.items()])
        first, *others = self.parts()
        leading = replace(first, hero=self.verdict)
        what = Section("What it is of", tables=[hashes])
        about = header({"agent": self.name, "environment": environment()})
        sections = [leading, *others, what, *self.sections]
        page = Page(f"Dossier of {self.name}", sections, about, sheet=True)
        page.write(self.file.with_suffix(".html"))

    def falsehoods(self) -> Iterator[str]:
        """What is wrong in the dossier that was written: against the agent, its files, and their commands again.

        Raises:
            ConfigError: there is none.
        """
        if not self.file.exists():
            raise ConfigError(f"{self.file} is not there: rans dossier {self.name} writes it.")
        written = _Written.read(self.file)
        before = {(row.file, row.what): row for row in written.rows}
        for key, value in self.hashes.items():
            if written.hashes.get(key) != value:
                yield f"the dossier is of another agent: {key} differs"
        yield from _differences(before, self.rows, "its file says", is_exact=True)

    def repeated(self, row: Row) -> Iterator[str]:
        """Differences of the rows of a file from those that its command gives in an empty folder.

        Args:
            row: any row of the file.
        """
        words = self._words(row.command)
        if not words:
            yield f"{row.file} names no command of a dossier: {row.command}"
            return
        with tempfile.TemporaryDirectory() as place:
            again = _again(self, words, Path(place))
        old = {(one.file, one.what): one for one in self.rows if one.file == row.file}
        new = [one for one in again if one.file == row.file]
        yield from _differences(old, new, "its command gives", is_exact=False)

    def _words(self, command: str) -> list[str]:
        """Words of a command that a file names; none if it may run code of whoever wrote the file."""
        known = {shlex.split(source.command)[1] for source in SOURCES}
        try:
            words = shlex.split(command)
            names = [value for word in words if ":" in (value := word.partition("=")[2] or word)]
            parsed = [ContestantName.parse(name) for name in names if name != self.name]
        except (ConfigError, ValueError):
            return []
        # MODULE:NAME would be imported, as a name that the user has typed.
        is_code = any(":" in name.name + name.setup + name.craft for name in parsed)
        # More steps up than there are folders.
        up = (Path(normpath(path)).parts.count("..") for word in words for path in _paths(word))
        is_out = any(count >= len(Path.cwd().parts) for count in up)
        is_trusted = any(word.startswith("--trust") for word in words)
        is_known = words[:1] == ["rans"] and not known.isdisjoint(words[1:2])
        return words if is_known and not (is_code or is_out or is_trusted) else []


def _about(file: Path) -> dict[str, Any]:
    """How a file of results was made: command, environment and hashes; empty where it does not say."""
    with reading(file) as content:
        about = content | content.get("about", {})
        return about | {key: dict(about.get(key, {})) for key in ("environment", "hashes")}


def _again(dossier: Dossier, words: Sequence[str], place: Path) -> list[Row]:
    """Rows after a command has run beside a copy of the agent alone.

    Raises:
        ConfigError: the command has failed.
    """
    name = ContestantName.parse(dossier.name)
    copied = [Path(word) for word in (name.craft, *words[2:]) if word.endswith(".toml")]
    if name.policy_file:
        copied.append(name.policy_file)
    if name.kind == "run folder":
        results = [*(source.files for source in SOURCES), "*.html", dossier.file.name]
        copied += [file for file in Path(name.name).iterdir() if not any(map(file.match, results))]
    # Below the place is a folder for every path: a relative one is there as it is here, with "..".
    folder = place / _moved(str(Path.cwd()), place)
    folder.mkdir(parents=True)
    for file in copied:
        if file.is_file():
            inner = folder / _moved(str(file), place)
            inner.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, inner)
    for arguments in (words[1:], ["dossier", dossier.name]):
        done = subprocess.run(
            # No module is imported from the folder of an agent.
            [sys.executable, "-P", "-m", "rans", *(_moved(word, place) for word in arguments)],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
    written = next(place.rglob(dossier.file.name), None)
    if written is None:
        raise ConfigError(f"{shlex.join(words)} ended with {done.returncode}: {done.stderr[-300:]}")
    rows = []
    for row in _Written.read(written).rows:
        texts = {
            key: x.replace(str(place), "") for key, x in asdict(row).items() if isinstance(x, str)
        }
        rows.append(replace(row, **texts))  # pyrefly: ignore[bad-argument-type]
    return rows


def _moved(word: str, place: Path) -> str:
    """A word of a command with its paths from the root below a place."""
    return "".join(f"{place}{x}" if Path(x).is_absolute() else x for x in _paths(word))


def _paths(word: str) -> list[str]:
    """What may be paths in a word, and what is between them."""
    return re.split("([=@])", word)


def _differences(
    before: Mapping[tuple[str, str], Row], after: Sequence[Row], where: str, is_exact: bool
) -> Iterator[str]:
    """Rows that say something else than those of a dossier."""
    now = {(row.file, row.what): row for row in after}
    for key in dict.fromkeys((*before, *now)):
        old = before.get(key)
        new = now.get(key)
        what = f"{key[1]} ({key[0] or 'no file'})"
        if old is None or new is None:
            yield f"{what}: the dossier {'lacks it' if old is None else 'has it'}, {where} otherwise"
        elif old.passed != new.passed:
            verdict = {True: "pass", False: "FAIL", None: "no verdict"}
            yield f"{what}: the dossier says {verdict[old.passed]}, {where} {verdict[new.passed]}"
        elif not _alike(old, new, is_exact):
            yield f"{what}: the dossier says {old.value}, {where} {new.value}"
        elif is_exact and old != new:
            changed = [key for key, value in asdict(old).items() if asdict(new)[key] != value]
            yield f"{what}: {', '.join(changed)} is another than that of its file"


def _alike(old: Row, new: Row, is_exact: bool) -> bool:
    """Whether two values are equal, or from two computers nearly so."""
    if old.value == new.value or (old.measured and not is_exact):
        return True
    if is_exact or old.machine == new.machine:
        return False
    numbers = [re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", text) for text in (old.value, new.value)]
    return len(numbers[0]) == len(numbers[1]) and all(
        abs(float(a) - float(b)) <= _ALIKE * max(abs(float(a)), abs(float(b)))
        for a, b in zip(*numbers, strict=True)
    )
