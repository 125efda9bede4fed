"""The agent for any craft: its commands depend on geometry alone, and executors agree on unseen craft."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from rans_any_craft.allocated import spare
from rans_any_craft.authority import Authority, Seen, braking_distance, nearer
from rans_any_craft.networks import authority, effects, farthest, for_craft, without

import rans
from rans import ConfigError, Spacecraft, Thruster
from rans.evaluation.fly.any_craft import for_spacecraft
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.aggregate import measure
from rans.model.spacecraft_file import load_spacecraft, parse_spacecraft, to_toml
from rans.policy.network import Network
from tests.support.pose_observations import observations


def network(dimension: int = 2) -> Network:
    return contestant(f"pretrained:any-craft-{dimension}d").network


def reordered(craft: Spacecraft, order: list[int]) -> Spacecraft:
    return replace(craft, thrusters=tuple(craft.thrusters[k] for k in order))


@pytest.mark.parametrize("name", ["floating-platform", "cubesat-3u"])
def test_reordered_thrusters_get_the_same_commands_reordered(name):
    craft = load_spacecraft(name)
    order = [int(k) for k in np.random.default_rng(4).permutation(len(craft.thrusters))]
    seen = observations(400, dimension=craft.dimension)
    agent = network(craft.dimension)
    here, _ = for_craft(agent, craft, 0.2).deterministic_action(seen, None)
    there, _ = for_craft(agent, reordered(craft, order), 0.2).deterministic_action(seen, None)
    wheels = list(range(len(order), here.shape[1]))
    assert torch.equal(here[:, [*order, *wheels]], there)
    assert len(torch.unique(here, dim=0)) > 10


def test_a_far_goal_is_near_in_its_direction():
    """5 m and 1 rad become half a metre and 0.35 rad, about the same axis; what is nearer stays."""
    for far, slow in ((1.0, 1.0), (1.0, 0.0), (0.01, 1.0)):
        error = [3.0 * far, 0.0, -4.0 * far]
        sines = [0.0, 0.6 * np.sin(far), 0.8 * np.sin(far)]
        angle = min(far, 0.35) if slow else far
        found = nearer(Seen(error, np.cos(far), sines, [], []), 0.5, slow)
        assert found.error == pytest.approx([x * min(1.0, 0.1 / far) for x in error])
        assert [found.cosine, *found.sines] == pytest.approx(
            [np.cos(angle), 0.0, 0.6 * np.sin(angle), 0.8 * np.sin(angle)]
        )


def test_thrusters_that_push_along_z_alone_are_not_spare():
    assert spare(effects(load_spacecraft("atmos-orbit-16"), 0.2)) == tuple(range(12))


def test_the_speed_at_which_wheels_are_full_by_hand():
    """Without its first thruster cubesat-3u is pushed along -x with torques about x and y, 0.11 N m for each N.

    The momenta of both wheels share them: 0.015 N m s each at 2 x 0.015 / 0.11 N s of the 5 kg.
    """
    craft = load_spacecraft("cubesat-3u")
    assert farthest(craft, Authority.of_numbers(authority(craft, 0.5))) == 0.0
    craft = without(craft, 0)
    own = Authority.of_numbers(authority(craft, 0.5))
    speed = 0.6 * 2.0 * 0.015 / 0.11 / 5.0
    expected = braking_distance(speed, 2.0 * 0.025 / 3.0**0.5 / 5.0, 0.5)
    assert farthest(craft, own) == pytest.approx(expected, rel=1e-5)
    # The braking curve: speed^2 = 2 x 0.7 a (way - 3 periods at that speed), with a linear end.
    usable = 0.7 * 2.0 * 0.025 / 3.0**0.5 / 5.0
    assert expected == pytest.approx(speed**2 / (2.0 * usable) + 1.5 * speed)


def own_craft() -> Spacecraft:
    """Six slanted thrusters of two forces, which nobody else has."""
    thrusters = []
    for k, force in enumerate((1.0, 0.8, 1.0, 0.8, 1.0, 0.8)):
        angle = 2.0 * np.pi * k / 6.0
        along = angle + (2.2 if k % 2 else -2.2)
        thrusters.append(
            Thruster(
                (0.25 * np.cos(angle), 0.25 * np.sin(angle), 0.0),
                (np.cos(along), np.sin(along), 0.0),
                force,
            )
        )
    base = load_spacecraft("floating-platform")
    return replace(base, name="six", thrusters=tuple(thrusters), mass=9.0)


def test_a_craft_never_seen_settles_from_its_file(tmp_path):
    file = tmp_path / "six.toml"
    file.write_text(to_toml(own_craft()), "utf-8")
    run = contestant(f"any-craft-2d@{file}")
    flight = fly_episodes(run.controller, run.judged, 2023, 24, workers=1)
    assert run.craft.name == "six"
    rows = {row.name: row for row in measure(flight).rows}
    assert rows["solved"].value >= 90.0


@pytest.mark.filterwarnings("ignore:spacecraft .* cannot push and turn it")
def test_craft_that_it_cannot_fly_are_refused_with_the_reason():
    with pytest.raises(ConfigError, match="in the plane only: name any-craft-3d for spheres"):
        for_craft(network(), load_spacecraft("spheres"), 0.1)
    # Thrusters through the centre of mass, and no wheels.
    with pytest.raises(ConfigError, match=r"afrl-deputy cannot turn.*lqr:go-to-position-3d@"):
        for_craft(network(3), load_spacecraft("afrl-deputy"), 1.0)
    # Go-to-position is no advice where a push is missing too.
    deputy = load_spacecraft("afrl-deputy")
    pushed = replace(deputy, thrusters=deputy.thrusters[:1])
    with pytest.raises(ConfigError, match=r"cannot accelerate it along .*missing or reversed"):
        for_craft(network(3), pushed, 1.0)
    with pytest.raises(ConfigError, match="innocube has no thruster"):
        for_craft(network(3), load_spacecraft("innocube"), 1.0)
    craft = load_spacecraft("floating-platform")
    few = replace(craft, thrusters=craft.thrusters[:3])
    # It turns and goes along x, and nothing pushes it along y: y is named, not x.
    flat = replace(
        craft,
        thrusters=tuple(
            Thruster((x, y, 0.0), (x / 0.2, 0.0, 0.0), 1.0)
            for x in (0.2, -0.2)
            for y in (0.1, -0.1)
        ),
    )
    with pytest.raises(ConfigError, match="missing or reversed thruster"):
        for_craft(network(), few, 0.1)
    with pytest.raises(ConfigError, match=r"accelerate it along \+y"):
        for_craft(network(), flat, 0.1)
    specialist = contestant("pretrained:go-to-pose-2d")
    with pytest.raises(ConfigError, match="any-craft-2d"):
        for_spacecraft(specialist, craft)


def test_an_agent_flies_its_own_craft_with_slosh_and_no_other():
    run = contestant("pretrained:go-to-pose-2d")
    slosh = rans.Slosh(0.5, 0.06, (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
    # As a file has it, whose directions differ in their last digits.
    text = to_toml(replace(run.craft, name="sloshing", further_effectors=(slosh,)))
    sloshing = parse_spacecraft(text, "a file")
    found = for_spacecraft(run, sloshing)
    assert found.craft == sloshing
    assert found.controller is run.controller
    assert found.timing == run.timing
    with pytest.raises(ConfigError, match="any-craft-2d"):
        for_spacecraft(run, replace(sloshing, mass=6.0))
