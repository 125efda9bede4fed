"""Safety filter by flown backups: it never lets a zone be entered, whoever commands, in every engine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from rans_missions.guard import FlownBackup, safety_filter
from rans_missions.guard.ahead import Ahead
from rans_missions.tasks import Avoid
from rans_missions.tasks.avoid import Zones

from rans import ConfigError, Engine, Timing
from rans.episode.flight import Flight, fly
from rans.episode.scenario import scenarios
from rans.episode.step import Setup, World
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.shapes import Ball

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")


@dataclass
class Ramming:
    """Thrusts towards the nearest zone: opens every thruster that pushes there."""

    craft: Any
    task: Any
    name: str = "ramming"

    def reset(self, count: int) -> None:
        """Nothing to forget."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        balls = self.task.scenery(goal)
        ways = np.array([(ball.centre - state.p).columns() for ball in balls])
        gaps = np.array([ball.gap(state.p) for ball in balls])
        nearest = np.take_along_axis(ways, gaps.argmin(axis=0)[None, None], axis=0)[0]
        forces = np.array(self.craft.wrench_map)[:, : self.craft.dimension]
        opened = []
        for force in forces:
            zero = np.zeros(len(observation))
            pushed = state.attitude.rotate(type(state.p)(*(zero + x for x in force)))
            opened.append(np.sum(np.array(pushed.columns()) * nearest, axis=0) > 0.0)
        return np.array(opened, dtype=float).T


def rammed(craft: Any, task: Any, count: int, guard: Any, flying: Any = fly) -> Flight:
    starts = scenarios(task, craft, seed=3, count=count)
    return flying(
        craft, task, Ramming(craft, task), starts, Timing(0.2, None, 60, checks=4), guard=guard
    )


@pytest.mark.slow
@pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=lambda craft: craft.name)
def test_nobody_can_be_made_to_enter_a_zone(craft):
    task = Avoid().for_evaluation()
    free = rammed(craft, task, 8, None)
    assert free.violated().mean() >= 0.5
    assert free.guarded is None
    kept = rammed(craft, task, 8, safety_filter(Setup(craft, task)))
    assert not kept.violated().any()
    assert kept.guarded is not None
    assert kept.guarded.any()
    assert np.isin(kept.commands, (0.0, 1.0)).all()


def heading_for(distance: float, speed: float) -> tuple[Any, Any, Any]:
    """A task, a state that flies along x with this distance to the rim of a ball ahead, and a goal."""
    task = Avoid(zones=1)
    here = PlanarState(Vec2(0.0, 0.0), Heading(0.0), Vec2(speed, 0.0), 0.0)
    ball = Ball(Vec2(distance + 0.4, 0.0), Vec2(0.0, 0.0), 0.4)
    goal = PlanarState(Vec2(9.0, 9.0), Heading(0.0), Vec2(0.0, 0.0), 0.0, notes=Zones((ball,)))
    return task, here, goal


def test_thrust_towards_a_zone_is_cut_where_braking_would_be_too_late():
    """Four nozzles of 0.707 N each in x give 0.532 m/s^2.

    From 0.316 m/s the platform stops within 0.094 m, so it may coast 0.22 m away. After a period of thrust
    forwards it has 0.146 m left and needs 0.167 m, and to swerve takes as long as to brake.
    """
    ahead = tuple(float(force[0] > 0.5) for force in np.array(PLATFORM.wrench_map))
    for distance, passes in ((5.0, True), (0.22, False)):
        task, here, goal = heading_for(distance, 0.316)
        world = World(Setup(PLATFORM, task, task.timing))
        given, changed = FlownBackup().admitted(world, here, goal, ahead)
        assert changed is not passes
        assert (given == ahead) is passes
        coasting = FlownBackup().admitted(world, here, goal, (0.0,) * 8)
        assert coasting == ((0.0,) * 8, False)


@pytest.mark.parametrize("speed", [0.0, 0.1])
def test_within_the_reserve_of_a_zone_a_craft_retreats(speed):
    """0.2 m away coasting keeps two thirds of the reserve. Four nozzles push away, and give 0.106 m/s in 0.2 s."""
    task, here, goal = heading_for(0.2, 0.0)
    here = replace(here, v=Vec2(0.0, speed))
    world = World(Setup(PLATFORM, task, task.timing))
    given, changed = FlownBackup(reserve=(("zone 1", 0.3),)).admitted(world, here, goal, (0.0,) * 8)
    assert changed
    reached = Ahead(world).fly(*map_leaves(lambda x: np.full(1, x), (here, goal)), given)
    assert reached.state.v.x[0] < -0.09


def test_one_spacecraft_of_numbers_is_filtered_as_in_a_batch_and_in_torch():
    task = Avoid()
    world = World(Setup(PLATFORM, task, task.timing))
    starts = scenarios(task, PLATFORM, seed=2, count=30)
    # Fast towards the goal, through the zones.
    towards = (starts.goal.p - starts.start.p).scale(0.35)
    state = replace(starts.start, v=towards)
    zero = np.zeros(30)
    command = tuple(zero + float(k % 3 == 0) for k in range(8))
    guard = FlownBackup()
    batch, changed = guard.admitted(world, state, starts.goal, command)
    assert 0 < changed.sum() < 30

    def tensor(x):
        return torch.as_tensor(x) if np.ndim(x) else x

    of_torch, also = guard.admitted(
        world,
        map_leaves(tensor, state),
        map_leaves(tensor, starts.goal),
        tuple(map(tensor, command)),
    )
    assert torch.stack(of_torch).numpy().tolist() == np.array(batch).tolist()
    assert also.numpy().tolist() == changed.tolist()
    for k in np.flatnonzero(changed)[:2]:
        one = map_leaves(lambda x, k=k: float(x[k]) if np.ndim(x) else x, (state, starts.goal))
        alone, is_changed = guard.admitted(world, *one, tuple(float(x[k]) for x in command))
        assert alone == tuple(x[k] for x in batch)
        assert is_changed is True


def test_engines_and_environments_fly_it():
    task = Avoid()
    engine = Engine(PLATFORM, task, 8, seed=4, guard=FlownBackup())
    torch.manual_seed(0)
    for _ in range(20):
        assert torch.isfinite(engine.step((torch.rand(8, 8) < 0.5).float()).reward).all()
    with pytest.raises(ConfigError, match="compiled"):
        Engine(PLATFORM, task, 8, guard=FlownBackup(), compiled=True)
    env = gymnasium.make("rans/Avoid2D-v0", guard=FlownBackup())
    env.reset(seed=0)
    assert env.step(np.ones(8, int))[0].shape == env.observation_space.shape


def test_where_no_backup_keeps_the_reserve_a_safe_state_stays_safe_without_it():
    """As after a reading that is worse than those before, with any heading and spin close to a zone."""
    task = Avoid(zones=1)
    world = World(Setup(PLATFORM, task, task.timing))
    rng = np.random.default_rng(4)
    count = 48
    zero = np.zeros(count)
    distance = rng.uniform(0.05, 0.4, count)
    state = PlanarState(
        Vec2(zero, rng.uniform(-0.3, 0.3, count)),
        Heading(rng.uniform(-3.0, 3.0, count)),
        Vec2(rng.uniform(0.1, 0.5, count), zero),
        rng.uniform(-0.5, 0.5, count),
    )
    ball = Ball(Vec2(distance + 0.4, zero), Vec2(zero, zero), zero + 0.4)
    goal = PlanarState(
        Vec2(zero + 9.0, zero), Heading(zero), Vec2(zero, zero), zero, notes=Zones((ball,))
    )
    plain, wary = FlownBackup(), FlownBackup(reserve=(("zone 1", 0.3),))
    some = plain.safe(world, state, goal) & ~wary.safe(world, state, goal)
    assert some.sum() > 10
    command = tuple(1.0 * (rng.random((8, count)) < 0.5))
    given, _ = wary.admitted(world, state, goal, command)
    reached = Ahead(world).fly(state, goal, given)
    assert plain.safe(world, reached.state, reached.goal)[some].all()
