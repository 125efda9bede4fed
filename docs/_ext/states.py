"""The page docs/reference/states.md: what functions of an own task receive and may call, from the code."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from dataclasses import fields
from typing import Any, get_type_hints

from markdown_tables import table

from rans.base.display import meanings
from rans.model import drift, fields as field_functions
from rans.model.dynamics import PlanarState, SpatialState, State
from rans.model.fields import Heading, Quat, Vec2, Vec3
from rans.model.random import Random
from rans.tasks import TASKS, observation_terms, rewards, shapes
from rans.tasks.rewards import Transition

FRAMES = {
    "p": ("W", "m"),
    "attitude": ("of B in W", "rad"),
    "v": ("W", "m/s"),
    "w": ("about z; in space expressed in B", "rad/s"),
    "notes": ("-", "see below"),
    "stores": ("-", "kg, N m s, rad, rad/s"),
}
"""Frame and unit of every field of a state."""

FUNCTIONS = ("where", "sqrt", "atan2", "at_least", "within", "wrap", "ascending")
"""Functions of fields with a meaning of their own; the others are those of NumPy of the same names."""

PLAIN = ("sin", "cos", "exp", "log", "log1p", "tanh", "absolute", "floor")

EXAMPLE = """
>>> import math
>>> import rans
>>> from rans.model.fields import Vec2, where
>>> state = rans.state((3.0, 1.0), attitude=math.pi / 2)
>>> round(float(state.p.norm()), 3), round(state.attitude.angle, 3), state.w
(3.162, 1.571, 0.0)
>>> to_goal = Vec2(0.0, 0.0) - state.p
>>> in_body = state.attitude.inverse().rotate(to_goal)
>>> [round(float(x), 3) for x in in_body.columns()]
[-1.0, 3.0]
>>> float(where(to_goal.norm() < 0.5, 1.0, 0.0))
0.0
"""
"""What a reader can type: the tests run it."""


def states_page() -> str:
    """The page as Markdown."""
    return "\n".join(_lines())


def _lines() -> Iterable[str]:
    yield from (
        "# States, vectors, random numbers",
        "",
        "What the functions of [your own task](../own_task.md) receive, and what they may call. Every number of a "
        "state is a *field*: one number for each of many spacecraft, as a torch tensor, a NumPy array, a float "
        "or a symbol. W is the world frame; B is the body frame, with its origin at the center of mass.",
        "",
        "```python",
        EXAMPLE.strip(),
        "```",
        "",
        "## State and goal",
        "",
        "A goal is a state too. A field has the shape `(N,)` for N spacecraft, and no shape for one.",
        "",
        table(("field", "plane", "space", "frame", "unit", "meaning"), _state_rows()),
        "`state.spin()` is the angular velocity as a tuple, of one field in the plane and three in space.",
        "",
        "## Notes of the goals",
        "",
        "`goal.notes` is what an episode has drawn or remembers, an object of the frozen dataclass that a task "
        "names as `goal_notes`. `sample` makes it, `later` and `remember` replace its fields. Tasks that are not "
        "in the table have none.",
        "",
        table(("task", "field", "meaning"), _note_rows()),
        "## What a reward receives",
        "",
        "`reward(self, transition)` reads these fields of the control period that has ended:",
        "",
        table(
            ("field", "meaning"),
            [
                *(
                    (f"`transition.{name}`", _code(text))
                    for name, text in meanings(Transition).items()
                ),
                *(
                    (f"`transition.{name}`", _first_line(getattr(Transition, name).fget))
                    for name in ("thrusters", "impulse")
                ),
            ],
        ),
        "## Fields",
        "",
        "`+ - * / ** -x abs(x)`, the comparisons `< <= > >=`, and `& | ~` of truth values. A field has no truth "
        "value: write `where(x < 1, a, b)` instead of `a if x < 1 else b`, and `&`, `|`, `~` instead of `and`, "
        f"`or`, `not`. `rans.model.fields` also has {', '.join(f'`{name}`' for name in PLAIN)}, and:",
        "",
        table(
            ("function", "result"),
            [_row(getattr(field_functions, name), name) for name in FUNCTIONS],
        ),
        "## Vectors",
        "",
        "`Vec2(x, y)` in the plane and `Vec3(x, y, z)` in space have `u + v` and `u - v`. There is no `v * s`: use "
        "`v.scale(s)`. At zero, `norm` has no derivative: use it in `errors` and `reward`, not in observations.",
        "",
        table(("method", "result"), _method_rows(Vec3, "v", {"cross": " (space)"})),
        "## Attitudes",
        "",
        "An attitude is `Heading(angle)` in the plane and `Quat(w, x, y, z)`, of unit length, in space. It rotates "
        "from B to W:",
        "",
        table(("method", "result"), _method_rows(Quat, "attitude", {"times": " (space)"})),
        "## Random numbers",
        "",
        "`sample(self, random)` takes all random numbers from its argument. They follow from seed and number of "
        "the episode alone, in the order of the calls: what is drawn must not depend on a field. A range is "
        "`(low, high)`, or one number.",
        "",
        table(("method", "result"), _method_rows(Random, "random", {})),
        "## Drift",
        "",
        "`drift` of a task says how a free point moves, and `step_goal(goal, drift, time)` moves a goal so.",
        "",
        table(
            ("class of `rans.model.drift`", "motion"),
            _class_rows(drift, drift.Drift, fields_too=True),
        ),
        "## Entries of an observation",
        "",
        "Each takes a name, a unit and a value; `meaning=` describes it in contracts.",
        "",
        table(
            ("class of `rans.tasks.observation_terms`", "its value"),
            _class_rows(
                observation_terms, observation_terms.ObservationTerm, but=("TaskDependent",)
            ),
        ),
        "## Rewards and shapes",
        "",
        table(
            ("function of `rans.tasks.rewards`", "result"),
            [
                _row(rewards.nearness, "nearness"),
                _row(rewards.smooth_within, "smooth_within"),
                _row(rewards.speed, "speed"),
            ],
        ),
        table(
            ("class of `rans.tasks.shapes`", "region"),
            _class_rows(shapes, shapes.Shape, fields_too=True),
        ),
    )


def _state_rows() -> Iterable[tuple[str, ...]]:
    """A row for every field of a state, with its type in the plane and in space."""
    planar, spatial = (get_type_hints(kind) for kind in (PlanarState, SpatialState))
    texts = meanings(State)
    for field in fields(State):
        frame, unit = FRAMES[field.name]
        yield (
            f"`{field.name}`",
            _kind(planar[field.name]),
            _kind(spatial[field.name]),
            frame,
            unit,
            texts[field.name],
        )


def _kind(hint: Any) -> str:
    """A type as the page has it: a class by its name, a tuple of fields, or a field."""
    if hint in (Vec2, Vec3, Heading, Quat):
        return f"`{hint.__name__}`"
    return "tuple" if getattr(hint, "__origin__", None) is tuple else "field"


def _note_rows() -> Iterable[tuple[str, str, str]]:
    """A row for every note of every task whose goals have notes."""
    for name in filter(TASKS.comes_with_rans, TASKS):
        notes = TASKS[name].goal_notes
        for note, meaning in meanings(notes).items() if notes else ():
            yield f"[{name}](tasks/{name}.md)", f"`goal.notes.{note}`", _code(meaning)


def _method_rows(kind: type, name: str, only: dict[str, str]) -> Iterable[tuple[str, str]]:
    """Public methods of a class in the order of its definition, those of its bases first."""
    named: dict[str, Any] = {}
    for part in reversed(kind.__mro__):
        for method, value in vars(part).items():
            if inspect.isfunction(value) and not method.startswith("_"):
                named[method] = getattr(kind, method)
    for method, value in named.items():
        call, text = _row(value, f"{name}.{method}")
        yield call + only.get(method, ""), text


def _class_rows(
    module: Any, base: type, *, fields_too: bool = False, but: tuple[str, ...] = ()
) -> Iterable[tuple[str, str]]:
    """Public classes of a module below a base class, with the first line of their docstrings."""
    classes: dict[str, Any] = vars(module)
    for name, kind in classes.items():
        if not inspect.isclass(kind) or not issubclass(kind, base) or kind is base or name in but:
            continue
        arguments = ", ".join(getattr(kind, "__match_args__", ())) if fields_too else ""
        yield f"`{name}({arguments})`" if fields_too else f"`{name}`", _first_line(kind)


def _row(function: Any, name: str) -> tuple[str, str]:
    """A call of a function with the names of its arguments, and the first line of its docstring."""
    arguments = [
        parameter.name
        if parameter.default is parameter.empty
        else f"{parameter.name}={parameter.default}"
        for parameter in inspect.signature(function).parameters.values()
        if parameter.name != "self"
    ]
    return f"`{name}({', '.join(arguments)})`", _first_line(function)


def _first_line(thing: Any) -> str:
    """The first paragraph of a docstring, in Markdown."""
    return _code(" ".join((inspect.getdoc(thing) or "").partition("\n\n")[0].split()))


def _code(text: str) -> str:
    """Code of a docstring as Markdown has it."""
    return re.sub(r"``([^`]*)``", r"`\1`", text)
