"""Flights under conditions, effect by effect, against Drake.

Drake has its own way of what an effect does to valves, body and motion. What was drawn, when it begins and
what sensors tell are given to it: `validation.study.onsets` judges when effects begin, and `tests/randomization`
what is drawn and read.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from rans.episode.flight import fly
from rans.episode.scenario import draws, scenarios
from rans.model.fields import leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.reference.flight import fly_in_drake
from validation.study.checks import Check, Curve
from validation.study.sampling import ENDLESS, Restless, gaps, growth, reach

_GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "body": ("body", ("mass", "inertia", "centre")),
    "thrust and supply": ("thrusters", ("thrust", "pressure", "droop")),
    "late and gradual valves": ("thrusters", ("latency", "command_delay", "rise")),
    "least on-times": ("thrusters", ("least_on",)),
    "errors of thrusters": ("thrusters", ("noise", "misalignment")),
    "faults": ("faults", ("count", "kinds", "share", "time")),
    "steady pushes": ("disturbances", ("force", "torque")),
    "swinging pushes": ("disturbances", ("slow_force",)),
    "kicks": ("disturbances", ("kick",)),
    "readings": (
        "sensors",
        (
            "position",
            "attitude",
            "velocity",
            "spin",
            "delay",
            "outage",
        ),
    ),
}
"""What belongs together, by name: where it is in `Conditions`."""

_TIMING = {2: Timing(), 3: Timing(substeps=16)}
"""In space the step is a series: turned at 1.2 rad/s by a steady torque it leaves 2e-8 with eight substeps,
with 16 as much as with 32."""
_DRAKE_STEP = {2: 0.005, 3: 0.0025}
"""s; in space 0.005 leaves 6e-9 of its own where valves are gradual."""
_REASON = (
    "Rounding of both, which a turning craft lets grow to some 1e-10 over 25 s of closed loop; for "
    "every 10 m of way. An effect done the wrong way shows at 1e-6 or more."
)


class Watching(Restless):
    """Keeps what it was told and shown."""

    def __copy__(self) -> Any:
        """Itself: what it keeps is read after the flight."""
        return self

    def reset(self, count: int) -> None:
        """Forget the last flight."""
        self.states: list[np.ndarray] = []
        self.seen: list[np.ndarray] = []

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.episode.flight.Controller`."""
        self.states.append(np.array(leaves(state), dtype=float))
        self.seen.append(observation)
        return super().act(state, goal, observation)


def effect_groups(conditions: Conditions) -> dict[str, Conditions]:
    """Each group of effects alone, as far as these conditions have them, and all together."""
    alone = {name: _alone(conditions, *where) for name, where in _GROUPS.items()}
    return {
        **{name: one for name, one in alone.items() if _does_something(one)},
        "all together": conditions,
    }


def _alone(conditions: Conditions, section: str, names: tuple[str, ...]) -> Conditions:
    part = getattr(conditions, section)
    kept = replace(type(part)(), **{name: getattr(part, name) for name in names})
    others = tuple(_alone(other, section, names) for other in conditions.others)
    return replace(Conditions(weight=conditions.weight, others=others), **{section: kept})


def _does_something(conditions: Conditions) -> bool:
    parts = replace(conditions, others=()), *conditions.others
    return any(replace(part, weight=1.0).or_none for part in parts)


def condition_checks(
    craft: Spacecraft, conditions: Conditions, seed: int, count: int
) -> Iterator[Check | Curve]:
    """Flights of 25 s under a restless controller, in closed loop: one reading that differs would tell.

    Raises:
        ConfigError: this spacecraft's valves cannot do what the conditions ask for.
    """
    conditions.check_craft(craft)
    starts = scenarios(ENDLESS, craft, seed, count)
    timing = _TIMING[craft.dimension]
    for name, part in effect_groups(conditions).items():
        ours = Watching(craft, seed)
        drakes = Watching(craft, seed)
        flight = fly(
            craft, ENDLESS, ours, starts, timing, conditions=part, draws=draws(seed, count)
        )
        judged = fly_in_drake(
            craft,
            ENDLESS,
            drakes,
            starts,
            timing,
            conditions=part,
            draws=draws(seed, count),
            max_step=_DRAKE_STEP[craft.dimension],
        )
        tolerance = 1e-9 * reach(judged.states)
        apart = np.max([*gaps(flight.states, judged.states).values()], axis=0)
        told = np.abs(np.array(ours.states) - drakes.states).max(axis=1)
        for what, far in (("motion", apart), ("told", told)):
            period, number = np.unravel_index(np.argmax(far), far.shape)
            yield Check(
                f"{name}: {what}",
                float(far.max()),
                tolerance,
                "SI",
                _REASON,
                f"flight {number}, period {period}",
            )
        if name == "all together":
            yield from growth("under the conditions", flight.states, judged.states, timing)
