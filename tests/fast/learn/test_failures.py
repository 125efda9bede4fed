"""Episodes that begin where the agent fails: along flights that another engine finds failing too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rans.errors import ConfigError
from rans.evaluation.fly.contestants import contestant
from rans.fast.engine import Engine
from rans.fast.learn.config import Failures, MemorySettings
from rans.fast.stepping.step import begin_as, varying
from rans.flight import fly
from rans.model.fields import leaves
from rans.model.spacecraft import Spacecraft
from rans.scenario import FAILURES_SEED, scenarios
from rans.tasks import GoToPose
from tests.support.engines import SHORT, actions, both_crafts
from tests.support.training import CONFIG, after, everything, ignore, resumed, tiny_trainer

HALF = GoToPose(
    spawn_distance=(0.5, 1.0),
    evaluation_distance=(0.5, 1.0),
    position_tolerance=0.8,
    attitude_tolerance=2.0,
    fail_spin=40.0,
)
"""Nobody ends early; some who hardly move are within its tolerances all the time, and others never."""
LOOKING = replace(CONFIG, settings=HALF, failures=Failures(0.5, begin=0.25, searches=3, flights=24))


@both_crafts
@pytest.mark.parametrize("conditions", [None, "lab"])
def test_episodes_go_on_as_those_that_they_begin_as(
    craft: Spacecraft, conditions: str | None
) -> None:
    """Six of one engine's in rows of another: from there on they move bit for bit the same; no other does."""
    first, second = (
        Engine(craft, HALF, count, SHORT, seed=seed, conditions=conditions, remember=True)
        for count, seed in ((6, 1), (9, 2))
    )
    commands = actions(craft, 9, 8)
    for command in commands[:3]:
        first.step(command[:6])
        second.step(command)
    rows = torch.tensor([8, 0, 3, 4, 1, 7])
    others = torch.tensor([2, 5, 6])
    memory = lambda: [torch.as_tensor(x).clone() for x in second.episode.memory()]  # noqa: E731
    before = memory()
    begin_as(second.episode, SHORT, rows, varying(first.episode, second.episode))
    for old, new in zip(before, memory(), strict=True):
        assert torch.equal(old[others], new[others])
    assert torch.as_tensor(SHORT.step(second.episode.clock)).tolist() == [0, 0, 3, 0, 0, 3, 3, 0, 0]
    for command in commands[3:]:
        wide = command.clone()
        wide[rows] = command[:6]
        first.step(command[:6])
        second.step(wide)
        for one, other in zip(leaves(first.state), leaves(second.state), strict=True):
            if not isinstance(one, float):
                assert torch.equal(torch.as_tensor(one), torch.as_tensor(other)[rows])


def test_starts_are_where_flights_were_that_fail(tmp_path: Path) -> None:
    """Flown again in float64 by what evaluates agents; float32 is within 1e-5 after 20 steps."""
    trainer = tiny_trainer(tmp_path / "run", LOOKING)
    trainer.train(ignore, after(3))
    trainer.failures._search()
    loaded = contestant(str(tmp_path / "run"))
    controller = loaded.controller
    craft = loaded.craft
    timing = loaded.timing
    flight = fly(craft, HALF, controller, scenarios(HALF, craft, FAILURES_SEED, 24), timing)
    inside = (flight.errors()["position"] < 0.8) & (flight.errors()["attitude"] < 2.0)
    failed = ~inside[-4:].all(axis=0)
    assert 0 < failed.sum() < 24
    assert trainer.failures.log == [{"failures/share": pytest.approx(failed.mean())}]
    expected = np.stack(flight.states.p.columns())[:, :-1, failed].reshape(2, -1)
    found = torch.stack(trainer.failures._starts[0][:2]).numpy()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)


def test_a_share_of_the_environments_begins_there_in_turns(tmp_path: Path) -> None:
    """Eight of 16; an episode lasts three rollouts, so that every third of them begins anew at each."""
    trainer = tiny_trainer(tmp_path / "run", LOOKING)
    trainer.train(ignore, after(4))
    failures = trainer.failures
    engine = trainer.engine
    failures._search()
    starts = torch.stack(failures._starts[0][:2]).T.tolist()
    for turn, rows in enumerate(([0, 3, 6], [1, 4, 7], [2, 5], [0, 3, 6])):
        before = [
            list(pair) for pair in zip(*(x.tolist() for x in engine.state.p.columns()), strict=True)
        ]
        failures.begin(turn * 128)
        now = [
            list(pair) for pair in zip(*(x.tolist() for x in engine.state.p.columns()), strict=True)
        ]
        assert [row for row in range(16) if now[row] != before[row]] == rows
        assert all(now[row] in starts for row in rows)
        trainer.learner.learn()


def test_looks_are_spread_evenly_over_what_is_left(tmp_path: Path) -> None:
    """Three from a quarter on: after a quarter, a half and three quarters of all steps."""
    failures = tiny_trainer(tmp_path / "run", LOOKING).failures
    due = []
    for search in range(3):
        failures._searches = search
        due.append(failures._next_search() / LOOKING.total_timesteps)
    assert due == pytest.approx([0.25, 0.5, 0.75])


def test_the_newest_starts_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trainer = tiny_trainer(tmp_path / "run", LOOKING)
    failures = trainer.failures
    failures._search()
    found = len(failures._starts[0][0])
    failures._starts[0] = [torch.full_like(column, 99) for column in failures._starts[0]]
    monkeypatch.setattr("rans.fast.learn.failures._KEPT", found // 2)
    failures._search()
    assert len(failures._starts[0][0]) == found // 2
    assert not (failures._starts[0][0] == 99).any()


def test_who_begins_where_others_failed_remembers_nothing(tmp_path: Path) -> None:
    config = replace(LOOKING, ppo=replace(LOOKING.ppo, memory=MemorySettings("history")))
    trainer = tiny_trainer(tmp_path / "run", config)
    trainer.failures._search()
    memory: Any = trainer.learner.rollout.memory
    memory.fill_(1.0)
    trainer.failures.begin(0)
    assert [row for row in range(16) if not memory[row].any()] == [0, 3, 6]
    assert memory.sum() == 13 * memory.shape[1]


@pytest.mark.slow
@pytest.mark.parametrize("stop_at", [5, 9])
def test_a_resumed_training_begins_where_it_would_have(tmp_path: Path, stop_at: int) -> None:
    """Stopped after the first search, at 512 steps, and after the second, at 1,024; the third is later."""
    whole = tiny_trainer(tmp_path / "whole", LOOKING)
    whole.train(ignore)
    assert whole.failures._searches == 3
    tiny_trainer(tmp_path / "cut", LOOKING).train(ignore, after(stop_at))
    trainer = resumed(tmp_path / "cut")
    trainer.train(ignore)
    assert everything(trainer) == everything(whole)
    plain = tiny_trainer(tmp_path / "plain", replace(LOOKING, failures=Failures()))
    plain.train(ignore)
    assert everything(plain) != everything(whole)
    assert "failures/share" in whole.run.metrics()[-1]
    assert "failures/share" not in plain.run.metrics()[-1]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"share": 1.0}, "share must be at least 0 and below 1, got 1.0"),
        ({"begin": -0.1}, "begin must be at least 0 and below 1, got -0.1"),
        ({"searches": 0}, r"searches must be >= 1 and < 2\^24, got 0"),
        ({"flights": 2**24}, r"flights must be >= 1 and < 2\^24, got 16777216"),
    ],
)
def test_numbers_out_of_range(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        Failures(**wrong)
