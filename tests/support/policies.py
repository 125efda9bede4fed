"""What users might bring: functions of the observation, good and bad."""

from __future__ import annotations

from typing import Any

import numpy as np


def idle(observation: np.ndarray) -> np.ndarray:
    """Never opens a thruster."""
    return np.zeros((len(observation), 8))


def full(observation: np.ndarray) -> np.ndarray:
    """Opens all thrusters, which cancel."""
    return np.ones((len(observation), 8), dtype=np.int64)


def unsure(observation: np.ndarray) -> np.ndarray:
    """Answers probabilities."""
    return np.full((len(observation), 8), 0.5)


def narrow(observation: np.ndarray) -> np.ndarray:
    """Knows seven thrusters."""
    return np.zeros((len(observation), 7))


def broken(observation: np.ndarray) -> np.ndarray:
    """Raises."""
    raise KeyError("no such layer")


def leaving(observation: np.ndarray) -> np.ndarray:
    """Ends the program."""
    raise SystemExit(3)


class Counting:
    """Opens as many thrusters as control periods have passed since the episode began, as LSTMs of sb3-contrib do:
    the state is the second result, and zeros where an episode starts."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, **_: Any
    ) -> Any:
        count = np.zeros(len(observation), int) if state is None else state[0]
        if episode_start is not None:
            count = np.where(episode_start, 0, count)
        return (np.arange(8) <= count[:, None]).astype(int), (count + 1,)


PI = 3.14159
