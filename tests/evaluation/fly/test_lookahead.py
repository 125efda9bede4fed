from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from rans.errors import ConfigError
from rans.evaluation.compare.roster import contest_of, enlist
from rans.evaluation.fly.agent import Agent, LoadedRun
from rans.evaluation.fly.contestants import contestant, controller_name, output_folder
from rans.evaluation.fly.lookahead import Lookahead
from rans.fast.learn.network import Network
from rans.flight import Setup, fly
from rans.model.actuators import Throttle
from rans.model.timing import Timing
from rans.scenario import scenarios
from rans.tasks import GoToPose
from tests.fast.engines import PLATFORM
from tests.fast.training import scatter, tiny_learner

PERIODS = 4
FAST = "pretrained:go-to-pose-2d-fast"
CHATTERING = GoToPose(switching_weight=0.3, thrust_weight=0.05, spawn_distance=(1.0, 2.0))
"""What was open before matters to its reward."""


class Told:
    """An agent that is told its first commands, (periods, N, thrusters), and remembers that it gave them."""

    name = "told"

    def __init__(self, network: Network, first: np.ndarray) -> None:
        self._network, self._first = network, first

    def reset(self, count: int) -> None:
        self._memory, self._periods = self._network.blank(count), 0

    @torch.no_grad()
    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        output, columns = self._network.shown(torch.from_numpy(observation), self._memory)
        command = output.policy.mode()
        if self._periods < len(self._first):
            command = torch.from_numpy(self._first[self._periods]).float()
        self._memory = self._network.remember(columns, self._memory, command, output)
        self._periods += 1
        return command.numpy()


def earned(setup: Setup, network: Network, first: np.ndarray, starts: Any) -> np.ndarray:
    """(N,) rewards of the PERIODS that begin with the last command told."""
    begin = len(first) - 1
    flight = fly(setup.craft, setup.task, Told(network, first), starts,
                 replace(setup.timing, episode_steps=begin + PERIODS))
    return np.asarray(sum(flight.rewards().values()))[begin:].sum(axis=0)


@pytest.mark.parametrize("memory", [{}, {"memory": "history", "history": 3, "averages": (0.5,)},
                                    {"memory": "recurrent", "recurrent_units": 8}])
def test_it_gives_what_brute_force_finds_best(memory: dict[str, Any]) -> None:
    """Every choice flown by itself, in the first period and in the second, which knows what the first did."""
    network = scatter(tiny_learner(PLATFORM, task=CHATTERING, **memory).network)
    setup = Setup(PLATFORM, CHATTERING, Timing(episode_steps=2))
    starts = scenarios(CHATTERING, PLATFORM, 5, 6)
    ahead = Lookahead(LoadedRun(Agent(network, "tiny"), *setup), horizon=PERIODS * 0.2)
    given = fly(PLATFORM, CHATTERING, ahead, starts, setup.timing).commands
    changed = 0
    for period in range(2):
        own = fly(PLATFORM, CHATTERING, Told(network, given[:period]), starts, setup.timing).commands[period]
        choices = np.abs(own - np.vstack([np.zeros(8), np.eye(8)])[:, None])
        worth = [earned(setup, network, np.array([*given[:period], one]), starts) for one in choices]
        best = np.argmax(worth, axis=0)
        np.testing.assert_array_equal(given[period], choices[best, np.arange(6)])
        changed += (best > 0).sum()
    assert changed > 3  # of twelve: else nothing was shown


def test_nothing_is_earned_after_a_failure() -> None:
    """Flying out at once would pay most if the reward of the far side counted after the episode is over."""
    task = replace(CHATTERING, fail_distance=1.3, spawn_distance=(1.2, 1.29), switching_weight=0.0)
    network = scatter(tiny_learner(PLATFORM, task=task).network)
    agent = Agent(network, "tiny")
    ahead = Lookahead(LoadedRun(agent, PLATFORM, task, Timing()), horizon=6.0)
    starts = scenarios(task, PLATFORM, 5, 32)
    flights = [fly(PLATFORM, task, one, starts, Timing(episode_steps=40))
               for one in (agent, ahead)]
    lost = [flight.failed().mean() for flight in flights]
    assert lost[0] > 0.5
    assert lost[1] < 0.5 * lost[0]


def test_it_is_named_before_an_agent() -> None:
    spec = f"lookahead:{FAST}"
    run, plain = contestant(spec), contestant(FAST)
    assert (run[1:], run.controller.name) == (plain[1:], "lookahead:go-to-pose-2d-fast")
    assert controller_name(spec) == ""
    assert output_folder(spec).name == "lookahead-pretrained-go-to-pose-2d-fast"
    bare = FAST.removeprefix("pretrained:")
    told, ahead, named = (enlist(one, contest_of(FAST, 4)) for one in (FAST, spec, bare))
    assert (told.knows, ahead.knows) == ("observation", "state, exact model")
    assert told.tuning.startswith("training: 3,400.0 M steps")
    assert told.tuning == ahead.tuning == named.tuning


@pytest.mark.parametrize(("spec", "message"), [
    ("lookahead:lqr:go-to-pose-2d", "LQR cannot look ahead: only trained agents do"),
    ("lookahead:pretrained:go-to-pose-2d-knob#0.5", "it has a knob"),
    ("lookahead:pretrained:nobody", "nobody"),
    ("lookahead:", "there is no contestant"),
])
def test_who_cannot_is_told(spec: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        contestant(spec)


@pytest.mark.parametrize("horizon", [0.0, -1.0, float("nan"), float("inf"), "8"])
def test_wrong_horizons_are_refused(horizon: Any) -> None:
    with pytest.raises(ConfigError, match="the horizon must be finite and > 0 s, got"):
        Lookahead(contestant(FAST), horizon)


def test_thrusters_that_are_throttled_are_refused() -> None:
    run = contestant(FAST)._replace(craft=replace(PLATFORM, actuators=Throttle()))
    with pytest.raises(ConfigError, match="open and shut single thrusters"):
        Lookahead(run)
