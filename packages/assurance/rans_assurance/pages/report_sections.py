"""What the report of a run says of its stress test and of its assurances."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rans.extend import Finding, Section, Table, counted
from rans.show.pages.page import Tile
from rans_assurance.pages.assure_counts import asked, counts, decision_sentence, is_over


def stress_section(_: Path, stress: Mapping[str, Any]) -> Section:
    """Shares solved under conditions without a size; stress.html has the rest."""
    flown = stress["conditions"] if "conditions" in stress else stress["worlds"]  # of version 0.2.0
    rows = [
        (f"{name}: {who}", "{value:.1%} ({low:.1%} to {high:.1%})".format(**result["held"]))
        for name, row in flown.items()
        if row["size"] is None
        for who, result in row["contestants"].items()
    ]
    findings = [Finding(text, False) for text in stress["failures"]]
    hero, tiles = _result(stress)
    return Section(
        "Stress",
        f"{stress['title']}.",
        [Table(("conditions", "solved"), rows), *asked(stress)],
        findings=findings,
        summary=rows,
        link="stress.html",
        hero=hero,
        tiles=tiles,
    )


def _result(stress: Mapping[str, Any]) -> tuple[str, list[Tile]]:
    """The result of a stress test in a sentence, and tiles, the worst first; neither where nobody has flown."""
    flown = stress.get("conditions", stress.get("worlds", {}))
    shares = {
        name: {who: result["held"] for who, result in row["contestants"].items()}
        for name, row in flown.items()
        if row["size"] is None
    }
    who = next((name for row in shares.values() for name in row), None)
    ranked = sorted((row[who]["value"], name) for name, row in shares.items() if who in row)
    if who is None or not ranked or stress["failures"]:
        return "", []

    def others(row: Mapping[str, Any], form: Callable[[Any], str]) -> str:
        return ", ".join(f"{name} {form(x)}" for name, x in row.items() if name != who)

    def share(solved: Mapping[str, float]) -> str:
        return "{value:.1%}".format(**solved)

    episodes = stress.get("contestants", {}).get(who, {}).get("episodes")
    part = (
        "99 %" if episodes is None or episodes >= 100 else f"all of {counted(episodes, 'episode')}"
    )
    tiles = []
    for _, name in ranked:
        own = shares[name][who]
        limits = "{low:.1%} to {high:.1%}".format(**own)
        note = "\n".join(filter(None, (limits, others(shares[name], share))))
        tiles.append(Tile(f"solved, {name}", share(own), note))
    for name, effect in stress.get("effects", {}).items():

        def size(value: float | str | None, unit: str = effect["unit"]) -> str:
            if isinstance(value, str):
                return value
            return "not solved" if value is None else f"{value:g} {unit}".rstrip()

        limits = effect["holds_to"] | dict.fromkeys(effect.get("not_finished", ()), "not finished")
        if who in limits:
            beside = others(limits, size)
            tiles.append(Tile(f"{name}, {part} solved up to", size(limits[who]), beside))
    worst = ranked[0][1]
    under = f"under {'the conditions' if len(ranked) == 1 else 'its worst conditions,'} {worst}"
    beside = others(shares[worst], share)
    hero = f"{who} solves {share(shares[worst][who])} of the episodes {under}"
    return f"{hero}{f'; beside it {beside}' if beside else ''}.", tiles


def assurance_section(file: Path, result: Mapping[str, Any]) -> Section:
    """Section of an assurance's counts (`assure_counts`); the page beside its file has the rest."""
    has_limit = result["about"]["below"] is not None
    page = file.with_suffix(".html")
    table = counts(result)
    passed = result["decision"] == "below" if has_limit and is_over(result) else None
    failed = "{failures:,} of {flights:,}".format(**result["bounds"]["any"])
    sentence = decision_sentence(result)
    return Section(
        file.stem.replace("-", " ").capitalize(),  # such as "Assurance lab"
        f"Flown by {result['command']}.",
        [table, *asked(result)],
        findings=[Finding(sentence, passed)],
        summary=[
            ("flights that failed", failed),
            (f"probability of failure, {table.columns[-1]}", table.rows[0][-1]),
        ],
        link=page.name if page.is_file() else "",
        hero=sentence,
        tiles=[Tile("flights that failed", failed)],
        sure=_failure_probability(result),
    )


def _failure_probability(result: Mapping[str, Any]) -> Tile:
    bound = result["bounds"]["any"]
    sure = 100.0 * result["about"]["confidence"]
    flights = (
        f"{bound['failures']:,} of {bound['flights']:,} flights failed\n{sure:.6g} % confidence"
    )
    return Tile("failure probability, at most", f"{bound['at most']:.3g}", flights)
