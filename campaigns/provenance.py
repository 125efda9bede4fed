"""Where the tables of the pages come from: the list `campaigns.table`, which `campaigns.reproduce` flies again.

``python -m campaigns.provenance`` writes docs/provenance.md from it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

from campaigns.table import ROWS
from rans.files import write_text

_EARLIER, _LATER = "af4f7ac0", "e3dd657d"
"""Commits whose code measured what is not measured again."""
PICTURES: dict[str, str] = {
    "agents.gif": "rans view go-to-pose-2d go-to-pose-3d --seed 5 --save docs/pictures/agents.gif",
    "frames.jpg": "rans view go-to-pose-3d --seed 5 --save docs/pictures/frames.jpg",
    "layouts.svg": f"campaigns.any_craft picture at {_LATER}",
    "craft/*.svg": "python -m campaigns.pictures",
    "diagrams/*.svg": "python -m campaigns.pictures",
    "missions/*.svg": "python -m campaigns.pictures",
    "proof-cells.svg": "python packages/proof/archcomp/picture.py FOLDER docs/pictures/proof-cells.svg",
    "proof-conditions.svg": f"campaigns.proof_conditions at {_LATER}",
    "tradeoff*.svg": f"campaigns.tradeoff at {_EARLIER}",
    "trapping-set.svg": "python -m rans_proof.picture CERTIFICATE docs/pictures/trapping-set.svg",
}
"""Files in docs/pictures, and what draws them."""
ONCE = (
    ("verification.md", "breaking.json", "campaigns.breaking", _EARLIER),
    (
        "any_craft/any_craft.md",
        "",
        "campaigns.any_craft layouts --engine drake --layouts 32 --episodes 2",
        _LATER,
    ),
    ("any_craft/any_craft_in_space.md", "", "campaigns dead-cubesats", _EARLIER),
    ("any_craft/any_craft_training.md", "", "campaigns.any_craft joined --episodes 1024", _LATER),
    ("certificate.md", "mixed-integer.json", "campaigns.mixed_integer --starts 16", _EARLIER),
    ("certificate.md", "bounds.json", "campaigns.bounds --craft 2000 --output FILE", _LATER),
    (
        "certificate.md",
        "",
        "campaigns.optimality --starts 50; --starts 30 --horizon 20 --seconds 30; --starts 128 --quantity time; "
        "--starts 32 --quantity settling",
        _LATER,
    ),
    ("decisions/exports.md", "exports.json", "campaigns exports", _LATER),
    ("export.md", "", "campaigns.cortex", _EARLIER),
    ("missions/guard.md", "", "campaigns.attack --missions avoid-2d", _EARLIER),
    ("missions/guard.md", "", "campaigns filter-cost", _LATER),
    (
        "missions/guard.md",
        "",
        "campaigns guard; with --missions avoid-2d --policies adversary --noise 0.1 0.01 --delay 1",
        _LATER,
    ),
    ("missions/dock.md", "", "campaigns orbits", _LATER),
    ("missions/hold.md", "", "campaigns station-keeping --error all", _LATER),
    (
        "missions/perturbed.md",
        "",
        "campaigns station-keeping --orbit.target-drag 3.7e-7 --orbit.ballistic-ratio 0.5; with --orbit.oblate "
        "--orbit.inclination-degrees 51.6; with all four",
        _LATER,
    ),
    (
        "robot/identified_agents.md",
        "identified-agents.json",
        "campaigns.identified_agents prepare FOLDER, then with train; campaigns identified-agents FOLDER",
        _EARLIER,
    ),
    (
        "robot/innocube.md",
        "",
        "campaigns.innocube FOLDER --agent RUN, after rans train campaigns/innocube_agent.toml",
        _LATER,
    ),
    ("robot/raft.md", "raft.json", "campaigns RAFT, after trainings of its recipes", _EARLIER),
    (
        "assurance/settled_gate.md",
        "settled-gate.json",
        "campaigns.settled_gate_entry RUN; campaigns settled-gate RUN",
        _EARLIER,
    ),
    (
        "proof/proofs-theory.md",
        "proof-conditions.json",
        "campaigns.proof_conditions proof-conditions.json PICTURE.svg",
        _LATER,
    ),
    (
        "proof/proofs-theory.md",
        "",
        "campaigns.proof_flights --problem FILE.toml --network FILE.onnx, or --agent AGENT --certificate FILE",
        _LATER,
    ),
    ("speed.md", "tradeoff*.json", "campaigns.tradeoff", _EARLIER),
    (
        "measured.md",
        "",
        "campaigns.scaling --processes 1 2 --n-envs 65536 --matmul bf16; with --processes 1 4",
        _LATER,
    ),
)
"""Pages whose figures were measured by code that left after a commit: evidence, modules and the commit."""
RECORDS: dict[str, tuple[str, str]] = {
    "floating-platform.html": (
        "validation.md",
        "rans validate floating-platform --output FOLDER",
    ),
}
"""Other files in docs/validation: the page of their figures, and what writes them."""
_WRITTEN = {name for source in ROWS.values() for name in source.evidence}


def page() -> str:
    """Text of docs/provenance.md."""
    measured = (*_rows(), _duration(), _TAIL, *_records())
    return "\n".join([_HEAD, *measured, _DRAWN, *_pictures(), _ONCE, *_once()]) + "\n"


_HEAD = """# Provenance

`rans reproduce` flies the tables of the pages again in a checkout, and writes a page of differences. This page
is made from the same list, `campaigns/table.toml`.

![A command writes a JSON file, from which a table of a page is made; two checks compare them]\
(pictures/diagrams/provenance.svg)

```
rans reproduce --quick                             # fewer flights of every table
rans reproduce --only stress "dock with errors"    # these alone, with every flight
rans reproduce                                     # all of them
```

Where a name alone measures a table, the command is `python -m campaigns NAME --docs docs`.

| table of | measured by | evidence | flights behind each share; with `--quick` | processor time with `--quick`, s |
|---|---|---|---|---|"""
_TAIL = """
A table marked with * needs trainings first, and is left out with a sentence until they are there.

## What agrees

Flights of a seed are deterministic. On the same processor, with the versions of the evidence, every cell is the
same. Elsewhere, and with `--quick`, a share agrees within three standard deviations of both samples (about
three of a thousand are beyond them), and another number within the tolerance of the list. Extremes of fewer
flights, times of a machine, and searches that a limit of time ends are not compared.

The page of differences, `runs/reproduce/differences.md`, has every cell that differs, the time of each row,
versions, processor and GPU, and the SHA-256 of every agent. The exit code is 1 if a cell differs or a command
fails. `--executor` spreads the rows over [many machines](cluster.md). The whole reproduction was not timed.

The tables of [InnoCube's telemetry](../packages/robot/docs/innocube.md) come from data that have no licence yet:
`rans reproduce` leaves them out.

## Other figures

Figures in sentences come from these files, and figures of speed from the command beside each. `rans reproduce` does
not measure them again.

| page | evidence | measured by |
|---|---|---|"""
_ONCE = """
## Measured once

The code of these figures is in git alone: another flight does not change them, or a command of RANS that their page
names flies the same again. `git worktree add ../then COMMIT` and `make setup` in that folder bring it back, and the
module named here runs there with `python -m`.

| page | evidence | module | commit |
|---|---|---|---|"""
_DRAWN = """
| picture | drawn by |
|---|---|"""


def _rows() -> Iterator[str]:
    for name, source in ROWS.items():
        link = f"[{Path(source.page).stem}]({_in_repository(source.page)})" + "*" * bool(
            source.needs
        )
        commands = "<br>".join(map(_short, source.measured_by(name)))
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
    every = {name: one.time(quick=True) for name, one in ROWS.items() if not one.needs}
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
        f"\nWith `--quick` all rows without * take {total:,.0f} s of one processor together, "
        f"{total / 120.0:.0f} minutes on two (AMD EPYC).{rest} With every flight the {len(grown)} rows whose "
        f"number of flights is stated would take {sum(grown):,.0f} s, if their times grow as the flights do: "
        f"{sum(grown) / 960.0:.0f} minutes on 16 processors. The other {len(every) - len(grown)} rows search or "
        "bound, and no proportion holds for them."
    )


def _pictures() -> Iterator[str]:
    yield from (f"| `pictures/{name}` | `{command}` |" for name, command in PICTURES.items())
    yield "\nOther pictures in `diagrams` were drawn once, by `campaigns.pictures` at `af4f7ac0`."


def _once() -> Iterator[str]:
    for where, name, modules, commit in ONCE:
        file = f"`{name}`" if name else "-"
        yield f"| [{Path(where).stem}]({_in_repository(where)}) | {file} | `{modules}` | `{commit}` |"


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
