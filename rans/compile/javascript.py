"""Traced programs as the text of JavaScript functions, which a browser runs in double precision.

A function takes arrays of numbers and returns an object of arrays. Dense layers are calls of ``dense``, which
whoever runs the text provides: ``dense(name, activation, [..])`` gives the outputs of the layer of this name. Pages
of flights run it; `tests/show/pages/test_playground.py` compares a page with Python.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

from rans.compile.substeps import Call, Substeps
from rans.model import operations
from rans.model.fields import Field
from rans.model.trace import Symbol, ordered
from rans.policy.activations import ACTIVATIONS
from rans.policy.capabilities import Capabilities
from rans.policy.program import inputs
from rans.policy.scalars import Stage

JAVASCRIPT = Capabilities(backbones=("dense", "allocated"))
"""Kinds of policies that are printed here: any of dense layers. Allocation is the page's own script."""

_LONGEST = 120
"""Characters of an expression that is written where it is used, once."""


def function(
    name: str,
    arguments: Mapping[str, Sequence[Symbol]],
    results: Mapping[str, Sequence[Field]],
    stages: Iterable[Stage | Call] = (),
) -> str:
    """JavaScript of a function.

    Args:
        name: of the function.
        arguments: arrays that it takes, in order: the symbols that their entries are.
        results: arrays in the object that it returns.
        stages: layers and substeps between inputs and results, in order (`rans.policy.scalars.symbols`,
            `rans.compile.substeps`).
    """
    named = {
        symbol: f"{argument}[{k}]"
        for argument, symbols in arguments.items()
        for k, symbol in enumerate(symbols)
    }
    stages = tuple(stages)
    constants = {key: [*map(Symbol.constant, row)] for key, row in results.items()}
    roots = [symbol for row in constants.values() for symbol in row]
    lines = _Lines(named, [*roots, *(symbol for stage in stages for symbol in stage.inputs)])
    # Stages: their inputs, then the call, whose entries have names afterwards.
    body = []
    for number, stage in enumerate(stages):
        body += lines.values(stage.inputs)
        if isinstance(stage, Call):
            state, others = lines.row(stage.state), lines.row(stage.others)
            text = f"repeated({stage.function}, {stage.repeats}, {state}, {others})"
        else:
            text = lines.row(stage.inputs)
            for layer in stage.layers:
                weights = layer.weight.removesuffix(".weight")
                text = f'dense("{weights}", "{layer.activation}", {text})'
        body.append(f"const stage{number} = {text};")
        lines.names |= {symbol: f"stage{number}[{k}]" for k, symbol in enumerate(stage.outputs)}
    # Results, in an object.
    body += lines.values(roots)
    answer = ", ".join(f"{key}: {lines.row(row)}" for key, row in constants.items())
    body.append(f"return {{{answer}}};")
    return "\n".join((f"function {name}({', '.join(arguments)}) {{", *body, "}"))


def substep_functions(substeps: Substeps) -> str:
    """The text of functions that calls name, and of ``repeated``, which applies one to a state several times.

    Calls in the texts of `function` have these names, and arguments in this order.
    """
    texts = [
        function(kind.name, {"state": kind.state, "load": kind.others}, {"state": kind.after})
        for kind in substeps.kinds
    ]
    loop = "for (let k = 0; k < count; ++k) state = substep(state, load).state;"
    return "\n".join(
        (*texts, f"function repeated(substep, count, state, load) {{\n{loop}\nreturn state;\n}}")
    )


def activations() -> str:
    """The text of an object ``ACTIVATIONS``: functions of one number by the names of `ACTIVATIONS`."""
    (x,) = inputs("x", 1)
    entries = ['"": x => x']
    for name, activation in ACTIVATIONS.items():
        result = Symbol.constant(activation.formula(x))
        lines = _Lines({x: "x"}, [result])
        body = " ".join(lines.values([result]))
        entries.append(f'"{name}": x => {{ {body} return {lines.operand(result)}; }}')
    return "const ACTIVATIONS = {\n" + ",\n".join(entries) + "\n};"


class _Lines:
    """Lines of a function, and what each symbol is called by then."""

    def __init__(self, names: Mapping[Symbol, str], roots: Sequence[Symbol]) -> None:
        self.names = dict(names)
        self._count = 0
        self._uses = Counter(
            [*roots, *(argument for symbol in ordered(roots) for argument in symbol.args)]
        )

    def values(self, roots: Iterable[Symbol]) -> Iterator[str]:
        """Lines that name the roots and their operands in order, short ones used once in place; changes `names`."""
        for symbol in ordered(roots, computed=self.names):
            if symbol.operation != "constant":
                operands = map(self.operand, symbol.args)
                text = operations.JAVASCRIPT.text(symbol.operation, symbol.operand_kind, *operands)
                if self._uses[symbol] == 1 and len(text) < _LONGEST:
                    self.names[symbol] = f"({text})"
                    continue
                self.names[symbol] = name = f"x{self._count}"
                self._count += 1
                yield f"const {name}={text};"

    def row(self, symbols: Iterable[Symbol]) -> str:
        """An array of symbols that have names."""
        return f"[{', '.join(map(self.operand, symbols))}]"

    def operand(self, symbol: Symbol) -> str:
        """A symbol that has a name, or a number."""
        return _number(symbol) if symbol.operation == "constant" else self.names[symbol]


def _number(symbol: Symbol) -> str:
    """A constant as JavaScript writes it, with all digits of a double, in parentheses if negative.

    A minus before a power is no JavaScript, and a minus after a minus would be a decrement: hence the parentheses.
    """
    value = symbol.value
    if symbol.kind == "bool":
        return "true" if value else "false"
    if math.isnan(value):
        return "NaN"
    text = repr(value).replace("inf", "Infinity")
    return f"({text})" if text.startswith("-") else text.removesuffix(".0")
