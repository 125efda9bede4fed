"""Timing: the paper's defaults and every wrong value."""

from __future__ import annotations

from typing import Any

import pytest

from rans.errors import ConfigError
from rans.model.timing import Timing


def test_defaults_are_25_seconds_at_5_hz() -> None:
    timing = Timing()
    assert 1 / timing.control_period == 5.0
    assert timing.control_period * timing.episode_steps == 25.0


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("control_period", 0.0),
        ("control_period", -0.2),
        ("control_period", float("nan")),
        ("control_period", float("inf")),
        ("control_period", "0.2"),
        ("control_period", True),
        ("control_period", None),
        ("substeps", 0),
        ("substeps", 1.5),
        ("substeps", True),
        ("episode_steps", -1),
        ("episode_steps", "ten"),
        ("episode_steps", None),
    ],
)
def test_a_wrong_value_is_one_sentence(key: str, value: Any) -> None:
    with pytest.raises(ConfigError) as caught:
        Timing(**{key: value})
    message = str(caught.value)
    assert message.startswith(key)
    assert message.endswith(f"got {value!r}.")
    assert "0 s" in message or ">= 1" in message


def test_an_episode_is_no_longer_than_a_clock_can_count() -> None:
    assert Timing(episode_steps=2**20 - 1).episode_steps == 1_048_575
    with pytest.raises(ConfigError, match=r"episode_steps must be <= 1,048,575, got 1,048,576\."):
        Timing(episode_steps=2**20)


@pytest.mark.parametrize("steps", [1, 3, 4, 125])
def test_a_clock_counts_periods_and_episodes(steps: int) -> None:
    """Wherever an episode ends, the next one begins at its period 0."""
    timing = Timing(episode_steps=steps)
    clock = 0
    for episode in range(3):
        assert (timing.episode(clock), timing.step(clock)) == (episode, 0)
        for ran in range(steps + 1):
            assert (timing.episode(clock + ran), timing.step(clock + ran)) == (episode, ran)
            assert timing.next_episode(clock + ran) == timing.next_episode(clock)
        clock = timing.next_episode(clock)
