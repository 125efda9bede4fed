"""Parts of spacecraft, tasks and conditions as tables for terminals, notebooks and programs."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from rans.base.display import default, meanings
from rans.base.table import Table
from rans.model.pace import seconds_for_a_metre, seconds_for_half_a_turn
from rans.model.spacecraft import Spacecraft
from rans.randomization.conditions import Conditions
from rans.tasks import Task, observation_columns
from rans.tasks.derived import PLACES, dimensions, example_state
from rans.tasks.quantities import QUANTITIES


def spacecraft_listing(craft: Spacecraft) -> Table:
    """Masses and shape in SI units, and how soon it moves a metre and turns by half."""
    moments = "\n".join(vector_text(row, 4) for row in craft.inertia)
    if craft.dimension == 2:  # the axis of the plane is the only one
        moments = f"{craft.inertia[2][2]:.4g}"
    metre = "never: it has no thruster"
    if craft.thrusters:
        alone = " by its thrusters alone" if craft.acting_effectors else ""
        metre = f"{seconds_for_a_metre(craft):.3g} s{alone}"
    half_a_turn = "never: it cannot turn"
    if craft.can_turn:
        half_a_turn = f"{seconds_for_half_a_turn(craft):.3g} s"
    return Table(
        ("property", "value"),
        [
            ("moves in", space(craft)),
            ("mass", f"{craft.mass:g} kg"),
            ("inertia about the centre of mass, kg m²", moments),
            ("centre of mass, m", vector_text(craft.centre_of_mass[: craft.dimension], 4)),
            ("outer radius", f"{craft.radius:g} m"),
            ("thrust sharing", craft.thrust_sharing),
            ("actuators", craft.actuators.kind if craft.thrusters else "reaction wheels"),
            *_further(craft),
            ("1 m from rest to rest, at the quickest", metre),
            ("half a turn from rest to rest, at the quickest", half_a_turn),
        ],
        craft.name,
    )


def _further(craft: Spacecraft) -> Iterator[tuple[str, str]]:
    """Rows of what only some craft have: throttle levels, several supplies, propellant, reaction wheels."""
    actuators = craft.actuators
    if (actuators.low, actuators.high) != (0.0, 1.0) or getattr(actuators, "always_lit", False):
        yield "a thruster's command", actuators.allowed
    if len(craft.supplies) > 1:
        for number, members in enumerate(craft.supplies):
            yield f"supply {number}", f"of thrusters {', '.join(map(str, members))}"
    if (tank := craft.propellant) is not None:
        place = "" if tank.position is None else f", tank at {vector_text(tank.position, 4)} m"
        yield "propellant", f"{tank.mass:g} kg, specific impulse {tank.specific_impulse:g} s{place}"
    for effector in craft.further_effectors:
        if effector.summary:
            yield effector.label, effector.summary
    for number, command in enumerate(craft.commands):
        if number >= craft.thruster_count + craft.wheel_count:
            yield f"command {number}", f"{command.name}, from {command.low:g} to {command.high:g}"
    for i, wheel in enumerate(craft.wheels):
        yield (
            f"wheel {i}",
            f"about {vector_text(wheel.axis, 4)}, {wheel.max_torque:g} N m, {wheel.max_momentum:g} N m s, "
            f"{wheel.inertia:g} kg m²",
        )


def thruster_listing(craft: Spacecraft) -> Table:
    """A row for each thruster, in G and in SI units, with its torque about the centre of mass."""
    axes = craft.dimension
    columns = ("thruster", "position, m", "direction", "force, N", "torque, N m")
    rows = []
    for i, (t, w) in enumerate(zip(craft.thrusters, craft.wrench_map, strict=True)):
        vectors = (t.position[:axes], t.direction[:axes], (t.force,), w[axes:])
        rows.append((str(i), *map(vector_text, vectors)))
    return Table(columns, rows, "Thrusters")


def task_listings(task: Task, prefix: str = "") -> Iterator[Table]:
    """Reward and ends of an episode, settings and observation; a multi-task has the episodes of what it draws."""
    if all(type(part) is type(task) for part in task.parts().values()):
        yield _episode(task)
    yield settings_listing(task, prefix)
    for dimension in dimensions(task):
        yield Table(
            ("column", "what", "unit", "frame"),
            [
                (str(index), *column)
                for index, column in enumerate(observation_columns(task, dimension))
            ],
            f"Observation {PLACES[dimension]}",
        )


def _episode(task: Task) -> Table:
    """Table of the reward of a step, and of what ends an episode: time, failure, limits and success."""
    near = ", ".join(
        f"{name} {value:.4g} {QUANTITIES[name].unit}" for name, value in task.tolerances().items()
    )
    timing = task.timing
    seconds = timing.episode_steps * timing.control_period
    rows = [
        ("reward of a step", reward_text(task)),
        (
            "truncated",
            f"{timing.episode_steps} control periods of {timing.control_period:g} s are over, "
            f"{seconds:g} s",
        ),
        ("terminated, failed", _when(type(task).failed)),
    ]
    state, goal = example_state(task, dimensions(task)[0])
    if limits := task.constraints(state, goal):
        ends = "terminated, failed" if task.violation_ends else "goes on, and is no success"
        rows.append((ends, f"a margin is negative: {', '.join(limits)}"))
    if task.done(state, goal) is None:
        rows.append(("as a success", f"truncated with errors within {near}"))
    else:
        rows.append(("as a success", _when(type(task).done)))
    return Table(("it", "what, or when"), rows, "An episode")


def reward_text(task: Task) -> str:
    """First sentence of what the reward's docstring says of its terms."""
    return (type(task).reward.__doc__ or "").strip().partition("\n")[0]


def _when(asked: Callable[..., Any]) -> str:
    """The condition that a method's docstring says it asks, without its "Whether"."""
    first = "".join((asked.__doc__ or "").strip().splitlines()[:1])
    return first.removeprefix("Whether ").removesuffix(".")


def settings_listing(settings: Any, prefix: str = "", title: str = "Settings") -> Table:
    """Listing with a row for each field; keys have the prefix of ``rans train --set``."""
    return Table(("key", "value", "meaning"), list(_settings(settings, prefix)), title)


def _settings(settings: Any, prefix: str) -> Iterator[tuple[str, str, str]]:
    """Key, value and meaning of each setting; keys follow the prefix, tasks within a multi-task are left out."""
    texts = meanings(type(settings))
    for setting_field in dataclasses.fields(settings):
        value = getattr(settings, setting_field.name)
        if dataclasses.is_dataclass(value) and not isinstance(value, Task):
            yield from _settings(value, f"{prefix}{setting_field.name}.")
        else:
            yield prefix + setting_field.name, setting(value), texts.get(setting_field.name, "")


def conditions_listing(conditions: Conditions) -> Table:
    """Listing of the settings that are not the defaults."""
    return Table(
        ("what", "range"),
        list(_changed(conditions)) or [("nothing", "nominal conditions")],
        conditions.description or "Conditions",
    )


def _changed(settings: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Names and values of the settings that differ from their defaults."""
    for setting_field in dataclasses.fields(settings):
        value = getattr(settings, setting_field.name)
        if dataclasses.is_dataclass(value):
            yield from _changed(value, f"{prefix}{setting_field.name}.")
        elif setting_field.name == "others":
            yield from ((f"others.{k}", str(element)) for k, element in enumerate(value))
        elif setting_field.name == "effectors":
            yield from ((f"factor on the {x.quantity}", setting(x.factor)) for x in value)
        elif value != default(setting_field) and setting_field.name != "description":
            ranged = isinstance(value, tuple) and all(isinstance(x, float) for x in value)
            yield (
                prefix + setting_field.name,
                (" to " if ranged else ", ").join(
                    map(setting, value if isinstance(value, tuple) else (value,))
                ),
            )


def setting(value: object) -> str:
    """A value of a setting as text."""
    if dataclasses.is_dataclass(value):
        return "its defaults"
    if isinstance(value, tuple):
        return ", ".join(map(setting, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def space(craft: Spacecraft) -> str:
    """Where it moves."""
    return "plane, 3DoF" if craft.dimension == 2 else "space, 6DoF"


def vector_text(numbers: Iterable[float], digits: int = 3) -> str:
    """Numbers side by side."""
    # Rounding first and adding zero turns -0 and rounding errors into 0.
    return " ".join(f"{round(x, 9) + 0.0:.{digits}g}" for x in numbers)
