from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from rans_lookahead.lookahead import ArrivalCost, Lookahead

import rans
from rans.episode import Setup
from rans.errors import ConfigError
from rans.evaluation.compare.entrants import contest_of, enlist
from rans.evaluation.fly.agent import Agent, LoadedRun
from rans.evaluation.fly.contestant_name import ContestantName
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.make_controller import controller
from rans.evaluation.fly.trade_off import FixedTradeOff
from rans.fast.learn.config import MemorySettings
from rans.flight import Flight, fly
from rans.model.actuators import Throttle
from rans.model.timing import Timing
from rans.policy.network import Network
from rans.scenario import scenarios
from rans.tasks import GoToPose, GoToPosePriced
from rans.tasks.goal_set import arrived
from tests.support import plugins
from tests.support.engines import PLATFORM
from tests.support.switching import SwitchingGoToPose
from tests.support.training import scatter, tiny_learner

plugins.register()

PERIODS = 4
FAST = "pretrained:go-to-pose-2d-trade-off#0"
CHATTERING = SwitchingGoToPose(switching_weight=0.3, thrust_weight=0.05, spawn_distance=(1.0, 2.0))
"""What was open before matters to its reward."""


class Told:
    """An agent that is told its first commands, (periods, N, thrusters), and remembers that it gave them."""

    name = "told"

    def __init__(self, network: Any, first: np.ndarray) -> None:
        self._network = network
        self._first = first

    def reset(self, count: int) -> None:
        self._memory = self._network.initial_state(count)
        self._periods = 0

    @torch.no_grad()
    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        output, columns = self._network.forward(torch.from_numpy(observation), self._memory)
        command = output.policy.mode()
        if self._periods < len(self._first):
            command = torch.from_numpy(self._first[self._periods]).float()
        self._memory = self._network.next_state(columns, self._memory, command)
        self._periods += 1
        return command.numpy()


def flown(setup: Setup, network: Any, first: np.ndarray, starts: Any, begin: int) -> Flight:
    """The flight that begins with commands told, until PERIODS after `begin`."""
    timing = replace(setup.timing, episode_steps=begin + PERIODS)
    return fly(setup.craft, setup.task, Told(network, first), starts, timing)


def earned(flight: Flight, begin: int) -> np.ndarray:
    """(N,) rewards from the period `begin` on."""
    return np.asarray(sum(flight.rewards().values()))[begin:].sum(axis=0)


def spared(flight: Flight, begin: int) -> np.ndarray:
    """(N,) the same of what arrival costs, episode by episode; -inf where the flight does not end there."""
    distance = flight.errors()["position"] / 0.4
    angle = flight.errors()["attitude"] / 1.0
    rest = (flight.states.v.norm() <= 0.05) & (abs(flight.states.w) <= math.radians(5.0))
    inside = (distance <= 1.0) & (angle <= 1.0)
    worth = np.zeros(flight.commands.shape[1])
    for n in range(len(worth)):
        there = False
        for k in range(begin + 1, len(distance)):
            there = inside[k, n] and any((inside & rest)[j, n] for j in range(k + 1))
            close = 0.5 * distance[k, n] ** 2 + 0.07 * angle[k, n] ** 2
            worth[n] -= flight.commands[k - 1, n].sum() / 8.0 + (close if there else 2.5)
        worth[n] = worth[n] if there else -math.inf
    return worth


NEAR = GoToPose(spawn_distance=(0.2, 0.35), position_tolerance=0.4, attitude_tolerance=1.0)
"""Begins at rest within wide tolerances, with any attitude: some are there, others may be."""


@pytest.mark.parametrize(
    ("task", "worth", "memory"),
    [
        (NEAR, spared, {}),
        (NEAR, spared, {"memory": MemorySettings("history", 3, (0.5,))}),
        (CHATTERING, earned, {"memory": MemorySettings("commands", 2)}),
    ],
)
def test_it_gives_what_brute_force_finds_best(
    memory: dict[str, Any], task: GoToPose, worth: Any
) -> None:
    """Every choice flown by itself, in the first period and in the second, which knows what the first did."""
    network = scatter(tiny_learner(PLATFORM, task=task, **memory).network)
    setup = Setup(PLATFORM, task, Timing(episode_steps=2))
    count = 24
    starts = scenarios(task, PLATFORM, 5, count)
    ahead = Lookahead(
        LoadedRun(Agent(network, "tiny"), *setup[:4]),
        horizon=PERIODS * 0.2,
        change_within=0.4,
        arrival=ArrivalCost() if worth is spared else None,
    )
    given = fly(PLATFORM, task, ahead, starts, setup.timing).commands
    changed = waited = 0
    for now in range(2):
        own = flown(setup, network, given[:now], starts, now).commands
        choices = [own[: now + 1]]
        for later in (now, now + 1):
            choices += [np.array([*own[:later], np.abs(own[later] - flip)]) for flip in np.eye(8)]
        values = [worth(flown(setup, network, one, starts, now), now) for one in choices]
        values[0] = np.maximum(values[0], -1e9)  # its own command stands where nothing ends there
        best = np.argmax(values, axis=0)
        np.testing.assert_array_equal(given[now], [choices[b][now, n] for n, b in enumerate(best)])
        changed += ((best > 0) & (best <= 8)).sum()
        waited += (best > 8).sum()
    assert min(changed, waited) > 0  # else nothing was shown


class Shown:
    """A network that sees a trade-off, to who shows it none."""

    def __init__(self, network: Network, trade_off: float) -> None:
        self.initial_state = network.initial_state
        self.next_state = network.next_state
        self._network = network
        self._trade_off = trade_off

    def forward(self, seen: torch.Tensor, memory: torch.Tensor | None) -> Any:
        return self._network.forward(
            torch.cat((seen, torch.full((len(seen), 1), self._trade_off)), dim=1), memory
        )


def test_a_trade_off_that_is_held_is_seen_all_the_way() -> None:
    """Against every choice flown by itself; the same commands where the task has the trade-off, and where not."""
    priced = GoToPosePriced(trade_off=(0.3, 0.3), spawn_distance=(1.0, 2.0))
    plain = priced.plain()
    timing = Timing(episode_steps=1)
    count = 24
    network = scatter(tiny_learner(PLATFORM, task=priced).network)
    ahead = Lookahead(
        LoadedRun(Agent(network, "tiny"), PLATFORM, priced, timing),
        horizon=PERIODS * 0.2,
        change_within=0.2,
    )
    starts = scenarios(plain, PLATFORM, 5, count)
    given = fly(PLATFORM, plain, FixedTradeOff(ahead, 0.3), starts, timing).commands
    setup = Setup(PLATFORM, plain, timing)
    told = Shown(network, 0.3)
    own = flown(setup, told, np.zeros((0, count, 8)), starts, 0).commands[:1]
    choices = [own, *(np.abs(own - flip) for flip in np.eye(8))]
    best = np.argmax([earned(flown(setup, told, one, starts, 0), 0) for one in choices], axis=0)
    assert (best > 0).any()
    np.testing.assert_array_equal(given[0], [choices[b][0, n] for n, b in enumerate(best)])
    same = fly(PLATFORM, priced, ahead, scenarios(priced, PLATFORM, 5, count), timing).commands
    np.testing.assert_array_equal(same, given)


@pytest.mark.slow
def test_nothing_is_earned_after_a_failure() -> None:
    """Flying out at once would pay most if the reward of the far side counted after the episode is over."""
    task = replace(CHATTERING, fail_distance=1.3, spawn_distance=(1.2, 1.29), switching_weight=0.0)
    network = scatter(tiny_learner(PLATFORM, task=task).network)
    agent = Agent(network, "tiny")
    ahead = Lookahead(LoadedRun(agent, PLATFORM, task, Timing()), horizon=6.0, change_within=0.2)
    starts = scenarios(task, PLATFORM, 5, 32)
    flights = [fly(PLATFORM, task, one, starts, Timing(episode_steps=40)) for one in (agent, ahead)]
    lost = [flight.failed().mean() for flight in flights]
    assert lost[0] > 0.5
    assert lost[1] < 0.5 * lost[0]


class Scripted:
    """A controller that is told its first commands, (periods, N, thrusters), and goes on as another would."""

    name = "scripted"

    def __init__(self, other: Any, first: np.ndarray) -> None:
        self._other = other
        self._first = first

    def reset(self, count: int) -> None:
        self._other.reset(count)
        self._periods = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        command = self._other.act(state, goal, observation)
        self._periods += 1
        return self._first[self._periods - 1] if self._periods <= len(self._first) else command


@pytest.mark.parametrize("name", ["lqr", pytest.param("guidance", marks=pytest.mark.slow), "mpc"])
def test_a_controller_looks_ahead_as_brute_force_does(name: str) -> None:
    """Every choice flown by itself, in the first two periods; the second knows what the first remembered."""
    setup = Setup(PLATFORM, NEAR, Timing(episode_steps=2))
    count = 12 if name != "mpc" else 3
    starts = scenarios(NEAR, PLATFORM, 5, count)
    other = controller(name, setup)
    run = LoadedRun(controller(name, setup), *setup[:4])
    ahead = Lookahead(run, PERIODS * 0.2, change_within=0.2)
    given = fly(PLATFORM, NEAR, ahead, starts, setup.timing).commands

    def ends(first: np.ndarray, now: int) -> Flight:
        timing = replace(setup.timing, episode_steps=now + PERIODS)
        return fly(PLATFORM, NEAR, Scripted(other, first), starts, timing)

    changed = 0
    for now in range(2):
        own = ends(given[:now], now).commands
        choices = [own[: now + 1]]
        choices += [np.array([*own[:now], np.abs(own[now] - flip)]) for flip in np.eye(8)]
        best = np.argmax([earned(ends(one, now), now) for one in choices], axis=0)
        np.testing.assert_array_equal(given[now], [choices[b][now, n] for n, b in enumerate(best)])
        changed += (best > 0).sum()
    assert changed > 0


def test_a_controller_may_look_ahead_in_a_comparison() -> None:
    """By its full name, and by the bare one after somebody who gives the task."""
    contest = contest_of("lqr:go-to-pose-2d", 2)
    for spec in ("lookahead:switching", "lookahead:switching:go-to-pose-2d"):
        one = enlist(spec, contest)
        assert (one.name, one.knows) == ("lookahead:switching", "state, exact model")
        assert one.tuning == enlist("switching", contest).tuning
        assert isinstance(one.controller, Lookahead)
        assert one.controller.arrival == ArrivalCost()


@pytest.mark.slow
def test_who_is_paid_for_arriving_looks_ahead_for_it() -> None:
    """Sooner at rest and with less thrust."""
    run = contestant(FAST)
    task = run.task.for_evaluation()
    timing = Timing(episode_steps=36)
    starts = scenarios(task, run.craft, 2024, 4)
    flights = [
        fly(run.craft, task, one, starts, timing)
        for one in (run.controller, Lookahead(run, change_within=0.2, arrival=ArrivalCost()))
    ]
    there = [arrived(task, flight.states, flight.goals) for flight in flights]
    assert there[1].any(axis=0).all()
    assert there[1].argmax(axis=0).sum() <= there[0].argmax(axis=0).sum()
    assert flights[1].commands.sum() < flights[0].commands.sum()
    named = [
        contestant(f"lookahead:{one}").controller for one in (FAST, "pretrained:go-to-pose-2d")
    ]
    assert [one.arrival for one in named if isinstance(one, Lookahead)] == [ArrivalCost(), None]


def test_an_agent_of_many_tasks_looks_ahead_on_each() -> None:
    """Which have no goal set in common; with a horizon of a period, what it looks at is paid at once."""
    run = contestant("pretrained:multi-task-2d")
    starts = scenarios(run.task, run.craft, 5, 8)
    flight = fly(run.craft, run.task, Lookahead(run, horizon=0.2), starts, Timing(episode_steps=3))
    assert np.isfinite(sum(flight.rewards().values())).all()


def test_it_is_named_before_an_agent() -> None:
    spec = f"lookahead:{FAST}"
    run = contestant(spec)
    plain = contestant(FAST)
    assert (run[1:], run.controller.name) == (plain[1:], f"lookahead:{plain.controller.name}")
    assert ContestantName.parse(spec).controller == ""
    assert (
        ContestantName.parse(spec).output_folder.name
        == "lookahead-pretrained-go-to-pose-2d-trade-off"
    )
    bare = FAST.removeprefix("pretrained:")
    told, ahead, named = (enlist(one, contest_of(FAST, 4)) for one in (FAST, spec, bare))
    assert (told.knows, ahead.knows) == ("observation", "state, exact model")
    assert told.tuning.startswith("training: 4,000.1 M steps")
    assert told.tuning == ahead.tuning == named.tuning


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (
            "lookahead:pretrained:go-to-pose-2d-trade-off",
            "a trade-off; fix it, as in lookahead:go-to-pose-2d-trade-off#0.5",
        ),
        ("lookahead:pretrained:nobody", "nobody"),
        ("lookahead:", "has no name after its colon"),
    ],
)
def test_who_cannot_is_told(spec: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        contestant(spec)


@pytest.mark.slow
def test_python_takes_one_made_there() -> None:
    plain = "pretrained:go-to-pose-2d"
    ahead = Lookahead(contestant(plain), horizon=0.6)
    found, alone = (
        rans.evaluate(who, episodes=2, seed=5)["impulse"].value for who in (ahead, plain)
    )
    assert found != alone
    env = gymnasium.make("rans/GoToPose2D-v0")
    seen, _ = env.reset(seed=0)
    assert rans.Pilot(ahead, env).act(seen).shape == (8,)
    with pytest.raises(
        ConfigError, match=r"as in Lookahead\(rans\.load_agent.*got 'go-to-pose-2d-"
    ):
        Lookahead("go-to-pose-2d-trade-off#0")  # type: ignore[arg-type]
    with pytest.raises(
        ConfigError, match=r"arrival must be a rans_lookahead\.lookahead\.ArrivalCost, got 3"
    ):
        Lookahead(contestant(FAST), arrival=3)  # type: ignore[arg-type]


@pytest.mark.parametrize("horizon", [0.0, -1.0, float("nan"), float("inf"), "8"])
def test_wrong_horizons_are_refused(horizon: Any) -> None:
    with pytest.raises(ConfigError, match="the horizon must be finite and > 0 s, got"):
        Lookahead(contestant(FAST), horizon)
    with pytest.raises(
        ConfigError, match="the time that changes come within must be finite and > 0 s, got"
    ):
        Lookahead(contestant(FAST), change_within=horizon)


@pytest.mark.parametrize("price", [-0.1, float("nan"), float("inf"), "2"])
def test_wrong_prices_are_refused(price: Any) -> None:
    with pytest.raises(ConfigError, match="the price late must be finite and >= 0, got"):
        ArrivalCost(late=price)


def test_thrusters_that_are_throttled_are_refused() -> None:
    run = contestant(FAST)._replace(craft=replace(PLATFORM, actuators=Throttle()))
    with pytest.raises(ConfigError, match="open and shut single thrusters"):
        Lookahead(run)
