"""Environment steps per second of a JAX environment: a compiled loop over steps, over a batch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
from stopwatch import steps_per_second


def loop_rate(
    step: Callable[[Any], Any], first: Any, num_envs: int, steps: int, seconds: float
) -> float:
    """Rate of a whole step with everything it gives.

    Args:
        step: from what the last step gave to what this one gives: state, observation, reward, ends. All of it
            is carried from step to step, so that the compiler can leave none of it out.
        first: what a step could have given.
        num_envs: environments in it.
        steps: in one compiled loop.
        seconds: of a repeat.
    """

    @jax.jit
    def loop(carried: Any) -> Any:
        return jax.lax.fori_loop(0, steps, lambda _, c: step(c), carried)

    return steps_per_second(lambda: jax.block_until_ready(loop(first)), steps * num_envs, seconds)


def device_name() -> str:
    """Kind of device as torch calls it, "cpu" or "cuda"."""
    backend = jax.default_backend()
    return "cuda" if backend == "gpu" else backend
