"""What decides a PPO iteration's time, as our preset for go-to-pose in the plane has it.

Peers cannot import ours; a test compares the two.
"""

from __future__ import annotations

from typing import NamedTuple


class Settings(NamedTuple):
    """By the names of `rans.PPO`."""

    n_envs: int
    n_steps: int
    batch_size: int
    n_epochs: int
    layers: tuple[int, ...]

    @property
    def rollout(self) -> int:
        """Steps of an iteration."""
        return self.n_envs * self.n_steps

    def __str__(self) -> str:
        return (
            f"{self.n_envs} x {self.n_steps}, minibatches of {self.batch_size}, {self.n_epochs} epochs, "
            f"networks {'x'.join(map(str, self.layers))}"
        )


SETTINGS = {
    "cpu": Settings(128, 64, 2048, 4, (64, 64)),
    "cuda": Settings(256, 32, 2048, 4, (128, 128)),
}
