"""A bank of Kalman filters, which trust the designed craft more or less, as agents keep it.

After Magill, "Optimal adaptive estimation of sampled stochastic processes", 1965; which to believe is left to
the network (docs/decisions/robustness.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from rans.effectors.commands import allowed, is_identity
from rans.errors import ConfigError
from rans.model.spacecraft import Spacecraft
from rans.policy.kalman_filter import Filter
from rans.policy.kinematic_roles import Share, shares
from rans.tasks.base import Task
from rans.tasks.observation_terms import Layout


class Filters(NamedTuple):
    """Of one spacecraft and task; what they have in common, and the variances of each, see `Filter`."""

    drift: tuple[float, ...]
    period: float
    """s."""
    push: tuple[tuple[float, ...], ...]
    twist: tuple[tuple[float, ...], ...]
    share: tuple[Share, ...]
    steady: tuple[float, ...] = ()
    """Without: 0 of each."""
    response: tuple[float, ...] = ()
    """Without: 0 of each."""
    gate: float = 0.0
    """Error up to which a reading is believed, see `rans.policy.measurement_gate`; 0: every reading counts
    as it came, a repeated one too."""

    @classmethod
    def of(
        cls,
        craft: Spacecraft,
        task: Task,
        period: float,
        drift: Sequence[float],
        steady: Sequence[float] = (),
        response: Sequence[float] = (),
        gate: float = 0.0,
    ) -> Filters:
        """Design the filters of a spacecraft; ConfigError where none can follow its observation or commands."""
        if not is_identity(craft):
            raise ConfigError(
                f"filters follow thrusters whose commands are from 0 to 1, and {craft.name!r} takes "
                f'{allowed(craft)}: train without filters, with memory="history".'
            )
        force, torque = np.split(np.array(craft.wrench_map), [craft.dimension], axis=1)
        spins = slice(-torque.shape[1], None)  # in the plane about z alone
        inertia = np.array(craft.inertia)[spins, spins]
        gains = period / craft.mass * force, period * np.linalg.solve(inertia, torque.T).T
        push, twist = (tuple(map(tuple, gain.tolist())) for gain in gains)
        drift, steady, response = (tuple(map(float, x)) for x in (drift, steady, response))
        return cls(
            drift,
            period,
            push,
            twist,
            tuple(shares(task, craft.dimension)),
            steady,
            response,
            float(gate),
        )

    @property
    def each(self) -> tuple[Filter, ...]:
        """The filters."""
        return tuple(
            Filter(drift, values, answer, self.period, self.push, self.twist, self.share)
            for drift, values, answer in zip_longest(
                self.drift, self.steady, self.response, fillvalue=0.0
            )
        )

    def fits(self, layout: Layout, thrusters: int) -> bool:
        """Whether it has as many rows and numbers as that takes."""
        axes, spins = (block.width for block in layout.blocks[:2])
        sizes = (thrusters, axes), (thrusters, spins), (len(layout.blocks), 3)
        count = len(self.drift)
        consistent = (
            count > 0
            and np.shape(self.drift) == (count,)
            and np.shape(self.steady) in ((0,), (count,))
            and np.shape(self.response) in ((0,), (count,))
        )
        numbers = isinstance(self.period, float) and isinstance(self.gate, float)
        numbers = numbers and (self.gate == 0.0 or 1e-6 <= self.gate <= 1e6)
        return consistent and numbers and tuple(map(np.shape, self[2:5])) == sizes
