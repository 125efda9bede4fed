"""Bounds that are asked for once and kept."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
from rans_bounds import first_starts, transfers
from rans_bounds.first_starts import certified_bounds
from rans_bounds.goal_set import goal_set
from rans_bounds.starts import Question, staying_set

from rans import ConfigError, GoToPose, Timing
from rans.base.progress import unseen_stages
from rans.evaluation.compare.bounds import Bound, Event
from rans.evaluation.compare.contest import Contest
from rans.evaluation.compare.run import Comparison
from rans.model.spacecraft_file import load_spacecraft

CONTEST = Contest(
    load_spacecraft("floating-platform"), GoToPose().for_evaluation(), Timing(0.25), 4, 3
)
EVENTS = [Event("settling"), Event(horizon=5.0)]


@pytest.fixture
def asked(monkeypatch) -> list[Question]:
    """What is searched, answered with numbers that name start and horizon."""
    questions: list[Question] = []

    def search(given: list[Question], starts: list[int], *_: Any) -> Iterator[tuple[int, Bound]]:
        for k, (question, start) in enumerate(zip(given, starts, strict=True)):
            questions.append(question)
            yield (
                k,
                Bound(
                    start,
                    question.horizon,
                    1.0 + start,
                    math.inf,
                    math.inf,
                    [[1, 0]],
                    2.0,
                    0.25,
                    question.kind,
                ),
            )

    monkeypatch.setattr(first_starts, "bounds_in_parallel", search)
    return questions


def test_every_start_has_a_time_and_its_horizons(asked):
    events = [Event(), Event("settling"), Event(horizon=10.0)]
    answers = list(certified_bounds(CONTEST, 2, events))
    assert [(a.start, a.event) for a in answers] == [(k, event) for k in (0, 1) for event in events]
    assert [q.scenario.start.p.x for q in asked[::3]] == CONTEST.starts.start.p.x[:2].tolist()
    for asking in asked:
        rest = asking.kind == "arrival"
        assert (asking.craft, asking.period) == (CONTEST.craft, 0.25)
        assert asking.aims == ("attitude", "position", *["spin"] * rest, "velocity")
        assert asking.goals == (
            goal_set(CONTEST.task) if rest else staying_set(CONTEST.craft, CONTEST.task, 0.25)
        )
    assert len(list(certified_bounds(CONTEST, 99, [Event()]))) == 3  # no more starts than there are


def test_what_is_kept_comes_back_whole(asked, tmp_path):
    """Infinities too; under the number that the start has now; and each counts as progress."""
    cache = tmp_path / "bounds.json"
    ticks = []
    first = list(certified_bounds(CONTEST, 2, EVENTS, cache))
    again = list(certified_bounds(CONTEST, 2, EVENTS, cache, progress=ticks.append))
    assert again == first
    assert len(asked) == len(ticks) == 4
    rows = json.loads(cache.read_text())
    cache.write_text(json.dumps({key: {**row, "start": 77} for key, row in rows.items()}))
    assert [a.start for a in certified_bounds(CONTEST, 2, EVENTS, cache)] == [0, 0, 1, 1]
    assert len(asked) == 4
    cache.write_text('{"key": 3}')
    with pytest.raises(ConfigError, match=r"bounds\.json is not what RANS writes there"):
        list(certified_bounds(CONTEST, 1, EVENTS, cache))


@pytest.mark.usefixtures("asked")
def test_two_comparisons_at_once_lose_no_bounds(tmp_path):
    """Each reads what is kept when it begins, and adds to what is there when it has found something."""
    cache = tmp_path / "bounds.json"
    slow = certified_bounds(CONTEST, 2, [Event()], cache)
    quick = certified_bounds(CONTEST, 1, [Event("settling")], cache)
    next(slow)
    list(quick)
    list(slow)
    assert len(json.loads(cache.read_text())) == 3


def test_other_questions_and_older_proofs_are_searched_anew(asked, tmp_path, monkeypatch):
    cache = tmp_path / "bounds.json"
    list(certified_bounds(CONTEST, 1, [Event()], cache))
    for other in (
        replace(CONTEST, timing=Timing(0.2)),
        replace(CONTEST, seed=5),
        replace(CONTEST, craft=replace(CONTEST.craft, mass=6.0)),
    ):
        list(certified_bounds(other, 1, [Event()], cache))
    assert len(asked) == 4
    list(certified_bounds(CONTEST, 1, [Event()], cache))
    assert len(asked) == 4
    monkeypatch.setattr(first_starts, "_VERSION", first_starts._VERSION + 1)
    list(certified_bounds(CONTEST, 1, [Event()], cache))
    assert len(asked) == 5


def test_a_hull_bound_that_no_search_improved_is_told(monkeypatch):
    """A search with too many points gives its event the hull's bound; other events are certified."""
    found = [Bound(0, 5.0, 1.0), Bound(0, None, 1.0, lower=2.0, kind="settling")]
    monkeypatch.setattr(transfers, "certified_bounds", lambda *_: iter(found))
    monkeypatch.setattr(Comparison, "events", lambda _: EVENTS)
    comparison = Comparison(CONTEST)
    transfers.add_first_starts(
        comparison, certified=1, cache=None, stages=unseen_stages, workers=None
    )
    assert comparison.certified == found[::-1]  # in the order of events
    assert [note.split(".")[0] for note in comparison.notes] == [
        "The hull bound alone stands for some starts: impulse by 5 s"
    ]
