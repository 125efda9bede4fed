"""Starts of many rows, divided among processes."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping
from itertools import groupby
from typing import Any, TypeVar

from rans.base.processes import Workers, nothing

Part = TypeVar("Part")
Row = TypeVar("Row", bound=Hashable)


def in_parts(
    job: Callable[..., Part],
    together: Mapping[Row, int],
    count: int,
    workers: int | None,
    *further: Any,
) -> Iterator[tuple[Row, list[Part]]]:
    """Yield every row and its parts, in the order of its starts, as soon as they are known.

    The jobs of all rows are queued at once, so that no process waits for the end of a row.

    Args:
        job: called with None, a row, the first of its starts, how many, and ``further``; defined at the top level
            of a module.
        together: how many starts a job has, by rows.
        count: number of starts of every row.
        workers: number of processes; None: one per processor.
        further: what is the same for all jobs, such as a seed.
    """
    jobs = [
        (row, first, min(size, count - first), *further)
        for row, size in together.items()
        for first in range(0, count, size)
    ]
    parts = Workers(nothing, (), workers, "flew starts").ordered(job, jobs)
    pairs = zip(jobs, parts, strict=True)
    for row, group in groupby(pairs, key=lambda pair: pair[0][0]):
        yield row, [part for _, part in group]
