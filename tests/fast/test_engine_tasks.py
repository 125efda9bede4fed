"""What only some tasks ask of the engine: the previous command, and goals that know their task."""

import numpy as np
import pytest
import torch

from rans import ConfigError
from rans.episode.scenario import scenario
from rans.model.fields import leaves
from rans.tasks import GoToPosition, MultiTask, TrackVelocity, observation
from tests.support.engines import FLYER, NEAR, PLATFORM, SHORT, actions, by_turns, run
from tests.support.switching import SwitchingGoToPose

COSTLY = SwitchingGoToPose(**vars(NEAR), switching_weight=0.25)
MIXED = MultiTask(
    tasks=("go-to-pose", "go-to-position", "track-velocity"),
    go_to_pose=COSTLY,
    go_to_position=GoToPosition(spawn_distance=(0.5, 1.0), fail_distance=1.05, fail_spin=15.0),
    track_velocity=TrackVelocity(velocity_tolerance=0.5, fail_spin=2.0),
)
"""With it too many episodes of `SHORT` fail under random thrust, and others do not."""


@by_turns
def test_every_valve_that_moves_is_paid_for(backend, craft):
    """Episodes begin with all valves shut, wherever the last one ended."""
    engine = backend(craft, COSTLY, 32, SHORT, seed=1)
    paid = engine.term_names.index("switching")
    before = torch.zeros(32, len(craft.thrusters))
    begun = 0
    for action in actions(craft, 32, 45, held=2):
        step = engine.step(action)
        moved = (action - before).abs().sum(dim=1)
        torch.testing.assert_close(step.terms[paid], -0.25 * moved)
        ended = step.terminated | step.truncated
        before = torch.where(ended[:, None], 0, action).float()
        begun = begun + int(ended.sum())
    assert begun > 32
    engine.reset()
    opened = engine.step(torch.ones(32, len(craft.thrusters))).terms[paid]
    torch.testing.assert_close(opened, torch.full((32,), -0.25 * len(craft.thrusters)))


def test_it_remembers_what_the_task_looks_at_and_nothing_more(backend):
    """A byte a thruster, where switching costs anything; by default state, clock and the goal's attitude:
    actuators, drifts, bodies and goals that move cost nothing where they are the usual ones."""
    engines = [backend(PLATFORM, task, 16, SHORT) for task in (NEAR, COSTLY)]
    sizes = [sum(x.nbytes for x in engine.save_state()["buffers"]) for engine in engines]
    assert sizes[1] - sizes[0] == 16 * 8
    assert sizes[0] == 16 * 4 * (6 + 1 + 1)
    assert set(engines[1].term_names) - set(engines[0].term_names) == {"switching"}


@pytest.mark.parametrize(
    ("backend", "craft", "task"),
    [("torch", FLYER, COSTLY), ("numpy", PLATFORM, MIXED)],
    indirect=["backend"],
    ids=["switching", "multi-task"],
)
def test_a_loaded_state_goes_on_bit_for_bit(backend, craft, task):
    engine, other = (backend(craft, task, 16, SHORT, seed=seed) for seed in (9, 123))
    run(engine, 7)
    saved = engine.save_state()
    expected = run(engine, 45, seed=2)
    before = [x.data_ptr() for x in leaves(other.state)] if craft is FLYER else []
    other.load_state(saved)
    for a, b in zip(expected, run(other, 45, seed=2), strict=True):
        assert all(torch.equal(x, y) for x, y in zip(a, b, strict=True))
    # A CUDA graph reads and writes these very places.
    assert before == ([x.data_ptr() for x in leaves(other.state)] if craft is FLYER else [])


def test_a_state_without_commands_is_refused_where_they_are_needed(backend):
    saved = backend(PLATFORM, NEAR, 4, SHORT).save_state()
    with pytest.raises(ConfigError, match="saved state is not one of 4 environments"):
        backend(PLATFORM, COSTLY, 4, SHORT).load_state(saved)


@by_turns
def test_episode_k_is_the_same_however_many_fly(backend, craft):
    """Environment i of N flies episodes i, i + N, i + 2 N, ... as `scenario` gives them, each with its task."""
    flags = set()
    for count in (1, 6):
        engine = backend(craft, MIXED, count, SHORT, seed=11, dtype=torch.float64)
        number = np.arange(count)
        begun = np.full(count, True)
        seen = engine.observe()
        for action in actions(craft, count, 45):
            for i in np.flatnonzero(begun):
                chosen = scenario(MIXED, craft.dimension, 11, int(number[i]))
                expected = observation(MIXED, chosen.start, chosen.goal)
                # Both take the same draws; sine and cosine may differ in the last place.
                np.testing.assert_allclose(seen[i].numpy(), expected, rtol=0, atol=1e-14)
                flags.add(chosen.goal.notes.flag)
            step = engine.step(action)
            begun = (step.terminated | step.truncated).numpy()
            seen = step.observation
            number = number + count * begun
        assert number.min() >= 2 * count
    assert flags == {0.0, 1.0, 2.0}
