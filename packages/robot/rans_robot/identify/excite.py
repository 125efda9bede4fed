"""The most informative commands about a spacecraft, chosen in flight and within a box.

Every command that is held changes velocities by an amount that depends on forces, inertia, centre of mass and
disturbance. The information about these parameters is the sum of the products of its derivatives, which are finite
differences of `motion.py`, each divided by the noise of the readings. Of many random commands the one is given that
increases the determinant of the information most (D-optimal design: Fedorov, Theory of Optimal Experiments, 1972),
among those after which the spacecraft still stays in the box. Where none is, the calmest is given.
"""

from __future__ import annotations

import numpy as np

from rans.extend import Spacecraft
from rans_robot.identify.fit import DIFFERENCE, parameters_of, physics_of
from rans_robot.identify.motion import moved

_CANDIDATES = 256
"""Random commands of which one is given."""
_DENSITIES = (0.125, 0.25, 0.5)
"""Probabilities that a thruster is open in one of them."""
_HOLDS = (1, 2, 4)
"""Control periods for which a command is held: short ones determine delays, long ones forces."""
_RETURN = 0.2
"""1/s: speed towards the middle of the box per distance from it."""
_SPIN = 1.0
"""rad/s: bound on the turn rate; a fifth of a radian between two readings still shows every turn."""
_RADIUS = 0.5
"""m: a rad/s is as undesired as so many m/s."""
_NOISE = 0.01
"""m/s and rad/s: noise of velocities that were measured or fitted."""


class Excitation:
    """Chooses commands, one after the other, for one flight.

    Args:
        craft: spacecraft with thrusters alone.
        period: control period, s.
        side: side of the box, m, whose middle is the origin.
        seed: of the random commands.
    """

    def __init__(self, craft: Spacecraft, period: float, side: float, seed: int) -> None:
        self.craft = craft
        self.period = period
        self.side = side
        self.random = np.random.default_rng(seed)
        self.low = np.array([command.low for command in craft.commands])
        self.command = self.low.copy()
        self.left = 0
        """Control periods for which the command is still held."""
        # Quantities as designed, and each of them changed; a command alone tells nothing about delays.
        nominal, prior = np.array([(one.nominal, one.prior) for one in parameters_of(craft)]).T
        self.size = len(prior) - 2
        self.values = nominal + np.eye(self.size + 1, len(prior), -1) * prior * DIFFERENCE
        self.spread = np.eye(self.size)
        """Covariance of the parameters in units of what was assumed before."""

    def after(
        self, commands: np.ndarray, state: np.ndarray, lasting: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """States (K, columns) after commands (K, n) that are held for a time, s, and what they tell.

        That are derivatives (K, d + turns, P) of velocities by parameters, in units of the noise and of what was
        assumed before. The state (columns,) is one of `predicted`; nothing is remembered.
        """
        count = len(commands)
        physics = physics_of(self.craft, np.repeat(self.values, count, axis=0))
        wrench = np.tile(commands, (len(self.values), 1)) * physics.gain @ self.craft.wrenches
        start = np.tile(state, (len(wrench), 1))
        step = np.full((len(wrench), 1, 1), lasting)
        ends = moved(self.craft, physics, start, wrench[:, None], step)[:, -1]
        ends = ends.reshape(len(self.values), count, -1)
        rates = ends[..., -self.craft.degrees_of_freedom :]
        rows = np.moveaxis(rates[1:] - rates[0], 0, -1) / (DIFFERENCE * np.sqrt(2.0) * _NOISE)
        return ends[0], rows

    def choose(self, state: np.ndarray) -> np.ndarray:
        """Command (n,) of the next control period, for a state (columns,) of `predicted`.

        It remembers command, time left and information. Each flight of a seed has the same candidates, drawn in the
        order density, commands, length.
        """
        if self.left:
            self.left -= 1
            return self.command
        random = self.random
        density = random.choice(_DENSITIES, (_CANDIDATES, 1))
        commands = np.where(random.random((_CANDIDATES, len(self.low))) < density, 1.0, self.low)
        held = int(random.choice(_HOLDS))
        ends, rows = self.after(commands, state, held * self.period)
        # How calm each leaves the craft, and how much it tells.
        d = self.craft.dimension
        rates = ends[:, -self.craft.degrees_of_freedom :]
        drift = np.linalg.norm(rates[:, :d] + _RETURN * ends[:, :d], axis=1)
        turning = np.linalg.norm(rates[:, d:], axis=1)
        calm = (drift <= 0.5 * _RETURN * self.side) & (turning <= _SPIN)
        gained = rows @ self.spread @ rows.mT
        gain = np.linalg.slogdet(np.eye(rows.shape[1]) + gained)[1]
        if calm.any():
            best = int(np.argmax(np.where(calm, gain, -np.inf)))
        else:
            best = int(np.argmin(drift**2 + (_RADIUS * turning) ** 2))
        chosen = rows[best]
        weight = np.linalg.inv(np.eye(len(chosen)) + gained[best])
        across = self.spread @ chosen.T
        self.spread = self.spread - across @ weight @ across.T
        self.command = commands[best]
        self.left = held - 1
        return self.command
