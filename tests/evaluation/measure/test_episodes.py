from __future__ import annotations

from pathlib import Path

import numpy as np

from rans.evaluation.fly.contestants import contestant
from rans.evaluation.measure.aggregate import measure, save_episodes
from rans.flight import fly
from rans.model.timing import Timing
from rans.scenario import scenarios
from tests.evaluation.flights import two_episodes


def test_every_metric_of_every_episode(tmp_path: Path) -> None:
    flight, file = two_episodes(), tmp_path / "episodes.npz"
    save_episodes(flight, file)
    with np.load(file) as read:
        episodes = dict(read)
    assert episodes["settling_time"].tolist() == [2.5, np.inf]
    assert episodes["PT5"].tolist() == [80.0, 90.0]
    for row in measure(flight).rows:
        values = episodes[row.name.replace(" ", "_")]
        centre = np.median if row.name == "settling time" else np.mean
        # float32 in the file
        np.testing.assert_allclose(centre(values), row.value, rtol=1e-6, atol=1e-6)
    # The goal is at (2, -1), the episodes start 1 m and 4 cm west of it.
    np.testing.assert_allclose(episodes["start"][:, :2], [[1.0, -1.0], [1.96, -1.0]], atol=1e-6)
    assert "states" not in episodes


def test_trajectories_of_both_dimensions(tmp_path: Path) -> None:
    for dimension in (2, 3):
        controller, craft, task, _ = contestant(f"lqr:go-to-pose-{dimension}d")
        flight = fly(craft, task, controller, scenarios(task, craft, 1, 3), Timing(episode_steps=4))
        save_episodes(flight, tmp_path / "episodes.npz", trajectories=True)
        with np.load(tmp_path / "episodes.npz") as read:
            episodes = dict(read)
        column = dict(zip(episodes["columns"].tolist(), np.moveaxis(episodes["states"], 2, 0), strict=True))
        np.testing.assert_allclose(column["v_y"], flight.states.v.y, atol=1e-6)
        np.testing.assert_allclose(column["y"], flight.states.p.y, atol=1e-6)
        last = flight.states.spin()[-1]
        np.testing.assert_allclose(column["w_z"], last, atol=1e-6)
        np.testing.assert_array_equal(episodes["commands"], flight.commands)
        assert episodes["times"].shape == (5,)
