"""``rans follow`` from a run folder to files; how well an agent follows is no concern of these tests."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from rans_assurance.commands.follow import Follow

from rans.tasks import TrackVelocity
from tests.support.training import CONFIG, tiny_trainer


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An agent that has learnt nothing yet."""
    config = replace(CONFIG, task="track-velocity", settings=TrackVelocity(), total_timesteps=128)
    trainer = tiny_trainer(tmp_path_factory.mktemp("runs") / "tracker", config)
    trainer.save()
    return trainer.run.path


@pytest.mark.slow
def test_writes_table_and_numbers(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert Follow(str(run), episodes=3).run() == 0
    printed = capsys.readouterr().out
    assert "cross-track RMS" in printed
    written = run / "follow-circle.json"
    assert str(written) in printed.replace("\n", "")
    numbers = json.loads(written.read_text())
    assert (numbers["speed"], numbers["look_ahead"]) == (0.25, 0.25)
    assert all(len(row["flights"]) == 3 for row in numbers["quantities"])


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_the_same_seed_gives_the_same_flights(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results = []
    for seed in (1, 1, 2):
        monkeypatch.setattr("rans_assurance.commands.follow.EVALUATION_SEED", seed)
        assert Follow(str(run), episodes=2).run() == 0
        results.append(json.loads((run / "follow-circle.json").read_text())["quantities"])
    assert results[0] == results[1] != results[2]
