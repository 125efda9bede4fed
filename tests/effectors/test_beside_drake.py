"""Every effector that is registered, with all that a control period does to its push, beside Drake."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from rans_example.motion import Torquer
from rans_missions.slosh.liquid import Slosh

from rans import (
    BodyConditions,
    Conditions,
    ConfigError,
    GoToPose,
    ThrusterConditions,
    Timing,
)
from rans.episode.flight import fly
from rans.episode.scenario import draws, scenarios
from rans.model.actuators import Propellant, Wheel
from rans.model.spacecraft_file import EFFECTORS, load_spacecraft
from rans.randomization.conditions_file import CONDITIONS, load_conditions
from rans.reference.flight import fly_in_drake
from tests.support.effector_flights import scripted
from tests.support.played import Played
from tests.support.torquer import Fan
from validation.study.sampling import gap

PLACE = (0.1, -0.05, 0.0)
"""Place of an effector away from the centre of mass, in the plane of the planar craft, m."""
OF_KINDS: dict[str, Any] = {
    "fan": {"further_effectors": (Fan(0.3, PLACE),)},
    "torquer": {"further_effectors": (Torquer((0.0, 0.6, 0.8), 0.05, 1.5),)},
    "slosh": {"further_effectors": (Slosh(0.4, 0.1, PLACE, (-1.0, 0.0, 0.0), 2e-3),)},
    "thrusters": {},
    "wheel": {"wheels": (Wheel((0.0, 0.0, 1.0), 0.05, 0.08, 1e-3),)},
}
"""What each kind adds to a craft; those of the example and of tests are registered by nobody."""
CRAFTS = {2: load_spacecraft("floating-platform"), 3: load_spacecraft("free-flyer")}
TANK = Propellant(1.0, 3.0, (0.06, -0.03, 0.0), 0.05)
"""A fifth of the mass or less, beside the centre of mass, of which 1.2 s of thrust burn a quarter."""
CHANGED = Conditions(
    BodyConditions(centre=(0.01, 0.03)),
    ThrusterConditions(latency=(0.0, 0.1), rise=0.15, command_delay=(0.0, 0.3)),
)
"""What changes a push within a period, where it acts, or the period that has it."""
TOLERANCE = 3e-6
"""m, rad, m/s and rad/s after 1.2 s; Drake, which weighs a craft in steps, has 1.4e-6 of it (`test_pairs`). A push
that does not know of lost mass is 6e-5 off or more, one that does not know of rising thrust 1e-2."""


def test_every_registered_effector_is_flown_here():
    assert OF_KINDS.keys() >= set(EFFECTORS)


def flown_alike(kind: str, dimension: int, burns: bool, conditions: Conditions) -> None:
    craft = replace(CRAFTS[dimension], **OF_KINDS[kind], propellant=TANK if burns else None)
    task = GoToPose()
    timing = Timing(episode_steps=6, substeps=None if dimension == 2 else 4)
    starts = scenarios(task, craft, 5, 2)
    given: Any = {"conditions": conditions, "draws": draws(5, 2)}
    ours = fly(craft, task, scripted(craft), starts, timing, **given)
    drakes = fly_in_drake(craft, task, scripted(craft), starts, timing, **given, max_step=0.01)
    assert max(gap(drakes.states, ours.states).values()) < TOLERANCE
    if kind == "thrusters":
        return
    # And it is felt: without its kind the craft goes elsewhere.
    bare = replace(craft, further_effectors=(), wheels=())
    played = Played(lambda step, _: ours.commands[step][:, : len(bare.commands)])
    others = fly(bare, task, played, starts, timing, **given)
    assert max(gap(drop_stores(others.states), drop_stores(ours.states)).values()) > 1e-3


def drop_stores(states: Any) -> Any:
    return replace(states, stores=())


def refuses(kind: str, dimension: int) -> bool:
    """Whether a craft with this kind and a tank is refused, in a sentence that names both."""
    if kind != "slosh":
        return False
    with pytest.raises(ConfigError, match=r"slosh.*propellant"):
        replace(CRAFTS[dimension], **OF_KINDS[kind], propellant=TANK)
    return True


@pytest.mark.parametrize(
    ("kind", "dimension"),
    [("fan", 2), ("torquer", 2), ("slosh", 2), ("wheel", 2), ("fan", 3), ("thrusters", 3)],
)
def test_what_a_period_does_to_a_push_is_done_to_every_one(kind, dimension):
    flown_alike(kind, dimension, not refuses(kind, dimension), CHANGED)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*swings the liquid:rans.RansWarning")
@pytest.mark.parametrize("kind", OF_KINDS)
@pytest.mark.parametrize("name", [name for name in CONDITIONS if CONDITIONS.comes_with_rans(name)])
def test_under_every_condition_that_comes_with_rans(name, kind):
    """In the plane or in space, and with propellant or without, by turns."""
    number = [*CONDITIONS].index(name) + [*OF_KINDS].index(kind)
    dimension = 3 if name in ("real-space", "train-faults-3d", "train-robust-pose-3d") else 2
    burns = number % 2 == 0 and not refuses(kind, dimension)
    flown_alike(kind, dimension, burns, load_conditions(name, CRAFTS[dimension]))
