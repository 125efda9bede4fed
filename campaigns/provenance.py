"""Where the tables of the pages come from: one list, which `campaigns.reproduce` flies again.

``python -m campaigns.provenance`` writes docs/provenance.md from it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from campaigns import error_sources
from campaigns.figures import TABLES
from rans.files import write_text
from rans.model.spacecraft_file import spacecraft_names

_AGENTS = "pretrained:go-to-pose-2d-robust pretrained:go-to-pose-2d-faults pretrained:go-to-pose-2d"
_STUDIED = ("floating-platform", "floating-platform-air-tank", "floating-platform-shared")
_IN_SPACE = ("free-flyer", "free-flyer-shared")


@dataclass(frozen=True)
class Source:
    """Where tables come from, and how nearly a repetition must agree.

    Flights of a seed are deterministic: with the same processor and versions every cell is the same. Elsewhere, and
    with fewer flights, shares agree within three standard deviations and other numbers within a tolerance.
    """

    tables: tuple[str, ...]
    """Their names in `campaigns.figures.TABLES`."""
    page: str
    """Page that has them, from docs."""
    commands: tuple[str, ...]
    """What measures them, in a folder with a copy of docs."""
    seconds: float = 0.0
    """Processor time of the commands, s, on an AMD EPYC; 0: not measured."""
    quick: tuple[str, ...] = ()
    """Commands of `--quick`, with fewer flights; empty: it runs those of the whole reproduction."""
    quick_seconds: float = 0.0
    """Processor time of the quick commands, s; 0: not measured."""
    fewer_rows: bool = False
    """Whether the quick commands measure some rows of the tables only; the others are not compared."""
    flights: tuple[int, int] = (0, 0)
    """Flights behind a share, and with ``quick``; 0: the table has no shares, or says the number in each row."""
    shares: tuple[str, ...] = ()
    """Parts of the headings of columns with shares in %, beside those whose heading or cell has a "%"."""
    tolerance: tuple[float, float] = (0.02, 0.25)
    """Relative difference of other numbers that is accepted, and with ``quick``."""
    uncompared: tuple[str, ...] = ()
    """Headings of columns that are not compared: times of a machine, and with fewer flights extremes."""
    evidence: tuple[str, ...] = ()
    """Files in docs/validation that the commands write."""
    moved: tuple[tuple[str, str], ...] = ()
    """Files that the commands write elsewhere, and their names in docs/validation."""
    needs: str = ""
    """Folder of trainings that must be there first, and how to make it."""
    deterministic: bool = True
    """Whether two runs on one machine are equal; false where a limit of time ends a search."""


def _mission(
    name: str,
    options: str,
    quick: str,
    quick_seconds: float = 0.0,
    fewer_rows: bool = False,
) -> Source:
    """A mission's table, whose rows say their number of flights."""
    command = f"python -m campaigns.missions {name} --docs docs"
    return Source(
        tables=(name.replace("-", " "), f"standings of {name}"),
        page=f"missions/{name}.md",
        commands=(f"{command}{options}",),
        quick=(f"{command}{quick}",),
        fewer_rows=fewer_rows,
        quick_seconds=quick_seconds,
        uncompared=("starts", "worst"),
        evidence=(f"mission-{name}.json",),
    )


SOURCES: dict[str, Source] = {
    "stress": Source(
        tables=("stress",),
        page="assurance/stress.md",
        commands=(f"rans stress {_AGENTS} lqr switching --output runs/stress",),
        quick=("python -m campaigns.named_conditions --docs docs --episodes 64",),
        flights=(256, 64),
        shares=("go-to-pose", "lqr", "switching"),
        evidence=("stress.json",),
        moved=(("runs/stress/stress.json", "stress.json"),),
        quick_seconds=75.0,
    ),
    "validate": Source(
        tables=("validations", "values"),
        page="validation.md",
        commands=tuple(
            f"rans validate {name} --output runs/{name}" for name in (*_STUDIED, *_IN_SPACE)
        ),
        quick=tuple(
            f"rans validate {name} --quick --output runs/{name}" for name in (*_STUDIED, *_IN_SPACE)
        ),
        fewer_rows=True,
        # Rounding errors differ by a factor; what counts is that each is below its tolerance.
        tolerance=(30.0, 100.0),
        uncompared=("time", "checks"),
        evidence=tuple(f"{name}.json" for name in (*_STUDIED, *_IN_SPACE)),
        moved=tuple(
            (f"runs/{name}/validation.json", f"{name}.json") for name in (*_STUDIED, *_IN_SPACE)
        ),
        quick_seconds=136.0,
    ),
    "judges": Source(
        tables=("judges",),
        page="judges.md",
        commands=("rans validate --judges --output runs/judges",),
        # Differences of the last digits differ by a factor with the processor.
        tolerance=(30.0, 100.0),
        evidence=("judges.json",),
        moved=(("runs/judges/judges.json", "judges.json"),),
        quick_seconds=20.0,
    ),
    "robustness": Source(
        tables=("robustness",),
        page="robustness.md",
        commands=(
            "python -m campaigns.robustness pretrained:go-to-pose-2d-robust --episodes 2000",
            "python -m campaigns.robustness pretrained:go-to-pose-3d-robust --episodes 1000 --output "
            "docs/validation/robustness-space.json",
        ),
        quick=(
            "python -m campaigns.robustness pretrained:go-to-pose-2d-robust --episodes 200",
            "python -m campaigns.robustness pretrained:go-to-pose-3d-robust --episodes 100 --output "
            "docs/validation/robustness-space.json",
        ),
        flights=(1000, 100),
        shares=("solved",),
        evidence=("robustness.json", "robustness-space.json"),
        quick_seconds=81.0,
    ),
    "faults": Source(
        tables=("faults",),
        page="robustness.md",
        commands=(
            "python -m campaigns.faults pretrained:go-to-pose-2d-faults --episodes 2000 --bounded 100 "
            "--certified 64",
            "python -m campaigns.faults pretrained:go-to-pose-3d-faults --episodes 2000 --bounded 400 --output "
            "docs/validation/faults-space.json",
        ),
        quick=(
            "python -m campaigns.faults pretrained:go-to-pose-2d-faults --episodes 100 --bounded 2 "
            "--certified 1",
            "python -m campaigns.faults pretrained:go-to-pose-3d-faults --episodes 100 --bounded 2 --output "
            "docs/validation/faults-space.json",
        ),
        flights=(2000, 100),
        shares=("start", "by 15 s", "moment"),
        # A single certified start costs up to half as much again as the mean of many.
        tolerance=(0.02, 0.5),
        evidence=("faults.json", "faults-space.json"),
        deterministic=False,
        quick_seconds=95.0,
    ),
    "rest": Source(
        tables=("rest",),
        page="agents.md",
        commands=("python -m campaigns.rest",),
        quick=(
            "python -m campaigns.rest pretrained:go-to-pose-2d pretrained:go-to-pose-3d "
            "pretrained:track-velocity-2d --episodes 256",
        ),
        fewer_rows=True,
        flights=(16384, 256),
        uncompared=("steps of the cycles", "in a cycle", "opposite"),
        evidence=("rest.json",),
        quick_seconds=9.0,
    ),
    "assurances": Source(
        tables=("assurances",),
        page="assurance/assurances.md",
        commands=("python -m campaigns.assurances",),
        quick=(
            "python -m campaigns.assurances go-to-pose-2d go-to-pose-2d-robust --flights 2048 --no-replay",
        ),
        fewer_rows=True,
        uncompared=("flights", "failed", "probability", "how they fail", "flown again"),
        evidence=("assurance",),
        quick_seconds=15.0,
    ),
    "craft": Source(
        tables=("craft", "agents of craft"),
        page="craft.md",
        commands=("python -m campaigns.craft",),
        quick=("python -m campaigns.craft pingu spheres --drake 2",),
        fewer_rows=True,
        flights=(1024, 1024),
        uncompared=("in Drake",),
        evidence=("craft.json",),
        deterministic=False,
        quick_seconds=13.0,
    ),
    "craft rivals": Source(
        tables=("controllers of craft",),
        page="craft.md",
        commands=("python -m campaigns.craft_rivals",),
        quick=("python -m campaigns.craft_rivals pingu spheres --episodes 8",),
        fewer_rows=True,
        flights=(16, 8),
        uncompared=("flights",),
        evidence=("craft_rivals.json",),
        quick_seconds=45.0,
    ),
    "craft bounds": Source(
        tables=("bounds of craft",),
        page="certificate.md",
        commands=("python -m campaigns.craft_bounds",),
        quick=("python -m campaigns.craft_bounds freeflyer2 --starts 1",),
        fewer_rows=True,
        uncompared=("starts",),
        evidence=("craft-bounds.json",),
        quick_seconds=10.0,
    ),
    "avoid": _mission("avoid", "", " --episodes 64 --bounded 4", 55.0),
    "impulse among zones": Source(
        tables=("impulse among zones",),
        page="missions/avoid.md",
        commands=("python -m campaigns.zones",),
        quick=("python -m campaigns.zones --times 20.2",),
        fewer_rows=True,
        evidence=("avoid-front.json",),
        quick_seconds=35.0,
    ),
    "impulse to the port": Source(
        tables=("impulse to the port",),
        page="missions/dock-port.md",
        commands=("python -m campaigns.ports",),
        quick=("python -m campaigns.ports --times 14",),
        fewer_rows=True,
        evidence=("dock-port-front.json",),
        quick_seconds=48.0,
    ),
    "dock port": _mission("dock-port", "", " --episodes 64", 130.0),
    "dock": _mission(
        "dock",
        " --episodes 10000",
        " --episodes 64 --bounded 1 --deadlines 1000",
        fewer_rows=True,
        quick_seconds=26.0,
    ),
    "hold": _mission(
        "hold",
        " --bounded 4",
        " --episodes 4 --bounded 1 --deadlines 600",
        fewer_rows=True,
        quick_seconds=63.0,
    ),
    "rendezvous": _mission(
        "rendezvous",
        " --episodes 256",
        " --episodes 8 --bounded 1 --deadlines 4000",
        fewer_rows=True,
        quick_seconds=84.0,
    ),
    "land": _mission(
        "land", " --drake 8", " --episodes 16 --bounded 2 --drake 1", quick_seconds=104.0
    ),
    "dock with errors": Source(
        tables=("dock with errors",),
        page="missions/dock.md",
        commands=("python -m campaigns.dock_errors --docs docs",),
        quick=("python -m campaigns.dock_errors --docs docs --episodes 48 --bounded 4",),
        flights=(1024, 48),
        uncompared=("worst",),
        evidence=("dock-errors.json",),
        quick_seconds=99.0,
    ),
    "dock on ellipses": Source(
        tables=("dock on ellipses", "coasts on ellipses"),
        page="missions/elliptic.md",
        commands=("python -m campaigns.elliptic --docs docs",),
        quick=("python -m campaigns.elliptic --docs docs --episodes 16 --bounded 1",),
        flights=(64, 16),
        uncompared=("starts", "over the bound", "median time, s"),
        evidence=("elliptic.json",),
        quick_seconds=127.0,
    ),
    "hold with J2 and drag": Source(
        tables=(
            "hold with J2 and drag",
            "what is known with J2 and drag",
            "coasts with J2 and drag",
        ),
        page="missions/perturbed.md",
        commands=("python -m campaigns.perturbed --docs docs",),
        quick=("python -m campaigns.perturbed --docs docs --episodes 4 --true 1",),
        flights=(64, 4),
        uncompared=("starts", "mean spent, N s", "over the sphere, %", "worst, %"),
        evidence=("perturbed.json",),
        quick_seconds=170.0,
    ),
    "error sources": Source(
        tables=tuple(f"errors: {name}" for name in error_sources.TABLE_NAMES),
        page="missions/errors.md",
        commands=("python -m campaigns.error_sources --docs docs",),
        quick=("python -m campaigns.error_sources --docs docs --episodes 48 --flights 256",),
        flights=(512, 48),
        tolerance=(0.05, 0.5),
        evidence=("error-sources.json",),
        quick_seconds=302.0,
    ),
    "slosh": Source(
        tables=("slosh",),
        page="missions/slosh.md",
        commands=("python -m campaigns.slosh --docs docs",),
        quick=("python -m campaigns.slosh --docs docs --episodes 64 --drake 4",),
        flights=(256, 64),
        uncompared=("first starts, %", "in Drake, %"),
        evidence=("slosh.json",),
        quick_seconds=155.0,
    ),
    "docking with contact": Source(
        tables=("docking with contact",),
        page="missions/dock-port.md",
        commands=("python -m campaigns.dock_contact --docs docs",),
        quick=("python -m campaigns.dock_contact --docs docs --episodes 2",),
        flights=(64, 2),
        uncompared=("at most",),
        evidence=("dock-contact.json",),
        quick_seconds=69.0,
    ),
    "safe states": Source(
        tables=("safe states",),
        page="missions/guard.md",
        commands=("python -m campaigns.safe_set --docs docs",),
        quick=("python -m campaigns.safe_set --docs docs --states 128",),
        flights=(500, 60),  # about half of the states lie within another zone
        shares=(" m",),
        evidence=("safe-set.json",),
        seconds=7.0,
        quick_seconds=5.0,
    ),
    "identification": Source(
        tables=("identification",),
        page="robot/identify.md",
        commands=("python -m campaigns.identification --docs docs",),
        quick=("python -m campaigns.identification --docs docs --count 12",),
        flights=(256, 12),
        tolerance=(0.02, 1.0),
        uncompared=("95 % of errors below",),
        evidence=("identification.json",),
        quick_seconds=37.0,
    ),
    "identification in space": Source(
        tables=("identification in space",),
        page="robot/identify.md",
        commands=(
            "python -m campaigns.identification --spacecraft cubesat-6u --period 0.5 --docs docs",
        ),
        quick=(
            "python -m campaigns.identification --spacecraft cubesat-6u --period 0.5 --count 4 --docs docs",
        ),
        flights=(256, 4),
        tolerance=(0.02, 1.0),
        uncompared=("95 % of errors below",),
        evidence=("identification-space.json",),
        quick_seconds=90.0,
    ),
    "inspect": Source(
        tables=("inspect", "standings of inspect"),
        page="missions/inspect.md",
        commands=("python -m campaigns.inspection --docs docs",),
        quick=(
            'python -m campaigns.inspection --docs docs --episodes 2 --only "circumnavigation, 3,600 s"',
        ),
        fewer_rows=True,
        flights=(64, 2),
        tolerance=(0.02, 0.6),
        evidence=("mission-inspect.json",),
        quick_seconds=31.0,
    ),
    "passive safety": Source(
        tables=("passive safety", "percentiles"),
        page="missions/passive_safety.md",
        commands=("python -m campaigns.passive --docs docs",),
        quick=('python -m campaigns.passive --docs docs --episodes 64 --only "dock, mission"',),
        fewer_rows=True,
        uncompared=("starts", "least", "90 %", "99 %", "99.7 %"),
        evidence=("passive-safety.json",),
        quick_seconds=7.0,
    ),
    "published optima": Source(
        tables=("published optima",),
        page="optimal.md",
        commands=("python -m campaigns.published_optima --docs docs",),
        tolerance=(0.001, 0.001),
        uncompared=("guesses", "optima"),
        evidence=("published-optima.json",),
        seconds=15.0,
    ),
    "throttling": Source(
        tables=("throttling",),
        page="missions/land.md",
        commands=("python -m campaigns.throttling --docs docs",),
        quick=("python -m campaigns.throttling --docs docs --episodes 3",),
        uncompared=("starts", "with a landing", "one by one", "other starts"),
        evidence=("throttling.json",),
        quick_seconds=54.0,
    ),
    "identified agents": Source(
        tables=("identified agents",),
        page="robot/identified_agents.md",
        commands=("python -m campaigns.identified_agents fly runs/identified --docs docs",),
        flights=(1024, 1024),
        evidence=("identified-agents.json",),
        needs="runs/identified, hidden craft and 22 trainings (docs/robot/identified_agents.md)",
    ),
    "agents": Source(
        tables=("agents",),
        page="agents.md",
        commands=("python -m campaigns.agents runs/agents",),
        flights=(1024, 1024),
        evidence=("agents.json",),
        needs="runs/agents, three trainings of each row (docs/agents.md)",
    ),
    "RAFT": Source(
        tables=("RAFT", "RAFT with a wheel"),
        page="robot/raft.md",
        commands=("python -m campaigns.raft",),
        flights=(5120, 5120),
        shares=("PPO", "oracle", "LQR", "switching", "MPC"),
        evidence=("raft.json",),
        needs="runs/raft, a training of each recipe (docs/robot/raft.md)",
    ),
    "settled gate": Source(
        tables=("settled gate",),
        page="settled_gate.md",
        commands=(
            "python -m campaigns.settled_gate_entry fly runs/settled-gate runs/settled-gate-1 "
            "runs/settled-gate-2",
        ),
        flights=(500, 500),
        shares=("bias",),
        evidence=("settled-gate.json",),
        needs="runs/settled-gate, -1 and -2, three trainings (docs/settled_gate.md)",
    ),
    "V-BAR": Source(
        tables=("V-BAR",),
        page="missions/vbar.md",
        commands=("python -m campaigns.vbar --docs docs",),
        seconds=0.0,
        evidence=("vbar.json",),
        needs="vbar, an environment with Python 3.12 and V-BAR (docs/missions/vbar.md)",
    ),
}
"""By what is measured, the table of robustness first."""


PICTURES: dict[str, str] = {
    "agents.gif": "rans view go-to-pose-2d go-to-pose-3d --seed 5 --save docs/pictures/agents.gif",
    "frames.jpg": "rans view go-to-pose-3d --seed 5 --save docs/pictures/frames.jpg",
    "layouts.svg": "python -m campaigns.any_craft picture",
    "craft/*.svg": "python -m campaigns.craft",
    "diagrams/*.svg": "python -m campaigns.pictures",
    "missions/error-sources.svg": "python -m campaigns.error_sources --docs docs",
    "missions/*.svg": "python -m campaigns.pictures",
    "proof-cells.svg": "python packages/proof/archcomp/picture.py FOLDER docs/pictures/proof-cells.svg",
    "proof-conditions.svg": "python -m campaigns.proof_conditions docs/validation/proof-conditions.json "
    "docs/pictures/proof-conditions.svg",
    "tradeoff*.svg": "python -m campaigns.speed.tradeoff",
    "trapping-set.svg": "python -m campaigns.proofs CERTIFICATE docs/pictures/trapping-set.svg",
}
"""Files in docs/pictures, and what draws them."""
RECORDS: dict[str, tuple[str, str]] = {
    "bounds.json": (
        "certificate.md",
        "python -m campaigns.bounds --craft 2000 --output docs/validation/bounds.json",
    ),
    "breaking.json": ("verification.md", "python -m campaigns.breaking"),
    "exports.json": ("export.md", "python -m campaigns.exports"),
    "floating-platform.html": (
        "validation.md",
        "rans validate floating-platform --output FOLDER",
    ),
    "mixed-integer.json": (
        "certificate.md",
        "python -m campaigns.mixed_integer --starts 16 --output docs/validation/mixed-integer.json",
    ),
    "proof-conditions.json": (
        "proof/proofs.md",
        "python -m campaigns.proof_conditions docs/validation/proof-conditions.json PICTURE.svg",
    ),
    "robots.json": ("robot/robots.md", "python -m campaigns.robots"),
    "tradeoff*.json": ("speed.md", "python -m campaigns.speed.tradeoff"),
}
"""Other files in docs/validation: the page of their figures, and what writes them."""


def page() -> str:
    """Text of docs/provenance.md."""
    return (
        "\n".join([_HEAD, *_rows(), _duration(), _TAIL, *_records(), _DRAWN, *_pictures()]) + "\n"
    )


_HEAD = """# Provenance

Where the tables of the pages come from. `rans reproduce` flies them again in a checkout, and writes a page
of differences. This page is made from the same list, `campaigns/provenance.py`.

![A command writes a JSON file, from which a table of a page is made; two checks compare them]\
(pictures/diagrams/provenance.svg)

```
rans reproduce --quick                             # fewer flights of every table
rans reproduce --only stress "dock with errors"    # these alone, with every flight
rans reproduce                                     # all of them
```

| table of | measured by | evidence | flights behind each share; with `--quick` | processor time with `--quick`, s |
|---|---|---|---|---|"""
_TAIL = """
A table marked with * needs trainings first, and is left out with a sentence until they are there.

## What agrees

Flights of a seed are deterministic. On the same processor, with the versions of the evidence, every cell is the
same. Elsewhere, and with `--quick`, a share agrees within three standard deviations of both samples, and another
number within the tolerance of the list. Extremes of fewer flights and times of a machine are not compared.
Searches that a limit of time ends are never compared bit for bit. Of a thousand shares that agree, about three are
expected beyond three standard deviations.

The page of differences, `runs/reproduce/differences.md`, has every cell that differs, the time of each row,
versions, processor and GPU, and the SHA-256 of every agent. The exit code is 1 if a cell differs or a command
fails.

The whole reproduction was not timed. Flights in Drake, bounds and searches run on processors, and with
`--executor` on those of a cluster ([on many machines](cluster.md)). A GPU shortens only the flights in torch. On a
machine with one H100 and 16 processors two rows were timed with every flight: robustness in the plane 57 s on one
processor, and identification in the plane 74 s on all, 795 s of processor time. Whether all rows together take less
than an hour is not known: Drake and CasADi were not installed there.

The tables of [InnoCube's telemetry](../packages/robot/docs/innocube.md) come from
`python -m campaigns.innocube FOLDER`, with the data in FOLDER. They have no licence yet, so there
is no evidence here, and `rans reproduce` leaves these tables out.

## Other figures

Figures in sentences come from these files, and figures of speed from the command beside each. `rans reproduce` does
not measure them again.

| page | evidence | measured by |
|---|---|---|"""
_DRAWN = """
| picture | drawn by |
|---|---|"""


def _rows() -> Iterator[str]:
    for source in SOURCES.values():
        link = f"[{Path(source.page).stem}]({_in_repository(source.page)})" + "*" * bool(
            source.needs
        )
        commands = "<br>".join(f"`{command}`" for command in source.commands)
        files = ", ".join(f"[{name}](validation/{name})" for name in source.evidence)
        full, quick = source.flights
        counts = f"{full:,}, {quick:,}" if full else "-"
        seconds = quick_seconds(source)
        yield f"| {link} | {commands} | {files} | {counts} | {f'{seconds:.0f}' if seconds else '-'} |"


def _in_repository(page: str) -> str:
    """Path of a page from docs: that of a package, in docs by a symbolic link, is beside the package."""
    docs = Path(__file__).parents[1] / "docs"
    return Path(os.path.relpath((docs / page).resolve(), docs)).as_posix()


def quick_seconds(source: Source) -> float:
    """Processor time of a row with ``--quick``, s; 0: not measured."""
    return source.quick_seconds if source.quick else source.seconds


def _duration() -> str:
    """Sentence with the time of all quick rows."""
    every = {name: quick_seconds(one) for name, one in SOURCES.items() if not one.needs}
    total = sum(every.values())
    missing = [name for name, seconds in every.items() if not seconds]
    rest = f" The sum leaves out what was not measured: {', '.join(missing)}." if missing else ""
    # Shares of more flights take longer in proportion; searches and bounds do not.
    grown = [
        seconds * SOURCES[name].flights[0] / SOURCES[name].flights[1]
        for name, seconds in every.items()
        if SOURCES[name].flights[1]
    ]
    return (
        f"\nWith `--quick` all rows without * take {total:,.0f} s of one processor together, "
        f"{total / 120.0:.0f} minutes on two (AMD EPYC).{rest} With every flight the {len(grown)} rows whose "
        f"number of flights is stated would take {sum(grown):,.0f} s, if their times grow as the flights do: "
        f"{sum(grown) / 960.0:.0f} minutes on 16 processors. The other {len(every) - len(grown)} rows search or "
        "bound, and no proportion holds for them."
    )


def _pictures() -> Iterator[str]:
    yield from (f"| `pictures/{name}` | `{command}` |" for name, command in PICTURES.items())


def _records() -> Iterator[str]:
    for name, (where, command) in RECORDS.items():
        yield f"| [{Path(where).stem}]({_in_repository(where)}) | `{name}` | `{command}` |"


def unlisted(docs: Path) -> set[str]:
    """Tables of `campaigns.figures`, and files of evidence and pictures, of which nothing says what makes them."""
    tables = TABLES.keys() - {name for source in SOURCES.values() for name in source.tables}
    evidence = {name for source in SOURCES.values() for name in source.evidence}
    files = {file.name for file in (docs / "validation").iterdir()} - evidence
    pictures = {
        file.relative_to(docs / "pictures").as_posix() for file in (docs / "pictures").rglob("*.*")
    }
    return {
        *tables,
        *(name for name in files if not any(fnmatch(name, known) for known in RECORDS)),
        *(name for name in pictures if not any(fnmatch(name, known) for known in PICTURES)),
    }


if __name__ == "__main__":
    assert set(_STUDIED + _IN_SPACE) <= set(spacecraft_names())
    write_text(Path("docs/provenance.md"), page())
