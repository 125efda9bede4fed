"""What estimators in flight are to a policy; installed packages have them.

A policy that adapts has its backbone's (`rans.policy.backbones.Backbone.adaptation`), and computes with it in torch
and as a program that is written, which both are `Rows`. Filters of readings are registered (entry point
``rans.estimators``, name "filters"), and are formulas on fields.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from rans.base.registry import Registry
from rans.model.fields import Field
from rans.tasks.observation_terms import Columns, Layout

Row = TypeVar("Row")


class Rows(Protocol[Row]):
    """What computes with rows (N, k), or (k,) that are the same for all N: torch, or a program that is written."""

    def constant(self, values: object) -> Row:
        """Numbers that are the same for all N, (k,)."""
        ...

    def product(self, row: Row, table: np.ndarray) -> Row:
        """A row (N, k) times a table (k, o)."""
        ...

    def split(self, row: Row, widths: Sequence[int]) -> list[Row]:
        """Pieces of a row of these widths."""
        ...

    def joined(self, rows: Sequence[Row]) -> Row:
        """Rows side by side."""
        ...

    def computed(self, formula: Callable[..., list[Field]], rows: Sequence[Row]) -> list[Row]:
        """A formula applied to every number of rows, which are broadcast against each other."""
        ...

    def largest(self, row: Row, width: int) -> Row:
        """1 at the largest number of a row (N, width), the first of equal ones, and 0 elsewhere."""
        ...


class Estimate(NamedTuple, Generic[Row]):
    """What is estimated after a reading."""

    gains: list[Row]
    """Gain of velocities and gain of angular velocities, (N, 1) each, by the accepted hypothesis."""
    shut: Row
    """(N, thrusters) 1 for a thruster that is taken for lost, else 0."""
    known: list[Row]
    """Rows that the backbone is given, of the names and widths of `Adaptation.known`."""
    memory: Row
    """(N, m) what `Adaptation.next_memory` is given."""


class Adaptation(Protocol):
    """Estimator of one spacecraft. Zeros are its memory where an episode begins."""

    @property
    def twist(self) -> int:
        """Numbers of a twist, with which a reading in B begins."""
        ...

    @property
    def thrusters(self) -> int:
        """Number of thrusters."""
        ...

    @property
    def width(self) -> int:
        """Numbers of the memory."""
        ...

    @property
    def known(self) -> dict[str, int]:
        """Names of the rows `Estimate.known` in a program, and their widths."""
        ...

    def estimated(self, rows: Rows[Row], twist: Row, memory: Row) -> Estimate[Row]:
        """Estimate after a reading of the twist (N, d) in B, and the memory (N, width) of the period before."""
        ...

    def next_memory(self, rows: Rows[Row], estimate: Row, command: Row) -> Row:
        """Memory after an estimate (`Estimate.memory`) and a command from 0 to 1."""
        ...


class Filters(Protocol):
    """Filters of the readings of a policy, which predict them for one spacecraft and task.

    They are a named tuple of numbers and tuples of them, as agents' files hold it. Their class has `read`, of a
    table from a file (`ConfigError`, TypeError: it is damaged), and `of` craft, task, layout of its observations,
    control period (s) and settings of a training (`ConfigError`: no filter follows what the task shows).
    """

    @property
    def extra_columns(self) -> tuple[int, ...]:
        """Columns of each filter's estimate beyond those of the observation."""
        ...

    def width(self, layout: Layout) -> int:
        """Numbers of the memory, for columns of this layout; zeros are the memory where an episode begins."""
        ...

    def estimates(
        self, layout: Layout, read: Columns, memory: Columns
    ) -> list[tuple[Layout, Columns]]:
        """The reading, or what replaces it, and the estimate of every filter, each with its layout.

        Args:
            layout: of the columns of a reading, in the body frame.
            read: columns of the reading.
            memory: (`width`,) fields.
        """
        ...

    def after(
        self, layout: Layout, read: Columns, memory: Columns, command: Columns
    ) -> list[Field]:
        """Memory after a reading and a command (thrusters,) from 0 to 1; other arguments as of `estimates`."""
        ...

    def fits(self, layout: Layout, thrusters: int) -> bool:
        """Whether they have the sizes that this layout, of an observation in B, and these thrusters need.

        Files of strangers come here: whatever is not of these sizes would be an error inside of a flight.
        """
        ...

    def _asdict(self) -> dict[str, Any]: ...


ESTIMATORS: Registry[Any] = Registry("estimator", "rans.estimators")
"""Makers of estimators by their names; see `Filters`."""
