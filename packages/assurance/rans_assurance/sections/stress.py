"""What a robustness sweep says: a section of its JSON file, which terminal, notebook, report and dossier print."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rans.evaluation.measure.statistics import wanted
from rans.extend import WANTED, Chart, Fact, Mark, Picture, Section, Series, Table
from rans.show.palette import series_style
from rans_assurance.sections.assurance import asked

WORST = "Worst episodes"
"""Title of the table of commands that show them."""


def stress_section(_: Path, stress: Mapping[str, Any]) -> Section:
    """Shares solved in each set of conditions, and the largest size of each disturbance that is tolerated."""
    flown = stress["conditions"]
    named = {name: row["contestants"] for name, row in flown.items() if row["size"] is None}
    names = list(dict.fromkeys(who for row in flown.values() for who in row["contestants"]))
    first = next(iter(names), "")
    effects = {
        name: effect for name, effect in stress.get("effects", {}).items() if _curves(flown, name)
    }
    # Tables: sets of conditions, and sizes of disturbances.
    shares = [
        (name, *(_percent(row.get(who)) for who in names)) for name, row in named.items() if row
    ]
    reaches = [
        (name, effect["unit"], *(_reach(effect, who) for who in names))
        for name, effect in effects.items()
    ]
    tables = [Table(("solved", *names), shares, f"{stress['title']}")]
    if effects:
        title = f"Size of a disturbance up to which {_part(stress, names)} are solved"
        tables.append(Table(("disturbance", "unit", *names), reaches, title))
    # Facts are of the first contestant, whose dossier it is: the worst conditions first, others beside it.
    facts = [
        _fact(f"solved under {name}", cells, names)
        for name, *cells in sorted(shares, key=lambda row: _share(named[row[0]], first))
        if first in named[name]
    ]
    hero = ""
    if facts and not stress["failures"]:
        worst = facts[0]
        hero = f"{first} solves {worst.value} of the episodes {worst.what.removeprefix('solved ')}"
        hero += f", the worst of {len(facts)} sets of conditions" if len(facts) > 1 else ""
        hero += f" ({'; '.join(worst.note.splitlines())})."
    facts = [fact._replace(leads=not k) for k, fact in enumerate(facts)]
    asks = _part(stress, [first]).replace(" of the episodes", "")
    for name, unit, *cells in reaches:
        sizes = [f"{cell} {unit}".rstrip() if cell[-1].isdigit() else cell for cell in cells]
        fact = _fact(f"{name}, {asks} solved up to", sizes, names)
        facts.append(fact._replace(leads=name == "readings late by"))
    if missing := stress.get("not flown"):
        facts.append(Fact(f"disturbances that were not flown: {', '.join(missing)}", "", "limits"))
    sizes = [
        (
            row["effect"],
            f"{row['size']:g}",
            *(_percent(row["contestants"].get(who)) for who in names),
        )
        for row in flown.values()
        if row["size"] is not None and row["contestants"] and "effect" in row
    ]
    return Section(
        "Stress",
        str(stress.get("text", "")),
        tables,
        [Picture.of(chart) for chart in _charts(flown, effects)],
        facts,
        [*map(str, stress["failures"])],
        [*map(str, stress.get("notes", ()))],
        details=[
            *_worst_table(flown),
            *([Table(("solved", "size", *names), sizes, "Every size")] if sizes else []),
            *asked(stress),
        ],
        hero=hero,
        flies=True,
    )


def _part(stress: Mapping[str, Any], names: list[str]) -> str:
    """What is asked of the episodes of those that flew the most."""
    about = stress.get("contestants", {})
    counts = [about[name]["episodes"] for name in names if "episodes" in about.get(name, {})]
    return wanted(max(counts)) if counts else f"{100.0 * WANTED:g} %"


def _percent(result: Mapping[str, Any] | None) -> str:
    if result is None:
        return "-"
    return "{value:.1%} ({low:.1%} to {high:.1%})".format(**result["held"])


def _reach(effect: Mapping[str, Any], name: str) -> str:
    """To which size somebody solves 99 %; "none" where no size that was flown is small enough."""
    size = effect["holds_to"].get(name)
    last = effect["sizes"][-1] if effect.get("sizes") else None
    nominal = effect.get("nominal")
    if name in effect.get("not_finished", ()):
        size = effect["not_finished"][name]
        if size is None or size == nominal:
            return "not finished"
        return f"{size:g} or {'more' if size > nominal else 'less'}, not finished"
    if size is None or size == nominal:
        return "none"
    return f"all to {size:g}" if size == last else f"{size:g}"


def _worst_table(flown: Mapping[str, Any]) -> Iterator[Table]:
    """The worst episodes, with the commands that show them; none where nobody has flown."""
    if rows := [*_worst(flown)]:
        columns = ("scenario", "contestant", "episode", "largest errors", "command that shows it")
        yield Table(columns, rows, WORST)


def _worst(flown: Mapping[str, Any]) -> Iterator[list[str]]:
    """The worst episodes in each set of conditions, and of each disturbance at the first size that was too much."""
    lost = set[str]()
    for name, row in flown.items():
        results = row["contestants"]
        effect = row.get("effect", name)
        is_lost = any(result["held"].get("value", 1.0) < 1.0 for result in results.values())
        if row["size"] is not None and (effect in lost or not is_lost):
            continue
        if row["size"] is not None:
            lost.add(effect)
        for who, result in results.items():
            for one in result.get("worst", ()):
                errors = ", ".join(f"{what}: {x:.3g}" for what, x in one["errors"].items())
                yield [name, who, str(one["episode"]), errors, one["see"]]


def _curves(
    flown: Mapping[str, Any], name: str, nominal: float | None = None
) -> dict[str, list[Mark]]:
    """Solved episodes, %, over the sizes of a disturbance, the nominal one first, by contestant."""
    rows = [(row["size"], row) for row in flown.values() if row.get("effect") == name]
    if nominal is not None and "perfect" in flown:
        rows.insert(0, (nominal, flown["perfect"]))
    curves: dict[str, list[Mark]] = {}
    for size, row in rows:
        if size is not None:
            for who, result in row["contestants"].items():
                low, value, high = (100.0 * result["held"][key] for key in ("low", "value", "high"))
                curves.setdefault(who, []).append(Mark(size, value, None, (low, high)))
    return curves


def _charts(flown: Mapping[str, Any], effects: Mapping[str, Any]) -> Iterator[Chart]:
    """Solved episodes over the size of each disturbance."""
    for name, effect in effects.items():
        series = [
            Series(who, marks, *series_style(k), "solid")
            for k, (who, marks) in enumerate(_curves(flown, name, effect.get("nominal")).items())
        ]
        label = f"{name}, {effect['unit']}"
        caption = f"Solved episodes over {label}."
        yield Chart(label, "solved, %", series, caption, y_range=(-3.0, 103.0))


def _share(row: Mapping[str, Any], name: str) -> float:
    """Share that a contestant solves, 0 to 1; 1 where it has not flown."""
    return float(row[name]["held"]["value"]) if name in row else 1.0


def _fact(what: str, cells: list[str], names: list[str]) -> Fact:
    """The first contestant's cell of a table, and below it its interval, and what the others have."""
    (value, limits), *others = (cell.removesuffix(")").partition(" (")[::2] for cell in cells)
    beside = ", ".join(f"{who} {x}" for who, (x, _) in zip(names[1:], others, strict=True))
    return Fact(what, value, "limits", note="\n".join(filter(None, (limits, beside))))
