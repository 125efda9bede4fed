"""An oracle for RAFT's protocol: a controller without training that knows every fault.

It knows what each set of open thrusters gives with the faults as they are, and opens the set that is nearest to
what a proportional-derivative law wants. It does not plan, and it does not spin the craft.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rans.model.spacecraft import Spacecraft

DIRECTIONS = 12
"""Directions in the plane of which it is asked how hard the craft can be pushed; an even number."""
_GAIN = 0.5
"""1/s: of the approach's speed with the distance."""
_BRAKING = 0.9
"""Share of the speed from which the craft can brake within the distance."""
_REACTION = 0.5
"""s in which a wrong velocity is corrected."""
_SHARE = 0.7
"""Share of the balanced acceleration that the law asks for; the rest is left for turning."""
_LEVER = 0.1
"""m: how much a rad/s^2 counts beside a m/s^2."""
_OWED = (0.4, 0.4, 4.0)
"""m/s^2 and rad/s^2: bounds of what is carried to the next control period."""
_LEAST = 0.004
"""m/s^2 that the law counts on where the craft can be pushed less."""


def patterns(thrusters: int) -> np.ndarray:
    """(2^n, n): every set of open thrusters, as zeros and ones."""
    numbers = np.arange(2**thrusters)[:, None]
    return (numbers >> np.arange(thrusters) & 1).astype(float)


def effects(craft: Spacecraft, gain: np.ndarray, leak: np.ndarray) -> np.ndarray:
    """(N, 2^n, 3): acceleration in B, m/s^2 and rad/s^2, of every set of open thrusters.

    Gains and leaks are (N, n), see `rans.model.body.Body`; a shared supply gives one thruster's worth.
    """
    scale = np.array([craft.mass, craft.mass, craft.inertia[2][2]])
    table = np.array(craft.wrench_map) / scale
    opened = patterns(len(craft.thrusters))
    found = []
    for one_gain, one_leak in zip(gain, leak, strict=True):
        flow = opened * one_gain + one_leak
        if craft.thrust_sharing == "split":
            flow = flow / np.maximum(flow.sum(axis=1, keepdims=True), 1.0)
        found.append(flow @ table)
    return np.array(found)


def balanced_reach(effect: np.ndarray, wheel: float = 0.0) -> np.ndarray:
    """(12,) how hard the craft can be pushed in each direction of B while nothing turns it, on average, m/s^2.

    Sets of open thrusters by turns give on average what lies between their effects. The greatest force without a
    torque is given by two of them: it is a linear programme with two equations. Without any such two: -inf.

    Args:
        effect: (P, 3) acceleration of every set of open thrusters.
        wheel: largest angular acceleration of a reaction wheel either way, rad/s^2.
    """
    angles = np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS)
    directions = np.stack([np.cos(angles), np.sin(angles)])
    if wheel > 0.0:
        turned = np.array([0.0, 0.0, wheel])
        effect = np.concatenate([effect + turned, effect - turned])
    effect = np.unique(np.round(effect, 6), axis=0)
    left = effect[effect[:, 2] >= 0.0]
    right = effect[effect[:, 2] <= 0.0]
    if not len(left) or not len(right):
        return np.full(DIRECTIONS, -np.inf)
    apart = left[:, None, 2] - right[None, :, 2]
    # Neither turns the craft: each alone is balanced, and any share will do.
    share = np.where(apart > 1e-9, -right[None, :, 2] / np.maximum(apart, 1e-9), 1.0)
    first = left[:, :2] @ directions
    second = right[:, :2] @ directions
    mixed = share[:, :, None] * first[:, None] + (1.0 - share[:, :, None]) * second[None]
    return mixed.max(axis=(0, 1))


class Oracle:
    """A controller (`rans.flight.Controller`) of craft whose faults it knows from the moment when they begin."""

    name = "oracle"

    def __init__(self, craft: Spacecraft, gain: np.ndarray, leak: np.ndarray, begins: int) -> None:
        """Make the law for N craft.

        Args:
            craft: spacecraft as designed.
            gain: share of its force that each thruster gives when open, (N, n).
            leak: share of its force that each thruster always gives, (N, n).
            begins: number of the control period in which the faults begin.
        """
        self._patterns = patterns(len(craft.thrusters))
        self._wheel = 0.0
        if craft.wheels:
            self._wheel = abs(craft.wheel_map[0][0]) / craft.inertia[2][2]
        sound = effects(craft, np.ones((1, gain.shape[1])), np.zeros((1, gain.shape[1])))
        broken = effects(craft, gain, leak)
        self._effects = sound.astype(np.float32), broken.astype(np.float32)
        self._reach = tuple(
            np.array([balanced_reach(one, self._wheel).min() for one in each])
            for each in (sound, broken)
        )
        self._begins = begins
        self._turns = 1.0
        if craft.wheels:
            self._turns = np.sign(craft.wheel_map[0][0])
        self._step = 0
        self._owed = np.zeros((0, 3))

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._owed = np.zeros((count, 3))
        self._step = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; looks at the state, not at the observation."""
        broken = int(self._step >= self._begins)
        self._step += 1
        effect = self._effects[broken]
        reach = np.maximum(self._reach[broken], _LEAST)

        # A speed towards the goal from which the craft can brake, and the acceleration in B that brings it.
        x = np.asarray(goal.p.x - state.p.x)
        y = np.asarray(goal.p.y - state.p.y)
        distance = np.hypot(x, y) + 1e-9
        speed = np.minimum(_GAIN * distance, _BRAKING * np.sqrt(2.0 * reach * distance))
        push_x = (speed * x / distance - state.v.x) / _REACTION
        push_y = (speed * y / distance - state.v.y) / _REACTION
        within = np.minimum(1.0, _SHARE * reach / (np.hypot(push_x, push_y) + 1e-9))
        cos = np.cos(state.attitude.angle)
        sin = np.sin(state.attitude.angle)
        spin = np.asarray(state.spin()[0])
        wanted = np.stack(
            [
                (cos * push_x + sin * push_y) * within,
                (cos * push_y - sin * push_x) * within,
                0.5 * np.clip(-spin / _REACTION, -1.0, 1.0),
            ],
            axis=1,
        )

        # The set of thrusters nearest to what is owed, after what the wheel can make up for.
        self._owed = self._owed + wanted
        gap = self._owed[:, None].astype(np.float32) - effect
        if self._wheel:
            gap[:, :, 2] -= np.clip(gap[:, :, 2], -self._wheel, self._wheel)
        gap[:, :, 2] *= _LEVER
        cost = np.einsum("npk,npk->np", gap, gap) + 1e-7 * self._patterns.sum(axis=1)
        best = cost.argmin(axis=1)
        rows = np.arange(len(best)) if len(effect) > 1 else 0
        owed = self._owed - effect[rows, best]
        command = self._patterns[best]
        if self._wheel:
            turn = np.clip(owed[:, 2] / self._wheel, -1.0, 1.0)
            owed[:, 2] -= turn * self._wheel
            command = np.column_stack([command, turn * self._turns])
        self._owed = np.clip(owed, -np.array(_OWED), _OWED)
        return command
