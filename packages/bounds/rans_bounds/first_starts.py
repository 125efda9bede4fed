"""Certified bounds for some of the starts, with a cache in a file."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import Any

from rans.base.files import number, one_at_a_time
from rans.extend import (
    Bound,
    Contest,
    Event,
    Progress,
    each,
    reading,
    to_toml,
    unseen,
    write_json,
)
from rans_bounds.problem import SearchEffort
from rans_bounds.starts import Question, bounds_in_parallel, question

_EFFORT = SearchEffort(work=20.0, nozzle_work=2.0, levels=4)
"""Effort of each question; most take two processor seconds. With less gaps are wider, and bounds hold all the
same."""
_VERSION = 6
"""Version of the proofs: bounds of other versions are searched again."""


def certified_bounds(
    contest: Contest,
    count: int,
    events: Sequence[Event],
    cache: Path | None = None,
    workers: int | None = None,
    progress: Progress = unseen,
) -> Iterator[Bound]:
    """Bounds of events from the first starts, as soon as each is known; those of the cache come first.

    Args:
        contest: contest with the starts.
        count: number of starts.
        events: what is bounded from each start.
        cache: JSON file that keeps the bounds; other processes may add theirs meanwhile.
        workers: see `bounds_in_parallel`.
        progress: reports bounds.

    Raises:
        RansError: a process died, or the cache is damaged or cannot be written.
    """
    cached = _read(cache) if cache and cache.exists() else {}
    common = (contest.craft, contest.task, contest.timing.control_period)
    scenarios = list(each(contest.starts))
    # Bounds of the cache first, by a hash of the question and the craft.
    pending: list[tuple[str, int, Question]] = []
    for start, event in product(range(min(count, contest.episodes)), events):
        item = question(*common, event, _EFFORT, scenarios[start])
        key = hashlib.sha256(f"{_VERSION} {to_toml(item.craft)} {item[1:]!r}".encode()).hexdigest()[
            :32
        ]
        if key in cached:
            yield replace(cached[key], start=start, horizon=event.horizon, kind=event.kind)
            progress(1)
        else:
            pending.append((key, start, item))
    # The others are computed by all workers, and stored one by one.
    keys, starts, questions = zip(*pending, strict=True) if pending else ((), (), ())
    for k, answer in bounds_in_parallel(questions, starts, workers, progress):
        if cache:
            _add(cache, keys[k], answer)
        yield answer


def _add(cache: Path, key: str, bound: Bound) -> None:
    """Add a bound to the cache, to which other processes may have added some.

    Keys are digests of questions with `_VERSION`: raise it with every change of a bound, or old ones are read.
    """
    with one_at_a_time(cache.parent):
        cached = _read(cache) if cache.exists() else {}
        write_json(
            cache,
            {
                key_name: asdict(bound_value)
                for key_name, bound_value in (cached | {key: bound}).items()
            },
        )


def _revived(row: dict[str, Any]) -> Bound:
    values: Any = {
        key: number(row[key])
        for key in ("hull", "lower", "upper", "tube")
        if row.get(key) is not None
    }
    bound = Bound(**row | values)
    if not 0.0 <= bound.best <= bound.upper * (1.0 + 1e-9):
        raise ValueError
    return bound


def _read(cache: Path) -> dict[str, Bound]:
    with reading(cache) as rows:
        return {key: _revived(row) for key, row in rows.items()}
