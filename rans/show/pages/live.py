"""The page of a flight that Python steps while a person plays with it: any controller, any task."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rans.evaluation.fly.agent import LoadedRun
from rans.model.fields import leaves
from rans.show import markup
from rans.show.pages.interactive import FRAME, InteractiveFlight
from rans.show.pages.playground import Playground, pace, page_data, scenery, text_of, title_of


class Live:
    """A flight and its page, which asks for one control period after the other.

    Args:
        runs: who may command it; the first does.
        seed: of starts and goals.
        episode: number of the first start.

    Raises:
        ConfigError: see `InteractiveFlight`.
    """

    def __init__(self, runs: Sequence[LoadedRun], seed: int, episode: int = 0) -> None:
        self.flight = InteractiveFlight(runs, seed, episode, FRAME * pace(runs[0].judged))
        self._data = page_data(
            self.flight.world, self.flight.state, self.flight.goal, runs[0], seed, episode, 0
        )
        self._title = title_of(runs[0])
        self._one_by_one = threading.Lock()

    def html(self) -> str:
        """The page, which works while `answer` is served at its address."""
        script = f"const DATA = {markup.data(self._data)};\n{text_of('live.js')}"
        several = len(self.flight.controllers) > 1
        return Playground(self._title, script, self._data, "live", several).html()

    def answer(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Do what the page asks for, with its controls, and say everything of the flight as it is then.

        Raises:
            LookupError, TypeError, ValueError: the page of `html` does not ask for this.
        """
        flight = self.flight
        with self._one_by_one:
            # Controls.
            faults = asked["faults"]
            flight.delay = min(max(float(asked["delay"]), 0.0), float(self._data["longest"]))
            flight.noise = min(max(float(asked["noise"]), 0.0), 1.0)
            thrusters = range(flight.world.craft.thruster_count)
            flight.dead = {k for k in thrusters if faults[k] == "dead"}
            flight.stuck = {k for k in thrusters if faults[k] == "stuck open"}
            # What is asked for; a page that has just been opened only reads.
            states = [flight.state]
            what, value = asked["what"], asked["value"]
            if what == "step":
                states = flight.step()
            elif what == "restart":
                flight.restart(int(value))
            elif what == "rewind":
                flight.rewind(int(value))
            elif what == "goal":
                flight.place_goal([float(x) for x in value])
            elif what == "next":
                flight.command_by(flight.active + 1)
            return self._said(states)

    def _said(self, states: Sequence[Any]) -> dict[str, Any]:
        """Message to the page: the flight now, and the poses of these states; live.js reads its keys."""
        flight = self.flight
        task = flight.world.task
        seen = {
            "errors": [*flight.errors().values()],
            "reached": _numbers([task.reached(flight.state, flight.goal)]),
            "scenery": _numbers(x for shape in scenery(task, flight.goal) for x in leaves(shape)),
            "markers": _numbers(leaves(task.markers(flight.goal))),
        }
        return {
            "number": flight.number,
            "name": flight.controller.name,
            "time": flight.time,
            "over": flight.over,
            "command": [*flight.command],
            "carried": _numbers(leaves((flight.state, flight.goal))),
            "poses": [_numbers(leaves((one.p, one.attitude))) for one in states],
            "seen": seen,
        }


def _numbers(fields: Any) -> list[float]:
    """The only number of each field; those that JSON has no word for are 0."""
    values = (float(np.asarray(x).ravel()[0]) for x in fields)
    return [x if math.isfinite(x) else 0.0 for x in values]
