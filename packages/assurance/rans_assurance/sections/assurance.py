"""What an assurance says: a section of its JSON file, which terminal, report and dossier print."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rans.extend import QUANTITIES, Fact, Failure, Section, Table

_TEXT = (
    "A flight fails if the task declares it failed, if its state is no longer finite, or if at any step of "
    "its last fifth an error is outside of the task's tolerances, by the true state. Starts, goals and "
    "conditions are drawn by the number of the scenario, independently. The bounds are those of Clopper and "
    "Pearson, which are exact: each holds at least with its confidence, for flights of this simulation. How "
    "the real craft differs from that, no bound here knows."
)
_JUDGES = {"numpy": "NumPy", "drake": "Drake"}


def assurance_section(file: Path, result: Mapping[str, Any]) -> Section:
    """Section of an assurance: counts, bounds and failed flights, and behind them what they rest on."""
    bound = result["bounds"]["any"]
    below = result["about"]["below"]
    passed = result["decision"] == "below" if below is not None and is_over(result) else None
    failed = "{failures:,} of {flights:,}".format(**bound)
    under = file.stem.removeprefix("assurance").replace("-", " ") or " own conditions"
    replays = result.get("replays") or {}
    judged = replays.get("judged", [])
    sure = Fact(
        f"failure probability under{under}, at most"
        + (f" ({below:g} allowed)" if below is not None else ""),
        f"{bound['at most']:.3g}",
        "requirement",
        passed,
        f"{failed} flights failed\n{_sure(result)} confidence",
        is_asked=below is not None,
        leads=True,
    )
    again = [*_replay_facts(replays, judged)]
    facts = [
        Fact(f"flights that failed under{under}", failed, "requirement"),
        sure,
        *again,
        *([] if bound["failures"] else [Fact("worst flight", "none failed", "limits")]),
        *_asked_facts(result),
    ]
    return Section(
        file.stem.replace("-", " ").capitalize(),  # such as "Assurance lab"
        f"Flown by {result['command']}. {_TEXT}",
        [counts(result)],
        facts=facts,
        notes=[f"{fact.what}: {fact.value}." for fact in again if fact.part == "evidence"],
        details=[
            *_again(judged),
            *asked(result),
            _hashes(result),
        ],
        hero=decision_sentence(result),
        sure=sure,
        flies=True,
    )


def decision_sentence(result: Mapping[str, Any]) -> str:
    """The decision of an assurance's JSON file in one sentence, with counts, bounds and confidence."""
    bound = result["bounds"]["any"]
    below = result["about"]["below"]
    sentences = (
        f"{bound['failures']:,} of {bound['flights']:,} flights failed: the probability of failure is "
        f"at most {bound['at most']:.3g}"
        + (f" and at least {bound['at least']:.3g}, each" if bound["failures"] else "")
        + f" at {_sure(result)} confidence."
    )
    if below is not None:
        sentences = {
            "below": f"Shown: the probability of failure is below {below:g}. ",
            "above": f"Refuted: the probability of failure is above {below:g}. ",
            "open": f"Not decided: whether the probability of failure is below {below:g}. ",
        }[result["decision"]] + sentences
    return sentences if is_over(result) else f"Interrupted. {sentences}"


def is_over(result: Mapping[str, Any]) -> bool:
    """Whether there is nothing left to fly."""
    flown = result["bounds"]["any"]["flights"]
    last_look = result["about"]["looks"][-1][0]
    return result["decision"] != "open" or flown >= last_look


def counts(result: Mapping[str, Any]) -> Table:
    """Failures of any kind and of each: how many flights, and bounds on the probability."""
    rows = [
        [
            "any failure" if name == "any" else Failure[name].meaning,
            f"{bound['failures']:,}",
            *(f"{bound[key]:.3g}" for key in ("rate", "at least", "at most")),
        ]
        for name, bound in result["bounds"].items()
    ]
    sure = _sure(result)
    return Table(("failure", "flights", "rate", f"at least ({sure})", f"at most ({sure})"), rows)


def asked(result: Mapping[str, Any]) -> Iterator[Table]:
    """Requirement, length, starts and conditions."""
    rows = [(str(what), str(text)) for what, text in result["scope"]["rows"]]
    yield Table(("what was asked", "it is"), rows, "What was asked")


def _asked_facts(result: Mapping[str, Any]) -> Iterator[Fact]:
    """Rows of the scope, those of a name as one."""
    texts: dict[str, list[str]] = {}
    for what, text in result["scope"]["rows"]:
        texts.setdefault(what, []).append(str(text))
    for what, some in texts.items():
        yield Fact(what, "; ".join(some), "domain" if what == "starts" else "requirement")


def _replay_facts(replays: Mapping[str, Any], judged: list[Mapping[str, Any]]) -> Iterator[Fact]:
    """How many failures each engine confirms, and of each kind of failure the worst flight."""
    if replays.get("failed again", 0) < replays.get("flown again", 0):
        again = f"{replays['failed again']:,} of {replays['flown again']:,}"
        yield Fact("failed flights, counted in float32, that fail again in float64", again)
    for judge, name in _JUDGES.items():
        flown = [replayed["again"][judge] for replayed in judged if judge in replayed["again"]]
        if flown:
            again = sum(kind is not None for kind in flown)
            passed = None if again == len(flown) else False
            yield Fact(
                f"failed flights that fail again in {name}",
                f"{again} of {len(flown)}",
                passed=passed,
            )
    for kind in dict.fromkeys(replayed["kind"] for replayed in judged):
        worst = max(
            (replayed for replayed in judged if replayed["kind"] == kind),
            key=lambda replayed: replayed["excess"],
        )
        text = f"{worst['excess']:.3g} tolerances; in the end it {worst['ending']}; {worst['see']}"
        yield Fact(f"worst flight: {Failure[kind].meaning}", text, "limits")


def _again(judged: list[Mapping[str, Any]]) -> Iterator[Table]:
    """Failed flights that were flown again, kind by kind, the worst first."""
    if not judged:
        return
    judges = [judge for judge in _JUDGES if judge in judged[0]["again"]]
    rows = []
    for replayed in judged:
        errors = [
            f"{QUANTITIES[name].display[0] * x:.3g} {QUANTITIES[name].display[1]}"
            for name, x in replayed["errors"].items()
        ]
        rows.append(
            [
                str(replayed["number"]),
                Failure[replayed["kind"]].meaning,
                *(_kind(replayed["again"][judge]) for judge in judges),
                ", ".join(errors),
                f"{100.0 * replayed['outside']:.0f} % of it",
                replayed["ending"],
                replayed["see"],
            ]
        )
    again = (f"again in {_JUDGES[judge]}" for judge in judges)
    last = ("largest errors", "outside for", "in the end it", "see it")
    yield Table(
        ("flight", "failure", *again, *last),
        rows,
        "Flights that failed",
        "Of each kind the worst, by the largest error of the last fifth in tolerances, then the first by "
        "number, as good as drawn by lot. All flew again step by step in float64.",
    )


def _kind(name: str | None) -> str:
    return Failure[name].meaning if name else "does not fail"


def _hashes(result: Mapping[str, Any]) -> Table:
    """SHA-256 of everything that decides how a flight ends."""
    rows = [[name, value] for name, value in result["about"].get("hashes", {}).items()]
    return Table(("what", "SHA-256"), rows, "What it is of")


def _sure(result: Mapping[str, Any]) -> str:
    return f"{100.0 * result['about']['confidence']:.6g} %"
