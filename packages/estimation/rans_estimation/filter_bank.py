"""A bank of Kalman filters with different process noise, which trust the designed craft more or less.

After Magill, "Optimal adaptive estimation of sampled stochastic processes", 1965; the network weighs their
estimates itself (docs/decisions/learning.md).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import accumulate, pairwise, zip_longest
from typing import Any, NamedTuple

import numpy as np

from rans import PPOSettings
from rans.extend import Columns, ConfigError, Field, Layout, Spacecraft, Task
from rans_estimation.kalman_filter import Filter
from rans_estimation.kinematic_roles import Sensitivity, sensitivities
from rans_estimation.measurement_gate import GatedReading, GateMemory, gated_reading


class Filters(NamedTuple):
    """A bank of filters for one spacecraft and task, as agents' files hold it under these names.

    The filters have their period, gains and sensitivities in common and differ in three variances, each with an
    entry for every filter.
    """

    drift: tuple[float, ...]
    """(filters,), see `Filter.drift`."""
    period: float
    """Control period, s."""
    push: tuple[tuple[float, ...], ...]
    """(thrusters, axes), m/s, see `Filter.push`."""
    twist: tuple[tuple[float, ...], ...]
    """(thrusters, axes), rad/s, see `Filter.twist`."""
    share: tuple[Sensitivity, ...]
    """(blocks,), see `Filter.sensitivities`."""
    steady: tuple[float, ...]
    """(filters,), see `Filter.steady`; empty: 0 for each."""
    response: tuple[float, ...]
    """(filters,), see `Filter.response`; empty: 0 for each."""
    gate: float
    """Threshold of a reading's innovation, see `rans_estimation.measurement_gate`."""

    @classmethod
    def of(
        cls,
        craft: Spacecraft,
        task: Task,
        layout: Layout,
        period: float,
        settings: PPOSettings,
    ) -> Filters:
        """Filters of a training (`rans.policy.adaptation.Filters`)."""
        force, torque = np.split(craft.wrenches, [craft.dimension], axis=1)
        spins = slice(-torque.shape[1], None)  # in the plane about z alone
        inertia = np.array(craft.inertia)[spins, spins]
        gains = period / craft.mass * force, period * np.linalg.solve(inertia, torque.T).T
        push, twist = (tuple(map(tuple, gain.tolist())) for gain in gains)
        chosen = settings.filters
        drift, response = (tuple(map(float, x)) for x in (chosen.drift, chosen.response))
        return cls(
            drift,
            period,
            push,
            twist,
            tuple(sensitivities(task, layout.body, craft.dimension)),
            tuple(chosen.steady * bool(x) for x in response),
            response,
            chosen.gate,
        )

    @classmethod
    def read(cls, table: dict[str, Any]) -> Filters:
        """Filters of an agent's file, as `_asdict` has them; tables of before lack some names.

        Raises:
            ConfigError: they are of a kind that only earlier versions had.
            TypeError: a name is missing or unknown.
        """
        table = {"steady": [], "response": [], "gate": 0.0} | table
        found = cls(**{name: _numbers(value) for name, value in table.items()})
        estimated = [np.ravel(x).astype(bool).tolist() for x in (found.steady, found.response)]
        if estimated[0] != estimated[1] or found.gate == 0.0:
            raise ConfigError(
                "the agent has Kalman filters without a gate, or some that estimate steady accelerations or the "
                "thrusters' response alone, as versions of RANS before 0.3 wrote them, which this one does not "
                "read: train it anew."
            )
        return found

    @property
    def extra_columns(self) -> tuple[int, ...]:
        """Numbers beside the columns that each filter of the bank gives, see `Filter.extra_columns`."""
        return tuple(one.extra_columns for one in self.each)

    @property
    def each(self) -> tuple[Filter, ...]:
        """The filters, in the order in which their estimates follow one another in an observation.

        Shorter lists are filled with 0: no such effect.
        """
        return tuple(
            Filter(
                drift=drift,
                steady=steady,
                response=response,
                period=self.period,
                push=self.push,
                twist=self.twist,
                sensitivities=self.share,
            )
            for drift, steady, response in zip_longest(
                self.drift, self.steady, self.response, fillvalue=0.0
            )
        )

    def width(self, layout: Layout) -> int:
        """Numbers of the memory of all filters, then of the gate, for columns of this layout."""
        return sum(filter_.width(layout) for filter_ in self.each) + GateMemory.width(layout)

    def estimates(
        self, layout: Layout, read: Columns, memory: Columns
    ) -> list[tuple[Layout, Columns]]:
        """The reading behind the gate and the estimate of every filter, each with its layout.

        Args:
            layout: of the columns of a reading, in the body frame.
            read: columns of the reading.
            memory: (`width`,) of the filters and of the gate.
        """
        gated = self._gated(layout, read, memory).columns
        return [
            (layout, gated),
            *(
                (filter_.layout(layout), filter_.estimate(layout, gated, own_memory))
                for filter_, own_memory in self._with_memory(layout, memory)
            ),
        ]

    def after(
        self, layout: Layout, read: Columns, memory: Columns, command: Columns
    ) -> list[Field]:
        """Memory after a reading and a command (thrusters,); other arguments as of `estimates`.

        Its order is that of `estimates`.
        """
        reading = self._gated(layout, read, memory)
        with_memory = list(self._with_memory(layout, memory))
        after = [
            x
            for filter_, own_memory in with_memory
            for x in filter_.next_memory(layout, reading.columns, own_memory, command)
        ]
        last, own_memory = with_memory[-1]
        predicted = last.predicted_reading(
            layout, reading.columns, own_memory, command, reading.noise_evidence
        )
        gate = self._gate_memory(layout, memory)
        return after + gate.after(read, reading, predicted, command)

    def _with_memory(self, layout: Layout, memory: Columns) -> Iterator[tuple[Filter, Columns]]:
        """Each filter with its part of the memory."""
        ends = accumulate((filter_.width(layout) for filter_ in self.each), initial=0)
        return (
            (filter_, memory[a:b])
            for filter_, (a, b) in zip(self.each, pairwise(ends), strict=True)
        )

    def _gated(self, layout: Layout, read: Columns, memory: Columns) -> GatedReading:
        """The reading behind the gate, whose prediction is that of the last filter, the best informed."""
        last, own_memory = list(self._with_memory(layout, memory))[-1]
        is_first = last.is_first(layout, own_memory)
        gate = self._gate_memory(layout, memory)
        return gated_reading(layout, read, gate, last, self.gate, is_first)

    def _gate_memory(self, layout: Layout, memory: Columns) -> GateMemory:
        """The gate's part of the memory, its last fields."""
        return GateMemory.unpacked(layout, memory[-GateMemory.width(layout) :])

    def fits(self, layout: Layout, thrusters: int) -> bool:
        """Whether the bank has the sizes that this layout, of an observation in B, and these thrusters need.

        Files of strangers come here: whatever is not of these sizes would be an error inside of a flight.
        """
        axes, spins = (block.width for block in layout.blocks[:2])
        sizes = (thrusters, axes), (thrusters, spins), (len(layout.blocks), 3)
        count = len(self.drift)
        consistent = (
            count > 0
            and np.shape(self.drift) == (count,)
            and np.shape(self.steady) == np.shape(self.response)
            and np.shape(self.response) in ((0,), (count,))
        )
        numbers = isinstance(self.period, float) and isinstance(self.gate, float)
        numbers = numbers and 1e-6 <= self.gate <= 1e6
        return consistent and numbers and tuple(map(np.shape, self[2:5])) == sizes


def _numbers(value: Any) -> Any:
    """Number, or nested tuples of numbers for lists."""
    return tuple(map(_numbers, value)) if isinstance(value, list) else float(value)
