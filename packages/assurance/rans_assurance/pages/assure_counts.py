"""Counts of an assurance as a sentence and a table, for its own page and for the report of a run.

Both are of what its JSON file holds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rans.extend import Failure, Table


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
    return (
        sentences
        if is_over(result)
        else f"Interrupted, to be gone on with by the same command. {sentences}"
    )


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
    """Requirement, length, starts and conditions; none in files of version 0.2.0."""
    if "scope" in result:
        rows = [[str(text) for text in row] for row in result["scope"]["rows"]]
        yield Table(("what was asked", "it is"), rows)


def _sure(result: Mapping[str, Any]) -> str:
    return f"{100.0 * result['about']['confidence']:.6g} %"
