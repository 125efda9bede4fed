"""Flights as a page that replays them in the browser, which needs neither Drake nor a network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rans.episode.flight import Flight
from rans.evaluation.measure.metrics import arrival_times
from rans.model.fields import leaves
from rans.show.pages.page import Page, Section
from rans.show.pages.race import Track, race
from rans.show.palette import series_style


def replay_page(flights: Sequence[Flight], title: str) -> Page:
    """All episodes of flights: those of one craft from the same starts fly side by side in one picture."""
    groups: dict[Any, list[tuple[int, Flight]]] = {}
    for number, flight in enumerate(flights):
        groups.setdefault(_beginnings(flight), []).append((number, flight))
    return Page(title, [_section(group) for group in groups.values()])


def _section(group: Sequence[tuple[int, Flight]]) -> Section:
    """The replay of flights that begin alike, each with its number among all."""
    flight = group[0][1]
    times = [arrival_times(each) for _, each in group]
    starts = [
        (
            f"episode {flight.first + k}",
            [
                Track(each.controller, each, k, float(own[k]), series_style(number)[0])
                for (number, each), own in zip(group, times, strict=True)
            ],
        )
        for k in range(flight.commands.shape[1])
    ]
    return Section(
        f"{flight.craft.name} from {starts[0][0]}", race=race(flight.craft, starts, plays=True)
    )


def _beginnings(flight: Flight) -> tuple[Any, ...]:
    """What flights that are shown in one picture have in common."""
    fields = (*leaves(flight.states.p), *leaves(flight.goals.p))
    # Zero has one sign as text.
    numbers = str([(np.round(np.atleast_1d(x)[0], 6) + 0.0).tolist() for x in fields])
    craft = flight.craft
    period = flight.timing.control_period
    return craft.name, craft.dimension, period, flight.commands.shape[1:], numbers
