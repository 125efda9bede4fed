"""The dossier of an agent: what is known of it, row by row, each with its evidence and the command that repeats it.

Its questions are those of ESA's handbook on qualifying machine learning (ECSS-E-HB-40-02A): operational domain,
requirement, evidence, limits. Rows come from the files of results in the agent's folder, and a question without a
file of this very question (agent, task, trade-off) is an empty row.
"""

from __future__ import annotations

import hashlib
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from copy import copy
from dataclasses import asdict, dataclass, replace
from os.path import normpath
from pathlib import Path
from typing import Any, Literal, get_args

from rans.evaluation.fly.evidence import question_hashes
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
    read_text,
    reading,
    structure,
    write_json,
    write_text,
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
_LATE = "readings late by"
"""The disturbance without which no dossier says how it stands."""
_ALIKE = 1e-3
"""How far a number may be from that of the command run again, relative: its last digits depend on the processor."""
_SLOWER = 10.0
"""How many times as long a command of an agent may take on another processor, or on one that is busy."""
_OF_A_RUN = ("environment", "seconds", "revision", "rans")
"""Entries of files of results that every run has of its own."""


@dataclass(frozen=True)
class Source:
    """A file of results that answers some questions."""

    files: str
    """Pattern of its name, below the agent's folder."""
    command: str
    """Command that writes it, with {agent}, {craft} and {folder}."""
    of: Literal["question", "agent", "spacecraft", "simulation"]
    """What its file must be of, by SHA-256: the question is the agent with its task, trade-off and timing."""
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
        "question",
        (
            ("requirement", "requirement, and bound on the failure probability"),
            ("limits", "worst flights with their replay"),
        ),
    ),
    Source(
        "evaluation*drake.json",
        "rans evaluate {agent} --engine drake --episodes 64",
        "question",
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
        "question",
        (("limits", "disturbances and faults that are tolerated"),),
    ),
    Source(
        "compare.json",
        "rans compare {agent} --with lqr optimal --conditions perfect --episodes 16 --certified 2",
        "question",
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
    """Command that makes missing evidence, with {agent}, {craft} and {folder}; empty: there is none."""
    file: str = ""
    """File of the evidence, below the agent's folder."""
    date: str = ""
    data: str = ""
    """SHA-256 of the file."""
    is_asked: bool = False
    """Whether a bound is asked, which is undecided where ``passed`` is None."""
    leads: bool = False
    """See `Fact`."""


@dataclass(frozen=True)
class _Written:
    """Content of a dossier's JSON file."""

    names: dict[str, str]
    """Agent, craft and folder, as commands name them."""
    hashes: dict[str, str]
    rows: tuple[Row, ...]
    environment: dict[str, str]


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
        self.file = inside(self.folder, "-".join(filter(None, ("dossier", parsed.part))) + ".json")
        """File of the rows, beside which the page is."""
        self.hashes = question_hashes(self.name, run.judged)
        craft = parsed.craft or run.craft.name
        training: list[Row] = []
        if parsed.kind in ("run folder", "pretrained"):
            own = RunFolder(parsed.own_folder)
            training = [_training(own)] if own.config_file.exists() else []
            if parsed.kind == "run folder" and not parsed.craft:
                craft = str(own.spacecraft_file)
        names = {"agent": self.name, "craft": craft, "folder": str(self.folder)}
        self.names = {key: shlex.quote(name) for key, name in names.items()}
        self.sections: list[Section] = []
        """Sections of the files that are evidence."""
        of_files = [row for source in SOURCES for row in self._rows(source)]
        self.rows = [*training, *of_files, UNPROVED]

    def _rows(self, source: Source) -> Iterator[Row]:
        """Rows of a source: the facts of its files, or its questions."""
        others = []
        answered = set[Part]()
        for file in sorted(self.folder.glob(source.files)):
            if other := self._other(source, file):
                others.append(other)
                continue
            for found, section in sections_of(file.parent):
                if found == file:
                    self.sections.append(replace(section, folded=True))
                    for fact in section.facts:
                        answered.add(fact.part)
                        yield self._row(fact, file, source)
        for part, what in source.questions:
            if part not in answered:
                yield Row(part, "; ".join([what, *others]), "", None, source.command)

    def _other(self, source: Source, file: Path) -> str:
        """Why a file is no evidence of this question; "": it is."""
        about = _about(file)
        if about.get("is_partial"):
            return f"{file.name} is of an interrupted command"
        recorded = about["hashes"]
        of_others = {
            "agent": {"task and timing"},
            "spacecraft": self.hashes.keys() - {"spacecraft"},
        }
        left_out = self.hashes if source.of == "simulation" else of_others.get(source.of, ())
        for key, value in self.hashes.items():
            if key not in left_out and recorded.get(key) != value:
                what = "is of another" if key in recorded else "says nothing of its"
                return f"{file.name} {what} {key}"
        return ""

    def _row(self, fact: Fact, file: Path, source: Source) -> Row:
        about = _about(file)
        return Row(
            fact.part,
            fact.what,
            fact.amount,
            fact.passed,
            str(about.get("command", "")) if fact.value else source.command,
            file.relative_to(self.folder).as_posix(),
            str(about["environment"].get("date", "")),
            hashlib.sha256(read_bytes(file, _LARGEST)).hexdigest(),
            fact.is_asked,
            fact.leads,
        )

    def command(self, row: Row) -> str:
        """Command of a row, which can be typed."""
        return row.command if row.value else row.command.format(**self.names)

    def parts(self) -> list[Section]:
        """A section a question, in the order in which an engineer asks, with the rows that answer it."""
        sections = []
        for part in get_args(Part):
            rows = [row for row in self.rows if row.part == part]
            columns = ("what", "value", "verdict", "command", "date", "data")
            cells = [
                (
                    row.what,
                    row.value or None,
                    "undecided" if row.is_asked and row.passed is None else row.passed,
                    self.command(row),
                    row.date,
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
        """What matters first, how many bounds are kept, and how many rows have evidence."""
        answered = [row for row in self.rows if row.value]
        leading = [f"{row.what}: {row.value.partition(' (')[0]}" for row in answered if row.leads]
        if not any(row.what.startswith(_LATE) for row in answered):
            leading.append(f"{_LATE}: not flown")
        judged = [row.passed for row in answered if row.passed is not None or row.is_asked]
        words = {True: "kept", False: "not kept", None: "undecided"}
        bounds = ", ".join(f"{judged.count(x)} {word}" for x, word in words.items() if x in judged)
        leading.append(f"bounds: {bounds or 'none'}")
        return f"{'; '.join(leading)}. {len(answered)} of {counted(len(self.rows), 'row')} have evidence."

    def _page(self, made: Mapping[str, str]) -> str:
        """The page, as it was written under an environment."""
        first, *others = self.parts()
        hashes = Table(("what", "SHA-256"), [*self.hashes.items()])
        what = Section("What it is of", tables=[hashes], folded=True)
        about = header({"agent": self.name, "environment": dict(made)})
        sections = [replace(first, hero=self.verdict), *others, what, *self.sections]
        return Page(f"Dossier of {self.name}", sections, about, True, made["date"]).html()

    def write(self) -> None:
        """Write JSON file and page, with the sections of all evidence folded below the rows."""
        made = environment()
        write_json(self.file, asdict(_Written(self.names, self.hashes, (*self.rows,), made)))
        write_text(self.file.with_suffix(".html"), self._page(made))

    def falsehoods(self) -> Iterator[str]:
        """What is wrong in the dossier that was written: against the agent, its files, and its page.

        A folder that has been moved since is named as it was.

        Raises:
            ConfigError: there is none, or it is damaged.
        """
        if not self.file.exists():
            raise ConfigError(f"{self.file} is not there: rans dossier {self.name} writes it.")
        old, page = self._written()
        for key in dict.fromkeys((*self.hashes, *old.hashes)):
            if old.hashes.get(key) != self.hashes.get(key):
                yield f"the dossier is of another agent: {key} differs"
        before, now = (
            {f"{row.what} ({row.file or 'no file'})": asdict(row) for row in rows}
            for rows in (old.rows, self.rows)
        )
        yield from _differences(before, now, "the dossier says", "its file")
        file = self.file.with_suffix(".html")
        if not file.exists() or read_text(file) != page:
            yield f"{file.name} is not the page of these rows: it was changed, or another version of RANS wrote it"

    def _written(self) -> tuple[_Written, str]:
        """The dossier that was written, and its page as it would be now, by the names of then."""
        with reading(self.file) as table:
            old = structure(table, _Written, self.file.name, is_written=True)
            was = copy(self)
            was.names = {**self.names, **old.names}
            was.name = shlex.split(was.names["agent"])[0]
            return old, was._page(old.environment)

    def repeated(self, row: Row) -> Iterator[str]:
        """Differences of a file of results from what its command writes in an empty folder.

        Args:
            row: any row of the file.
        """
        words = self._words(row.command)
        if not words:
            yield f"{row.file} names no command of a dossier: {row.command}"
            return
        with tempfile.TemporaryDirectory() as place:
            again = _again(self, words, row.file, Path(place))
        with reading(self.folder / row.file) as before:
            yield from _differences(before, again, f"{row.file} says", "its command")

    def made_elsewhere(self, row: Row) -> str:
        """With what the file of a row was made that is another one here, which may explain differences."""
        before = _about(self.folder / row.file)["environment"]
        here = environment()
        keys = ("rans", "revision", "processor", "torch", "numpy", "drake")
        others = (f"{x} {before.get(x)} (here {here[x]})" for x in keys if before.get(x) != here[x])
        return ", ".join(others)

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


def _training(own: RunFolder) -> Row:
    """How an agent was trained, by its folder; without a value where nobody has recorded it."""
    known = own.training()
    made = known.get("environment", {})
    value = ""
    if known:
        value = f"{own.config().algorithm}, {known['steps']:,} steps, seed {known['seed']}, RANS "
        value += f"{made.get('rans', 'unknown')}, revision {made.get('revision', 'unknown')}"
    return Row("domain", "training", value, None, "")


def _about(file: Path) -> dict[str, Any]:
    """How a file of results was made: command, environment and hashes; empty where it does not say."""
    with reading(file) as content:
        about = content | content.get("about", {})
        return about | {key: dict(about.get(key, {})) for key in ("environment", "hashes")}


def _again(dossier: Dossier, words: list[str], file: str, place: Path) -> Any:
    """What a command writes into a file beside a copy of the agent alone, which it finds where it names it.

    Raises:
        ConfigError: the command has not written the file.
    """
    name = ContestantName.parse(dossier.name)
    # Files of here by the paths that the command gives them: the folder may have been moved since.
    named = [word for word in words[2:] if word.endswith(".toml")]
    copied = {Path(path): Path(path) for path in named}
    if name.craft.endswith(".toml"):
        copied[Path(words[2].partition("#")[0].rpartition("@")[2])] = Path(name.craft)
    if name.policy_file:
        copied[name.policy_file] = name.policy_file
    if name.kind == "run folder":
        was = Path(words[2].removesuffix(f"#{name.part}"))
        was = was.parent if words[1] == "validate" else was
        results = [*(source.files for source in SOURCES), "*.html", "dossier*.json"]
        for inner in Path(name.name).iterdir():
            if not any(map(inner.match, results)):
                copied[was / inner.name] = inner
    # Below the place is a folder for every path: a relative one is there as it is here, with "..".
    folder = place / _moved(str(Path.cwd()), place)
    folder.mkdir(parents=True)
    for there, here in copied.items():
        if here.is_file():
            inner = folder / _moved(str(there), place)
            inner.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(here, inner)
    done = subprocess.run(
        # No module is imported from the folder of an agent.
        [sys.executable, "-P", "-m", "rans", *(_moved(word, place) for word in words[1:])],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    written = next(place.rglob(file), None)
    if written is None:
        raise ConfigError(f"{shlex.join(words)} ended with {done.returncode}: {done.stderr[-300:]}")
    # It names paths as they were, not those below the place.
    write_text(written, read_text(written).replace(str(place), ""))
    with reading(written) as content:
        return content


def _moved(word: str, place: Path) -> str:
    """A word of a command with its paths from the root below a place."""
    return "".join(f"{place}{x}" if Path(x).is_absolute() else x for x in _paths(word))


def _paths(word: str) -> list[str]:
    """What may be paths in a word, and what is between them."""
    return re.split("([=@])", word)


def _differences(old: Any, new: Any, said: str, by: str) -> Iterator[str]:
    """Values of two JSON values that differ, apart from what every run has of its own."""
    before, after = dict(_leaves(old)), dict(_leaves(new))
    for path in dict.fromkeys((*before, *after)):
        if path not in before or path not in after:
            yield f"{path}: {said} {'it' if path in before else 'nothing'}, {by} otherwise"
        elif not _alike(before[path], after[path]):
            yield f"{path}: {said} {before[path]}, {by} {after[path]}"


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Plain values of a JSON value, by their place in it."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if key not in _OF_A_RUN:
                yield from _leaves(inner, f"{path}, {key}" if path else str(key))
    elif isinstance(value, list | tuple):
        for number, inner in enumerate(value):
            own = inner.get("name", number) if isinstance(inner, Mapping) else number
            yield from _leaves(inner, f"{path}, {own}")
    else:
        yield path, value


def _alike(old: Any, new: Any) -> bool:
    """Whether two values are equal, to the digits that depend on the processor; times of a command roughly."""
    if isinstance(old, str) and isinstance(new, str):
        parts = [re.split(r"(\d+(?:\.\d+)?) us", text) for text in (old, new)]
        times = zip(*(part[1::2] for part in parts), strict=False)
        return parts[0][::2] == parts[1][::2] and all(
            float(a) <= _SLOWER * float(b) and float(b) <= _SLOWER * float(a) for a, b in times
        )
    if bool in (type(old), type(new)) or not all(isinstance(x, int | float) for x in (old, new)):
        return bool(old == new)
    return abs(old - new) <= _ALIKE * max(abs(old), abs(new))
