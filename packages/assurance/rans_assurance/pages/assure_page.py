"""An assurance as one page that an engineer can sign: the verdict first, and everything that it rests on.

Everything on it is in the JSON beside it; whoever signs relies on the scope in words.
"""

from __future__ import annotations

from collections.abc import Iterator

from rans.extend import QUANTITIES, Failure, Finding, Flight, Section, Table, is_installed
from rans.show.pages.page import Page, Picture, header
from rans_assurance.assure.assurance import Assurance
from rans_assurance.assure.replay import CANDIDATES, Judge, Replayed, has_drake
from rans_assurance.pages.assure_counts import counts, decision_sentence

_JUDGES: dict[Judge, str] = {"numpy": "NumPy", "drake": "Drake"}
_TEXT = (
    "A flight fails if the task declares it failed, if its state is no longer finite, or if at any step of "
    "its last fifth an error is outside of the task's tolerances, by the true state. Starts, goals and "
    "conditions are drawn by the number of the scenario, independently. The bounds are those of Clopper and "
    "Pearson, which are exact: each holds at least with its confidence, for flights of this simulation. How "
    "the real craft differs from that, no bound here knows."
)


def assurance_page(assurance: Assurance, worst_case: str = "") -> Page:
    """Everything on one page, with the name of a file beside it that shows the worst case."""
    campaign = assurance.campaign
    run = assurance.run
    described = run.conditions.description if run.conditions else "perfect"
    result = assurance.to_json()
    counted = Section("What failed", _TEXT, [counts(result)], findings=[*findings(assurance)])
    asked = Section("What was asked", "", [Table(("", "it is"), assurance.scope.rows)])
    sections = [
        asked,
        counted,
        _plan(assurance),
        *_again(assurance),
        *_worst_flight_section(assurance, worst_case),
        _evidence(assurance),
        _signatures(),
    ]
    return Page(
        f"Assurance of {assurance.spec}",
        sections,
        header(
            {
                "command": assurance.command,
                "task": type(run.task).__name__,
                "spacecraft": run.craft.name,
                "conditions": described or assurance.conditions,
                "flights": f"{campaign.flights:,}, scenarios 0 to "
                f"{campaign.flights - 1:,} of seed {campaign.seed}; "
                f"{', '.join(sorted(campaign.ways))}, {campaign.seconds:,.0f} s",
                "environment": assurance.environment,
            }
        ),
        assurance.scope.sentence,
        decision_sentence(result),
    )


def write_page(assurance: Assurance) -> None:
    """Write the page beside the file of an assurance, and that of the worst case if one was found."""
    assert assurance.file is not None
    worst = assurance.worst_case_page
    if worst is not None and assurance.searched and assurance.searched.breaking:
        from rans.show.pages.replay import replay_page

        replay_page([assurance.searched.breaking.flight], "Worst case").write(worst)
    page = assurance_page(assurance, worst.name if worst is not None else "")
    page.write(assurance.file.with_suffix(".html"))


def findings(assurance: Assurance) -> Iterator[Finding]:
    """Findings beside the verdict: passed or failed where something was asked or refuted, else None."""
    campaign = assurance.campaign
    replays = assurance.replays
    if campaign.plan.below is not None and campaign.over:
        passed = campaign.decision == "below"
        yield Finding(f"probability of failure below {campaign.plan.below:g}", passed)
    if replays is None or not replays.found:
        return
    for judge in replays.judges():
        refuted = replays.refuted(judge)
        confirmed = len(replays.found) - len(refuted)
        yield Finding(
            f"{confirmed} of {len(replays.found)} failed flights, the worst and the first of each kind, "
            f"fail again in {_JUDGES[judge]}"
            + (f", not {', '.join(map(str, refuted))}" if refuted else ""),
            False if refuted else None,
        )
    if replays.failed < replays.tried:
        yield Finding(
            f"{replays.failed:,} of the {replays.tried:,} that were flown to find these, at most "
            f"{CANDIDATES} of each kind, fail again in float64; they were counted in float32, in "
            "which some go another way"
        )
    if not has_drake():
        yield Finding("Drake is not installed here: nothing was flown again by it")


def _plan(assurance: Assurance) -> Section:
    """Section of the plan: looks, allowed failures and chances of error, as they were fixed before the flights."""
    plan = assurance.campaign.plan
    flown = assurance.campaign.flights
    # A stage shows the bound if no more than the allowed number of flights failed.
    rows = [
        [
            f"{stage.flights:,}",
            f"at most {allowed:,}" if (allowed := plan.allowed(stage)) >= 0 else None,
            f"{stage.high_level:.2g}",
            f"{stage.low_level:.2g}",
            "reached" if stage.flights <= flown else None,
        ]
        for stage in plan.looks
    ]
    title = "When it was looked at"
    if len(plan.looks) == 1:
        text = "Once, after a number of flights that was fixed before the first: nothing had to be paid for more."
        return Section(title, text)
    text = (
        "The looks were fixed before the first flight. Each has a part of the allowed chance of error for itself, "
        "and the parts add up to the whole, so that stopping early does not make the bounds too good."
    )
    chances = ("chance of error, at most", "chance of error, at least")
    columns = ("flights", "failures that show the bound", *chances, "")
    return Section(title, text, [Table(columns, rows)])


def _again(assurance: Assurance) -> Iterator[Section]:
    """Sections of the failed flights that were flown again, kind by kind, the worst first."""
    replays = assurance.replays
    if replays is None or replays.flight is None:
        return
    for kind in Failure:
        numbers = [k for k, replayed in enumerate(replays.found) if replayed.kind == kind]
        if not numbers:
            continue
        title = f"flight {replays.found[numbers[0]].number:,}"
        pictures = [*_drawn(replays.flight, numbers, title)] if _has_pictures() else []
        rows = [_replayed(assurance, replays.found[k]) for k in numbers]
        judges = (f"in {_JUDGES[judge]}" for judge in replays.judges())
        columns = ("flight", *judges, "largest errors", "outside for", "in the end it", "see it")
        yield Section(
            f"Flights that failed: {kind.meaning}",
            (
                "The worst first, by the largest error of the last fifth in tolerances; then the first by "
                "number, as good as drawn by lot. All flew again step by step in float64. Orange: the worst."
                + ("" if pictures else " Matplotlib is not installed here: there are no pictures.")
            ),
            [Table(columns, rows)],
            pictures,
        )


def _worst_flight_section(assurance: Assurance, link: str) -> Iterator[Section]:
    """Section with the smallest disturbance that breaks the agent, and whether its flight fails again."""
    result = assurance.searched
    if result is None:
        return
    breaking = result.breaking
    text = (
        f"The cross-entropy method over starts and over {result.world}, all of whose ranges were shrunk "
        f"towards nominal conditions, or widened to at most {result.largest:.3g} times their size. "
        f"{result.failed:,} of {result.flights:,} flights failed; {result.summary}."
    )
    if breaking is None:
        yield Section("Worst case", text, findings=[Finding(result.summary)])
        return
    again = [
        f"{_JUDGES[judge]}: {kind.meaning if kind else 'does not fail'}"
        for judge, kind in breaking.again.items()
    ]
    rows = [
        ["flown again in", "; ".join(again)],
        ["largest error", f"{breaking.excess:.3g} tolerances"],
        ["in the end it", breaking.ending],
        *([name, text] for name, text in breaking.drew.items()),
    ]
    pictures = [*_drawn(breaking.flight, [0], "the worst case")] if _has_pictures() else []
    yield Section(
        "Worst case",
        text,
        [Table(("what", "it is"), rows)],
        pictures,
        [Finding(result.summary)],
        link=link,
    )


def _has_pictures() -> bool:
    return is_installed("matplotlib")


def _replayed(assurance: Assurance, replayed: Replayed) -> list[str]:
    """Row of a failure that was flown again: what each engine says, its errors and its ending."""
    again = [
        ("fails" if failure == replayed.kind else f"fails: {failure.meaning}")
        if failure
        else "does not fail"
        for failure in replayed.again.values()
    ]
    errors = (
        (QUANTITIES[name].display[0] * x, QUANTITIES[name].display[1])
        for name, x in replayed.errors.items()
    )
    return [
        f"{replayed.number}",
        *again,
        ", ".join(f"{x:.3g} {unit}" for x, unit in errors),
        f"{100.0 * replayed.outside:.0f} % of it",
        replayed.ending,
        assurance.view(replayed.number),
    ]


def _drawn(flight: Flight, episodes: list[int], title: str) -> Iterator[Picture]:
    """Pictures of failed flights.

    Errors, ways from above, and the valves of the worst, in the order of the page.
    """
    from rans_assurance.figures import assure_figures as figures

    yield Picture.of(
        figures.errors_figure(flight, episodes),
        "Largest error in tolerances; the last fifth is grey.",
    )
    if "position" in flight.task.tolerances():
        yield Picture.of(
            figures.paths_figure(flight, episodes), "From above, relative to the goal."
        )
    yield Picture.of(figures.commands_figure(flight, episodes[0], title), f"Thrusters of {title}.")


def _evidence(assurance: Assurance) -> Section:
    """Section of the SHA-256 of everything that decides a flight; the JSON file has the same."""
    rows = [[_unbroken(name), value] for name, value in assurance.hashes.items()]
    campaign = assurance.campaign
    text = (
        "SHA-256 of everything that decides how a flight ends. The same command on the same code counts the "
        "same flights."
    )
    if failed := campaign.failures:
        listed = len(campaign.listed)
        text += f" The JSON file beside it lists {listed:,} of {failed:,} failed flights by number."
    return Section("What it is of", text, [Table(("what", "SHA-256"), rows)])


def _signatures() -> Section:
    room = (_unbroken(" " * 24),) * 3
    rows = [[who, *room] for who in ("flown by", "checked by", "accepted by")]
    return Section("Signatures", "", [Table(("", "name", "date", "signature"), rows)])


def _unbroken(text: str) -> str:
    return text.replace(" ", "\N{NO-BREAK SPACE}")
