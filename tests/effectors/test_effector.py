"""An effector of a kind that RANS does not know: one file and Drake's, and it works everywhere."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from rans_optimal.checks import check_craft

import rans
from rans import ConfigError, Timing
from rans.episode.flight import Setup
from rans.evaluation.compare.bounds import check_certifiable
from rans.fast.flights import Flights
from rans.model.accuracy import spin_up
from rans.model.actuators import Throttle
from rans.model.spacecraft import CommandRange
from rans.model.spacecraft_file import load_spacecraft, parse_spacecraft, to_toml
from rans.reference.plant import Plant
from tests.support.effector_flights import untrained_policy
from tests.support.torquer import TURNED, TURNED_IN_SPACE, Torquer
from tests.support.training import learner_on


def test_gymnasium_knows_its_command():
    craft = replace(TURNED, actuators=Throttle())
    env = gymnasium.make("rans/GoToPose2D-v0", spacecraft=craft).unwrapped
    check_env(env, skip_render_check=True)
    space: Any = env.action_space
    assert (space.low[-1], space.high[-1]) == (-1.0, 1.0)


def test_an_agent_trains_and_flies_with_it():
    engine = rans.Engine(TURNED, "go-to-pose", 16)
    learner_on(engine, n_steps=8).learn()
    policy = untrained_policy(TURNED)
    setup = Setup(TURNED, rans.GoToPose(), Timing(episode_steps=20))
    ways = [Flights(policy, setup, plain=plain).fly(0, 64, 1) for plain in (True, False)]
    assert ways[0].flights == ways[1].flights == 64


def test_its_file_says_what_it_is():
    text = to_toml(TURNED_IN_SPACE)
    assert parse_spacecraft(text, "a file").further_effectors == TURNED_IN_SPACE.further_effectors
    assert "[[effector]]" not in to_toml(load_spacecraft("free-flyer"))
    strange = text.replace("rans_example.motion:Torquer", "rans_example.motion:Other")
    with pytest.raises(ConfigError, match="would run that module's code"):
        parse_spacecraft(strange, "a file")


class Pusher(Torquer):
    """Takes a command and turns nothing."""

    largest_torque = 0.0  # type: ignore[assignment]


@pytest.mark.filterwarnings("ignore:.*cannot push and turn it")
def test_a_craft_may_have_no_other_effector():
    """0.03 N m about one axis turn moments of 0.1, 0.2 and 0.3 kg m^2 by 0.3 rad/s^2 at most."""
    inertia = ((0.1, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.3))
    alone = replace(TURNED_IN_SPACE, thrusters=(), inertia=inertia)
    assert spin_up(alone) == pytest.approx(0.3)
    assert alone.can_turn
    assert parse_spacecraft(to_toml(alone), "a file") == alone
    rans.Engine(alone, "go-to-attitude", 1).step(torch.ones(1, 1))
    pushed = replace(alone, further_effectors=(Pusher((0.0, 0.0, 1.0), 0.03, 1.0),))
    assert not pushed.can_turn
    assert spin_up(pushed) == 0.0


class Unknown(Torquer):
    """Nobody told Drake of it, and nobody commands it."""

    commands = ()  # type: ignore[assignment]


def test_what_knows_nothing_of_it_refuses():
    strange = replace(TURNED, further_effectors=(Unknown((0.0, 0.0, 1.0), 0.1, 1.0),))
    for check in (check_craft, check_certifiable):
        with pytest.raises(ConfigError, match="effectors of other"):
            check(strange)
    with pytest.raises(ConfigError, match="effectors of other kinds"):
        rans.LQR(TURNED, rans.GoToPose())
    with pytest.raises(ConfigError, match="Drake does not know effectors of the kind Unknown"):
        Plant(strange)
    assert TURNED.commands[-1] == CommandRange("torquer", "torque", -1.0, 1.0)
