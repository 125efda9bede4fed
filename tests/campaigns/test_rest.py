"""What agents do at rest, by hand and against the flights that evaluations are made of."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from campaigns.batch import loaded
from campaigns.rest import Rest, cycles, last_commands, opposite, said
from campaigns.runner import texts
from campaigns.table import ROWS
from rans.evaluation.fly.agent import Agent
from rans.fast.agent_files.agent import AGENT as AGENT_FILE
from rans.fast.agent_files.agent import read_policy
from rans.flight import fly
from rans.model.spacecraft_file import load_spacecraft
from rans.pretrained import pretrained_folder
from rans.scenario import scenarios

PLATFORM = load_spacecraft("floating-platform")


def spelt(*flights: str) -> torch.Tensor:
    """Commands of two thrusters: a letter a step, o none, a the first, b the second, x both."""
    steps = {"o": (0, 0), "a": (1, 0), "b": (0, 1), "x": (1, 1)}
    return (
        torch.tensor([[steps[letter] for letter in flight] for flight in flights])
        .bool()
        .transpose(0, 1)
    )


def test_a_cycle_is_what_repeats_and_moves() -> None:
    flights = (
        "aoaoaoaoao",
        "abbabbabba",
        "oooooooooo",
        "aaaaaaaaaa",
        "aoaoaoaoaa",
        "aooobaooob",
        "oooooooooa",
    )
    assert cycles(spelt(*flights)).tolist() == [2, 3, 0, 0, 0, 5, 0]


def test_only_what_cancels_is_opposite() -> None:
    """By the forces and torques of two thrusters open together: they are zero."""
    wrenches = np.array(PLATFORM.wrench_map)
    pairs = opposite(PLATFORM)
    assert len(pairs) == 4
    for i, j in pairs:
        np.testing.assert_allclose(wrenches[i] + wrenches[j], 0.0, atol=1e-9)
    assert len(opposite(load_spacecraft("free-flyer"))) == 8


def test_what_is_said_by_hand() -> None:
    """Four steps of 0.5 s, two flights; thrusters 0 and its opposite 1 or another."""
    commands = torch.zeros(4, 2, 8, dtype=torch.bool)
    i, j = opposite(PLATFORM)[0]
    commands[0, 0, [i, j]] = True  # shut a step later: two changes of one flight
    commands[::2, 1, i] = True  # a, -, a, -: three changes, a cycle of two steps
    found = said(commands, PLATFORM, 0.5)
    assert found["duty"] == pytest.approx(100.0 * 4 / 64)
    assert found["changes"] == pytest.approx((2 + 3) / 2 / 1.5)  # in three intervals of 0.5 s
    assert found["opposite"] == pytest.approx(100.0 / 8)
    assert (found["cycles"], found["lengths"]) == (50.0, {"2": 1})


def test_commands_are_those_of_evaluations() -> None:
    """In the engine in float32 and one by one in float64: a tie in rounding moves a pulse or two."""
    network, setup = loaded("pretrained:go-to-pose-2d", "cpu")
    found = last_commands(network, setup, 16, 7, "cpu").numpy()
    policy = read_policy(pretrained_folder("go-to-pose-2d") / AGENT_FILE).network
    flight = fly(
        *setup[:2], Agent(policy, "agent"), scenarios(setup.task, setup.craft, 7, 16), setup.timing
    )
    expected = flight.commands[-25:] > 0  # of 125 steps
    assert found.shape == expected.shape
    assert (found != expected).mean() < 0.05


def test_a_study_becomes_a_table() -> None:
    evidence = Rest(("pretrained:track-velocity-2d",), 32).measured()
    found = evidence["agents"]["pretrained:track-velocity-2d"]["at rest"]
    _, rows = texts(ROWS["rest"].tables["rest"], evidence)
    assert rows[0][:2] == ["`track-velocity-2d`", f"{found['duty']:.2f}"]
