"""Timing: clocks of episodes."""

import pytest

from rans import Timing


@pytest.mark.parametrize("steps", [1, 3, 4, 125])
def test_a_clock_counts_periods_and_episodes(steps):
    """Wherever an episode ends, the next one begins at its period 0."""
    timing = Timing(episode_steps=steps)
    clock = 0
    for episode in range(3):
        assert (timing.episode(clock), timing.step(clock)) == (episode, 0)
        for ran in range(steps + 1):
            assert (timing.episode(clock + ran), timing.step(clock + ran)) == (episode, ran)
            assert timing.next_episode(clock + ran) == timing.next_episode(clock)
        clock = timing.next_episode(clock)
