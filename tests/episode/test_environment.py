"""Environments that are watched or filmed, through Gymnasium's own wrappers."""

import gymnasium
import pytest
import torch
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo

from rans import GoToPose, Timing

PLANE = "rans/GoToPose2D-v0"
SPACE = "rans/GoToPose3D-v0"
QUICK = Timing(control_period=0.02, episode_steps=6)


@pytest.mark.parametrize("name", [PLANE, SPACE, "rans/GoToPose2D-Drake-v0"])
def test_gymnasium_finds_nothing_wrong(name):
    check_env(gymnasium.make(name, render_mode="rgb_array", timing=QUICK).unwrapped)


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
