"""The one traced program of a policy, from which everything but torch's forward is printed.

It says what `rans.policy.network.Network.deterministic_action` says. Formulas of single numbers are those of
torch's forward: of preprocessing, memory, activations, heads and filters; here is how they are put together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from rans.policy.architecture import BACKBONES, EXTRACTOR, Architecture
from rans.policy.capabilities import Capabilities
from rans.policy.memory import averaged, gated
from rans.policy.network import Network
from rans.policy.preprocess import magnified, normalised
from rans.policy.program import Program, inputs
from rans.policy.symmetry import AIM, Symmetries
from rans.tasks.observation_terms import Columns, Layout

TRACED = Capabilities(
    backbones=tuple(name for name, backbone in BACKBONES.items() if backbone.is_traced),
    recurrent=True,
)
"""What can be traced, and so what any executor but torch can have."""


def policy_program(architecture: Architecture, command: str = "command") -> Program:
    """What policies of an architecture answer to an observation (N, width) and a memory (N, m).

    Rows that executors may ask for, each if there is one: "body", columns as the preprocessor makes them;
    "history" and "filters", the two parts of the memory, which is the state of a recurrent core otherwise; "view",
    the side of the spacecraft that has the goal ahead; "seen", columns and what filters tell, from that side;
    "shown", what the trunk is given; "newest", what the history is continued with; "filters_after" and
    "memory_out"; and the commands, numbers from 0 to 1 (N, commands), by the name ``command``.

    What no program can have (`TRACED`) ends it at "shown" (`Program.lacks`).

    Raises:
        Untraceable: the layout does more than arithmetic on fields.
    """
    program = Program()
    program.lacks = TRACED.missing(architecture)
    observed = inputs("column", architecture.layout.width)
    columns = program.single("observation", len(observed))
    body = program.joined(
        *program.lowered(
            architecture.preprocessed(observed), dict(zip(observed, columns, strict=True))
        ),
        name="body",
    )
    history = known = ""
    if architecture.memory and not architecture.units:
        history, known = program.split(
            "memory", (architecture.rows, architecture.filtering), ("history", "filters")
        )

    # What the trunk is given: columns as they count and as filters have them, from one side, and the history.
    blocks = _filtered(program, architecture, body, known)
    view = _View.chosen(program, architecture, blocks[0][1])
    features = []
    viewed = []
    for (layout, block), extra in zip(blocks, architecture.extra_columns, strict=True):
        row = body if block is None else program.joined(*block)
        row = row if view is None else view.columns(program, layout, row)
        viewed.append(row)
        read, beside = program.split(row, (architecture.column_count, extra))
        features += _looks(program, architecture, read)
        if extra:
            clip = [program.constant(bound) for bound in (-architecture.clip, architecture.clip)]
            features.append(program.apply("Clip", beside, *clip))
    program.joined(*viewed, name="seen")
    if history:
        features.append(_recalled(program, architecture, view, history))
    x = program.joined(*features, name="shown")
    # Commands; what is remembered needs to know no more of them than their names.
    answer = command if program.lacks else _commands(program, architecture, view, x, command)

    # What is remembered once the command is given.
    if architecture.memory and not architecture.units:
        rows = _remembered(program, architecture, history, body, answer) if history else []
        if known:
            rows.append(_expected(program, architecture, body, known, answer))
        program.joined(*rows, name="memory_out")
    return program


def _commands(
    program: Program, architecture: Architecture, view: _View | None, x: str, command: str
) -> str:
    """Layers, the state of a recurrent core, and commands, each thruster's from its place in the view."""
    widths = (architecture.inputs, *architecture.layers)
    for number, (width, units) in enumerate(zip(widths, architecture.layers, strict=False)):
        x = program.dense(x, f"trunk.{2 * number}", units, width, architecture.activation)
    if architecture.units:
        x = _core(program, architecture, x)
    outputs = program.split(
        BACKBONES[architecture.backbone].traced(program, architecture, x),
        [architecture.thrusters] * architecture.last.outputs,
    )
    placed = [
        program.apply("Identity", one, name=f"placed_{k}")
        if view is None
        else program.apply("GatherElements", one, view.place, name=f"placed_{k}", axis=1)
        for k, one in enumerate(outputs)
    ]
    if architecture.last.is_advised:
        first, last = architecture.columns.advice
        change = program.joined(*program.single("body", architecture.column_count)[first:last])
        levers = program.constant(np.asarray(architecture.levers).T, "levers")
        placed.append(program.apply("MatMul", change, levers))
    return program.apply("Identity", program.each(architecture.last.command, *placed), name=command)


def parameters(network: Network) -> dict[str, np.ndarray]:
    """The program's parameters of a network of one member, float32, by their names there."""
    tensors = {name: x.detach().cpu().float() for name, x in network.tensors.items()}
    architecture = network.architecture
    result = {
        name.removeprefix(EXTRACTOR): x
        for name, x in tensors.items()
        if name.startswith(EXTRACTOR) and not name.startswith(f"{EXTRACTOR}critic.")
    }
    for gate in ("ih", "hh"):
        for kind in ("weight", "bias"):
            if (x := result.pop(f"core.{kind}_{gate}", None)) is not None:
                result[f"core.{gate}.{kind}"] = x
    result["head.weight"], result["head.bias"] = architecture.last.folded(
        tensors["action_net.weight"], tensors["action_net.bias"]
    )
    result["scale"] = torch.rsqrt(result["variance"] + 1e-6)
    result["zoom"] = result["scale"] * architecture.zoom
    return {name: x.numpy() for name, x in result.items()}


def _filtered(
    program: Program, architecture: Architecture, body: str, known: str
) -> list[tuple[Layout, list[str] | None]]:
    """Columns as they count and what each filter makes of them, with their layouts; None: those in B."""
    if not known:
        return [(architecture.columns, None)]
    read, memory = (
        inputs("read", architecture.column_count),
        inputs("filter", architecture.filtering),
    )
    rows = (*program.single(body, len(read)), *program.single(known, len(memory)))
    blocks = architecture.filtered((*read, *memory))
    result = program.lowered(
        [x for _, block in blocks for x in block],
        dict(zip((*read, *memory), rows, strict=True)),
    )
    split = []
    for layout, block in blocks:
        split.append((layout, result[: len(block)]))
        result = result[len(block) :]
    return split


def _looks(program: Program, architecture: Architecture, viewed: str) -> list[str]:
    """Columns normalised, and a second time magnified (docs/decisions/policies.md)."""
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
    """From which of its equivalent sides each spacecraft is seen (docs/decisions/policies.md)."""

    views: Symmetries
    which: str
    """(N,)."""
    place: str
    """(N, thrusters): index of each thruster's place in the view."""

    @classmethod
    def chosen(
        cls, program: Program, architecture: Architecture, counted: Sequence[str] | None
    ) -> _View | None:
        """The view that has the goal most ahead; None without symmetries or a way to go.

        Columns as they count are given one by one; None: those of "body".
        """
        views = architecture.symmetries
        if views is None or architecture.ahead(range(architecture.column_count)) is None:
            return None
        way = architecture.ahead(counted or program.single("body", architecture.column_count))
        assert way is not None
        # Rounding noise in a matrix would cost operations.
        turn = np.round(views.turn, 12) + 0.0
        aim = np.asarray(AIM[: len(way)])
        ahead = program.constant(np.einsum("i,sij->js", aim, turn), "ahead")
        score = program.apply("MatMul", program.joined(*way), ahead)
        which = program.apply("ArgMax", score, name="view", axis=1, keepdims=0)
        places = program.constant(views.place, "places", np.int64)
        return cls(views._replace(turn=turn), which, program.apply("Gather", places, which, axis=0))

    def columns(self, program: Program, layout: Layout, value: str, rows: bool = False) -> str:
        """Columns (N, k), or several rows of them (N, rows, k), as the view shows them."""
        count, size, _ = self.views.turn.shape
        table = np.concatenate(
            (self.views.turn.reshape(count, -1), self.views.hand[:, None]), axis=1
        )
        commands = program.apply("Gather", program.constant(table, "turns"), self.which, axis=0)
        if rows:
            commands = program.shaped(commands, 1, size * size + 1)
        *turn, hand = inputs("turn", size * size + 1)
        columns = inputs("column", layout.width)

        def turned(u: Columns) -> Columns:
            return [sum(turn[size * i + j] * x for j, x in enumerate(u)) for i in range(size)]

        known = dict(zip((*turn, hand), program.single(commands, size * size + 1), strict=True))
        known |= dict(zip(columns, program.single(value, layout.width), strict=True))
        return program.joined(*program.lowered(layout.mirrored(columns, turned, hand), known))

    def commands(self, program: Program, value: str, rows: int) -> str:
        """Commands (N, rows, thrusters) as the view shows them."""
        back = np.argsort(self.views.place, axis=1)
        table = program.constant(np.tile(back, (1, rows)), "places_back", np.int64)
        index = program.apply("Gather", table, self.which, axis=0)
        index = program.shaped(index, rows, back.shape[1])
        return program.apply("GatherElements", value, index, axis=2)


def _recalled(
    program: Program, architecture: Architecture, view: _View | None, history: str
) -> str:
    """What is remembered, (N, m), from the same side and with the columns normalised."""
    rows = program.shaped(history, architecture.recalled, architecture.row)
    then, commands = program.split(rows, (architecture.answered, architecture.thrusters))
    if view is not None:
        then = then and view.columns(program, architecture.columns, then, rows=True)
        commands = view.commands(program, commands, architecture.recalled)
    if then:
        then = program.each(
            lambda x, m, s: normalised(x, m, s, architecture.clip), then, "mean", "scale"
        )
    row = program.joined(then, commands)
    return program.apply("Identity", program.shaped(row, architecture.rows), name="recalled")


def _remembered(
    program: Program, architecture: Architecture, history: str, body: str, command: str
) -> list[str]:
    """Averages that move towards the newest columns and command, then the last ones, oldest first."""
    newest = program.joined("" if architecture.commands_only else body, command, name="newest")
    width = architecture.row
    count = len(architecture.averages)
    last = min(architecture.history, 1)
    averages, _, others = program.split(
        history, [x * width for x in (count, last, architecture.history - last)]
    )
    if count:
        kept = program.constant(np.repeat(np.asarray(architecture.averages), width), "kept")
        averages = program.each(averaged, averages, program.joined(*[newest] * count), kept)
    return [averages, others, newest if last else ""]


def _expected(
    program: Program, architecture: Architecture, body: str, known: str, command: str
) -> str:
    """What filters remember once the command is given."""
    symbols = []
    rows = []
    for name, width in (
        (body, architecture.column_count),
        (known, architecture.filtering),
        (command, architecture.thrusters),
    ):
        symbols += inputs(f"of {name}", width)
        rows += program.single(name, width)
    result = program.lowered(
        architecture.next_filter_memory(symbols), dict(zip(symbols, rows, strict=True))
    )
    return program.joined(*result, name="filters_after")


def _core(program: Program, architecture: Architecture, x: str) -> str:
    """A gated recurrent unit, torch's `GRUCell`: what it says is what it remembers."""
    units = architecture.units
    fresh = program.dense(x, "core.ih", 3 * units, architecture.layers[-1])
    kept = program.dense("memory", "core.hh", 3 * units, units)
    gates = [part for row in (fresh, kept) for part in program.split(row, [units] * 3)]
    return program.apply("Identity", program.each(gated, *gates, "memory"), name="memory_out")
