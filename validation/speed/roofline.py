"""What one step of one environment must read, write and compute, counted from the engine itself.

The engine's step is run on symbols (`rans.compile.step_program.trace_step`), which write down what is done to
them: every operation once, constants folded. What only the few episodes that end in a step need (their
start, their goal, the final observation) is not counted: with one end in 125 or 52 it is one or two bytes
a step.

``python -m validation.speed.roofline`` prints the tables of docs/speed.md.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass
from itertools import groupby

from rans.compile.step_program import BufferWrite, StepProgram, trace_step
from rans.fast.engine import Engine
from rans.model.fields import leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.model.trace import Symbol, ordered
from rans.tasks import GoToPose

_BYTES = {"int": 4, "signed char": 1}
"""Of the types that do not depend on the engine's dtype."""
_NO_OPERATIONS = ("input", "constant")
_SPECIAL = ("sin", "cos", "exp", "sqrt", "atan2", "/")
"""Operations that take a processor several times as long as the others."""


@dataclass(frozen=True)
class Traffic:
    """Bytes of one environment's step, for one part of what the engine holds or gives."""

    name: str
    read: int
    written: int


@dataclass(frozen=True)
class StepWork:
    """What one environment's step asks of the machine."""

    traffic: tuple[Traffic, ...]
    operations: Counter[str]
    """How often each operation is done."""

    @property
    def bytes_moved(self) -> int:
        """Read and written."""
        return sum(part.read + part.written for part in self.traffic)

    @property
    def special(self) -> int:
        """Operations that take several times as long as the others."""
        return sum(self.operations[name] for name in _SPECIAL)


def step_work(engine: Engine, remember: bool = True) -> StepWork:
    """What a step of this engine moves and computes, for actions of one byte a thruster.

    Args:
        engine: whose.
        remember: whether it remembers what episodes draw from their conditions, see `Engine`.

    Raises:
        TypeError: the task's functions do more than arithmetic on fields.
    """
    episode = (
        engine.episode
        if remember
        else engine._backend.episodes(
            engine._world, engine.body, engine.num_envs, engine._draws, remember=False
        )
    )
    program = trace_step(engine._world, episode, engine.dtype)
    symbols = list(ordered([program.ended, *(store.value for store in program.going())]))
    operations = Counter(s.operation for s in symbols if s.operation not in _NO_OPERATIONS)
    return StepWork(tuple(_traffic(engine, program, set(symbols))), operations)


def _traffic(engine: Engine, program: StepProgram, used: set[Symbol]) -> list[Traffic]:
    """By part, in the order of memory."""
    real = engine.dtype.itemsize
    names = _memory_names(engine, len(program.memory))
    sizes = [_BYTES.get(given.type, real) for given in program.memory]
    kept = {store.row for store in program.going() if store.array == "memory"}
    memory = [
        Traffic(name, size * (given.symbol in used), size * (row in kept))
        for row, (name, size, given) in enumerate(zip(names, sizes, program.memory, strict=True))
    ]
    commands = Traffic("action", sum(str(symbol.value).startswith("command") for symbol in used), 0)
    results = [
        Traffic(_result_name(program, store), 0, 1 if store.array == "flags" else real)
        for store in program.going()
        if store.array != "memory"
    ]
    bodies = [
        Traffic("mass properties", real, 0)
        for given in program.settings
        if given.each and given.symbol in used
    ]
    rows = [*memory, *bodies, commands, *results]
    parts = [_sum(name, list(group)) for name, group in groupby(rows, lambda row: row.name)]
    return [part for part in parts if part.read + part.written > 0]


def _sum(name: str, rows: list[Traffic]) -> Traffic:
    return Traffic(name, sum(row.read for row in rows), sum(row.written for row in rows))


def _memory_names(engine: Engine, count: int) -> list[str]:
    """Of each of so many arrays of the engine's memory, in its order."""
    goals = sum(not isinstance(goal, float) for goal in leaves(engine.goal))
    names = ["state"] * len(leaves(engine.state)) + ["goal"] * goals + ["clock"]
    return names + ["last command"] * (count - len(names))


def _result_name(program: StepProgram, store: BufferWrite) -> str:
    if store.array == "flags":
        return "flags"
    if store.row < program.shape.width:
        return "observation"
    return "reward terms" if store.row < program.shape.width + program.shape.terms else "reward"


def table(work: dict[str, StepWork]) -> str:
    """Bytes by part and operations of several engines, in Markdown."""
    names = list(dict.fromkeys(part.name for one in work.values() for part in one.traffic))
    parts = [{part.name: part for part in one.traffic} for one in work.values()]
    nothing = Traffic("", 0, 0)
    rows = [
        [name, *(f"{p.get(name, nothing).read} + {p.get(name, nothing).written}" for p in parts)]
        for name in names
    ]
    rows += [
        ["all", *(f"**{one.bytes_moved}**" for one in work.values())],
        ["operations", *(str(sum(one.operations.values())) for one in work.values())],
        ["of them " + ", ".join(_SPECIAL), *(str(one.special) for one in work.values())],
    ]
    head = [["bytes read + written", *work], ["---"] * (len(work) + 1)]
    return "\n".join(f"| {' | '.join(row)} |" for row in [*head, *rows])


def main() -> None:
    """Print the table of both dimensions."""
    crafts = map(load_spacecraft, ("floating-platform", "free-flyer"))
    work = {
        f"go-to-pose, {craft.name}": step_work(Engine(craft, GoToPose(), 1)) for craft in crafts
    }
    sys.stdout.write(table(work) + "\n")


if __name__ == "__main__":
    main()
