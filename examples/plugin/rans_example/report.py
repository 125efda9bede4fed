"""A metric of flights, and a section of a run's report that shows it."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rans.extend import Flight, Sample, Section, Table

_SECONDS = 5.0
"""Time in which a craft accelerates towards its goal, s."""


def early_duty(flight: Flight) -> Iterator[Sample]:
    """Mean duty cycle of the thrusters in the first seconds of each episode, %."""
    if not flight.craft.thruster_count:
        return
    periods = round(_SECONDS / flight.timing.control_period)
    values = 100.0 * flight.openings[:periods].mean(axis=(0, 2))
    meaning = f"mean duty cycle of the thrusters in the first {_SECONDS:g} s"
    # key: rans evaluate prints it without --full too, and rans compare has it.
    yield Sample("effort", "early duty", meaning, "%", values, key=True)


def early_duty_section(evaluation: Path, _: Mapping[str, Any]) -> Section | None:
    """Episodes by their early duty, in five bins; none where no such metric was measured."""
    episodes = evaluation.with_name(evaluation.stem.replace("evaluation", "episodes") + ".npz")
    if not episodes.is_file():
        return None
    with np.load(episodes) as arrays:
        if "early_duty" not in arrays:
            return None
        counts, edges = np.histogram(arrays["early_duty"], bins=5)
    rows = [
        (f"{low:.1f} to {high:.1f} %", str(count))
        for low, high, count in zip(edges, edges[1:], counts, strict=False)
    ]
    return Section("Early duty", tables=[Table(("duty cycle", "episodes"), rows)])
