"""``rans follow`` from a run folder to files; how well an agent follows is no concern of these tests."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from rans_assurance.commands.follow import Follow

from rans import TrackVelocity
from rans.show.pages.report import report_from_run
from tests.support.training import CONFIG, tiny_trainer


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """An agent that has learnt nothing yet."""
    config = replace(CONFIG, task="track-velocity", settings=TrackVelocity(), total_timesteps=128)
    trainer = tiny_trainer(tmp_path_factory.mktemp("runs") / "tracker", config)
    trainer.save()
    return trainer.run.path


@pytest.mark.slow
def test_writes_table_and_numbers_of_its_seed(run, monkeypatch, capsys):
    results = []
    written = run / "evaluation-circle.json"
    for seed in (1, 1, 2):
        monkeypatch.setattr("rans_assurance.commands.follow.EVALUATION_SEED", seed)
        assert Follow(str(run), episodes=2).run() == 0
        printed = capsys.readouterr().out
        assert "cross-track RMS" in printed
        assert str(written) in printed.replace("\n", "")
        results.append(json.loads(written.read_text())["fast"]["rows"])
    assert results[0] == results[1] != results[2]
    assert "Evaluation circle" in [section.title for section in report_from_run(run).sections]
