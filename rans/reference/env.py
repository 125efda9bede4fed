"""One spacecraft moved by Drake, as a Gymnasium environment."""

from __future__ import annotations

from rans.environment import Environment
from rans.episode import Mover
from rans.reference.flight import DrakeMover


class DrakeEnv(Environment):
    """`Environment` whose motion an independent judge computes.

    Made by ``gymnasium.make("rans/GoToPose2D-Drake-v0")``. It flies the same episodes as
    `rans.fast.SpacecraftEnv`, observes, rewards and ends them in the same way, and needs about a
    millisecond a step. Its motion is as accurate as `Plant` is: ``timing.substeps`` does not concern it.

    Raises:
        ConfigError: see `Environment`; or Drake refuses the spacecraft's mass properties.
    """

    def _mover(self) -> Mover:
        return DrakeMover(self.craft, self.timing, self.task.drift)
