"""Attacks on the filter: the search flies what it counts, and the gradient lowers the margin."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from campaigns import attack
from campaigns.attack import Attack, Counts, Flights, GradientAttack, Plan, by_search, flown
from rans.episode import Setup
from rans.files import read_json, write_json
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import load_task


def test_a_search_counts_every_flight_of_its_generations() -> None:
    free, filtered = by_search("avoid-2d", None, Plan(periods=2, generations=2), 5, 1)
    assert free.least.shape == filtered.least.shape == (128,)
    assert filtered.safe.all()
    # From one start, and with other commands, of which a later generation has the worse ones.
    assert len(np.unique(free.least)) > 16
    assert free.least[64:].mean() <= free.least[:64].mean()


def test_an_interrupted_attack_goes_on_with_the_next_job(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    begun: list[int] = []

    def search(mission: str, conditions: Any, plan: Plan, first: int, count: int) -> Any:
        begun.append(first)
        return by_search(mission, conditions, plan, first, count)

    monkeypatch.setitem(attack.ATTACKS, "cem", search)
    record = tmp_path / "record.json"
    results = []
    for file, counts in ((record, (2, 3)), (None, (3,))):
        for starts in counts:
            Attack(
                ("avoid-2d",),
                ("cem",),
                starts,
                periods=2,
                generations=1,
                job=1,
                workers=1,
                record=file,
            ).run()
            results.append(capsys.readouterr().out.splitlines()[-1])
    assert begun == [0, 1, 2, 0, 1, 2]
    assert results[1] == results[2] != results[0]
    assert "192 flights" in results[1]


def test_a_job_without_a_safe_start_comes_back_from_a_record(tmp_path: Path) -> None:
    empty = Flights(np.zeros(2, bool), np.ones(2), np.zeros(2))
    found = Counts.of(None, empty)
    write_json(tmp_path / "record.json", found._asdict())
    other = Counts(5, None, 1, -0.25, 4, 0)
    assert Counts.together([Counts(**read_json(tmp_path / "record.json")), other]) == other


@pytest.mark.slow
def test_gradients_lower_the_margin_more_than_coasting_does() -> None:
    task = load_task("avoid").for_evaluation()
    setup = Setup(load_spacecraft("floating-platform"), task, task.timing)
    numbers = np.arange(2)
    plan = Plan(periods=2)
    coast = flown(
        setup, plan, numbers, False, lambda k, state, goal: (np.zeros(2, np.float32),) * 8
    )
    attacked = flown(setup, plan, numbers, False, GradientAttack(setup))
    assert (attacked.least < coast.least - 0.005).all()
