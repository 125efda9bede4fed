"""The search finds what is known to be best, and its cost is what was flown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from rans import ConfigError, GoToPose, Timing
from rans.base.registry import typed
from rans.episode.scenario import EVALUATION_SEED, SELECTION_SEED, TUNING_SEED
from rans.episode.step import Setup
from rans.evaluation.compare.contest import Contest
from rans.evaluation.compare.tuning import tuned_settings
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions_file import load_conditions

HERE = "tests.evaluation.compare.test_tuning"
SETUP = Setup(
    load_spacecraft("floating-platform"), GoToPose().for_evaluation(), Timing(episode_steps=10)
)


@dataclass(frozen=True)
class Habit:
    """When to fire."""

    share: float = 0.5
    unused: float = 1.0


class Firing:
    """Opens every thruster in a share of the periods: the least thrust is that of the least share."""

    name = "firing"
    tunable = {"habit.share": (0.1, 10.0), "habit.unused": (0.5, 2.0)}  # noqa: RUF012

    def __init__(self, craft: Any, task: Any, timing: Any, habit: Habit = Habit()) -> None:
        self._share = habit.share
        self._count = len(craft.thrusters)

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`."""
        self._step = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.episode.flight.Controller`."""
        self._step += 1
        return np.full((len(observation), self._count), float(self._step * self._share >= 2.0))


def test_finds_the_least_and_counts_the_budget():
    """Below 0.2 no valve opens in 10 periods; nobody settles, which counts twice 2 s."""
    steps = []
    found = tuned_settings(typed(f"{HERE}:Firing"), SETUP, 12, 3, 0.5, "the command", steps.append)
    assert steps == [1] * 12
    assert found.settings["habit.share"] < 0.2
    assert 0.5 <= found.settings["habit.unused"] <= 2.0
    assert found.costs["tuned"] == pytest.approx(4.0)
    assert found.costs["default"] == pytest.approx(
        4.0 + 0.5 * 7 * 8 * 0.2
    )  # 7 periods, 8 thrusters of 1 N
    assert (found.candidates, found.starts, found.seed, found.price) == (12, 3, TUNING_SEED, 0.5)
    assert found == tuned_settings(typed(f"{HERE}:Firing"), SETUP, 12, 3, 0.5, "the command")


def test_an_interrupt_keeps_what_was_found(monkeypatch):
    flown = []
    fly = Contest.fly

    def interrupted(*given):
        if len(flown) == 3:
            raise KeyboardInterrupt
        flown.append(1)
        return fly(*given)

    whole = tuned_settings(typed(f"{HERE}:Firing"), SETUP, 3, 3, 0.5)
    monkeypatch.setattr(Contest, "fly", interrupted)
    found = tuned_settings(typed(f"{HERE}:Firing"), SETUP, 9, 3, 0.5)
    assert (found.candidates, found.costs["default"]) == (3, whole.costs["default"])
    with pytest.raises(KeyboardInterrupt):  # there is nothing yet
        tuned_settings(typed(f"{HERE}:Firing"), SETUP, 9, 3, 0.5)


def test_no_report_uses_its_starts():
    assert len({EVALUATION_SEED, SELECTION_SEED, TUNING_SEED}) == 3


class Whole(Firing):
    """Has a setting that is a whole number."""

    tunable = {"periods": (2, 30)}  # noqa: RUF012

    def __init__(self, craft: Any, task: Any, timing: Any, periods: int = 5) -> None:
        assert isinstance(periods, int)
        super().__init__(craft, task, timing, Habit(1.0 / periods))


def test_whole_settings_stay_whole():
    found = tuned_settings(typed(f"{HERE}:Whole"), SETUP, 6, 2, 0.01)
    assert isinstance(found.settings["periods"], int)
    assert 2 <= found.settings["periods"] <= 30


def test_the_search_ends_when_its_time_is_spent():
    """At least the default settings are flown, whatever the time."""
    found = tuned_settings(typed(f"{HERE}:Firing"), SETUP, 10_000, 2, 0.01, seconds=1e-9)
    assert (found.candidates, found.seconds > 0.0) == (1, True)
    with pytest.raises(ConfigError, match="--seconds must be > 0"):
        tuned_settings(typed(f"{HERE}:Firing"), SETUP, 1, 2, 0.01, seconds=0.0)


def test_settings_tuned_under_conditions_are_for_these_alone():
    """Those tuned without any serve where there are none of the setup's own."""
    lab, harsh = (load_conditions(name).or_none for name in ("lab", "harsh"))
    in_lab = tuned_settings(typed(f"{HERE}:Firing"), SETUP._replace(conditions=lab), 1, 2, 0.01)
    perfect = tuned_settings(typed(f"{HERE}:Firing"), SETUP, 1, 2, 0.01)
    for world, fits in ((lab, True), (harsh, False), (None, False)):
        setup = SETUP._replace(conditions=world)
        assert in_lab.fits(f"{HERE}:Firing", setup) == fits
        assert perfect.fits(f"{HERE}:Firing", setup)
    assert in_lab.budget().startswith("tuned: 1 settings on 2 starts under conditions")


class Fixed(Firing):
    """Has nothing to tune."""

    tunable: ClassVar = {}  # pyrefly: ignore[bad-override]
