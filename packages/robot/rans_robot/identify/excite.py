"""The most informative commands about a spacecraft, chosen in flight and within a box.

Every command that is held changes velocities by an amount that is linear in the forces, and in small changes of
inertia, centre of mass and disturbance. The information about these parameters is the sum of the products of such
regressors, each divided by the noise of the readings. Of many random commands the one is given that increases the
determinant of the information most (D-optimal design: Fedorov, Theory of Optimal Experiments, 1972), among those
after which the spacecraft still stays in the box. Where none is, the calmest is given.
"""

from __future__ import annotations

import numpy as np

from rans.extend import Spacecraft

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
_FACTOR, _CENTRE, _FORCE = 0.3, 0.03, 0.5
"""Standard deviations assumed before: of factors on forces and inertia, of the centre (m), and of a disturbance
as a part of the strongest thruster."""


class Excitation:
    """Chooses commands, one after the other, for one flight.

    Args:
        craft: spacecraft with thrusters alone.
        period: control period, s.
        side: side of the box, m, whose middle is the origin.
        seed: of the random commands.
    """

    def __init__(self, craft: Spacecraft, period: float, side: float, seed: int) -> None:
        turns = 1 if craft.dimension == 2 else 3
        self.wrenches = wrenches = craft.wrenches
        self.inertia = inertia = np.array(craft.inertia)[3 - turns :, 3 - turns :]
        self.low = low = np.array([command.low for command in craft.commands])
        self.period = period
        self.side = side
        self.d = wrenches.shape[1] - turns
        self.random = np.random.default_rng(seed)
        self.command = low.copy()
        self.left = 0
        """Control periods for which the command is still held."""
        n = len(wrenches)
        strongest = float(np.max(np.linalg.norm(wrenches[:, : self.d], axis=1)))
        lever = float(np.max(np.linalg.norm(wrenches[:, self.d :], axis=1)))
        self.per_wrench = np.zeros((self.d + turns, self.d + turns))
        """Acceleration of a wrench in B."""
        self.per_wrench[: self.d, : self.d] = np.eye(self.d) / craft.mass
        self.per_wrench[self.d :, self.d :] = np.linalg.inv(inertia)
        # Regressors that do not depend on the command: forces have one each, a disturbance one an axis.
        self.of_forces = _FACTOR * (self.per_wrench @ wrenches.T)
        self.of_push = self.per_wrench @ np.diag(
            [_FORCE * strongest] * self.d + [_FORCE * lever] * turns
        )
        self.size = n + turns * (turns + 1) // 2 + self.d + self.d + turns
        self.spread = np.eye(self.size)
        """Covariance of the parameters in units of what was assumed before."""

    def regressors(self, commands: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Derivatives (K, d + turns, P) of accelerations under commands (K, n) in an attitude.

        Accelerations are in B, with the rotation (d, d) from B to W. It changes nothing but its own tables.
        """
        count = len(commands)
        turns = len(self.inertia)
        wrench = commands @ self.wrenches
        acceleration = wrench @ self.per_wrench.T
        result = np.zeros((count, self.d + turns, self.size))
        n = len(self.wrenches)
        result[:, :, :n] = self.of_forces * commands[:, None, :]
        at = n
        inverse = self.per_wrench[self.d :, self.d :]
        for i in range(turns):
            for j in range(i, turns):
                change = np.zeros((turns, turns))
                change[i, j] = change[j, i] = _FACTOR * np.sqrt(
                    self.inertia[i, i] * self.inertia[j, j]
                )
                result[:, self.d :, at] = -acceleration[:, self.d :] @ (inverse @ change).T
                at += 1
        # A centre that lies elsewhere shortens levers: the torque changes by minus its offset times the force.
        force = np.zeros((count, 3))
        force[:, : self.d] = wrench[:, : self.d]
        for i in range(self.d):
            torque = -np.cross(_CENTRE * np.eye(3)[i], force)[:, 3 - turns :]
            result[:, self.d :, at] = torque @ inverse.T
            at += 1
        back = np.eye(self.d + turns)
        back[: self.d, : self.d] = rotation.T
        if turns == 3:
            back[self.d :, self.d :] = rotation.T
        result[:, :, at:] = self.of_push @ back
        return result

    def choose(
        self, position: np.ndarray, rotation: np.ndarray, velocity: np.ndarray, spin: np.ndarray
    ) -> np.ndarray:
        """Command (n,) of the next control period, for a position (d,) and velocity (d,) in W.

        The rotation (d, d) takes B to W, and the spin is in B. It remembers command, time left and information.

        Each flight of a seed has the same candidates, drawn in the order density, commands, length.
        """
        if self.left:
            self.left -= 1
            return self.command
        random = self.random
        n = len(self.wrenches)
        density = random.choice(_DENSITIES, (_CANDIDATES, 1))
        commands = np.where(random.random((_CANDIDATES, n)) < density, 1.0, self.low)
        held = int(random.choice(_HOLDS))
        lasting = held * self.period
        acceleration = (commands @ self.wrenches) @ self.per_wrench.T
        pushed = acceleration[:, : self.d] @ rotation.T
        after = position + lasting * velocity + 0.5 * lasting**2 * pushed
        drift = np.linalg.norm(velocity + lasting * pushed + _RETURN * after, axis=1)
        turning = np.linalg.norm(spin + lasting * acceleration[:, self.d :], axis=1)
        calm = drift <= 0.5 * _RETURN * self.side
        calm &= turning <= _SPIN
        rows = self.regressors(commands, rotation) * (lasting / (np.sqrt(2.0) * _NOISE))
        gained = rows @ self.spread @ rows.swapaxes(1, 2)
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
