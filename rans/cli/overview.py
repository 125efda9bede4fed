"""What there is, by name and with a line each: nothing is imported for it but spacecraft and conditions."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from rans.errors import EXTRAS, ConfigError, counted, installing
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.fast.learn.algorithms import LEARNERS
from rans.model.spacecraft_file import EFFECTORS, SPACECRAFT
from rans.pretrained import PACKAGE, missing_agents, pretrained_card, pretrained_names
from rans.randomization.conditions_file import CONDITIONS
from rans.registry import Registry
from rans.table import Table
from rans.tasks import TASKS


def _everything() -> Iterable[str | Table]:
    yield _all_spacecraft()
    yield _tasks()
    yield _all_conditions()
    yield _all_controllers()
    yield f"Learners (rans train --set algorithm=NAME): {_in_a_line(LEARNERS)}"
    yield f"Effectors (tables of a spacecraft's file): {_in_a_line(EFFECTORS)}"
    yield from _all_agents()


def _all_spacecraft() -> Table:
    """Table of all spacecraft by name; one that cannot be read has its reason in its row."""

    def row(name: str) -> tuple[str, ...]:
        c = SPACECRAFT[name].craft
        return _PLACES[c.dimension], f"{c.mass:g} kg", c.thrust, c.thrust_sharing

    return Table(
        ("name", "in", "mass", "thrusters", "sharing"),
        [_filled((named(SPACECRAFT, name), *or_why_not(row, name)), 5) for name in SPACECRAFT],
        "Spacecraft",
    )


_PLACES = {2: "plane", 3: "space"}
"""Where a spacecraft of a dimension moves."""


def _tasks() -> Table:
    """Table of all tasks by name and summary, without importing those of packages."""
    return Table(
        ("name", "what"),
        [
            (named(TASKS, name), or_why_not(lambda n: ("", TASKS.summary(n)), name)[-1])
            for name in TASKS
        ],
        "Tasks (rans list TASKS says how Gymnasium names them)",
    )


def _all_conditions() -> Table:
    """Table of all sets of conditions but those that only trainings use."""

    def row(name: str) -> tuple[str, ...]:
        return (CONDITIONS[name].conditions.description,)

    trained_in = [name for name in CONDITIONS.built_in if name.startswith("train-")]
    return Table(
        ("name", "what"),
        [
            (named(CONDITIONS, name), *or_why_not(row, name)[-1:])
            for name in CONDITIONS
            if name not in trained_in
        ],
        "Conditions (rans list NAME prints every number and its source)",
        f"Robust agents were trained in {', '.join(trained_in)}.",
    )


def _all_controllers() -> str:
    return f"Controllers (NAME:TASK-2d): {_in_a_line(CONTROLLERS)}"


def _in_a_line(registry: Registry[Any]) -> str:
    return ", ".join(named(registry, name) for name in registry)


def _filled(row: tuple[str, ...], count: int) -> tuple[str, ...]:
    return (*row, *("",) * (count - len(row)))


def named(registry: Registry[Any], name: str) -> str:
    """Name, with its package if that is not RANS."""
    return f"{name} (of {package})" if (package := registry.package(name)) else name


def or_why_not(row: Callable[[str], tuple[str, ...]], name: str) -> tuple[str, ...]:
    """Cells of one name; for an invalid object the second one is the reason."""
    try:
        return row(name)
    except ConfigError as error:
        return "", str(error)


def _all_agents() -> Iterable[str | Table]:
    """Installed agents with spacecraft and share solved, and how to install the others."""
    cards = map(pretrained_card, pretrained_names())
    yield Table(
        ("name", "spacecraft", "solved"),
        [(card["name"], card["spacecraft"], _solved(card)) for card in cards],
        "Agents (pretrained:NAME)",
    )
    if missing := missing_agents():
        yield f"{counted(len(missing), 'more agent')}: {installing(EXTRAS[PACKAGE])}"


def _solved(card: dict[str, Any]) -> str:
    """Share of solved episodes; for a multi-task agent those of its worst and its best task."""
    rates = [values["solved"][0] for values in card["evaluation"]["own"].values()]
    low = min(rates)
    high = max(rates)
    return f"{low:.4g} %" if low == high else f"{low:.4g} to {high:.4g} %"


PARTS: dict[str, Callable[[], Iterable[str | Table]]] = {
    "everything": _everything,
    "all spacecraft": lambda: [_all_spacecraft()],
    "all agents": _all_agents,
    "all controllers": lambda: [_all_controllers()],
    "all conditions": lambda: [_all_conditions()],
}
"""Printed lists, by what they are of."""
