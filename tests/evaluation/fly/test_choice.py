"""Flights of a craft choose how the agent for any craft flies it: in which order, once, and what is said."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from rans_any_craft.frugality import numbers_of

from rans import Conditions, RansWarning, ThrusterConditions, load_conditions
from rans.base.pretrained import pretrained_folder
from rans.evaluation.fly import choice
from rans.evaluation.fly.agent import LoadedRun, load_policy
from rans.evaluation.fly.any_craft import for_spacecraft, frugal
from rans.evaluation.fly.choice import Choice, Rival, _flown, chosen
from rans.evaluation.fly.contestant_name import ContestantName
from rans.evaluation.fly.contestants import contestant
from rans.fast.flights import Flights
from rans.model.actuators import Wheel
from rans.model.spacecraft_file import load_spacecraft, to_toml

PLATFORM = load_spacecraft("floating-platform")
OWN = load_policy(pretrained_folder("any-craft-2d"))


@pytest.fixture
def flown(monkeypatch, rivals) -> dict[float, int]:
    """Solved flights of each value, to be filled in by a test; without an entry none is.

    A larger value is slower and cheaper: 0.4 settles in 6.4 s with 16 N s.
    """
    solved: dict[float, int] = {}

    def result(run: LoadedRun, value: float, flights: int = 32) -> Choice:
        part = solved.get(value, 0) * flights // 32
        figures = 6.0 + value, 20.0 - 10.0 * value
        return Choice(value, run.timing.control_period, flights, part, *figures)

    monkeypatch.setattr(choice, "_flown", result)
    return solved


@pytest.fixture
def rivals(monkeypatch, tmp_path) -> dict[str, Rival]:
    """Flights of controllers, to be filled in by a test; without an entry they solve none."""
    beside: dict[str, Rival] = {}
    none = math.inf, math.inf
    monkeypatch.setattr(
        choice, "_controlled", lambda name, _: beside.get(name, Rival(name, 0.0, *none))
    )
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return beside


@pytest.mark.parametrize(
    ("lqr", "value", "is_named"),
    [
        ((1.0, 7.0, 18.0), 0.4, False),  # beaten by 0.4
        ((1.0, 7.0, 15.2), 0.5, False),  # cheaper than 0.4 alone
        ((1.0, 6.4, 15.9), 0.4, False),  # equal but for 1 %
        ((1.0, 6.0, 12.0), 0.4, True),  # better than any value
        ((0.9, 6.0, 12.0), 0.4, False),  # which loses flights
    ],
)
def test_the_choice_is_dominated_by_no_controller_or_names_it(lqr, value, is_named, flown, rivals):
    flown.update({one: 32 for one in (0.3, 0.4, 0.5, 0.6, 1.0)})
    rivals["lqr"] = Rival("lqr", *lqr)
    for _ in range(2):  # the second from the cache
        found = chosen(OWN, PLATFORM)
        assert (found.value, found.rival) == (value, rivals["lqr"] if is_named else None)
    assert ("lqr:go-to-pose-2d@mine.toml" in found.text("any-craft-2d", "mine.toml")) is is_named


def test_a_controller_that_solves_more_is_named_in_the_doubt(flown, rivals):
    flown[0.0] = 16
    rivals["lqr"] = Rival("lqr", 0.55, 6.0, 25.0)  # too few to tell of 16
    assert "lqr" not in chosen(OWN, PLATFORM).doubt("any-craft-2d", PLATFORM, "mine.toml")
    rivals["switching"] = Rival("switching", 0.9, 6.0, 12.0)
    found = chosen(OWN, replace(PLATFORM, mass=6.0)).doubt("any-craft-2d", PLATFORM, "mine.toml")
    assert "switching:go-to-pose-2d@mine.toml: solved 14 of 16" in found


@pytest.mark.usefixtures("rivals")
def test_conditions_decide_the_value():
    """Valves 40 ms late: of a strong platform 0.4 loses every flight, and 1 hardly one."""
    ways = [replace(one, force=3.6 * one.force) for one in PLATFORM.thrusters]
    strong = replace(PLATFORM, thrusters=tuple(ways))
    assert chosen(OWN, strong).value == 0.4
    late = Conditions(thrusters=ThrusterConditions(latency=0.04))
    found = chosen(OWN, strong, conditions=late)
    assert found.value == 1.0
    assert found.solved > 200
    assert _flown(frugal(for_spacecraft(OWN, strong), 0.4).under(late), 0.4).solved < 25


@pytest.mark.parametrize(
    ("solved", "value"),
    [
        ({0.4: 32, 0.3: 32}, 0.4),
        ({0.4: 31, 0.3: 32}, 0.3),
        ({0.4: 20, 0.3: 31, 0.0: 30}, 0.3),
        ({0.4: 9, 0.3: 32, 0.0: 30}, 0.0),
        ({0.0: 32}, 0.0),
    ],
)
def test_the_cheapest_value_that_loses_no_flight_is_taken(solved, value, flown):
    flown.update(solved)
    assert chosen(OWN, PLATFORM).value == value
    assert chosen(OWN, PLATFORM, value=1.0).solved == 0


@pytest.mark.parametrize(
    ("lost", "least"), [((), 0.0), ((1.0,), 1.0), ((1.0, 0.8), 0.8), ((1.0, 0.8, 0.6), 0.6)]
)
def test_the_least_larger_value_that_loses_flights_is_named(lost, least, flown):
    flown.update({value: 32 for value in (0.4, 0.6, 0.8, 1.0) if value not in lost})
    result = chosen(OWN, PLATFORM)
    assert result.lost == least
    assert (f"#{least:g}" in result.text("").partition(":")[2]) == bool(least)


def test_flights_are_flown_once_for_a_craft(flown, tmp_path):
    flown[0.4] = 32
    assert chosen(OWN, PLATFORM).value == 0.4
    flown.clear()
    flown[0.0] = 32
    assert chosen(OWN, replace(PLATFORM, name="alike")).value == 0.4
    assert chosen(OWN, replace(PLATFORM, mass=9.0)).value == 0.0
    for file in tmp_path.rglob("*.json"):
        file.write_text("[0.4, ")
    assert chosen(OWN, PLATFORM).value == 0.0


def test_a_craft_that_no_value_settles_is_doubted_wherever_it_is_loaded(flown, here):
    Path("mine.toml").write_text(to_toml(replace(PLATFORM, name="mine")))
    flown[0.0] = 12
    with pytest.warns(RansWarning, match="any-craft-2d#0: solved 12 of 32"):
        assert contestant("any-craft-2d@mine.toml").controller.name == "any-craft-2d#0"
    with pytest.warns(RansWarning, match="any-craft-2d#1: solved 0 of 32"):
        assert ContestantName.parse("any-craft-2d#1@mine.toml").folder.exists()
    with pytest.warns(RansWarning, match="any-craft-2d#1: solved 0 of 32"):
        contestant("mine.toml#1")


@pytest.mark.slow
@pytest.mark.parametrize("craft", ["floating-platform", "spheres"])
def test_finer_tolerances_are_held_by_the_same_weights(craft):
    """Without them 11 and 0 % of the flights are within 2 cm and 2 degrees."""
    run = contestant(f"any-craft-{load_spacecraft(craft).dimension}d#2cm,2deg@{craft}")
    assert run.judged.task.tolerances() == pytest.approx({"position": 0.02, "attitude": 0.0349066})
    result = Flights(run.network, run.judged).fly(0, 64, 77)
    assert result.unsolved <= 1  # 98 %: a start of a seed that chose nothing may be lost


@pytest.mark.slow
def test_pulses_that_are_long_for_a_heavy_craft_are_flown_more_often(monkeypatch, tmp_path):
    """A servicer with on/off thrusters of 5 N and wheels: at 1.0 s its pulses lose flights; 0.1 s thrusts least."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    start = load_spacecraft("free-flyer")
    thrusters = tuple(
        replace(
            one,
            force=5.0,
            position=(3.0 * one.position[0], 3.0 * one.position[1], 3.0 * one.position[2]),
        )
        for one in start.thrusters
    )
    wheels = tuple(Wheel(axis, 0.5, 20.0, 0.1) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    inertia = ((60.0, 0.0, 0.0), (0.0, 70.0, 0.0), (0.0, 0.0, 65.0))
    craft = replace(start, mass=300.0, inertia=inertia, thrusters=thrusters, wheels=wheels)
    result = chosen(load_policy(pretrained_folder("any-craft-3d")), craft)
    assert (result.solved, result.period) == (result.flights, 0.1)


@pytest.mark.parametrize(("conditions", "holds"), [("faults", 0.0), ("lab", 1.0)])
def test_pulses_hold_no_pose_where_thrusters_may_fail(conditions, holds):
    """any-craft-2d#1 solves 66 % of 256 flights under faults with pulses that hold a pose, 76 % without."""
    designed = frugal(for_spacecraft(OWN, PLATFORM), 1.0)
    run = designed.under(load_conditions(conditions))
    assert numbers_of(run.network.architecture).hold == holds
    assert run.under(load_conditions("lab")).controller is designed.controller
    assert run.controller.name == f"{OWN.controller.name}#1"
