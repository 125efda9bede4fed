"""A craft as a functional mock-up unit of FMI 2.0: commands in; pose, velocities, stores and mass out.

Its motion is the engine's, traced (`rans.model.trace`) and printed as C in double precision. A communication step
is a control period, or several. FMPy, which is not ours, flies it beside the engine (`tests/fmu/test_craft.py`).
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from rans.compile.cuda.source import Lines
from rans.compile.substeps import Call, Substep, Substeps
from rans.extend import (
    Body,
    ConfigError,
    Drift,
    Field,
    GoToPose,
    Heading,
    PlanarState,
    Quat,
    Setup,
    Spacecraft,
    SpatialState,
    StepInputs,
    Vec2,
    Vec3,
    World,
    brief,
    leaves,
    load_spacecraft,
    to_toml,
    unflatten,
    write_text,
)
from rans.languages import C
from rans.model.operations import C_DOUBLE
from rans.model.trace import Symbol
from rans.policy.program import inputs
from rans_robot.fmu.unit import Unit, Variable, write_unit

_PLANE = (
    ("x", "m", "position of the centre of mass in W"),
    ("y", "m", "position of the centre of mass in W"),
    ("heading", "rad", "angle from W's x to the body's"),
    ("vx", "m/s", "velocity in W"),
    ("vy", "m/s", "velocity in W"),
    ("spin", "rad/s", "angular velocity about z"),
)
_SPACE = (
    *((name, "m", "position of the centre of mass in W") for name in "xyz"),
    *((f"q{name}", "1", "quaternion from the body to W, scalar first") for name in "wxyz"),
    *((f"v{name}", "m/s", "velocity in W") for name in "xyz"),
    *((f"w{name}", "rad/s", "angular velocity relative to W, in the body") for name in "xyz"),
)
"""Name, unit and meaning of each number of a state, as `rans identify` names columns of its files."""
_Name = tuple[str, str, str]
"""Name, unit and meaning of a number of a state."""
_FARTHEST = 1e12
"""Largest number of a state at its start, beyond which double precision does not hold a metre."""


def write_craft(folder: Path, setup: Setup) -> None:
    """Write craft.fmu: the spacecraft as designed, in the world of its task, from states that the user sets.

    Raises:
        ConfigError: the compiler refuses the sources, or the disk refuses.
    """
    craft = setup.craft
    names = _names(setup)
    variables = _variables(setup, names)
    with tempfile.TemporaryDirectory() as build:
        source = Path(build)
        (source / "craft.c").write_text(_motion(setup), "utf-8")
        (source / "craft.h").write_text(_header(setup, [name for name, _, _ in names]), "utf-8")
        unit = Unit(
            "craft",
            craft.name,
            f"{craft.name}, as RANS computes its motion in {setup.task.drift.name}.",
            setup.timing.control_period,
            False,
            variables,
            ("craft_unit.c", "craft.c"),
            ("craft.h",),
        )
        write_unit(folder, source, unit, {"resources/spacecraft.toml": to_toml(craft).encode()})


def write_craft_export(
    spec: str,
    folder: Path,
    form: str = "fmu",
    episodes: int = 0,
    seed: int = 0,
    margins: int = 0,
) -> dict[str, Any]:
    """Write craft.fmu of a spacecraft in free flight, and its file; see `rans.deploy.export.Exporter`.

    Args:
        spec: name or file of the spacecraft.
        folder: folder to write.
        form: "fmu".
        episodes: not used: a spacecraft has no flights.
        seed: not used.
        margins: not used.

    Raises:
        ConfigError: the form is another, there is no such spacecraft, the folder has an agent, or the disk refuses.
    """
    if form != "fmu":
        raise ConfigError(
            f"{brief(spec)} is a spacecraft, which is exported as fmu, not as {form}; the usual cause is a missing "
            "name of the agent, as in any-craft-2d@my.toml."
        )
    craft = load_spacecraft(spec)
    if (folder / "contract.json").exists():
        raise ConfigError(
            f"{folder} has the files of an agent, whose craft.fmu moves in the agent's task: export into another "
            "folder."
        )
    write_craft(folder, Setup(craft, GoToPose()))
    write_text(folder / "spacecraft.toml", to_toml(craft))
    return {"episodes": episodes}


def _names(setup: Setup) -> list[_Name]:
    """Name, unit and meaning of each number of a state, with those of effectors and of where the target is.

    Their order is that of a state's leaves: `_motion` and craft.h rely on it, and models that import the unit on
    the names.
    """
    craft = setup.craft
    stores = [
        (store.name.replace(" ", "_"), store.unit, f"{store.name} of the effectors")
        for store in craft.stores
    ]
    orbit = [
        (name, "rad", f"{name.replace('_', ' ')} of the target on its orbit")
        for name in moving(setup.task.drift).values()
    ]
    return [*(_PLANE if craft.dimension == 2 else _SPACE), *stores, *orbit]


def moving(drift: Drift) -> dict[int, str]:
    """Which leaves of a drift change with time, and their names, such as that of a mean anomaly, rad."""
    later = leaves(drift.later(1.0))
    return {
        at: name
        for at, (name, now) in enumerate(zip(_names_of(drift), leaves(drift), strict=True))
        if later[at] != now
    }


def _names_of(drift: Any) -> list[str]:
    """Names of a drift's leaves."""
    names = []
    for one in fields(drift):
        value = getattr(drift, one.name)
        names += _names_of(value) if is_dataclass(value) else [one.name]
    return names


def drift_of(drift: Drift, entries: Sequence[Field]) -> Drift:
    """A drift with these numbers for those that change with time."""
    values = [*leaves(drift)]
    for at, entry in zip(moving(drift), entries, strict=True):
        values[at] = entry
    return unflatten(drift, values)


def entries_of(drift: Drift, still: Drift) -> list[Field]:
    """Numbers of a drift at the places of those of a still one, which is all numbers, that change with time."""
    return [leaves(drift)[at] for at in moving(still)]


def _start(setup: Setup) -> list[float]:
    """At rest in the origin, with stores as at the start of an episode, and the target where its orbit has it."""
    craft = setup.craft
    still = [0.0] * 6 if craft.dimension == 2 else [0.0] * 3 + [1.0] + [0.0] * 9
    stores = [float(store.initial) for store in craft.stores]
    drift = setup.task.drift
    return [*still, *stores, *map(float, entries_of(drift, drift))]


def _ranges(setup: Setup) -> list[tuple[float, float]]:
    """Least and largest number of each entry of a state at its start."""
    craft = setup.craft
    width = len(_PLANE if craft.dimension == 2 else _SPACE)
    return [
        *((-_FARTHEST, _FARTHEST) for _ in range(width)),
        *((float(store.low), float(store.high)) for store in craft.stores),
        *((-math.tau, math.tau) for _ in moving(setup.task.drift)),
    ]


def _variables(setup: Setup, names: Sequence[_Name]) -> list[Variable]:
    """Variables of the unit in this order, which numbers them.

    Commands, the state at the start, the state, the mass.
    """
    craft = setup.craft
    commands = [
        Variable(
            f"command[{at}]",
            f"{one.name}, {one.kind}",
            "input",
            start=float(one.low),
            low=float(one.low),
            high=float(one.high),
        )
        for at, one in enumerate(craft.commands)
    ]
    starts = [
        Variable(
            f"start_{name}",
            f"at the start: {meaning}",
            "parameter",
            unit,
            "fixed",
            start,
            low,
            high,
        )
        for (name, unit, meaning), start, (low, high) in zip(
            names, _start(setup), _ranges(setup), strict=True
        )
    ]
    states = [
        Variable(name, meaning, "output", unit, "continuous") for name, unit, meaning in names
    ]
    mass = Variable("mass", "mass with what is left in the tank", "output", "kg", "continuous")
    return [*commands, *starts, *states, mass]


def _header(setup: Setup, names: Sequence[str]) -> str:
    """craft.h: sizes, names and ranges, and the function of craft.c."""
    craft = setup.craft
    count = len(craft.commands)
    width = len(names)
    first, end = (3, 7) if craft.dimension == 3 else (0, 0)

    def table(kind: str, name: str, size: int, entries: Iterable[str]) -> str:
        return f"static const {kind} rans_craft_{name}[{size}] = {{{', '.join(entries)}}};"

    rigid = len(_PLANE if craft.dimension == 2 else _SPACE)
    tank = "" if craft.propellant is None else f" - {craft.propellant.mass!r} + state[{rigid}]"
    ranges = _ranges(setup)
    lines = [
        f"/* {C.word(craft.name)}: what craft_unit.c knows of it. SI units. */",
        "#ifndef RANS_CRAFT_H",
        "#define RANS_CRAFT_H",
        '#include "craft_fmu.h"',
        f"#define RANS_COMMANDS {count}",
        f"#define RANS_STATE {width}",
        f"#define RANS_QUATERNION {first}",
        f"#define RANS_QUATERNION_END {end}",
        table("double", "low", count, (repr(float(one.low)) for one in craft.commands)),
        table("double", "high", count, (repr(float(one.high)) for one in craft.commands)),
        table("int", "switches", count, (str(int(one.kind == "on-off")) for one in craft.commands)),
        table(
            "char *const", "effectors", count, (f'"{C.word(one.name)}"' for one in craft.commands)
        ),
        table("char *const", "names", width, (f'"{C.word(name)}"' for name in names)),
        table("double", "start", width, map(repr, _start(setup))),
        table("double", "least", width, (repr(low) for low, _ in ranges)),
        table("double", "most", width, (repr(high) for _, high in ranges)),
        "static inline double rans_craft_mass(const double *state) {",
        "    (void)state;",
        f"    return {float(craft.mass)!r}{tank};",
        "}",
        "/* The state after a control period in which commands are held. */",
        "void rans_craft_move(const double *state, const double *command, double *after);",
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def _motion(setup: Setup) -> str:
    """Text of craft.c: the engine's own equations of motion over a control period, traced in double precision.

    `tests/fmu/test_craft.py` flies it beside the engine.
    """
    world = World(setup._replace(conditions=None, guard=None))
    craft = world.craft
    before = inputs("state", len(_names(setup)))
    still = world.task.drift
    own = len(before) - len(moving(still))
    drift = drift_of(still, before[own:])
    command = inputs("command", len(craft.commands))
    substeps = Substeps()
    moved = world.move(
        state_of(craft, before[:own]),
        StepInputs(Body.of(craft), (tuple(command),), drift=drift),
        substeps.advance,
    )
    onwards = entries_of(drift.later(world.timing.control_period), still)
    ends = [*leaves(replace(moved[-1], notes=None)), *onwards]
    after = [Symbol.constant(x) for x in ends]
    text = [
        '#include "craft.h"',
        "",
        "#include <math.h>",
        "#include <stdbool.h>",
        "",
        "typedef double real;",
        "",
    ]
    for kind in substeps.kinds:
        text += _substep(kind)
    text.append("void rans_craft_move(const real *state, const real *command, real *after) {")
    lines = _CLines({"state": before, "command": command})
    text += ["    (void)state, (void)command;"]
    for number, call in enumerate(substeps.calls):
        text += _indented(lines.call(number, call))
    text += _indented(lines.results(after))
    return "\n".join([*text, "}", ""])


def state_of(craft: Spacecraft, entries: Sequence[Field]) -> Any:
    """A state of these entries in the order of `_names`, without stores' own changes."""
    stores = (0.0,) * len(craft.stores)
    still: Any = (
        PlanarState(Vec2(0.0, 0.0), Heading(0.0), Vec2(0.0, 0.0), 0.0, None, stores)
        if craft.dimension == 2
        else SpatialState(
            Vec3(0.0, 0.0, 0.0),
            Quat(1.0, 0.0, 0.0, 0.0),
            Vec3(0.0, 0.0, 0.0),
            Vec3(0.0, 0.0, 0.0),
            None,
            stores,
        )
    )
    return unflatten(still, entries)


def _substep(kind: Substep) -> list[str]:
    """Functions of a substep, and of its repetition, as lines of C.

    Results come after all reads, so that ``state`` may not be ``after``; the repeated one copies for that reason.
    """
    size = len(kind.state)
    lines = _CLines({"state": kind.state, "load": kind.others})
    body = _indented(lines.results(kind.after))
    return [
        f"static void {kind.name}(const real *state, const real *load, real *after) {{",
        "    (void)load;",
        *body,
        "}",
        "",
        f"static void {kind.name}_repeated(int count, const real *state, const real *load, real *after) {{",
        f"    real now[{size}];",
        f"    for (int k = 0; k < {size}; ++k) {{ now[k] = state[k]; }}",
        "    for (int repeat = 0; repeat < count; ++repeat) {",
        f"        {kind.name}(now, load, after);",
        f"        for (int k = 0; k < {size}; ++k) {{ now[k] = after[k]; }}",
        "    }",
        "}",
        "",
    ]


class _CLines(Lines):
    """Lines of a function of C99 in double precision."""

    def __init__(self, arguments: dict[str, Sequence[Symbol]]) -> None:
        super().__init__()
        for name, symbols in arguments.items():
            self.names |= {symbol: f"{name}[{k}]" for k, symbol in enumerate(symbols)}

    def expression(self, symbol: Symbol, args: list[str]) -> str:
        """An operation on operands."""
        return C_DOUBLE.text(symbol.operation, symbol.operand_kind, *args)

    def operand(self, symbol: Symbol) -> str:
        """The name of a symbol, or a number with all digits of a double, in C."""
        if symbol.operation != "constant":
            return self.names[symbol]
        if symbol.kind == "bool":
            return "true" if symbol.value else "false"
        if math.isnan(symbol.value):
            return "((real)NAN)"
        if math.isinf(symbol.value):
            return "((real)INFINITY)" if symbol.value > 0 else "(-(real)INFINITY)"
        text = repr(float(symbol.value))
        return f"({text})" if text.startswith("-") else text

    def call(self, number: int, call: Call) -> Iterator[str]:
        """Lines that call substeps; their results have names afterwards."""
        yield from self.values(call.inputs)
        state, others = ([*map(self.operand, row)] for row in (call.state, call.others))
        yield f"const real state{number}[] = {{{', '.join(state)}}};"
        yield f"const real load{number}[] = {{{', '.join(others)}}};"
        yield f"real moved{number}[{len(call.outputs)}];"
        yield f"{call.function}_repeated({call.repeats}, state{number}, load{number}, moved{number});"
        self.names |= {symbol: f"moved{number}[{k}]" for k, symbol in enumerate(call.outputs)}

    def results(self, after: Sequence[Symbol]) -> Iterator[str]:
        """What the function gives."""
        yield from self.values(after)
        for k, symbol in enumerate(after):
            yield f"after[{k}] = {self.operand(symbol)};"


def _indented(lines: Iterable[str]) -> list[str]:
    return [f"    {line}" for line in lines]
