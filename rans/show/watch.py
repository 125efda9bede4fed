"""Seeing an agent while it learns."""

from __future__ import annotations

import time
from pathlib import Path

import torch

from rans.evaluation.fly.agent import load_policy
from rans.evaluation.fly.episodes import fly_episodes
from rans.fast.learn.run_folder import RunFolder
from rans.scenario import EVALUATION_SEED
from rans.show.pages.page import Page
from rans.show.pages.replay import replay_page
from rans.window import Served, open_browser

_EPISODES = 4
_SECONDS = 10.0
"""An agent is shown at least so long before a newer one takes its place: most of what there is to see."""
_PAUSE = 0.5
"""Between two looks for a newer agent, s."""


def watch(run: Path, port: int) -> None:
    """Show a training's newest agent in the browser, for ever.

    It only looks whether the trainer has replaced ``agent.safetensors``, so the trainer need not know of it. A new
    agent flies four episodes in a batch, a fraction of a second of work; the browser then plays them by
    itself. `ConfigError` if the port is taken, or the run folder damaged.
    """
    torch.set_num_threads(1)  # of small networks; more would disturb the training
    page = Page("No agent yet", [])
    file = RunFolder(run).trained_file
    latest = 0
    served = Served(lambda: page.html(), [port])
    open_browser(served.url)
    while True:
        changed = file.stat().st_mtime_ns if file.exists() else 0
        if changed != latest:
            agent = load_policy(run)
            flight = fly_episodes(agent.controller, agent.judged, EVALUATION_SEED, _EPISODES)
            page = replay_page([flight], flight.controller)
            served.renew()
            latest = changed
            time.sleep(_SECONDS)
        time.sleep(_PAUSE)
