"""Frugality of an agent for any craft: slower and cheaper flights by the same weights."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, strategies as st
from rans_any_craft.frugality import AS_TRAINED, Leisure, cruise_speed, numbers_of
from rans_any_craft.networks import for_craft, frugal as at_value

from rans import ConfigError
from rans.base.pretrained import pretrained_folder
from rans.evaluation.fly.agent import load_policy
from rans.evaluation.fly.contestant_name import ContestantName
from rans.evaluation.fly.contestants import contestant
from rans.fast.agent_files.agent import actor_bytes, read_policy
from rans.model.spacecraft_file import load_spacecraft
from rans.policy.network import Network
from rans.policy.predict import predict
from tests.support.pose_observations import observations


def test_an_agent_with_weights_of_one_value_has_no_other():
    own = load_policy(pretrained_folder("any-craft-3d")).network
    with pytest.raises(ConfigError, match="weights of one value"):
        at_value(Network(own.architecture, own.tensors), 0.0, 3.5)


def test_the_ways_are_those_of_the_craft_that_flies():
    """The platform pushes most along its axes, `roboran-platform` between them, as a square does."""
    reach = contestant("any-craft-2d#1@roboran-platform").network.architecture.reach
    assert len(reach) == 8
    assert reach[4:] == pytest.approx([math.sqrt(2.0) * x for x in reach[:4]])
    # In space and with pulsed thrusters a network does not know them, and has one price and no pulses that hold.
    for spec in ("any-craft-3d#1", "any-craft-2d#1@pingu"):
        architecture = contestant(spec).network.architecture
        assert architecture.reach == ()
        assert (numbers_of(architecture).away, numbers_of(architecture).hold) == (1.0, 0.0)
    assert numbers_of(contestant("any-craft-2d#0.7").network.architecture).away == 1.0
    assert numbers_of(contestant("adaptive:any-craft-2d#1").network.architecture).hold == 0.0


def test_pulsed_craft_in_space_without_wheels_hurry_at_the_value_0():
    agent = contestant("pretrained:any-craft-3d").network

    def acceleration(name):
        own = for_craft(agent, load_spacecraft(name), 0.2)
        return numbers_of(at_value(own, 0.0, 3.5).architecture).acceleration

    assert acceleration("spheres") > 1.0
    assert acceleration("cubesat-3u") == acceleration("free-flyer") == 1.0


@given(
    st.floats(0.0, 1.0),
    st.floats(0.1, 10.0),
    st.floats(1.0, 500.0),
    st.floats(0.005, 1.0),
    st.floats(0.25, 3.0),
)
def test_a_longer_flight_has_slower_ways(value, distance, seconds, acceleration, margin):
    """Up to 0.5 no length counts; above, weights are from those of 0.5 to those of the value."""
    short, long = (
        Leisure.of_flight(value, distance, length, acceleration, margin)
        for length in (seconds, 2.0 * seconds)
    )
    assert 0.0 <= short.slow <= long.slow <= 1.0
    # Throttled craft of small margin have weights as frugal, and ways as slow.
    fine = Leisure.of_flight(value, distance, seconds, acceleration, margin, has_pulses=False)
    assert fine.slow == short.slow
    assert fine.value >= short.value
    if value <= 0.5:
        assert short == long == Leisure(value)
    else:
        assert 0.5 <= short.value <= value
        assert 0.5 <= long.value <= value
    speeds = [cruise_speed(distance, x, acceleration, 0.2, True) for x in (seconds, 2.0 * seconds)]
    assert speeds[1] <= speeds[0]


def test_a_file_keeps_the_weights_of_all_values(tmp_path):
    network = contestant("any-craft-2d").network
    file = tmp_path / "agent.safetensors"
    own = network.weights()
    file.write_bytes(actor_bytes(network.architecture, own, 0, network.at))
    again = read_policy(file).network
    assert again.at.keys() == network.at.keys()
    assert all(
        torch.equal(x, again.at[value][name])
        for value, tensors in network.at.items()
        for name, x in tensors.items()
    )
    for wrong, said in (
        ({0.0: own, 0.5: own}, "from 0 to 1"),
        ({0.0: own, 1.0: own, 2.0: own}, "from 0 to 1"),
        ({1.0: own}, "from 0 to 1"),
        (
            {0.0: own, 1.0: {name: x[..., None] for name, x in own.items()}},
            "not those of the network",
        ),
    ):
        file.write_bytes(actor_bytes(network.architecture, own, 0, wrong))
        with pytest.raises(ConfigError, match=said):
            read_policy(file)


def test_a_run_folder_keeps_the_value(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = ContestantName.parse("any-craft-2d#0.8@pingu").folder
    saved = read_policy(folder / "agent.safetensors").network
    expected = contestant("any-craft-2d#0.8@pingu").network
    assert numbers_of(saved.architecture) == numbers_of(expected.architecture) != AS_TRAINED
    seen = observations(200).numpy()
    assert np.array_equal(predict(saved, seen)[0], predict(expected, seen)[0])


def forged(network: Network, folder: Path, **changes: Any) -> Network:
    """What is read of its file with other numbers in it."""
    file = folder / "agent.safetensors"
    file.write_bytes(actor_bytes(replace(network.architecture, **changes), network.weights(), 0))
    return read_policy(file).network


@pytest.mark.parametrize(
    "changes",
    [
        *(
            {"frugal": tuple(AS_TRAINED._replace(**{name: wrong}))}
            for name, wrong in (
                ("shortened", 0.0),
                ("farthest", -1.0),
                ("largest_angle", 4.0),
                ("price", 0.0),
                ("acceleration", 0.0),
                ("coast", 0.0),
                ("away", 0.0),
                ("hold", 0.5),
                ("growth", -0.1),
            )
        ),
        *({"frugal": AS_TRAINED[:count]} for count in (3, 8)),
        *(
            {"reach": numbers}
            for numbers in ((0.4,) * 7, (0.4,) * 7 + (0.0,), (0.4,) * 7 + (math.inf,))
        ),
    ],
)
def test_other_numbers_in_a_file_are_refused(changes, tmp_path):
    with pytest.raises(ConfigError, match=r"frugality|reach"):
        forged(contestant("any-craft-2d").network, tmp_path, **changes)


@pytest.mark.parametrize("spec", ["adaptive:any-craft-2d", "any-craft-2d@pingu", "any-craft-3d"])
def test_a_file_says_that_pulses_hold_only_a_craft_that_they_can(spec, tmp_path):
    with pytest.raises(ConfigError, match="hold"):
        forged(contestant(spec).network, tmp_path, frugal=tuple(AS_TRAINED._replace(hold=1.0)))


@pytest.mark.parametrize("later", [(), (1.0,)])
def test_files_of_before_prices_fell_and_pulses_held_are_read(later, tmp_path):
    numbers = (1.0, 0.5, 0.0, 2.0, 1.0, 1.0, *later)
    read = forged(contestant("any-craft-2d").network, tmp_path, frugal=numbers)
    assert numbers_of(read.architecture) == AS_TRAINED._replace(farthest=0.5, price=2.0)
