"""Arguments of ``rans train`` for trainings whose iterations take milliseconds."""

from __future__ import annotations

import json
from typing import Any

TINY = {
    "ppo.n_envs": 16,
    "ppo.n_steps": 8,
    "ppo.batch_size": 64,
    "ppo.layers": [16, 16],
    "timing.episode_steps": 20,
    "solved_share": None,
}


def tiny(**changes: Any) -> list[str]:
    """Arguments for a training whose iterations take milliseconds."""
    settings = TINY | {key.replace("__", "."): value for key, value in changes.items()}
    given = [
        part for key, value in settings.items() for part in ("--set", f"{key}={json.dumps(value)}")
    ]
    return ["train", "go-to-pose", "--device", "cpu", *given]
