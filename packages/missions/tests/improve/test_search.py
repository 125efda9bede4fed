"""Local search over burns: what it returns is a flight that the engine repeats, and never a dearer one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rans_foreign_policies.flights_file import FlightsFile
from rans_missions.improve import pulses, search
from rans_missions.improve.command import Improve, improve
from rans_missions.improve.pulses import judged
from rans_missions.script import Script

from rans import ConfigError, GoToPosition, Timing
from rans.episode.scenario import scenarios
from rans.episode.step import Setup
from rans.evaluation.measure.metrics import impulses, won
from rans.model.spacecraft_file import load_spacecraft

CRAFT = load_spacecraft("floating-platform")
NEAR = GoToPosition(evaluation_distance=(0.02, 0.02)).for_evaluation()
"""A task that a craft solves at rest: it starts within the tolerance."""
SETUP = Setup(CRAFT, NEAR, Timing(episode_steps=20))


def test_a_flight_that_breaks_a_limit_or_does_not_arrive_is_never_cheap():
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


@pytest.mark.parametrize(
    ("words", "judged"),
    [
        (("avoid", "least.csv", "--spacecraft", "spheres"), "lqr:avoid-3d@spheres"),
        (
            ("avoid", "lqr", "--spacecraft", "floating-platform"),
            "lqr:avoid-2d@floating-platform",
        ),
        (("avoid", ("optimal.csv", "pretrained:avoid-2d")), "pretrained:avoid-2d"),
    ],
)
def test_the_next_command_judges_the_flights_on_their_own_craft(words, judged):
    task, who, *options = words
    command = Improve(
        task,
        (who,) if isinstance(who, str) else who,
        **dict(zip(["spacecraft"], options[1:], strict=False)),
    )
    assert command.following()[0].split()[2] == judged


def test_a_search_without_a_flight_to_begin_from_is_refused():
    far = SETUP._replace(task=GoToPosition().for_evaluation(), timing=Timing(episode_steps=2))
    coasting = Script(np.zeros((2, 2, CRAFT.command_count)))
    with pytest.raises(ConfigError, match="script does, from 2 starts: outside the tol"):
        search.improve(far, scenarios(far.task, CRAFT, 2023, 2), [coasting], rounds=1)
    with pytest.raises(ConfigError, match="afrl-deputy has other thrusters"):
        improve("dock", "mission")


def all_open() -> Script:
    """All thrusters of the platform open in one period, which moves it nowhere."""
    commands = np.zeros((20, 1, CRAFT.thruster_count))
    commands[3] = 1.0
    return Script(commands)


def test_an_interrupt_leaves_what_was_found_until_then(monkeypatch, tmp_path):
    """Ctrl-C in the second round: the flights of the first one are the result, and the engine repeats them."""
    rounds = []
    flies = search.fly

    def fly_until(*arguments, **options):
        if len(rounds) == 1:
            raise KeyboardInterrupt
        return flies(*arguments, **options)

    for module in (search, pulses):
        monkeypatch.setattr(module, "fly", fly_until)
    monkeypatch.setattr(pulses, "COPIES", 64)
    starts = scenarios(NEAR, CRAFT, 2023, 1)
    found = search.improve(
        SETUP, starts, [all_open()], 5, report=lambda _, best: rounds.append(best.copy())
    )
    assert found.rounds == 1
    np.testing.assert_array_equal(found.after, rounds[0])
    assert found.after[0] < found.before[0]
    file = tmp_path / "least.csv"
    monkeypatch.setattr(search, "improve", lambda *_, **__: found)
    with pytest.raises(KeyboardInterrupt):
        Improve("go-to-position", ("lqr",), spacecraft="floating-platform", output=file).run()
    again = flies(CRAFT, NEAR, FlightsFile(file, SETUP), starts, SETUP.timing)
    assert won(again).all()
    np.testing.assert_allclose(impulses(again), found.after, rtol=1e-9)
