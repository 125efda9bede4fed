"""Preprocessors: which columns a policy is given of those that a task observes.

A preprocessor is one class here and its name in `PREPROCESSORS`. Its columns are a formula on fields, which torch,
machine code, CUDA kernels and exported files all compute.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from rans.model.fields import Field
from rans.tasks.observation_terms import Columns, Layout


class Preprocessor(ABC):
    """Makes columns of observations."""

    views_and_filters: bool = False
    """Whether its columns are those of the body frame, which symmetries and filters are for."""

    @abstractmethod
    def layout(self, observed: Layout) -> Layout:
        """What its columns are, of observations of this layout."""

    @abstractmethod
    def columns(self, observed: Layout, row: Columns) -> list[Field]:
        """Its columns, of those of an observation."""


class BodyFrame(Preprocessor):
    """Vectors in the frame of the spacecraft, in which its own attitude is the same always (decision 004)."""

    views_and_filters = True

    def layout(self, observed: Layout) -> Layout:
        """See `Preprocessor`."""
        return observed.body

    def columns(self, observed: Layout, row: Columns) -> list[Field]:
        """See `Preprocessor`."""
        return observed.in_body(row)


class WorldFrame(Preprocessor):
    """Columns as they are observed: vectors in the world frame, beside the attitude."""

    def layout(self, observed: Layout) -> Layout:
        """See `Preprocessor`."""
        return observed

    def columns(self, observed: Layout, row: Columns) -> list[Field]:
        """See `Preprocessor`."""
        return list(row)


PREPROCESSORS: dict[str, Preprocessor] = {"body": BodyFrame(), "world": WorldFrame()}
"""By their names in settings and agents' files."""
