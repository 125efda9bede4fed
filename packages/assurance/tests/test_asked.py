"""The page that people sign states what was asked: conditions, tolerances, length and starts by their content."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from rans_assurance.assure.assurance import Assurance
from rans_assurance.assure.bounds import plan
from rans_assurance.assure.campaign import Campaign
from rans_assurance.sections.assurance import assurance_section
from rans_assurance.sections.stress import stress_section
from rans_assurance.stress.effects import Level
from rans_assurance.stress.outcome import StressOutcome
from rans_assurance.stress.report import StressReport

from rans.api.pages import flyers
from rans.files import plain
from rans.randomization.conditions import BodyConditions, Conditions, ThrusterConditions
from tests.support.evaluation_flights import two_episodes
from tests.support.stress_runs import small

OWN = Conditions(BodyConditions(mass=(0.83, 1.21)), ThrusterConditions(latency=(0.0, 0.047)))


def test_an_assurance_says_what_was_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # an agent for any craft is written into runs/
    (run,) = flyers(("any-craft-2d",), None, False)
    run = run._replace(timing=replace(run.timing, control_period=0.2, episode_steps=188))
    campaign = Campaign(plan(0.99, 2000, None), 1, flights=2000)
    assurance = Assurance("any-craft-2d", "mine.toml", campaign, given=run.under(OWN))
    # In short on the terminal, and in full in the section that pages have.
    asked = assurance.section.details[0]
    for text in ("0.83 to 1.21", "0 to 0.047 s", "5 cm", "5 deg", "37.6 s", "3 to 4 m"):
        assert text in assurance.scope.sentence
        assert text in str(asked)
    # The report of its folder has it from the file.
    content = json.loads(json.dumps(plain(assurance.to_json())))
    file = tmp_path / "assurance.json"
    assert "0.83 to 1.21" in str(assurance_section(file, content).details)
    del content["scope"]  # of version 0.2.0
    assert "0.83 to 1.21" not in str(assurance_section(file, content).details)


def test_a_stress_test_says_what_was_asked(tmp_path: Path) -> None:
    stress = small("lqr:go-to-pose-2d", episodes=2)
    stress.named = [Level("mine.toml", None, OWN)]
    stress.effects = []
    stress.outcomes = {("mine.toml", stress.names[0]): StressOutcome.of(two_episodes())}
    report = StressReport(stress, tmp_path, 1)
    content = json.loads(json.dumps(plain(report.to_json())))
    *_, asked = stress_section(tmp_path / "stress.json", content).details
    for text in ("5 cm", "5 deg", "25 s", "position error 3", "0.83 to 1.21"):
        assert text in str(asked)
