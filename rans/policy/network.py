"""The actor-critic of an agent.

Executors and exported files are compared with it; torch's own order of sums is theirs to rounding only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from rans.policy.architecture import EXTRACTOR, Architecture
from rans.policy.heads import Distribution, OnOff, Patterns
from rans.policy.memory import MakePreprocessor, PolicyState, Remembering, by_row, viewed
from rans.policy.preprocess import (
    TorchPreprocessor,
    magnified,
    normalised,
)
from rans.policy.program import Program, inputs
from rans.policy.torch_program import TorchProgram

Pooled = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
"""Variance and mean of several processes' values, from those of one."""


def _of_this_process(variance: Tensor, mean: Tensor) -> tuple[Tensor, Tensor]:
    return variance, mean


class Output(NamedTuple):
    """Outputs of a network for N observations."""

    policy: Distribution
    value: Tensor
    """(N,)."""


class Network(Remembering):
    """An actor-critic, with its weights and statistics, ``tensors``, by their names in SB3's policy."""

    def __init__(
        self,
        architecture: Architecture,
        tensors: Mapping[str, Tensor],
        preprocessor: MakePreprocessor = TorchPreprocessor,
        at: Mapping[float, Mapping[str, Tensor]] | None = None,
    ) -> None:
        self.architecture = architecture
        # Weights of an agent for any craft at frugalities from 0 to 1 (`rans.policy.backbones.AnyCraft.frugal`).
        self.at = at or {}
        self.tensors = dict[str, Tensor]()
        self.activation = architecture.activation_module()
        self.adopt(tensors)
        self._nominal = self._mean.new_tensor(
            architecture.nominal or (1.0,) * architecture.privileged
        )
        # Before a CUDA graph is recorded, which may not copy from a CPU.
        self._backbone = architecture.kind
        self.tables = self._backbone.tables(architecture, self._mean)
        program = Program()
        outputs = self._backbone.traced(program, architecture, "features")
        symbols = inputs("column", architecture.column_count)
        estimated = architecture.adaptation.known if architecture.adapts else {}
        given = {"features", *estimated, *self._backbone.known(architecture, symbols)}
        self._outputs = TorchProgram(program, outputs, given, self._mean)
        super().__init__(architecture, self._mean, preprocessor)

    def adopt(self, tensors: Mapping[str, Tensor]) -> None:
        """Use these tensors from now on, in the place of those of the same names."""
        self.tensors |= tensors
        self._mean, self._variance, self._count = (
            self.tensors[EXTRACTOR + name] for name in self.architecture.statistics()
        )
        self._trunk, self._critic = list(self._chain("trunk")), list(self._chain("critic"))

    @classmethod
    def copied(
        cls,
        architecture: Architecture,
        tensors: Mapping[str, Tensor],
        device: torch.device,
        dtype: torch.dtype,
        preprocessor: MakePreprocessor = TorchPreprocessor,
    ) -> Network:
        """A network with a copy of weights and statistics on a device."""
        own = {name: x.detach().to(device, dtype).clone() for name, x in tensors.items()}
        return cls(architecture, own, preprocessor)

    def _chain(self, name: str) -> Iterator[tuple[Tensor, Tensor]]:
        return (
            self.layer(key.removesuffix(".weight"))
            for key in self.tensors
            if key.startswith(f"{EXTRACTOR}{name}.") and key.endswith(".weight")
        )

    def layer(self, name: str) -> tuple[Tensor, Tensor]:
        """Weights (o, i) and biases (o,) of a layer, by its name in SB3's policy."""
        return self.tensors[f"{name}.weight"], self.tensors[f"{name}.bias"]

    @property
    def learnt(self) -> list[str]:
        """Names of what gradients change, in the order of SB3's policy."""
        statistics = {EXTRACTOR + name for name in self.architecture.statistics()}
        return [name for name in self.tensors if name not in statistics]

    def evaluate(
        self, observation: Tensor, memory: Tensor | None = None, privileged: Tensor | None = None
    ) -> Output:
        """Outputs for observations (N, width), as by `forward`."""
        return self.forward(observation, memory, privileged)[0]

    def forward(
        self, observation: Tensor, memory: Tensor | None = None, privileged: Tensor | None = None
    ) -> tuple[Output, Tensor]:
        """Distributions and values for observations (N, width).

        Beside them the columns that `next_state` is given. Memories are as from `initial_state`; what the critic
        is given beside, (N, p), is by default that of a nominal craft.
        """
        if (whole := self._preprocessor.whole(observation, self.tensors)) is not None:
            return Output(OnOff(whole[0]), whole[1]), observation  # nothing of which is remembered
        columns = self.in_body(observation)
        preprocessed, recalled, permutation = self.look(columns, memory)
        output = self.evaluate_seen(preprocessed, recalled, privileged)
        return output if permutation is None else output._replace(
            policy=output.policy.placed(permutation)
        ), columns

    @torch.no_grad()
    def deterministic_action(
        self, observation: Tensor, state: PolicyState
    ) -> tuple[Tensor, PolicyState]:
        """Deterministic commands (N, n), from 0 to 1, of observations (N, width), and the state after them."""
        output, columns = self.forward(observation, state)
        command = output.policy.mode()
        return command, self.next_state(columns, state, command)

    def in_body(self, observation: Tensor) -> Tensor:
        """The columns (N, k) of observations (N, width) in the body frame."""
        return self._preprocessor.in_body(observation.to(self._mean.dtype))

    def look(
        self, columns: Tensor, memory: Tensor | None = None
    ) -> tuple[Tensor, Tensor | None, Tensor | None]:
        """Columns (N, k) in the body frame and the memory from the side of the craft that has the goal ahead.

        The columns seen, (N, `Architecture.shown`), are those given and those of every filter; the memory is
        without the filters'. Also where each thruster is in that view, (N, thrusters), without symmetry None.
        They do not depend on weights, so one look serves an update.
        """
        architecture = self.architecture
        views = self._views
        history, filters = self._parted(memory, len(columns))
        rows = columns if filters is None else torch.cat((columns, filters), dim=1)
        if views is None or architecture.ahead(tuple(range(architecture.column_count))) is None:
            return rows if filters is None else self._preprocessor.viewed(rows)[0], history, None
        preprocessed, which = self._preprocessor.viewed(rows)
        # A column after the other: torch's kernel for rows takes ten times as long on a GPU.
        permutation = views.place.T.gather(1, which.expand(views.place.shape[1], -1)).T
        if history is None or not architecture.recalled:
            return preprocessed, history, permutation
        return (
            preprocessed,
            viewed(history, architecture.recalled, architecture.columns, views, which),
            permutation,
        )

    def evaluate_seen(
        self,
        preprocessed: Tensor,
        memory: Tensor | None = None,
        privileged: Tensor | None = None,
    ) -> Output:
        """Outputs for columns (N, k) that `look` returned; thrusters are in the order of that view."""
        architecture = self.architecture
        columns = preprocessed
        known: dict[str, Tensor] = {}
        if architecture.adapts:
            estimated = architecture.adaptation.known
            widths = [architecture.column_count, *estimated.values()]
            columns, *rows = preprocessed.split(widths, dim=1)
            known.update(zip(estimated, rows, strict=True))
        features, critic = self.features(columns, memory, privileged)
        further = self._backbone.known(architecture, columns.unbind(-1))
        known |= {name: torch.stack(row, dim=-1) for name, row in further.items()}
        return self._heads(features, critic, known)

    def features(
        self,
        preprocessed: Tensor,
        memory: Tensor | None = None,
        privileged: Tensor | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Features (N, width) of actor and critic; the same tensor unless the critic is privileged."""
        architecture = self.architecture
        x = self.inputs(preprocessed, memory)
        features = self._through(self._trunk, x)
        if not architecture.privileged:
            return features, features
        privileged_values = (
            self._nominal.expand(len(preprocessed), -1) if privileged is None else privileged
        )
        return features, self._through(self._critic, torch.cat((x, privileged_values), dim=-1))

    def inputs(self, preprocessed: Tensor, memory: Tensor | None = None) -> Tensor:
        """Inputs of the trunk from columns (N, k) and a history (N, m).

        With a history its rows follow the columns, viewed from the same side as these.
        """
        architecture = self.architecture
        views_of_rows = (
            preprocessed.split(
                [architecture.column_count + extra for extra in architecture.extra_columns], dim=-1
            )
            if architecture.filters
            else ()
        )
        x = (
            torch.cat([*map(self._filtered, views_of_rows)], dim=-1)
            if views_of_rows
            else self._looks(preprocessed)
        )
        if not architecture.recalled or memory is None:
            return x
        return torch.cat((x, by_row(self._recalled, memory, architecture.recalled)), dim=-1)

    def _filtered(self, rows: Tensor) -> Tensor:
        columns, extra = rows.tensor_split([self.architecture.column_count], dim=-1)
        x = self._looks(columns)
        clip = self.architecture.clip
        return torch.cat((x, extra.clamp(-clip, clip)), dim=-1) if extra.shape[-1] else x

    def _recalled(self, rows: Tensor) -> Tensor:
        then, extra = rows.tensor_split([self.architecture.answered], dim=-1)
        return torch.cat((self._normalised(then), extra), dim=-1) if then.shape[-1] else extra

    def _scale(self) -> Tensor:
        return torch.rsqrt(self._variance + 1e-6)

    def _normalised(self, x: Tensor) -> Tensor:
        """With zero mean and unit variance over the columns seen in training, clipped."""
        clip = self.architecture.clip
        return normalised(x, self._mean, self._scale(), clip)

    def _looks(self, preprocessed: Tensor) -> Tensor:
        """Inputs of the trunk from columns (..., k): normalised, (..., k), or zoomed, (..., 2 k).

        The second look is steepest at zero: there is the goal of every column that is no cosine.
        """
        x = self._normalised(preprocessed)
        zoom = self.architecture.zoom
        return torch.cat((x, magnified(preprocessed, self._scale() * zoom)), dim=-1) if zoom else x

    def _through(self, layers: Sequence[tuple[Tensor, Tensor]], x: Tensor) -> Tensor:
        dtype = x.dtype
        bf16 = self.architecture.bf16 and x.is_cuda
        with torch.autocast("cuda", torch.bfloat16) if bf16 else nullcontext():
            for weight, bias in layers:
                x = self.activation(functional.linear(x, weight, bias))
        return x.to(dtype)

    def _heads(self, features: Tensor, critic: Tensor, known: Mapping[str, Tensor]) -> Output:
        """Actor and critic, in one product where they share features; a backbone is given further rows (N, k)."""
        architecture = self.architecture
        head = architecture.last
        worth, constant = self.layer("value_net")
        if critic is features and architecture.backbone == "dense":
            weight, bias = head.folded(*self.layer("action_net"))
            out = functional.linear(
                features, torch.cat((weight, worth), dim=-2), torch.cat((bias, constant), dim=-1)
            )
            action = out[..., :-1]
            value = out[..., -1]
        else:
            value = functional.linear(critic, worth, constant)[..., 0]
            weight, bias = head.folded(*self.layer("action_net"))
            if self.tables:
                demand = functional.linear(features, weight, bias)
                return Output(Patterns(demand, *self.tables), value)
            layer = {"features": features, "head.weight": weight, "head.bias": bias}
            action = self._outputs(layer | dict(known))
        return Output(head.distribution(action, self.tensors.get("log_std")), value)

    @torch.no_grad()
    def update_statistics(
        self, preprocessed: Tensor, pooled: Pooled = _of_this_process, processes: int = 1
    ) -> None:
        """Merge mean and variance of columns (T, N, k) into the running ones.

        What filters make of them, further columns, counts as they do. Of several processes, which have as
        many columns each, ``pooled`` makes variance and mean of all from those of one.

        Chan, Golub and LeVeque, "Updating formulae and a pairwise algorithm for sample variances", 1979.
        """
        rows = preprocessed[..., : self.architecture.column_count]
        count = rows.shape[0] * rows.shape[1] * processes
        variance, mean = pooled(*torch.var_mean(rows, dim=(0, 1), correction=0))
        weight = count / (self._count + count)
        shift = mean - self._mean
        self._mean += shift * weight
        self._variance += (variance - self._variance) * weight + shift.square() * (
            weight * (1 - weight)
        )
        self._count += count

    def weights(self) -> dict[str, Tensor]:
        """A copy of weights and statistics, on the CPU, by their names in SB3's policy."""
        return {name: x.detach().cpu().clone() for name, x in self.tensors.items()}
