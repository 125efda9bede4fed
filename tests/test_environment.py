"""Environments that are watched or filmed, through Gymnasium's own wrappers."""

from __future__ import annotations

import urllib.request
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo

from rans import GoToPose, Timing
from tests.support.processes import PATIENCE

PLANE = "rans/GoToPose2D-v0"
SPACE = "rans/GoToPose3D-v0"
QUICK = Timing(control_period=0.02, episode_steps=6)
"""Real time must not take long."""


@pytest.fixture(autouse=True)
def _no_browser(monkeypatch) -> None:
    for display in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(display, raising=False)


def seen(env: Any) -> bytes:
    """The page of the window that an environment has open."""
    with urllib.request.urlopen(env._window.url, timeout=PATIENCE) as page:
        return page.read()


@pytest.mark.parametrize("name", [PLANE, SPACE, "rans/GoToPose2D-Drake-v0"])
def test_gymnasium_finds_nothing_wrong(name):
    env = gymnasium.make(name, render_mode="human", timing=QUICK)
    check_env(env.unwrapped)
    env.close()
    env.close()


def test_every_step_is_shown(monkeypatch):
    """Without a call of `render`, which then returns nothing."""
    shown = []
    monkeypatch.setattr("rans.window.Window.show", lambda window, frame: shown.append(frame))
    env = gymnasium.make(PLANE, render_mode="human", timing=QUICK)
    drawn = gymnasium.make(PLANE, render_mode="rgb_array", timing=QUICK)
    expected = []
    for flown in (env, drawn):
        flown.reset(seed=1)
        expected.append(flown.render())
        for k in range(3):
            flown.step(np.eye(8, dtype=int)[k])
            expected.append(flown.render())
    assert expected[:4] == [None] * 4
    np.testing.assert_array_equal(shown, expected[4:])
    assert b"/film" in seen(env.unwrapped)
    env.close()


def test_recording_a_video(tmp_path):
    """Its 6 steps and the start are 7 frames; moviepy 1 may write the last one twice."""
    from imageio_ffmpeg import count_frames_and_secs

    env = RecordVideo(
        gymnasium.make(PLANE, render_mode="rgb_array", timing=QUICK), str(tmp_path / "videos")
    )
    env.reset(seed=1)
    while not env.step(env.action_space.sample())[3]:
        pass
    env.close()
    (video,) = (tmp_path / "videos").glob("*.mp4")
    frames, seconds = count_frames_and_secs(str(video))
    assert frames in (7, 8)
    assert seconds == pytest.approx(frames / 50.0, abs=0.01)


def test_a_batch_is_reset_before_it_steps():
    envs = gymnasium.make_vec(PLANE, num_envs=2, task=GoToPose())
    with pytest.raises(ResetNeeded, match="call reset"):
        envs.step(torch.zeros(2, 8))
