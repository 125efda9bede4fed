"""Return, the sum of the rewards of an episode, of a task that ends early: by hand, everywhere the same."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import ClassVar

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from rans import Engine, GoToPosition, Timing
from rans.base.errors import NonFiniteState
from rans.episode.step import Setup
from rans.fast.flights import Flights
from rans.fast.learn.beginning import begin, statistics
from rans.fast.learn.config import TrainConfig
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer
from rans.model.dynamics import State
from rans.model.fields import Field
from rans.model.random import Random
from rans.show.progress import describe
from rans.tasks.rewards import Transition
from tests.support.engines import PLATFORM
from tests.support.training import TINY

HEAVY = replace(PLATFORM, mass=1e6, inertia=((1e6, 0.0, 0.0), (0.0, 1e6, 0.0), (0.0, 0.0, 1e6)))
"""Its thrusters move it by micrometres."""
TEN = Timing(control_period=0.2, episode_steps=10)


@dataclass(frozen=True)
class Gate(GoToPosition):
    """Coast through a gate at 0.5 m at 0.7 m/s, in steps of 0.14 m: through in the fourth."""

    timing: ClassVar[Timing] = Timing(episode_steps=100_000)  # in which a heavy craft flies 1 m

    done_weight: float = 20.0  # pyrefly: ignore[bad-override]

    def sample(self, random: Random) -> tuple[State, State]:
        start, goal = super().sample(random)
        way = type(start.v)(start.v.x * 0.0 + 0.7, start.v.y * 0.0)
        return replace(start, p=start.p.scale(0.0), v=way), goal

    def done(self, state: State, goal: State) -> Field:
        return state.p.x > 0.5

    def reward(self, transition: Transition) -> dict[str, Field]:
        zero = transition.state.p.x * 0.0
        return {"time": zero - 1.0, "bonus": zero + 0.5}


RETURN = 4 * (-1.0 + 0.5) + 20.0
"""Of four steps, the last of which pays for the gate."""


@pytest.mark.filterwarnings("ignore:spacecraft 'floating-platform' needs:UserWarning")
def test_one_return_in_bar_curve_tensorboard_and_evaluation(tmp_path):
    config = TrainConfig(
        "go-to-position",
        GoToPosition(),
        "floating-platform",
        TINY,
        TEN,
        total_timesteps=16 * 8 * 4,
        solved_share=None,
        report_interval=1,
    )
    run = RunFolder(tmp_path / "run")
    run.begin(config, "rans train")
    trainer = Trainer(replace(config, settings=Gate()), HEAVY, run)
    trainer.train(lambda _: None)
    row = json.loads(run.metrics_file.read_text().splitlines()[-1])

    # Sums of float32 rewards and counts.
    assert row["rollout/ep_len_mean"] == 4.0
    assert (row["rollout/at_goal_rate"], row["rollout/failure_rate"]) == (1.0, 0.0)
    assert row["rollout/ep_rew_mean"] == pytest.approx(RETURN, rel=1e-6)
    parts = {key: row[f"return/{key}"] for key in ("time", "bonus", "done")}
    assert parts == pytest.approx({"time": -4.0, "bonus": 2.0, "done": 20.0}, rel=1e-6)
    assert f"return {RETURN:.0f}," in describe(row, config.total_timesteps)
    events = EventAccumulator(str(run.path / "tensorboard"))
    events.Reload()
    board = events.Scalars("rollout/ep_rew_mean")[-1].value
    assert board == pytest.approx(RETURN, rel=1e-6)

    flights = Flights(trainer.learner.network, Setup(HEAVY, Gate(), TEN)).fly(0, 8, seed=1)
    assert flights.sums["return"].mean == pytest.approx(RETURN, rel=1e-6)


def test_no_return_where_no_episode_ended():
    """Ten steps an episode and eight a rollout, from clocks at zero: the first one ends none."""
    engine = Engine(HEAVY, GoToPosition(spawn_distance=(1.0, 2.0)), 16, TEN)
    learner = begin(engine, TINY, 0)
    engine.reset(0)
    row = statistics(learner.learn().tolist(), learner, 128)
    assert not [key for key in row if key.startswith(("return/", "rollout/"))]
    shown = describe(row | {"steps": 128, "success": 0.0, "steps_per_s": 1.0}, 256)
    assert "return" not in shown


@dataclass(frozen=True)
class Rooted(GoToPosition):
    """Its term "bad" has a root of a negative number beyond 1 m."""

    def reward(self, transition: Transition) -> dict[str, Field]:
        far = self.errors(transition.state, transition.goal)["position"]
        return super().reward(transition) | {"bad": (1.0 - far) ** 0.5}


@pytest.mark.filterwarnings("ignore:invalid value", "ignore:this engine steps slower")
def test_a_reward_that_is_nan_is_named():
    learner = begin(Engine(HEAVY, Rooted(spawn_distance=(2.0, 3.0)), 16, TEN), TINY, 0)
    with pytest.raises(NonFiniteState, match="bad") as error:
        statistics(learner.learn().tolist(), learner, 128)
    assert "stillness" not in str(error.value)
    assert "learning rate" not in str(error.value)
