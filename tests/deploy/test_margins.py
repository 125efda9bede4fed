"""Margins of a contract: values round those of the training at which an agent still holds its goal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest

from rans.deploy.margins import margin_lines, margins_around, measure_margins
from rans.evaluation.fly.agent import load_policy
from rans.evaluation.fly.episodes import fly_episodes
from rans.pretrained import pretrained_folder
from rans.randomization.conditions import (
    BodyConditions,
    Conditions,
    ThrusterConditions,
)
from rans.scenario import EVALUATION_SEED


@pytest.mark.slow
def test_margins_of_an_agent() -> None:
    """Against flights of evaluations."""
    run = load_policy(pretrained_folder("go-to-pose-2d"))
    margins = measure_margins(run.controller, run.judged, 8)
    assert margins["nominal"] == margins["training"] == 1.0
    for quantity, size, world in (
        ("latency", "0.1", Conditions(thrusters=ThrusterConditions(latency=0.1))),
        ("mass", "2", Conditions(body=BodyConditions(mass=2.0))),
        ("mass", "0.5", Conditions(body=BodyConditions(mass=0.5))),
    ):
        setup = run.judged._replace(conditions=world)
        alone = fly_episodes(
            run.controller, setup, EVALUATION_SEED, 8, workers=1
        ).verdict.solved.mean()
        assert margins[quantity]["held"][size] == alone
    least, most = margins["mass"]["holds"]
    assert least <= 0.65 < 1.0 < most == 2.0


def test_margins_are_around_the_training_and_leave_a_hole_out() -> None:
    """By hand: trained at 30 to 50 ms, it holds from 25 ms to 0.1 s, at any mass from 0.8 to 1.25."""
    trained = Conditions(thrusters=ThrusterConditions(latency=(0.03, 0.05)))
    every = list[Conditions]()

    def share(conditions: Conditions) -> float:
        latency, mass = conditions.thrusters.latency, conditions.body.mass
        least, most = latency if isinstance(latency, tuple) else (latency, latency)
        assert isinstance(mass, float)
        return 1.0 if least >= 0.025 and most <= 0.1 and 0.8 <= mass <= 1.25 else 0.33

    def measure(several: Sequence[Conditions]) -> list[float]:
        every.extend(several)
        return [share(one) for one in several]

    run = load_policy(pretrained_folder("go-to-pose-2d"))
    margins = margins_around(trained, run.craft, run.timing, measure)
    assert margins["latency"]["of_training"] == [0.03, 0.05]
    assert margins["latency"]["holds"] == [0.025, 0.1]
    assert margins["mass"]["holds"] == [0.8, 1.25]
    assert margins["noise of spin"]["holds"] == [0.0, 5.0]
    assert (margins["training"], margins["nominal"]) == (1.0, 0.33)
    # Everything but the quantity that is tried is as in the training.
    assert {one.thrusters.latency for one in every if one.body.mass != 1.0} == {(0.03, 0.05)}
    text = " ".join(margin_lines(margins))
    assert "0.025 to 0.1 s" in text
    assert "33.0%" in text
    assert text.count("Warning") == 1
    # What it has not learnt, its training has not left out.
    text = " ".join(margin_lines(margins | {"training": 0.2}))
    assert "only 20.0% of flights under the conditions of its own training" in text
    assert text.count("Warning") == 1


@pytest.mark.slow
def test_a_value_is_flown_in_every_part_of_a_mixture() -> None:
    """The flights that are counted for a value are those of episodes that drew it."""
    run = load_policy(pretrained_folder("go-to-pose-2d"))
    calm = Conditions(weight=3.0)
    mixed = replace(calm, others=(Conditions(body=BodyConditions(mass=20.0)),))
    margins = measure_margins(run.controller, run.judged._replace(conditions=mixed), 24)
    # 20 times the mass holds nowhere, and is a quarter of the episodes: 5 standard deviations of 24.
    assert margins["training"] == pytest.approx(0.75, abs=5 * math.sqrt(0.75 * 0.25 / 24))
    assert margins["nominal"] == margins["mass"]["held"]["1"] == 1.0
    assert margins["mass"]["held"]["20"] == 0.0
    assert margins["mass"]["of_training"] == [1.0, 20.0]
