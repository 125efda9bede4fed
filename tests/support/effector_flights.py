"""Craft with every kind of effector, and what commands them: random commands and random weights."""

from __future__ import annotations

from dataclasses import replace

import rans
from rans import PPOSettings, Spacecraft
from rans.fast.learn.beginning import architecture_of
from rans.model.actuators import Propellant
from rans.policy.network import Network
from tests.support.effector_crafts import BURNING, CUBESAT, LANDER, WHEELED, commands
from tests.support.played import Played

BOTH = replace(WHEELED, name="both", propellant=Propellant(0.5, 20.0, (0.1, 0.1, 0.0)))
"""On/off thrusters that use propellant, and a wheel."""
ALL = [CUBESAT, LANDER, WHEELED, BURNING, BOTH]


def task_of(craft: Spacecraft) -> str:
    return "track-velocity" if craft is LANDER else "go-to-pose"


def scripted(craft: Spacecraft) -> Played:
    """Random commands, the same in every flight."""
    return Played(lambda step, count: commands(craft, count, seed=step + 1))


def untrained_policy(craft: Spacecraft) -> Network:
    """A policy with random weights that asks for a good deal."""
    engine = rans.Engine(craft, task_of(craft), 8)
    given = architecture_of(engine, PPOSettings(layers=(16, 16)))
    tensors, _ = given.initial(3, 0.5)
    tensors["action_net.weight"] = tensors["action_net.weight"] * 60.0
    return Network(given, tensors)
