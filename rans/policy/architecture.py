"""Architecture of a policy's network, and its initial weights.

Its fields are stored in every agent's file: a new one needs a default that is what older agents do.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from rans.base.errors import ConfigError, brief
from rans.model.fields import Field
from rans.model.spacecraft import Spacecraft
from rans.policy.activations import ACTIVATIONS
from rans.policy.adaptation import Adaptation, Filters
from rans.policy.backbone_registry import backbone
from rans.policy.heads import HEADS, Head
from rans.policy.program import Program
from rans.policy.symmetry import Symmetries
from rans.tasks.observation_terms import Columns, Layout

Tokens = tuple[tuple[float, ...], ...]
"""What each effector of a craft is, by the numbers that a backbone needs."""


EXTRACTOR = "features_extractor."
"""Where SB3's policies have everything before the two heads."""


@dataclass(frozen=True, eq=False)
class Architecture:
    """Description of a network that gives its weights their meaning."""

    layout: Layout
    """Which columns of an observation are what."""
    thrusters: int
    """Outputs: one for each command of the craft, 0 to 1 (`rans.effectors.commands.of_outputs`)."""
    layers: tuple[int, ...] = (64, 64)
    """Units of each hidden layer."""
    activation: str = "tanh"
    """Key of `rans.policy.activations.ACTIVATIONS`."""
    zoom: float = 0.0
    """Magnification of a second look at every column, squashed by tanh, so that a centimetre is as plain to
    see as a metre (docs/decisions/learning.md). 0: no second look."""
    symmetries: Symmetries | None = None
    """Of the spacecraft: every state is seen from the one of its equivalent sides that has the goal ahead
    (docs/decisions/learning.md)."""
    bf16: bool = False
    """Whether on a GPU the hidden layers' products are of bfloat16."""
    head: str = "on-off"
    """Key of `rans.policy.heads.HEADS`: what the last layer's outputs mean for the commands."""
    backbone: str = "dense"
    """Name in `rans.policy.backbone_registry.BACKBONES`: how features become the commands' outputs."""
    tokens: tuple[tuple[float, ...], ...] = ()
    """What each effector is, for a backbone that is given that (`rans.policy.backbones.Backbone.tokens`)."""
    authority: tuple[float, ...] = ()
    """Control period (s), and largest accelerations along +x, -x, +y, -y (m/s^2) and about +z, -z (rad/s^2), of a
    network for any craft, whose columns are made by them; empty for others. In the plane the linear ones are
    possible in all directions within 45 degrees of the axis."""
    coast: float = 0.0
    """Control periods for which such a network coasts near the goal; 0: it never does, as networks of earlier
    versions."""
    farthest: float = 0.0
    """Distance (m) at which such a network is given a goal that is farther, as wheels would be full at the speeds
    of longer ways; 0: no bound."""
    farthest_lost: float = 0.0
    """Largest distance of the goal, m, once a network that adapts takes a thruster for lost; 0: no bound."""
    frugal: tuple[float, ...] = ()
    """Numbers by which such a network trades time for thrust; empty: it flies as it was trained."""
    reach: tuple[float, ...] = ()
    """Accelerations along the axes of B, both ways, and between them, m/s^2, that such a network in the plane is
    given; empty: it takes the least one of `authority` for possible along all."""
    filling: tuple[float, ...] = ()
    """Part of the momentum at which each wheel is full that its full command adds in a control period, for a
    network that remembers momenta; empty: it does not."""
    adapts: bool = False
    """Whether such a network estimates in flight how its craft differs from its file (`rans.policy.adaptation`)."""
    history: int = 0
    """How many last columns and commands the network is shown."""
    commands_only: bool = False
    """Whether those are commands without the columns that they answered."""
    averages: tuple[float, ...] = ()
    """Besides, exponential moving averages of all of them: the share that each keeps from step to step."""
    filters: Filters | None = None
    """Besides, what each of a bank of Kalman filters makes of the columns (docs/decisions/learning.md)."""
    privileged: int = 0
    """Numbers that only the critic, which then has a trunk of its own, is given."""
    nominal: tuple[float, ...] = ()
    """Those of the spacecraft as designed, for where it is given none; older files have ones instead."""
    clip: float = 10.0
    """Bound of a normalised column."""
    bounds: tuple[float, ...] = ()
    """Of the columns' absolute values, for whoever asks for a space; without them, those of float32."""

    def check_width(self, who: str, observation: np.ndarray) -> None:
        """Refuse (`ConfigError`) observations (..., width) of another width than the network's, by ``who``."""
        width = self.layout.width
        shape = np.shape(observation)
        if shape[-1:] != (width,):
            trained = shape[-1] if shape else "one"
            raise ConfigError(
                f"{who} observes {width} numbers, but was shown {trained}: it was trained "
                "for another task or for the other dimension."
            )

    def activation_module(self) -> nn.Module:
        """The function between layers."""
        return getattr(nn, ACTIVATIONS[self.activation].module)()

    @property
    def last(self) -> Head:
        """Head that gives the last layer's outputs their meaning."""
        return HEADS[self.head]

    @property
    def outputs(self) -> int:
        """Numbers that the actor's last layer gives."""
        return self.last.outputs * self.thrusters

    @property
    def continuous(self) -> bool:
        """Whether commands are numbers from 0 to 1, instead of 0 or 1."""
        return self.last.continuous

    @property
    def column_count(self) -> int:
        """Columns that the network is given of an observation."""
        return self.columns.width

    @property
    def read_count(self) -> int:
        """Columns of a reading, from which and from the memory those of the network are made."""
        return self.layout.body.width if self.adapts else self.column_count

    @cached_property
    def kind(self) -> Backbone:
        """What its backbone's name stands for; it is looked up before torch compiles, which cannot trace that."""
        return backbone(self.backbone)

    @property
    def adaptation(self) -> Adaptation:
        """Estimator of a network that adapts."""
        return self.kind.adaptation(self)

    @property
    def columns(self) -> Layout:
        """Layout of the columns: vectors are in the frame of the spacecraft (docs/decisions/learning.md)."""
        return self.kind.columns(self)

    def preprocessed(self, observation: Columns) -> list[Field]:
        """Columns of a reading (`read_count`), of those of an observation; all are fields, as everywhere here."""
        return self.kind.preprocessed(self, observation)

    def ahead(self, columns: Columns) -> Columns | None:
        """The way to go, of them, that chooses a side of the spacecraft; None where all sides are one."""
        return None if self.symmetries is None else self.columns.ahead(columns)

    @property
    def memory(self) -> int:
        """Numbers that the network remembers of a spacecraft from step to step."""
        return self.rows + self.filtering

    @property
    def rows(self) -> int:
        """Number of memory rows that hold a history."""
        return self.recalled * self.row

    @property
    def answered(self) -> int:
        """Columns in a row of a history, before the command that answered them."""
        return 0 if self.commands_only else self.column_count

    @property
    def row(self) -> int:
        """Numbers in a row of a history."""
        return self.answered + self.thrusters

    @property
    def filtering(self) -> int:
        """Numbers of the memory for the filters, or for the estimator of a network that adapts; they come last."""
        if self.adapts:
            return self.adaptation.width
        return self.filters.width(self.columns) if self.filters else 0

    @property
    def extra_columns(self) -> tuple[int, ...]:
        """Numbers beside the columns: as they are read, which is none, then as each filter has them."""
        return 0, *(self.filters.extra_columns if self.filters else ())

    @property
    def preprocessed_width(self) -> int:
        """Numbers of a filtered observation: columns as read and as each filter has them, or what is estimated."""
        if self.adapts:
            return self.column_count + sum(self.adaptation.known.values())
        return len(self.extra_columns) * self.column_count + sum(self.extra_columns)

    @property
    def inputs(self) -> int:
        """Numbers that the trunk is given."""
        return (
            len(self.extra_columns) * self.column_count * (2 if self.zoom else 1)
            + sum(self.extra_columns)
            + self.rows
        )

    @property
    def recalled(self) -> int:
        """Number of past columns and commands, single or averaged, that a network with a history observes."""
        return self.history + len(self.averages)

    @property
    def features(self) -> int:
        """Width of what actor and critic are heads on."""
        return self.layers[-1]

    def filtered(self, row: Columns) -> list[tuple[Layout, Columns]]:
        """The gated reading, which is always the first, and the estimate of every filter, each with its layout.

        Torch's network (`rans.policy.preprocess`) and the printed programs (`rans.policy.traced`) both take their
        input from this list, in this order.

        Args:
            row: columns of a reading in B, then the filters' memory.
        """
        read, memory = row[: self.column_count], row[self.column_count :]
        if self.filters is None:
            return [(self.columns, list(read))]
        return self.filters.estimates(self.columns, read, memory)

    def next_filter_memory(self, row: Columns) -> list[Field]:
        """Memory of the filters and of the gate after a reading and a command.

        Args:
            row: columns of a reading in B, the filters' memory, and the command (thrusters,).
        """
        ends = self.column_count, self.column_count + self.filtering
        read, memory, command = row[: ends[0]], row[ends[0] : ends[1]], row[ends[1] :]
        return (
            [] if self.filters is None else self.filters.after(self.columns, read, memory, command)
        )

    def modules(self) -> dict[str, nn.Module]:
        """Modules before the heads, in the order of SB3, with torch's initial weights.

        Names become those of tensors in agents' files.
        """
        modules: dict[str, nn.Module] = {"trunk": self._layers(self.inputs, self.layers)}
        if self.privileged:
            modules["critic"] = self._layers(
                self.inputs + self.privileged, (*self.layers[:-1], self.features)
            )
        return modules

    def _layers(self, width: int, layers: Sequence[int]) -> nn.Sequential:
        """Dense layers with an activation after each; their order decides the names of weights in files."""
        return nn.Sequential(
            *(
                module
                for i, o in pairwise((width, *layers))
                for module in (nn.Linear(i, o), self.activation_module())
            )
        )

    def statistics(self) -> dict[str, Tensor]:
        """Statistics of observations before any observation was made."""
        return {
            "mean": torch.zeros(self.column_count),
            "variance": torch.ones(self.column_count),
            "count": torch.zeros(()),
        }

    def parts(self) -> dict[str, nn.Module]:
        """Everything that is learnt, by how its names begin, in the order of SB3."""
        rows = self.kind.rows(self)
        return {
            EXTRACTOR: nn.ModuleDict(self.modules()),
            "action_net.": nn.Linear(self.features, rows),
            "value_net.": nn.Linear(self.features, 1),
        }

    def shapes(self) -> dict[str, torch.Size]:
        """Shape of every weight and statistic by its name, in the order of `initial`; nothing is allocated."""
        with torch.device("meta"):
            result = {"log_std": torch.Size((self.thrusters,))} if self.last.spread else {}
            for prefix, part in self.parts().items():
                result |= {prefix + name: value.shape for name, value in part.state_dict().items()}
            return result | {EXTRACTOR + name: x.shape for name, x in self.statistics().items()}

    def initial(
        self, seed: int, duty: float, log_std: float = 0.0
    ) -> tuple[dict[str, Tensor], torch.Generator]:
        """Weights and statistics of a network that has learnt nothing, and its random numbers from then on.

        They are what SB3's policy draws with this seed: torch's layers, the trunk's before the heads, then
        orthogonal weights with gains of sqrt(2), 0.01 and 1 and zero biases. Torch's own random numbers are
        left as they were. See `rans.policy.heads.Head.expect` for the duty. Gaussians begin with SB3's standard
        deviation of 1 unless ``log_std`` says otherwise, so that most valves are tried open or shut: with 0.37
        some seeds learnt to turn and never to move.
        """
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            parts = self.parts()
            for part, gain in zip(parts.values(), (math.sqrt(2), 0.01, 1.0), strict=True):
                for layer in part.modules():
                    if isinstance(layer, nn.Linear):
                        nn.init.orthogonal_(layer.weight, gain)
                        nn.init.zeros_(layer.bias)
            generator = torch.Generator()
            generator.set_state(torch.get_rng_state())
        tensors = {"log_std": torch.full((self.thrusters,), log_std)} if self.last.spread else {}
        for prefix, part in parts.items():
            tensors |= {prefix + name: value for name, value in part.state_dict().items()}
        # A demand begins near 0, which opens nothing.
        with torch.no_grad():
            if not self.tokens:
                self.last.expect(tensors["action_net.bias"], duty)
        return tensors | {EXTRACTOR + name: x for name, x in self.statistics().items()}, generator


class Backbone(ABC):
    """Makes outputs for commands of features."""

    def tokens(self, craft: Spacecraft, period: float) -> Tokens:
        """`Architecture.tokens` of a network that learns for a craft; () if it is not given its effectors.

        Raises:
            ConfigError: it cannot command the craft.
        """
        return ()

    def check(self, architecture: Architecture) -> None:
        """Refuse (`ValueError`) numbers of an agent's file that no such network has."""
        of_others = (
            architecture.tokens,
            architecture.authority,
            architecture.frugal,
            architecture.reach,
            architecture.filling,
        )
        if any(of_others) or architecture.adapts:
            raise ValueError(
                f"it has numbers that its backbone {brief(architecture.backbone)} lacks"
            )

    def columns(self, architecture: Architecture) -> Layout:
        """Layout of the columns that the network is given."""
        return architecture.layout.body

    def preprocessed(self, architecture: Architecture, observation: Columns) -> list[Field]:
        """Columns of a reading, which are all of an observation's in B for a network that adapts."""
        return architecture.layout.in_body(observation)

    def known(self, architecture: Architecture, columns: Columns) -> dict[str, list[Field]]:
        """Rows beside features that outputs need, by their names in a program, of the columns of the network."""
        return {}

    def adaptation(self, architecture: Architecture) -> Adaptation:
        """Estimator of a network that adapts; `check` refuses others."""
        raise NotImplementedError

    def adapted(
        self, architecture: Architecture, read: Columns, gains: Columns, lost: Field
    ) -> list[Field]:
        """Columns of a network that adapts; `check` refuses others.

        Args:
            architecture: of the network.
            read: columns of a reading.
            gains: of velocities and of angular velocities, over those of the file (`rans.policy.adaptation`).
            lost: 1 if a thruster is taken for lost, else 0.
        """
        raise NotImplementedError

    def for_faults(self, architecture: Architecture) -> Architecture:
        """The architecture with which the network flies where thrusters fail."""
        return architecture

    def choices(self, architecture: Architecture) -> int:
        """Number of ways to open thrusters together of which outputs choose one; 0: each command by itself."""
        return 0

    @abstractmethod
    def rows(self, architecture: Architecture) -> int:
        """Rows of the last layer, whose weights are ``action_net``."""

    def tables(self, architecture: Architecture, like: Tensor) -> tuple[Tensor, ...]:
        """What `rans.policy.heads.Patterns` has beside the last layer's outputs, as ``like`` is in memory.

        (): each command is decided by an output.

        A network makes them once, since neither a compiler nor a CUDA graph may: see `Network.tables`.
        """
        return ()

    @abstractmethod
    def traced(self, program: Program, architecture: Architecture, features: str) -> str:
        """Write outputs for commands into a program: a row (N, outputs n) of a row of features (N, features).

        See `rans.policy.heads.Head`. Torch computes that program (`rans.policy.torch_program`).

        The last layer's parameters are those of "head", after `rans.policy.heads.Head.folded`.
        """
