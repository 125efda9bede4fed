"""An agent as a straight-line program over arrays: written down once, printed as ONNX and as NumPy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice

import numpy as np
import torch
from torch import Tensor

from rans.effectors.commands import is_identity
from rans.errors import ConfigError
from rans.model.spacecraft import CommandRange, Spacecraft
from rans.model.trace import Symbol, ordered
from rans.policy.activations import ACTIVATIONS
from rans.policy.architecture import EXTRACTOR, Architecture
from rans.policy.capabilities import Capabilities
from rans.policy.network import Network
from rans.policy.symmetry import AIM, Symmetries
from rans.tasks.observation_terms import Columns, Layout

_LOWERED = {
    "+": "Add",
    "-": "Sub",
    "*": "Mul",
    "/": "Div",
    "==": "Equal",
    "neg": "Neg",
    "where": "Where",
    "maximum": "Max",
    ">": "Greater",
    "<": "Less",
    "tanh": "Tanh",
    "exp": "Exp",
}
"""ONNX's names of what a layout and filters do to columns."""
_ACTIVATIONS = {"tanh": "Tanh", "elu": "Elu", "relu": "Relu"}


@dataclass(frozen=True)
class Step:
    """One operation, by ONNX's name and with its meaning."""

    operation: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    attributes: Mapping[str, int] = field(default_factory=dict)


class Program:
    """Steps in order, on values that have names; inputs are "observation" and "memory", if there is one."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.constants: dict[str, np.ndarray] = {}

    def constant(self, value: object, name: str = "", dtype: type = np.float32) -> str:
        """A table or number that is the same for all observations."""
        name = name or f"constant_{len(self.constants)}"
        self.constants[name] = np.array(value, dtype)
        return name

    def apply(self, operation: str, *inputs: str, name: str = "", **attributes: int) -> str:
        """The value of an operation; a name is for readers."""
        output = name or f"x{len(self.steps)}"
        self.steps.append(Step(operation, inputs, (output,), attributes))
        return output

    def split(self, value: str, widths: Sequence[int]) -> list[str]:
        """The value's last axis in pieces of these widths; none for a piece without any."""
        kept = [width for width in widths if width]
        if len(kept) == 1:
            return [value if width else "" for width in widths]
        outputs = tuple(f"{value}_{place}" for place in range(len(kept)))
        sizes = self.constant(kept, dtype=np.int64)
        self.steps.append(Step("Split", (value, sizes), outputs, {"axis": -1}))
        pieces = iter(outputs)
        return [next(pieces) if width else "" for width in widths]

    def joined(self, *values: str, name: str = "") -> str:
        """Values side by side along the last axis; empty names are nothing."""
        return self.apply("Concat", *filter(None, values), name=name, axis=-1)

    def linear(self, value: str, weight: str, bias: str) -> str:
        """A layer, (N, i) to (N, o)."""
        return self.apply("Gemm", value, weight, bias, transB=1)

    def lowered(self, results: Sequence[Symbol], given: Mapping[Symbol, str]) -> list[str]:
        """The columns that these symbols are, of inputs that are columns.

        Raises:
            ConfigError: the layout does something else with its columns than turning and mirroring them.
        """
        values = dict(given)
        for symbol in ordered(results, given):
            if symbol.operation == "constant":
                values[symbol] = self.constant(symbol.value)
            elif symbol.operation in _LOWERED:
                values[symbol] = self.apply(
                    _LOWERED[symbol.operation], *(values[x] for x in symbol.args)
                )
            else:
                raise ConfigError(
                    f"the agent's layout takes {symbol.operation!r} of its columns, which no "
                    "export knows: only sums, products, quotients, the larger of two and "
                    "choices by equality do."
                )
        return [values[symbol] for symbol in results]


_CAN = Capabilities(recurrent=True)


def agent_program(network: Network, craft: Spacecraft | None = None) -> Program:
    """What a network of one member answers: "command" (N, commands), and "memory_out" (N, m) if it has one.

    Commands are in the ranges of the craft; without one they are from 0 to 1.

    The same as `rans.policy.network.Network.deterministic_action`, of "observation" (N, width) and "memory" (N, m).
    What the network sees of its columns is traced from the layout's own code.
    """
    given = network.architecture
    if lacking := _CAN.missing(given):
        raise ConfigError(
            f"the agent has {lacking}, which no ONNX and no NumPy file knows yet: export it as rans or sb3."
        )
    program = Program()
    weights = {
        name: program.constant(x.detach().numpy(), name.removeprefix(EXTRACTOR))
        for name, x in _actors(network).items()
    }

    # Columns in the body frame, and as filters have them: first of all as they count.
    body = _in_body(program, given.layout)
    columns = program.joined(*body, name="body")
    kept = given.rows, given.filtering
    history, known = program.split("memory", kept) if any(kept) else ("", "")
    filters = program.split(known, [1] * given.filtering) if given.filters else []
    filtered = _filtered(program, given, body, filters) if filters else []
    counted = filtered[0][1] if filtered else body

    # What the trunk is given, from the side of the craft that has the goal ahead.
    view = _View.chosen(program, given, counted)
    x = _shown(program, network, view, columns, filtered, history)
    for layer in range(len(given.layers)):
        weight, bias = (
            weights[f"{EXTRACTOR}trunk.{2 * layer}.{part}"] for part in ("weight", "bias")
        )
        x = _activated(program, given.activation, program.linear(x, weight, bias))
    if given.units:
        x = _core(program, weights, x)

    # Commands, each thruster's from its place in that view.
    head = program.linear(x, weights["head.weight"], weights["head.bias"])
    outputs = program.split(head, [given.thrusters] * given.last.outputs)
    if view is not None:
        outputs = [program.apply("GatherElements", one, view.place, axis=1) for one in outputs]
    ranges = () if craft is None or is_identity(craft) else craft.commands
    command = _command(program, given, outputs, "output" if ranges else "command")
    if ranges:
        _commanded(program, command, ranges)
    if any(kept):
        rows = _remembered(program, given, history, columns, command) if history else []
        rows += _expected(program, given, body, filters) if filters else []
        program.joined(*rows, name="memory_out")
    return program


def _activated(program: Program, name: str, x: str) -> str:
    """What the function between layers makes of rows, by ONNX's own operation where it has one."""
    if name in _ACTIVATIONS:
        return program.apply(_ACTIVATIONS[name], x)
    symbol = Symbol.input("x")
    return program.lowered([ACTIVATIONS[name].formula(symbol)], {symbol: x})[0]


def _command(program: Program, given: Architecture, outputs: Sequence[str], name: str) -> str:
    """The deterministic commands (N, n) from the last layer's outputs, (N, n) each; see `rans.policy.heads`."""
    if given.head == "on-off":
        opens = program.apply("Greater", *outputs, program.constant(0.0))
        return program.apply("Cast", opens, name=name, to=1)  # to float32
    if given.head == "gaussian":
        bounds = program.constant(0.0), program.constant(1.0)
        return program.apply("Clip", *outputs, *bounds, name=name)
    symbols = _symbols("output", len(outputs))
    known = dict(zip(symbols, outputs, strict=True))
    (command,) = program.lowered([Symbol.constant(given.last.command(*symbols))], known)
    return program.apply("Identity", command, name=name)


def _commanded(program: Program, output: str, ranges: Sequence[CommandRange]) -> None:
    """Commands in their ranges, from outputs from 0 to 1: what `rans.effectors.commands.of_outputs` does."""

    def row(values: Iterable[float]) -> str:
        return program.constant(np.array([*values], dtype=np.float32))

    scale = row(one.high - one.low if one.kind != "on-off" else 0.0 for one in ranges)
    low = row(one.low for one in ranges)
    if not any(one.kind == "on-off" for one in ranges):
        program.apply("Add", program.apply("Mul", output, scale), low, name="command")
        return
    between = program.apply("Add", program.apply("Mul", output, scale), low)
    # From 0.5 on: more than the number before it.
    before = np.nextafter(np.float32(0.5), np.float32(0.0))
    opens = program.apply("Cast", program.apply("Greater", output, program.constant(before)), to=1)
    chosen = row(float(one.kind == "on-off") for one in ranges)
    program.apply("Add", between, program.apply("Mul", opens, chosen), name="command")


def _actors(network: Network) -> dict[str, Tensor]:
    """Weights without the critic's; the head of a choice is the difference of its two logits."""
    kept = {
        name: x
        for name, x in network.tensors.items()
        if name.startswith((f"{EXTRACTOR}trunk.", f"{EXTRACTOR}core."))
    }
    tensors = network.tensors
    kept["head.weight"], kept["head.bias"] = network.architecture.last.folded(
        tensors["action_net.weight"], tensors["action_net.bias"]
    )
    return kept


def _in_body(program: Program, layout: Layout) -> list[str]:
    symbols = _symbols("column", layout.width)
    columns = program.split("observation", [1] * layout.width)
    return program.lowered(layout.in_body(symbols), dict(zip(symbols, columns, strict=True)))


def _symbols(name: str, count: int) -> list[Symbol]:
    return [Symbol.input(f"{name} {k}") for k in range(count)]


@dataclass(frozen=True)
class _View:
    """From which of its equivalent sides each spacecraft is seen (decision 009)."""

    views: Symmetries
    which: str
    """(N,)."""
    place: str
    """(N, thrusters): index of each thruster's place in the view."""

    @classmethod
    def chosen(cls, program: Program, given: Architecture, body: Sequence[str]) -> _View | None:
        """The view that has the goal most ahead; None without symmetries or a way to go."""
        way = given.layout.body.ahead(body)
        views = given.symmetries
        if views is None or way is None:
            return None
        aim = np.asarray(AIM[: len(way)], np.float32)
        ahead = program.constant(np.einsum("i,sij->js", aim, views.turn), "ahead")
        score = program.apply("MatMul", program.joined(*way), ahead)
        which = program.apply("ArgMax", score, name="view", axis=1, keepdims=0)
        places = program.constant(views.place, "places", np.int64)
        return cls(views, which, program.apply("Gather", places, which, axis=0))

    def columns(self, program: Program, layout: Layout, value: str, rows: bool = False) -> str:
        """Columns (N, k), or several rows of them (N, rows, k), as the view shows them."""
        count, size, _ = self.views.turn.shape
        table = np.concatenate(
            (self.views.turn.reshape(count, -1), self.views.hand[:, None]), axis=1
        )
        told = program.apply("Gather", program.constant(table, "turns"), self.which, axis=0)
        if rows:
            told = _shaped(program, told, 1, size * size + 1)
        turn = _symbols("turn", size * size)
        hand = Symbol.input("hand")
        symbols = _symbols("column", layout.width)

        def turned(u: Columns) -> Columns:
            return [sum(turn[size * i + j] * x for j, x in enumerate(u)) for i in range(size)]

        known = dict(zip((*turn, hand), program.split(told, [1] * (size * size + 1)), strict=True))
        known |= dict(zip(symbols, program.split(value, [1] * layout.width), strict=True))
        return program.joined(*program.lowered(layout.mirrored(symbols, turned, hand), known))

    def commands(self, program: Program, value: str, rows: int) -> str:
        """Commands (N, rows, thrusters) as the view shows them."""
        back = np.argsort(self.views.place, axis=1)
        table = program.constant(np.tile(back, (1, rows)), "places_back", np.int64)
        index = _shaped(
            program, program.apply("Gather", table, self.which, axis=0), rows, back.shape[1]
        )
        return program.apply("GatherElements", value, index, axis=2)


def _shaped(program: Program, value: str, *shape: int) -> str:
    return program.apply("Reshape", value, program.constant((-1, *shape), dtype=np.int64))


def _looks(program: Program, network: Network, seen: str) -> str:
    """Columns normalised and clipped, and a second time magnified and squashed (decision 008)."""
    zoom = network.architecture.zoom
    scale = _scale(network)
    x = _normalised(program, network, seen)
    if not zoom:
        return x
    magnified = program.apply("Mul", seen, program.constant((scale * zoom).numpy(), "zoom"))
    return program.joined(x, program.apply("Tanh", magnified))


def _scale(network: Network) -> Tensor:
    return torch.rsqrt(network.tensors[f"{EXTRACTOR}variance"] + 1e-6)


def _normalised(program: Program, network: Network, x: str) -> str:
    mean = program.constant(network.tensors[f"{EXTRACTOR}mean"].numpy(), "mean")
    shifted = program.apply("Sub", x, mean)
    scaled = program.apply("Mul", shifted, program.constant(_scale(network).numpy(), "scale"))
    clip = network.architecture.clip
    return program.apply("Clip", scaled, program.constant(-clip), program.constant(clip))


def _shown(
    program: Program,
    network: Network,
    view: _View | None,
    columns: str,
    filtered: Sequence[tuple[Layout, list[str]]],
    history: str,
) -> str:
    """The columns, or what `_filtered` makes of them, and a history, each if there is one."""
    if filtered:
        x = _looks_at_filtered(program, network, view, filtered)
    else:
        layout = network.architecture.layout.body
        x = _looks(
            program, network, columns if view is None else view.columns(program, layout, columns)
        )
    recalled = _recalled(program, network, view, history) if history else ""
    return program.joined(x, recalled, name="shown") if filtered or recalled else x


def _filtered(
    program: Program, given: Architecture, body: Sequence[str], filters: Sequence[str]
) -> list[tuple[Layout, list[str]]]:
    """The reading as it counts, and what each filter makes of it, with their layouts."""
    read = _symbols("read", given.seen)
    memory = _symbols("filter", given.filtering)
    known = dict(zip((*read, *memory), (*body, *filters), strict=True))
    blocks = given.filtered((*read, *memory))
    found = iter(program.lowered([x for _, block in blocks for x in block], known))
    return [(layout, list(islice(found, len(block)))) for layout, block in blocks]


def _looks_at_filtered(
    program: Program,
    network: Network,
    view: _View | None,
    filtered: Sequence[tuple[Layout, list[str]]],
) -> str:
    """All of `_filtered` from the same side, each looked at in the same way."""
    given = network.architecture
    shown = []
    for (layout, block), told in zip(filtered, given.told, strict=True):
        rows = program.joined(*block)
        rows = rows if view is None else view.columns(program, layout, rows)
        columns, beside = program.split(rows, (given.seen, told))
        bounds = [program.constant(x) for x in (-given.clip, given.clip)]
        shown += [
            _looks(program, network, columns),
            beside and program.apply("Clip", beside, *bounds),
        ]
    return program.joined(*shown)


def _expected(
    program: Program, given: Architecture, body: Sequence[str], filters: Sequence[str]
) -> list[str]:
    """What filters remember once the command is given."""
    sizes = {"read": given.seen, "filter": given.filtering, "told": given.thrusters}
    symbols = [symbol for name in sizes for symbol in _symbols(name, sizes[name])]
    columns = *body, *filters, *program.split("command", [1] * given.thrusters)
    return program.lowered(given.expected(symbols), dict(zip(symbols, columns, strict=True)))


def _recalled(program: Program, network: Network, view: _View | None, history: str) -> str:
    """What is remembered, (N, m), from the same side and with the columns normalised."""
    given = network.architecture
    rows = _shaped(program, history, given.recalled, given.row)
    then, told = program.split(rows, (given.answered, given.thrusters))
    if view is not None:
        then = then and view.columns(program, given.layout.body, then, rows=True)
        told = view.commands(program, told, given.recalled)
    return _shaped(
        program, program.joined(then and _normalised(program, network, then), told), given.rows
    )


def _remembered(
    program: Program, given: Architecture, history: str, columns: str, command: str
) -> list[str]:
    """Averages that move towards the newest columns and command, then the last ones, oldest first."""
    newest = command if given.commands_only else program.joined(columns, command)
    width = given.row
    count = len(given.averages)
    last = min(given.history, 1)
    averages, _, others = program.split(
        history, [x * width for x in (count, last, given.history - last)]
    )
    if count:
        kept = program.constant(np.repeat(np.asarray(given.averages, np.float32), width), "kept")
        often = program.joined(*[newest] * count)
        apart = program.apply("Mul", kept, program.apply("Sub", averages, often))
        averages = program.apply("Add", often, apart)
    return [averages, others, newest if last else ""]


def _core(program: Program, weights: Mapping[str, str], x: str) -> str:
    """A gated recurrent unit, torch's `GRUCell`: what it says is what it remembers."""
    given, kept = (
        [weights[f"{EXTRACTOR}core.{kind}_{of}"] for kind in ("weight", "bias")]
        for of in ("ih", "hh")
    )
    units = program.constants[kept[0]].shape[1]
    reset, update, fresh = program.split(program.linear(x, *given), [units] * 3)
    old_reset, old_update, old = program.split(program.linear("memory", *kept), [units] * 3)
    reset = program.apply("Sigmoid", program.apply("Add", reset, old_reset))
    update = program.apply("Sigmoid", program.apply("Add", update, old_update))
    fresh = program.apply("Tanh", program.apply("Add", fresh, program.apply("Mul", reset, old)))
    apart = program.apply("Mul", update, program.apply("Sub", "memory", fresh))
    return program.apply("Add", fresh, apart, name="memory_out")
