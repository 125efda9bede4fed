"""Views of a policy's architecture and network, which its parts, such as backbones, depend on."""

from __future__ import annotations

from typing import Protocol

from torch import Tensor

from rans.model.fields import Field
from rans.policy.adaptation import Adaptation
from rans.policy.frugality import Frugality
from rans.policy.heads import Head
from rans.tasks.observation_terms import Columns, Layout


class ArchitectureView(Protocol):
    """Sizes and kinds of a policy's layers; `rans.policy.architecture.Architecture` has them."""

    @property
    def features(self) -> int:
        """Numbers of the last hidden layer."""
        ...

    @property
    def thrusters(self) -> int:
        """Number of commands."""
        ...

    @property
    def outputs(self) -> int:
        """Outputs of the actor's last layer."""
        ...

    @property
    def last(self) -> Head:
        """The head, which says what these outputs mean."""
        ...

    @property
    def activation(self) -> str:
        """Key of `rans.policy.activations.ACTIVATIONS`."""
        ...

    @property
    def tokens(self) -> tuple[tuple[float, ...], ...]:
        """A description of each effector, see `rans.policy.any_craft.effects`."""
        ...

    @property
    def authority(self) -> tuple[float, ...]:
        """See `rans.policy.architecture.Architecture`; empty for a network of one craft alone."""
        ...

    @property
    def frugality(self) -> Frugality:
        """See `rans.policy.architecture.Architecture`."""
        ...

    @property
    def farthest(self) -> float:
        """See `rans.policy.architecture.Architecture`."""
        ...

    @property
    def farthest_lost(self) -> float:
        """See `rans.policy.architecture.Architecture`."""
        ...

    @property
    def adapts(self) -> bool:
        """Whether features are followed by what is estimated in flight, see `rans.policy.adaptation`."""
        ...

    @property
    def filling(self) -> tuple[float, ...]:
        """See `rans.policy.architecture.Architecture`."""
        ...


class PreprocessingView(Protocol):
    """Formulas of a policy's columns; `rans.policy.architecture.Architecture` has them."""

    @property
    def adapts(self) -> bool:
        """Whether columns depend on what is estimated in flight (`rans.policy.adaptation`)."""
        ...

    @property
    def adaptation(self) -> Adaptation:
        """Estimator of a policy that adapts."""
        ...

    @property
    def read_count(self) -> int:
        """Columns of a reading in the body frame."""
        ...

    def adapted(self, read: Columns, gains: Columns, lost: Field = 0.0) -> list[Field]:
        """Columns of a reading in the body frame, by the estimated gains; ``lost`` is 1 without a thruster."""
        ...

    def preprocessed(self, observation: Columns) -> list[Field]:
        """Columns of the preprocessor, from those of an observation."""
        ...

    def filtered(self, row: Columns) -> list[tuple[Layout, Columns]]:
        """Blocks of columns that the network is given, each with its layout, from a row with filters' memory."""
        ...

    def ahead(self, columns: Columns) -> Columns | None:
        """Direction in columns that selects a side of the spacecraft; None where all sides are the same."""
        ...

    def next_filter_memory(self, row: Columns) -> list[Field]:
        """Memory of filters after a row."""
        ...


class NetworkView(Protocol):
    """Weights of a policy in torch; `rans.policy.network.Network` has them."""

    @property
    def architecture(self) -> ArchitectureView:
        """Sizes and kinds of its layers."""
        ...

    @property
    def tables(self) -> tuple[Tensor, ...]:
        """Constants of its backbone, see `rans.policy.backbones.Backbone.tables`."""
        ...

    def layer(self, name: str) -> tuple[Tensor, Tensor]:
        """Weight and bias of a layer, by its name in ``tensors``."""
        ...
