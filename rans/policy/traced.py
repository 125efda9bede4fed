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


def policy_program(given: Architecture, command: str = "command") -> Program:
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
    program.lacks = TRACED.missing(given)
    observed = inputs("column", given.layout.width)
    columns = program.single("observation", len(observed))
    body = program.joined(
        *program.lowered(given.preprocessed(observed), dict(zip(observed, columns, strict=True))),
        name="body",
    )
    history = known = ""
    if given.memory and not given.units:
        history, known = program.split(
            "memory", (given.rows, given.filtering), ("history", "filters")
        )

    # What the trunk is given: columns as they count and as filters have them, from one side, and the history.
    blocks = _filtered(program, given, body, known)
    view = _View.chosen(program, given, blocks[0][1])
    shown = []
    seen = []
    for (layout, block), told in zip(blocks, given.told, strict=True):
        row = body if block is None else program.joined(*block)
        row = row if view is None else view.columns(program, layout, row)
        seen.append(row)
        read, beside = program.split(row, (given.seen, told))
        shown += _looks(program, given, read)
        if told:
            clip = [program.constant(bound) for bound in (-given.clip, given.clip)]
            shown.append(program.apply("Clip", beside, *clip))
    program.joined(*seen, name="seen")
    if history:
        shown.append(_recalled(program, given, view, history))
    x = program.joined(*shown, name="shown")
    # Commands; what is remembered needs to know no more of them than their names.
    answer = command if program.lacks else _commands(program, given, view, x, command)

    # What is remembered once the command is given.
    if given.memory and not given.units:
        rows = _remembered(program, given, history, body, answer) if history else []
        if known:
            rows.append(_expected(program, given, body, known, answer))
        program.joined(*rows, name="memory_out")
    return program


def _commands(
    program: Program, given: Architecture, view: _View | None, x: str, command: str
) -> str:
    """Layers, the state of a recurrent core, and commands, each thruster's from its place in the view."""
    widths = (given.inputs, *given.layers)
    for number, (width, units) in enumerate(zip(widths, given.layers, strict=False)):
        x = program.dense(x, f"trunk.{2 * number}", units, width, given.activation)
    if given.units:
        x = _core(program, given, x)
    outputs = program.split(
        BACKBONES[given.backbone].traced(program, given, x), [given.thrusters] * given.last.outputs
    )
    placed = [
        program.apply("Identity", one, name=f"placed_{k}")
        if view is None
        else program.apply("GatherElements", one, view.place, name=f"placed_{k}", axis=1)
        for k, one in enumerate(outputs)
    ]
    if given.last.is_advised:
        first, last = given.columns.advice
        change = program.joined(*program.single("body", given.seen)[first:last])
        levers = program.constant(np.asarray(given.levers).T, "levers")
        placed.append(program.apply("MatMul", change, levers))
    return program.apply("Identity", program.each(given.last.command, *placed), name=command)


def parameters(network: Network) -> dict[str, np.ndarray]:
    """The program's parameters of a network of one member, float32, by their names there."""
    tensors = {name: x.detach().cpu().float() for name, x in network.tensors.items()}
    given = network.architecture
    found = {
        name.removeprefix(EXTRACTOR): x
        for name, x in tensors.items()
        if name.startswith(EXTRACTOR) and not name.startswith(f"{EXTRACTOR}critic.")
    }
    for gate in ("ih", "hh"):
        for kind in ("weight", "bias"):
            if (x := found.pop(f"core.{kind}_{gate}", None)) is not None:
                found[f"core.{gate}.{kind}"] = x
    found["head.weight"], found["head.bias"] = given.last.folded(
        tensors["action_net.weight"], tensors["action_net.bias"]
    )
    found["scale"] = torch.rsqrt(found["variance"] + 1e-6)
    found["zoom"] = found["scale"] * given.zoom
    return {name: x.numpy() for name, x in found.items()}


def _filtered(
    program: Program, given: Architecture, body: str, known: str
) -> list[tuple[Layout, list[str] | None]]:
    """Columns as they count and what each filter makes of them, with their layouts; None: those in B."""
    if not known:
        return [(given.columns, None)]
    read, memory = inputs("read", given.seen), inputs("filter", given.filtering)
    rows = (*program.single(body, len(read)), *program.single(known, len(memory)))
    blocks = given.filtered((*read, *memory))
    found = program.lowered(
        [x for _, block in blocks for x in block],
        dict(zip((*read, *memory), rows, strict=True)),
    )
    split = []
    for layout, block in blocks:
        split.append((layout, found[: len(block)]))
        found = found[len(block) :]
    return split


def _looks(program: Program, given: Architecture, seen: str) -> list[str]:
    """Columns normalised, and a second time magnified (decision 008)."""
    mean, scale = (program.parameter(name, given.seen) for name in ("mean", "scale"))
    found = [program.each(lambda x, m, s: normalised(x, m, s, given.clip), seen, mean, scale)]
    if given.zoom:
        found.append(program.each(magnified, seen, program.parameter("zoom", given.seen)))
    return found


@dataclass(frozen=True)
class _View:
    """From which of its equivalent sides each spacecraft is seen (decision 009)."""

    views: Symmetries
    which: str
    """(N,)."""
    place: str
    """(N, thrusters): index of each thruster's place in the view."""

    @classmethod
    def chosen(
        cls, program: Program, given: Architecture, counted: Sequence[str] | None
    ) -> _View | None:
        """The view that has the goal most ahead; None without symmetries or a way to go.

        Columns as they count are given one by one; None: those of "body".
        """
        views = given.symmetries
        if views is None or given.ahead(range(given.seen)) is None:
            return None
        way = given.ahead(counted or program.single("body", given.seen))
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
        told = program.apply("Gather", program.constant(table, "turns"), self.which, axis=0)
        if rows:
            told = program.shaped(told, 1, size * size + 1)
        *turn, hand = inputs("turn", size * size + 1)
        columns = inputs("column", layout.width)

        def turned(u: Columns) -> Columns:
            return [sum(turn[size * i + j] * x for j, x in enumerate(u)) for i in range(size)]

        known = dict(zip((*turn, hand), program.single(told, size * size + 1), strict=True))
        known |= dict(zip(columns, program.single(value, layout.width), strict=True))
        return program.joined(*program.lowered(layout.mirrored(columns, turned, hand), known))

    def commands(self, program: Program, value: str, rows: int) -> str:
        """Commands (N, rows, thrusters) as the view shows them."""
        back = np.argsort(self.views.place, axis=1)
        table = program.constant(np.tile(back, (1, rows)), "places_back", np.int64)
        index = program.apply("Gather", table, self.which, axis=0)
        index = program.shaped(index, rows, back.shape[1])
        return program.apply("GatherElements", value, index, axis=2)


def _recalled(program: Program, given: Architecture, view: _View | None, history: str) -> str:
    """What is remembered, (N, m), from the same side and with the columns normalised."""
    rows = program.shaped(history, given.recalled, given.row)
    then, told = program.split(rows, (given.answered, given.thrusters))
    if view is not None:
        then = then and view.columns(program, given.columns, then, rows=True)
        told = view.commands(program, told, given.recalled)
    if then:
        then = program.each(lambda x, m, s: normalised(x, m, s, given.clip), then, "mean", "scale")
    row = program.joined(then, told)
    return program.apply("Identity", program.shaped(row, given.rows), name="recalled")


def _remembered(
    program: Program, given: Architecture, history: str, body: str, command: str
) -> list[str]:
    """Averages that move towards the newest columns and command, then the last ones, oldest first."""
    newest = program.joined("" if given.commands_only else body, command, name="newest")
    width = given.row
    count = len(given.averages)
    last = min(given.history, 1)
    averages, _, others = program.split(
        history, [x * width for x in (count, last, given.history - last)]
    )
    if count:
        kept = program.constant(np.repeat(np.asarray(given.averages), width), "kept")
        averages = program.each(averaged, averages, program.joined(*[newest] * count), kept)
    return [averages, others, newest if last else ""]


def _expected(program: Program, given: Architecture, body: str, known: str, command: str) -> str:
    """What filters remember once the command is given."""
    symbols = []
    rows = []
    for name, width in ((body, given.seen), (known, given.filtering), (command, given.thrusters)):
        symbols += inputs(f"of {name}", width)
        rows += program.single(name, width)
    found = program.lowered(given.expected(symbols), dict(zip(symbols, rows, strict=True)))
    return program.joined(*found, name="filters_after")


def _core(program: Program, given: Architecture, x: str) -> str:
    """A gated recurrent unit, torch's `GRUCell`: what it says is what it remembers."""
    units = given.units
    fresh = program.dense(x, "core.ih", 3 * units, given.layers[-1])
    kept = program.dense("memory", "core.hh", 3 * units, units)
    gates = [part for row in (fresh, kept) for part in program.split(row, [units] * 3)]
    return program.apply("Identity", program.each(gated, *gates, "memory"), name="memory_out")
