"""``rans list``: the spacecraft, tasks and agents there are, and what one of them is made of."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from rich.table import Table
from tyro import conf

from rans.errors import ConfigError, meant
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.files import number
from rans.model.conditions_file import CONDITIONS
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import SPACECRAFT, load_spacecraft, spacecraft_names
from rans.pretrained import pretrained_card, pretrained_folder, pretrained_names
from rans.registry import Registry
from rans.tasks import TASKS, gymnasium_ids, observation_columns
from rans.terminal import Terminal, table

_ARROWS = "→↗↑↖←↙↓↘"
_TOWARDS, _AWAY = "⊙", "⊗"
_WIDEST = 3.0
"""The farthest thruster in a picture is so many units away: of the outer radius, or longer ones."""


@dataclass(frozen=True)
class List:
    """Show the spacecraft, tasks and agents there are; with a name, one of them in detail."""

    name: Annotated[str | None, conf.Positional, conf.arg(metavar="[NAME]")] = None
    """A spacecraft, a task, an agent, a controller, conditions (the word CONDITIONS for all of them), or the
    .toml file of your own spacecraft."""
    picture: Annotated[Path | None, conf.arg(metavar="FILE")] = None
    """Save a drawing of the spacecraft's thrusters here (.png, .svg or .pdf)."""

    def run(self) -> int:
        """Print; 0 unless the name or the picture's file is wrong, which raises `ConfigError`."""
        console = Terminal()
        for part in self._parts():
            console.print(part, soft_wrap=isinstance(part, str))
        return 0

    def _parts(self) -> Iterable[str | Table]:
        crafts, agents = spacecraft_names(), pretrained_names()
        if self.picture is not None and (self.name is None or self.name in TASKS or self.name in agents):
            raise ConfigError(f"--picture {self.picture} draws one spacecraft: name it, for example "
                              f"rans list floating-platform --picture {self.picture}.")
        if self.name is None:
            controllers = ", ".join(_named(CONTROLLERS, name) for name in CONTROLLERS)
            return (_all_spacecraft(), _all_tasks(), _all_conditions(),
                    f"Controllers (NAME:TASK-2d): {controllers}", *([_all_agents()] if agents else []))
        if self.name.lower() == "conditions":
            return (_all_conditions(),)
        if self.name in CONDITIONS:
            return (CONDITIONS[self.name].text.rstrip(),)
        if self.name in TASKS:
            return _task_details(self.name)
        if (agent := self.name.removeprefix("pretrained:")) in agents:
            return _agent_details(agent)
        if self.name in CONTROLLERS:
            return (f"{self.name}: {_summary(CONTROLLERS[self.name])}",
                    f"As a contestant {self.name}:go-to-pose-2d, or {self.name} after a first one.")
        if self.name not in crafts and ":" not in self.name and not self.name.endswith(".toml"):
            near = meant(self.name, [*crafts, *TASKS, *CONDITIONS, *CONTROLLERS, *agents])
            raise ConfigError(
                f"there is no spacecraft, task, agent, controller or set of conditions named {self.name!r}"
                f"{near}; known spacecraft are {', '.join(crafts)}; known tasks are {', '.join(TASKS)}; "
                f"known conditions are {', '.join(CONDITIONS)}; known controllers are "
                f"{', '.join(CONTROLLERS)}; known agents are {', '.join(agents) or 'none'}; your own "
                "spacecraft's file must end in .toml.")
        craft = load_spacecraft(self.name)
        if self.picture is None:
            return _spacecraft_details(craft)
        from rans.drawing import draw_layout, save_picture

        save_picture(draw_layout(craft), self.picture)
        return (*_spacecraft_details(craft), f"Picture: {self.picture}")




def layout_text(craft: Spacecraft) -> str:
    """The thrusters of a spacecraft seen along z, drawn with characters.

    Each thruster is its index with the direction of its force: an arrow, or ⊙ towards the viewer and
    ⊗ away; + is the centre of mass and the dots are the outer radius.
    """
    arms = [[p - c for p, c in zip(t.position, craft.centre_of_mass, strict=True)] for t in craft.thrusters]
    unit = max(craft.radius, *(math.hypot(x, y) / _WIDEST for x, y, _ in arms))
    cells: dict[tuple[int, int], str] = {}
    for angle in range(0, 360, 6):
        x, y = (craft.radius / unit * f(math.radians(angle)) for f in (math.cos, math.sin))
        cells[_cell((x, y), 1.0)] = "·"
    _put(cells, (0.0, 0.0), "+")
    for index, (thruster, (x, y, _)) in enumerate(zip(craft.thrusters, arms, strict=True)):
        dx, dy, dz = thruster.direction
        mark = _ARROWS[round(math.atan2(dy, dx) / (math.pi / 4)) % 8]
        if abs(dz) > math.hypot(dx, dy):
            mark = _TOWARDS if dz > 0 else _AWAY
        _put(cells, (x / unit + 0.35 * dx, y / unit + 0.35 * dy), f"{index}{mark}")
    rows, columns = zip(*cells, strict=True)
    width = range(min(columns) - 2, max(columns) + 1)
    return "\n".join("".join(cells.get((row, column), " ") for column in width)
                     for row in range(min(rows), max(rows) + 1))


def _cell(place: Sequence[float], width: float) -> tuple[int, int]:
    """Row and first column of a text centred at a place given in units; characters are 1 x 2."""
    return round(-8.0 * place[1]), round(16.0 * place[0] - (width - 1) / 2)


def _put(cells: dict[tuple[int, int], str], place: Sequence[float], text: str) -> None:
    """Write the text at its place, or in the first free row below."""
    row, column = _cell(place, len(text))
    span = range(column, column + len(text))
    while any(cells.get((row, c), "·") != "·" for c in span):
        row += 1
    cells.update({(row, c): letter for c, letter in zip(span, text, strict=True)})


def _all_spacecraft() -> Table:
    def row(name: str) -> tuple[str, ...]:
        c = SPACECRAFT[name].craft
        return _space(c), f"{c.mass:g} kg", f"{len(c.thrusters)} x {_forces(c)}", c.thrust_sharing

    return table("Spacecraft", ("name", "moves in", "mass", "thrusters", "thrust sharing"), [
        (_named(SPACECRAFT, name), *_or_why_not(row, name)) for name in SPACECRAFT])


def _all_tasks() -> Table:
    def row(name: str) -> tuple[str, ...]:
        return _flag(TASKS[name]), _summary(TASKS[name])

    return table("Tasks", ("name, Gymnasium ids", "flag", "what"), [
        ("\n  ".join((_named(TASKS, n), *gymnasium_ids(n))), *_or_why_not(row, n)) for n in TASKS])


def _all_conditions() -> Table:
    def row(name: str) -> tuple[str, ...]:
        return (CONDITIONS[name].conditions.description,)

    return table("Conditions (rans list NAME tells every number and its source)", ("name", "what"),
                 [(_named(CONDITIONS, name), *_or_why_not(row, name)[-1:]) for name in CONDITIONS])


def _named(registry: Registry[Any], name: str) -> str:
    """The name, and the package it comes from if that is not RANS."""
    return f"{name} (of {package})" if (package := registry.package(name)) else name


def _or_why_not(row: Callable[[str], tuple[str, ...]], name: str) -> tuple[str, ...]:
    """The cells of one name; of what does not work, the reason in the second of them."""
    try:
        return row(name)
    except ConfigError as error:
        return "", str(error)


def _all_agents() -> Table:
    cards = map(pretrained_card, pretrained_names())
    return table("Agents (pretrained:NAME)", ("name", "spacecraft", "solved"), [
        (card["name"], card["spacecraft"], _solved(card)) for card in cards])


def _solved(card: dict[str, Any]) -> str:
    """Share of episodes; of a multi-task agent those of its worst and its best task."""
    shares = [values["solved"][0] for values in card["evaluation"]["own"].values()]
    low, high = min(shares), max(shares)
    return f"{low:.4g} %" if low == high else f"{low:.4g} to {high:.4g} %"


def _agent_details(name: str) -> Iterable[str | Table]:
    from rans.evaluation.measure.statistics import figure

    card = pretrained_card(name)
    training = card["training"]
    yield f"{name}: {card['task']} with {card['spacecraft']}, in {pretrained_folder(name)}"
    yield (f"Trained with seed {training['seed']} for {training['steps']:,} steps in "
           f"{training['seconds']:.1f} s on {training['device']}; judged on {card['episodes']:,} episodes of "
           f"seed {card['evaluation_seed']}.")
    for protocol, parts in card["evaluation"].items():
        for part, values in parts.items():
            yield table(f"Protocol {protocol} {part}".rstrip(), ("metric", "value", "95 % interval"), [
                (metric, f"{figure(value)} {unit if math.isfinite(value) else ''}".rstrip(),
                 f"{figure(low)} to {figure(high)}")
                for metric, (*three, unit) in values.items() for value, low, high in [map(number, three)]])


def _spacecraft_details(craft: Spacecraft) -> Iterable[str | Table]:
    axes, moments = craft.dimension, "\n".join(_vector(row, 4) for row in craft.inertia)
    yield table(craft.name, ("property", "value"), [
        ("moves in", _space(craft)),
        ("mass", f"{craft.mass:g} kg"),
        ("inertia about the centre of mass, kg m²", moments),
        ("centre of mass, m", _vector(craft.centre_of_mass[:axes], 4)),
        ("outer radius", f"{craft.radius:g} m"),
        ("thrust sharing", craft.thrust_sharing)])
    yield table("Thrusters", ("", "position, m", "direction", "force, N", "torque, N m"), [
        (str(i), *(_vector(v) for v in (t.position[:axes], t.direction[:axes], (t.force,), w[axes:])))
        for i, (t, w) in enumerate(zip(craft.thrusters, craft.wrench_map, strict=True))])
    yield f"\n{layout_text(craft)}\n"
    yield f"x to the right, y up; arrows are forces on the craft; {_TOWARDS} towards you, {_AWAY} away."


def _task_details(name: str) -> Iterable[str | Table]:
    task = TASKS[name]()
    yield f"{name}: {_summary(TASKS[name])}"
    yield f"Gymnasium: {', '.join(gymnasium_ids(name))}; task flag: {_flag(task)}"
    meanings = _field_meanings(TASKS[name])
    yield table("Settings", ("name", "default", "meaning"), [
        (f.name, _setting(getattr(task, f.name)), meanings.get(f.name, ""))
        for f in dataclasses.fields(task)])
    shown = {"the plane": observation_columns(task, 2), "space": observation_columns(task, 3)}
    for where, columns in shown.items():
        yield table(f"Observation in {where}", ("column", "what", "unit", "frame"), [
            (str(index), *column) for index, column in enumerate(columns)])


def _flag(task: object) -> str:
    return str(getattr(task, "flag", "drawn"))


def _field_meanings(described: type) -> dict[str, str]:
    """The texts under a dataclass's fields, which Python itself does not keep."""
    meanings = {}
    parts: list[type] = [part for part in reversed(described.__mro__) if dataclasses.is_dataclass(part)]
    for part in parts:
        written: Any = ast.parse(inspect.getsource(part)).body[0]
        for field, text in itertools.pairwise(written.body):
            match field, text:
                case ast.AnnAssign(ast.Name(name)), ast.Expr(ast.Constant(str(meaning))):
                    meanings[name] = " ".join(meaning.split())
    return meanings


def _setting(value: object) -> str:
    if dataclasses.is_dataclass(value):
        return "its defaults"
    if isinstance(value, tuple):
        return ", ".join(_setting(x) for x in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _space(craft: Spacecraft) -> str:
    return "plane, 3DoF" if craft.dimension == 2 else "space, 6DoF"


def _forces(craft: Spacecraft) -> str:
    forces = sorted({t.force for t in craft.thrusters})
    return f"{forces[0]:g} N" if len(forces) == 1 else f"{forces[0]:g} to {forces[-1]:g} N"


def _vector(numbers: Iterable[float], digits: int = 3) -> str:
    # Rounding first and adding zero turns -0 and rounding errors into 0.
    return "  ".join(f"{round(x, 9) + 0.0:.{digits}g}" for x in numbers)


def _summary(described: object) -> str:
    return (described.__doc__ or "").strip().splitlines()[0]
