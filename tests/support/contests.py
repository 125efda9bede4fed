"""Contests that take little time."""

from rans import GoToPose, Timing
from rans.evaluation.compare.contest import Contest
from rans.model.spacecraft_file import load_spacecraft

IDLE = "python:tests.support.policies:idle"
NEAR = GoToPose(evaluation_distance=(0.8, 0.9)).for_evaluation()
CONTEST = Contest(load_spacecraft("floating-platform"), NEAR, Timing(episode_steps=30), 4, 3)
"""Starts so near that the searches take little time."""
