"""Gymnasium environment of one spacecraft with the equations of RANS."""

from __future__ import annotations

from rans.episode.environment import Environment


class SpacecraftEnv(Environment):
    """Gymnasium environment of one spacecraft, for debugging, rendering and other libraries.

    >>> env = gymnasium.make("rans/GoToPose2D-v0", spacecraft="atmos", conditions="lab")
    >>> env.reset(seed=0)[0].shape
    (10,)

    ``gymnasium.make("rans/GoToPose2D-v0")`` creates it. It has the same episodes as one environment of
    `rans.SpacecraftVectorEnv` and as `rans.reference.flight.DrakeEnv`. Arguments, observations and ``info``
    are those of `rans.episode.environment.Environment`.
    """

    def _mover(self) -> None:
        """None: the equations of `rans.model.dynamics`."""
