"""L2F, the simulator of "Learning to Fly in Seconds": quadrotors fly back to where they are to hover."""

from __future__ import annotations

from typing import Any

import l2f
import numpy as np
from stopwatch import options, say, steps_per_second

_LARGEST = 8192
"""Environments of a batch: its C++ has them as constants, up to this one."""
_STEPS = 10


class _Batch:
    """Environments stepped together, as L2F's own wrapper for Stable-Baselines3 does it."""

    def __init__(self, size: int, seed: int) -> None:
        self._calls = l2f.vector_selector[size]
        self._device, self._envs = l2f.Device(), self._calls.VectorEnvironment()
        self._parameters, self._random = self._calls.VectorParameters(), self._calls.VectorRng()
        self._state, self._next = self._calls.VectorState(), self._calls.VectorState()
        self._calls.initialize_rng(self._device, self._random, seed)
        self._calls.initialize_environment(self._device, self._envs)
        self._calls.sample_initial_parameters(*self._of_all, self._random)
        self._calls.sample_initial_state(*self._of_all, self._state, self._random)
        self._action = np.random.default_rng(seed).uniform(-1, 1, (size, 4)).astype(np.float32)
        self._observation = np.zeros((size, self._envs.OBSERVATION_DIM), np.float32)
        self._reward = np.zeros(size, np.float32)
        self._ended = np.zeros(size, bool)
        self._age = np.zeros(size, int)

    @property
    def _of_all(self) -> tuple[Any, ...]:
        return self._device, self._envs, self._parameters

    def step(self) -> None:
        """Dynamics, reward, ends, reset, observation."""
        calls = self._calls
        of_all = self._of_all
        random = self._random
        calls.step(*of_all, self._state, self._action, self._next, random)
        calls.reward(*of_all, self._state, self._action, self._next, self._reward, random)
        calls.terminated(*of_all, self._next, self._ended, random)
        self._age += 1
        self._ended |= self._age >= self._envs.EPISODE_STEP_LIMIT
        self._age[self._ended] = 0
        calls.sample_initial_parameters_if_truncated(*of_all, self._ended, random)
        calls.sample_initial_state_if_truncated(*of_all, self._next, self._ended, random)
        calls.observe(*of_all, self._next, self._observation, random)
        self._state.assign(self._next)


def main() -> None:
    """Measure and print."""
    given = options()
    size = min(given.num_envs, _LARGEST)
    batches = [_Batch(size, seed) for seed in range(given.num_envs // size)]

    def steps() -> None:
        for batch in batches:
            for _ in range(_STEPS):
                batch.step()

    say(
        "l2f",
        "hover, a quadrotor with its rotors, 100 Hz",
        f"batches of {size:,} in C++ from Python, auto-reset, constant actions",
        given.num_envs,
        "cpu",
        steps_per_s=steps_per_second(steps, _STEPS * given.num_envs, given.seconds),
    )


if __name__ == "__main__":
    main()
