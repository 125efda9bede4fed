"""Policies as one traced program, from which every executor but torch prints its own code.

The program computes what `rans.policy.network.Network.deterministic_action` computes with torch. Formulas of
single numbers are shared with torch's forward pass: preprocessing, memory, activations, heads and filters. This
module puts them together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from rans.model.fields import Field
from rans.policy.adaptation import Rows
from rans.policy.architecture import EXTRACTOR, Architecture
from rans.policy.memory import averaged
from rans.policy.network import Network
from rans.policy.preprocess import magnified, normalised
from rans.policy.program import Program, inputs
from rans.policy.symmetry import AIM, Symmetries
from rans.tasks.observation_terms import Columns, Layout


def policy_program(architecture: Architecture, command: str = "command") -> Program:
    """Program of all policies of an architecture: commands from an observation (N, width) and a memory (N, m).

    Commands, numbers from 0 to 1 (N, commands), are the row called ``command``. Executors may ask for these rows
    too, each if the architecture has it:

    - "body": columns of the preprocessor; "history" and "filters": the parts of the memory;
    - "view": side of the spacecraft that has the goal ahead; "seen": columns, gated and filtered, from that side;
    - "shown": features, the input of the trunk;
    - "newest": the row that is appended to the history; "filters_after" and "memory_out": the next memory.

    Raises:
        Untraceable: the layout does more than arithmetic on fields.
    """
    # Columns in the body frame, and the parts of the memory.
    program = Program()
    observed = inputs("column", architecture.layout.width)
    columns = program.single("observation", len(observed))
    body = program.joined(
        *program.lowered(
            architecture.preprocessed(observed), dict(zip(observed, columns, strict=True))
        ),
        name="body",
    )
    history = filter_memory = ""
    if architecture.memory:
        history, filter_memory = program.split(
            "memory", (architecture.rows, architecture.filtering), ("history", "filters")
        )

    if architecture.adapts:
        _adapting(program, architecture, body, filter_memory, command)
        return program

    _tell_whereabouts(program, architecture, body)
    # Features: gated columns and every filter's estimate, from the side with the goal ahead; then the history.
    blocks = _filtered(program, architecture, body, filter_memory)
    view = _View.towards_goal(program, architecture, blocks[0][1])
    features = []
    viewed = []
    for (layout, block), extra in zip(blocks, architecture.extra_columns, strict=True):
        row = body if block is None else program.joined(*block)
        row = row if view is None else view.columns(program, layout, row)
        viewed.append(row)
        read, extras = program.split(row, (architecture.column_count, extra))
        features += _normalised_columns(program, architecture, read)
        if extra:
            clip = [program.constant(bound) for bound in (-architecture.clip, architecture.clip)]
            features.append(program.apply("Clip", extras, *clip))
    program.joined(*viewed, name="seen")
    if history:
        features.append(_normalised_history(program, architecture, view, history))
    features_row = program.joined(*features, name="shown")

    command_row = _commands(program, architecture, view, features_row, command)

    # The next memory.
    if architecture.memory:
        rows = _next_history(program, architecture, history, body, command_row) if history else []
        if filter_memory:
            rows.append(
                _next_filter_memory(program, architecture, body, filter_memory, command_row)
            )
        program.joined(*rows, name="memory_out")
    return program


def _adapting(
    program: Program, architecture: Architecture, body: str, memory: str, command: str
) -> None:
    """Commands and next memory of a policy that adapts, of its columns by the estimated gains."""
    rows = ProgramRows(program)
    adaptation = architecture.adaptation
    read = program.single(body, architecture.read_count)
    estimate = adaptation.estimated(rows, program.joined(*read[: adaptation.twist]), memory)
    lost = rows.product(estimate.shut, np.ones((adaptation.thrusters, 1)))
    symbols = inputs("read", len(read)), inputs("gain", 2)
    (symbol,) = inputs("lost", 1)
    columns = program.lowered(
        architecture.kind.adapted(architecture, *symbols, symbol),
        dict(zip((*symbols[0], *symbols[1], symbol), (*read, *estimate.gains, lost), strict=True)),
    )
    row = program.joined(*columns)
    _tell_whereabouts(program, architecture, row)
    known = [
        program.apply("Identity", value, name=name)
        for name, value in zip(adaptation.known, estimate.known, strict=True)
    ]
    program.joined(row, *known, name="seen")
    features = program.joined(*_normalised_columns(program, architecture, row), name="shown")
    command_row = _commands(program, architecture, None, features, command)
    after = adaptation.next_memory(rows, estimate.memory, command_row)
    program.apply("Identity", after, name="filters_after")
    program.apply("Identity", "filters_after", name="memory_out")


def _tell_whereabouts(program: Program, architecture: Architecture, row: str) -> None:
    """Add rows that the backbone needs beside features, from the columns (`Backbone.known`)."""
    symbols = inputs("column", architecture.column_count)
    for name, numbers in architecture.kind.known(architecture, symbols).items():
        names = dict(zip(symbols, program.single(row, len(symbols)), strict=True))
        program.joined(*program.lowered(numbers, names), name=name)


@dataclass(eq=False)
class ProgramRows(Rows[str]):
    """Rows of `rans.policy.adaptation` as values of a program, by their names."""

    program: Program

    def constant(self, values: object) -> str:
        """See `Rows`."""
        return self.program.constant(values)

    def product(self, row: str, table: np.ndarray) -> str:
        """See `Rows`."""
        return self.program.apply("MatMul", row, self.program.constant(table))

    def split(self, row: str, widths: Sequence[int]) -> list[str]:
        """See `Rows`."""
        return self.program.split(row, widths)

    def joined(self, rows: Sequence[str]) -> str:
        """See `Rows`."""
        return self.program.joined(*rows)

    def computed(self, formula: Callable[..., list[Field]], rows: Sequence[str]) -> list[str]:
        """See `Rows`."""
        symbols = inputs("number", len(rows))
        names = dict(zip(symbols, rows, strict=True))
        return self.program.lowered(formula(*symbols), names)

    def largest(self, row: str, width: int) -> str:
        """See `Rows`."""
        best = self.program.apply("ArgMax", row, axis=1, keepdims=0)
        return self.program.apply("Gather", self.program.constant(np.eye(width)), best, axis=0)


def _commands(
    program: Program, architecture: Architecture, view: _View | None, x: str, command: str
) -> str:
    """Row of commands from features: trunk, backbone and head.

    The head's outputs are those of thrusters as the view numbers them, and are put back in the craft's order.
    """
    widths = (architecture.inputs, *architecture.layers)
    for number, (width, units) in enumerate(zip(widths, architecture.layers, strict=False)):
        x = program.dense(x, f"trunk.{2 * number}", units, width, architecture.activation)
    outputs = program.split(
        architecture.kind.traced(program, architecture, x),
        [architecture.thrusters] * architecture.last.outputs,
    )
    # Outputs in the order of the craft's thrusters.
    by_thruster = [
        program.apply("Identity", output, name=f"placed_{k}")
        if view is None
        else program.apply(
            "GatherElements", output, view.thruster_index, name=f"placed_{k}", axis=1
        )
        for k, output in enumerate(outputs)
    ]
    return program.apply(
        "Identity", program.each(architecture.last.command, *by_thruster), name=command
    )


def parameters(network: Network) -> dict[str, np.ndarray]:
    """Parameters of a program for a network: float32 arrays by their names in the program.

    These names are in exports and in machine code's tables; the scale is 1 / sqrt(variance + 1e-6), as in training.
    """
    # Layers before the heads, without the critic's.
    tensors = {name: x.detach().cpu().float() for name, x in network.tensors.items()}
    architecture = network.architecture
    result = {
        name.removeprefix(EXTRACTOR): x
        for name, x in tensors.items()
        if name.startswith(EXTRACTOR) and not name.startswith(f"{EXTRACTOR}critic.")
    }
    # Both outputs of an on/off thruster become its log-odds; scales are computed once.
    result["head.weight"], result["head.bias"] = architecture.last.folded(
        tensors["action_net.weight"], tensors["action_net.bias"]
    )
    result["scale"] = torch.rsqrt(result["variance"] + 1e-6)
    result["zoom"] = result["scale"] * architecture.zoom
    return {name: x.numpy() for name, x in result.items()}


def _filtered(
    program: Program, architecture: Architecture, body: str, filter_memory: str
) -> list[tuple[Layout, list[str] | None]]:
    """Layout and columns of the gated reading, then of each filter's estimate (`Architecture.filtered`).

    Without filters it is the layout in B alone, and None for its columns: those of "body".
    """
    if not filter_memory:
        return [(architecture.columns, None)]
    read, memory = (
        inputs("read", architecture.column_count),
        inputs("filter", architecture.filtering),
    )
    rows = (*program.single(body, len(read)), *program.single(filter_memory, len(memory)))
    blocks = architecture.filtered((*read, *memory))
    result = program.lowered(
        [x for _, block in blocks for x in block],
        dict(zip((*read, *memory), rows, strict=True)),
    )
    split: list[tuple[Layout, list[str] | None]] = []
    for layout, block in blocks:
        split.append((layout, result[: len(block)]))
        result = result[len(block) :]
    return split


def _normalised_columns(program: Program, architecture: Architecture, viewed: str) -> list[str]:
    """Columns normalised and, if there is a zoom, a second time magnified (docs/decisions/learning.md)."""
    mean, scale = (program.parameter(name, architecture.column_count) for name in ("mean", "scale"))
    results = [
        program.each(lambda x, m, s: normalised(x, m, s, architecture.clip), viewed, mean, scale)
    ]
    if architecture.zoom:
        results.append(
            program.each(magnified, viewed, program.parameter("zoom", architecture.column_count))
        )
    return results


@dataclass(frozen=True)
class _View:
    """The equivalent side from which each spacecraft is viewed (docs/decisions/learning.md)."""

    views: Symmetries
    side: str
    """(N,) index of the side."""
    thruster_index: str
    """(N, thrusters) number in the view of each thruster of the craft."""

    @classmethod
    def towards_goal(
        cls, program: Program, architecture: Architecture, gated_columns: Sequence[str] | None
    ) -> _View | None:
        """View from the side that has the goal most ahead; None without symmetries or a direction to the goal.

        Args:
            program: to which steps are added.
            architecture: of the policy.
            gated_columns: columns one by one; None: those of "body".
        """
        views = architecture.symmetries
        if views is None or architecture.ahead(range(architecture.column_count)) is None:
            return None
        direction = architecture.ahead(
            gated_columns or program.single("body", architecture.column_count)
        )
        assert direction is not None
        # Entries that are zero but for rounding would cost operations.
        rotations = np.round(views.turn, 12) + 0.0
        aim = np.asarray(AIM[: len(direction)])
        ahead = program.constant(np.einsum("i,sij->js", aim, rotations), "ahead")
        # Cosine of the angle between the direction and each side's front, and the side where it is largest.
        score = program.apply("MatMul", program.joined(*direction), ahead)
        side = program.apply("ArgMax", score, name="view", axis=1, keepdims=0)
        thruster_table = program.constant(views.place, "places", np.int64)
        return cls(
            views._replace(turn=rotations),
            side,
            program.apply("Gather", thruster_table, side, axis=0),
        )

    def columns(self, program: Program, layout: Layout, value: str, rows: bool = False) -> str:
        """Columns (N, k), or with ``rows`` several rows of them (N, rows, k), as viewed from the side.

        Rows of a history are turned by the side of the present observation.
        """
        count, size, _ = self.views.turn.shape
        table = np.concatenate(
            (self.views.turn.reshape(count, -1), self.views.hand[:, None]), axis=1
        )
        # Rotation matrix and handedness of each spacecraft's side.
        transforms = program.apply("Gather", program.constant(table, "turns"), self.side, axis=0)
        if rows:
            transforms = program.shaped(transforms, 1, size * size + 1)
        *turn, hand = inputs("turn", size * size + 1)
        columns = inputs("column", layout.width)

        def rotated(u: Columns) -> Columns:
            return [sum(turn[size * i + j] * x for j, x in enumerate(u)) for i in range(size)]

        values = dict(zip((*turn, hand), program.single(transforms, size * size + 1), strict=True))
        values |= dict(zip(columns, program.single(value, layout.width), strict=True))
        return program.joined(*program.lowered(layout.mirrored(columns, rotated, hand), values))

    def commands(self, program: Program, value: str, rows: int) -> str:
        """Commands (N, rows, thrusters) put from the craft's order of thrusters into the order of the view."""
        back = np.argsort(self.views.place, axis=1)
        table = program.constant(np.tile(back, (1, rows)), "places_back", np.int64)
        index = program.apply("Gather", table, self.side, axis=0)
        index = program.shaped(index, rows, back.shape[1])
        return program.apply("GatherElements", value, index, axis=2)


def _normalised_history(
    program: Program, architecture: Architecture, view: _View | None, history: str
) -> str:
    """Features (N, m) of a history: its rows viewed from the same side, columns normalised."""
    rows = program.shaped(history, architecture.recalled, architecture.row)
    past_columns, commands = program.split(rows, (architecture.answered, architecture.thrusters))
    if view is not None:
        past_columns = past_columns and view.columns(
            program, architecture.columns, past_columns, rows=True
        )
        commands = view.commands(program, commands, architecture.recalled)
    if past_columns:
        past_columns = program.each(
            lambda x, m, s: normalised(x, m, s, architecture.clip), past_columns, "mean", "scale"
        )
    row = program.joined(past_columns, commands)
    return program.apply("Identity", program.shaped(row, architecture.rows), name="recalled")


def _next_history(
    program: Program, architecture: Architecture, history: str, body: str, command: str
) -> list[str]:
    """Parts of the next history: moving averages of columns and command, then the last rows, oldest first.

    `Remembering` has the same order in torch.
    """
    newest = program.joined("" if architecture.commands_only else body, command, name="newest")
    width = architecture.row
    count = len(architecture.averages)
    has_last = min(architecture.history, 1)
    averages, _, later = program.split(
        history, [x * width for x in (count, has_last, architecture.history - has_last)]
    )
    if count:
        decay = program.constant(np.repeat(np.asarray(architecture.averages), width), "kept")
        averages = program.each(averaged, averages, program.joined(*[newest] * count), decay)
    return [averages, later, newest if has_last else ""]


def _next_filter_memory(
    program: Program, architecture: Architecture, body: str, filter_memory: str, command: str
) -> str:
    """Next memory of the filters (`Architecture.next_filter_memory`)."""
    symbols = []
    rows = []
    for name, width in (
        (body, architecture.column_count),
        (filter_memory, architecture.filtering),
        (command, architecture.thrusters),
    ):
        symbols += inputs(f"of {name}", width)
        rows += program.single(name, width)
    result = program.lowered(
        architecture.next_filter_memory(symbols), dict(zip(symbols, rows, strict=True))
    )
    return program.joined(*result, name="filters_after")
