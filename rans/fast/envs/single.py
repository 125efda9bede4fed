"""One spacecraft moved by the equations that all engines share, as a Gymnasium environment."""

from __future__ import annotations

from rans.environment import Environment


class SpacecraftEnv(Environment):
    """`Environment` for debugging, pictures and other libraries' algorithms.

    >>> env = gymnasium.make("rans/GoToPose2D-v0", spacecraft="atmos", conditions="lab")
    >>> env.reset(seed=0)[0].shape
    (10,)

    Made by ``gymnasium.make("rans/GoToPose2D-v0")``. It flies the same episodes as one environment of
    `rans.fast.SpacecraftVectorEnv`, and as `rans.reference.flight.DrakeEnv`.
    """

    def _mover(self) -> None:
        """See `Environment`: our equations."""
