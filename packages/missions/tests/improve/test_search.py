"""Local search over burns: what it returns is a flight that the engine repeats, and never a dearer one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.improve import pulses, search
from rans_missions.improve.command import Improve
from rans_missions.improve.judging import judged
from rans_missions.script import Script
from rans_missions.tasks import Dock

from rans.episode import Setup
from rans.errors import ConfigError
from rans.evaluation.fly.flights_file import FlightsFile
from rans.evaluation.measure.metrics import impulses, won
from rans.flight import fly
from rans.model.actuators import Actuators, OnOff, Throttle
from rans.model.spacecraft_file import load_spacecraft, spacecraft_names
from rans.model.timing import Timing
from rans.scenario import scenarios
from rans.tasks import GoToPosition

CRAFT = load_spacecraft("afrl-deputy")
TASK = Dock(deadline=(600.0, 600.0)).for_evaluation()
SETUP = Setup(CRAFT, TASK, replace(TASK.timing, episode_steps=62))


class Wasteful:
    """Guidance that also pushes against itself for a minute: a flight with something to find."""

    name = "wasteful"

    def __init__(self) -> None:
        self._inner = MissionGuidance(CRAFT, TASK)
        self._step = 0

    def reset(self, count: int) -> None:
        self._inner.reset(count)
        self._step = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        commands = self._inner.act(state, goal, observation).copy()
        if self._step in (10, 11):
            # Across the orbit, there and back a period later.
            axis = [k for k, t in enumerate(CRAFT.thrusters) if t.direction[2] != 0.0]
            commands[:, axis] = 0.0
            commands[:, axis[self._step - 10]] = 0.05
        self._step += 1
        return commands


@pytest.mark.slow
def test_a_search_finds_what_a_flight_wastes_and_the_engine_repeats_it(tmp_path: Path) -> None:
    starts = scenarios(TASK, CRAFT, 2023, 2)
    found = search.improve(SETUP, starts, [Wasteful()], rounds=3)
    assert (found.after <= found.before).all()
    assert (found.after < 0.99 * found.before).any()
    file = found.write(tmp_path / "least.csv")
    flight = fly(CRAFT, TASK, FlightsFile(file, SETUP), starts, SETUP.timing)
    assert won(flight).all()
    np.testing.assert_allclose(impulses(flight), found.after, rtol=1e-9)


def test_a_flight_that_breaks_a_limit_or_does_not_arrive_is_never_cheap() -> None:
    """Three flights without any burn, of which the second broke a limit, and the third did not solve its task."""
    flight = SimpleNamespace(
        verdict=SimpleNamespace(solved=np.array([True, True, False])),
        violated=lambda: np.array([False, True, False]),
        failed=lambda: np.zeros(3, bool),
        craft=CRAFT,
        commands=np.zeros((4, 3, CRAFT.command_count)),
        timing=SETUP.timing,
        lengths=None,
    )
    flown: Any = flight
    np.testing.assert_array_equal(judged(flown), [0.0, np.inf, np.inf])


@given(
    st.sampled_from(["afrl-deputy", "vbar-chaser"]),
    st.integers(0, 10_000),
    st.floats(1e-3, 1.0),
)
def test_a_changed_flight_keeps_to_what_its_thrusters_give(
    name: str, seed: int, size: float
) -> None:
    craft = load_spacecraft(name)
    form = search._Form.of(SETUP._replace(craft=craft))
    random = np.random.default_rng(seed)
    start = random.uniform(form.low, form.high, (30, len(form.columns)))
    flight = np.where(random.random((30, 1)) < 0.2, start, 0.0)
    search._change(flight, size, form, random)
    assert np.abs(flight @ form.levers.T).max() <= 1.0 + 1e-12


@pytest.mark.parametrize(
    ("words", "judged"),
    [
        (("dock", "mission"), "mission:dock-3d"),
        (("inspect", "least.csv"), "circumnavigation:inspect-3d"),
        (
            ("avoid", "lqr", "--spacecraft", "floating-platform"),
            "lqr:avoid-2d@floating-platform",
        ),
        (("avoid", ("optimal.csv", "pretrained:avoid-2d")), "pretrained:avoid-2d"),
    ],
)
def test_the_next_command_judges_the_flights_on_their_own_craft(
    words: tuple[Any, ...], judged: str
) -> None:
    task, who, *options = words
    command = Improve(
        task,
        (who,) if isinstance(who, str) else who,
        **dict(zip(["spacecraft"], options[1:], strict=False)),
    )
    assert command.following()[0].split()[2] == judged


def test_a_search_without_a_flight_to_begin_from_is_refused() -> None:
    coasting = Script(np.zeros((2, 2, CRAFT.command_count)))
    short = SETUP._replace(timing=replace(SETUP.timing, episode_steps=2))
    with pytest.raises(ConfigError, match="script does, from 2 starts: time was up"):
        search.improve(short, scenarios(TASK, CRAFT, 2023, 2), [coasting], rounds=1)
    wheeled = next(name for name in spacecraft_names() if load_spacecraft(name).wheels)
    with pytest.raises(ConfigError, match="wheels or other effectors"):
        search._Form.of(SETUP._replace(craft=load_spacecraft(wheeled)))


PLATFORM = load_spacecraft("floating-platform")
NEAR = GoToPosition(evaluation_distance=(0.02, 0.02)).for_evaluation()
"""A task that a craft solves at rest: it starts within the tolerance."""


def all_open() -> Script:
    """All thrusters of the platform open in one period, which moves it nowhere."""
    commands = np.zeros((20, 1, PLATFORM.thruster_count))
    commands[3] = 1.0
    return Script(commands)


@pytest.mark.parametrize("actuators", [OnOff(), Throttle()])
def test_an_interrupt_leaves_what_was_found_until_then(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, actuators: Actuators
) -> None:
    """Ctrl-C in the second round: the flights of the first one are the result, and the command says so."""
    rounds: list[np.ndarray] = []
    flies = search.fly

    def fly_until(*arguments: Any, **options: Any) -> Any:
        if len(rounds) == 1:
            raise KeyboardInterrupt
        return flies(*arguments, **options)

    for module in (search, pulses):
        monkeypatch.setattr(module, "fly", fly_until)
        monkeypatch.setattr(module, "COPIES", 64)
    setup = Setup(replace(PLATFORM, actuators=actuators), NEAR, Timing(episode_steps=20))
    starts = scenarios(NEAR, PLATFORM, 2023, 1)
    found = search.improve(
        setup, starts, [all_open()], 5, report=lambda _, best: rounds.append(best.copy())
    )
    assert found.rounds == 1
    np.testing.assert_array_equal(found.after, rounds[0])
    assert found.after[0] < found.before[0]
    file = tmp_path / "least.csv"
    monkeypatch.setattr(search, "improve", lambda *_, **__: found)
    with pytest.raises(KeyboardInterrupt):
        Improve("dock", ("mission",), episodes=1, output=file).run()
    assert file.exists()
