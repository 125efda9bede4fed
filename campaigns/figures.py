"""Tables of documents, from the files in docs/validation that their figures come from.

``python -m campaigns.figures`` writes all of them again; tests/test_figures.py compares.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from campaigns import (
    agents,
    assurances,
    craft,
    craft_bounds,
    craft_rivals,
    dock_contact,
    dock_errors,
    elliptic,
    error_sources,
    faults,
    identification,
    identified_agents,
    inspection,
    missions,
    passive,
    perturbed,
    ports,
    published_optima,
    raft,
    rest,
    robustness,
    safe_set,
    settled_gate_entry,
    slosh,
    standings,
    throttling,
    vbar,
    zones,
)
from campaigns.markdown import Table
from rans.files import read_json
from rans.model.spacecraft_file import spacecraft_names


def stress(docs: Path) -> Table:
    """The table of robustness: what each solves under conditions without a size, in %."""
    found = read_json(docs / "validation" / "stress.json")
    names = [one["spec"].removeprefix("pretrained:") for one in found["contestants"].values()]
    rows = [
        (one["effect"], *map(_solved, one["contestants"].values()))
        for one in found["conditions"].values()
        if one["size"] is None
    ]
    return Table("assurance/stress.md", "rans stress", ("solved, %", *names), rows, "")


def _solved(told: dict[str, Any]) -> str:
    return f"{100.0 * told['held']['value']:.1f}"


def validations(docs: Path) -> Table:
    """The first table of validation.md: how many checks of every spacecraft passed."""
    rows = []
    for name, found in _studies(docs).items():
        passed = sum(check["passed"] for check in found["checks"])
        rows.append(
            (
                name,
                f"`rans validate {name} --output FOLDER`",
                f"{passed} of {len(found['checks'])}",
                f"{found['settings']['seconds']:.0f} s",
                f"[{name}.json](validation/{name}.json)",
            )
        )
    return Table(
        "validation.md",
        "rans validate",
        ("spacecraft", "command", "checks", "time", "numbers"),
        rows,
        "",
    )


def judges(docs: Path) -> Table:
    """The table of judges.md: how far ours is from what others computed."""
    rows = []
    for one in read_json(docs / "validation" / "judges.json"):
        differences = one["differences"]
        rows.append(
            (
                one["case"],
                one["about"],
                "<br>".join(f"{x['name']}: {x['value']:.1e} {x['unit']}" for x in differences),
                "<br>".join(f"{x['bound']:.0e}" for x in differences),
                one["spread"],
                f"`{one['file']}`",
                "agrees" if one["passed"] else "**disagrees**",
            )
        )
    headings = ("case", "what", "largest difference", "bound", "their own spread", "file", "")
    return Table("judges.md", "rans validate --judges", headings, rows, "")


def values(docs: Path) -> Table:
    """The second: the largest difference that every check has found."""
    found = {
        name: {check["name"]: check for check in study["checks"]}
        for name, study in _studies(docs).items()
    }
    rows = []
    for name in dict.fromkeys(name for checks in found.values() for name in checks):
        same = [checks.get(name) for checks in found.values()]
        tolerances = dict.fromkeys(f"{one['tolerance']:.0e}" for one in same if one)
        unit = next(one["unit"] for one in same if one)
        rows.append(
            (
                name,
                unit,
                "/".join(tolerances),
                *(f"{one['value']:.0e}" if one else "" for one in same),
            )
        )
    return Table(
        "validation.md", "rans validate, values", ("check", "unit", "tolerance", *found), rows, ""
    )


def _studies(docs: Path) -> dict[str, Any]:
    files = {name: docs / "validation" / f"{name}.json" for name in spacecraft_names()}
    return {name: read_json(file) for name, file in files.items() if file.exists()}


TABLES: dict[str, Callable[[Path], Table]] = {
    "agents": agents.in_document,
    "rest": rest.in_document,
    "assurances": assurances.in_document,
    "robustness": robustness.in_document,
    "faults": faults.in_document,
    "craft": craft.authority_table,
    "agents of craft": craft.agent_table,
    "controllers of craft": craft_rivals.table,
    "bounds of craft": craft_bounds.table,
    "avoid": partial(missions.in_document, mission="avoid"),
    "impulse among zones": zones.FRONT.in_document,
    "impulse to the port": ports.FRONT.in_document,
    "dock port": partial(missions.in_document, mission="dock-port"),
    "dock": partial(missions.in_document, mission="dock"),
    "dock with errors": dock_errors.in_document,
    "dock on ellipses": elliptic.in_document,
    "coasts on ellipses": elliptic.errors_in_document,
    "hold with J2 and drag": perturbed.in_document,
    "what is known with J2 and drag": perturbed.known_in_document,
    "coasts with J2 and drag": perturbed.coasts_in_document,
    **{
        f"errors: {name}": partial(error_sources.in_document, table=name)
        for name in error_sources.TABLE_NAMES
    },
    "slosh": slosh.in_document,
    "docking with contact": dock_contact.in_document,
    "safe states": safe_set.in_document,
    "identification": identification.in_document,
    "identification in space": partial(identification.in_document, space=True),
    "identified agents": identified_agents.in_document,
    "inspect": inspection.in_document,
    "passive safety": passive.in_document,
    "percentiles": passive.percentiles_in_document,
    "hold": partial(missions.in_document, mission="hold"),
    "land": partial(missions.in_document, mission="land"),
    "published optima": published_optima.in_document,
    "throttling": throttling.in_document,
    "rendezvous": partial(missions.in_document, mission="rendezvous"),
    "RAFT": partial(raft.in_document, spacecraft=raft.PLATFORM),
    "RAFT with a wheel": partial(raft.in_document, spacecraft=raft.WHEELED),
    "stress": stress,
    **{
        f"standings of {name}": partial(standings.in_document, mission=name)
        for name in standings.MISSIONS
    },
    "settled gate": settled_gate_entry.in_document,
    "judges": judges,
    "validations": validations,
    "values": values,
    "V-BAR": vbar.in_document,
}
"""By what measured it."""


def main() -> int:
    """Write every table."""
    for make in TABLES.values():
        make(Path("docs")).write(Path("docs"))
    return 0


if __name__ == "__main__":
    from campaigns.command import ended

    raise SystemExit(ended("python -m campaigns.figures", main))
