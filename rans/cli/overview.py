"""What there is, by name and with a line each: nothing is imported for it but spacecraft and conditions."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from rans.base.errors import EXTRAS, ConfigError, counted, installing
from rans.base.pretrained import PACKAGE, missing_agents, pretrained_card, pretrained_names
from rans.base.registry import Registry
from rans.base.table import Table
from rans.deploy.forms import FORMATS
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.evaluation.fly.policy_text import FLIGHTS, POLICIES
from rans.fast.learn.learners import LEARNERS
from rans.model.foreign import IMPORTERS
from rans.model.spacecraft_file import EFFECTORS, SPACECRAFT
from rans.randomization.conditions_file import CONDITIONS
from rans.show.films import FILMS
from rans.tasks import TASKS


def all_spacecraft() -> Iterable[str | Table]:
    """All spacecraft; one that cannot be read has its reason in its row."""

    def cells(name: str) -> tuple[str, ...]:
        craft = SPACECRAFT[name].craft
        place = "plane" if craft.dimension == 2 else "space"
        return place, f"{craft.mass:g} kg", craft.thrust, craft.thrust_sharing

    columns = ("name", "in", "mass", "thrusters", "sharing")
    yield Table(columns, rows_of(SPACECRAFT, cells, 4), "Spacecraft")


def _all_tasks() -> Iterable[str | Table]:
    """All tasks with their summaries, without importing those of packages."""
    rows = rows_of(TASKS, lambda name: (TASKS.summary(name),))
    title = "Tasks (rans list TASKS says how Gymnasium names them)"
    yield Table(("name", "what"), rows, title)


def all_conditions() -> Iterable[str | Table]:
    """All sets of conditions but those that only trainings use."""
    trained_in = [name for name in CONDITIONS.built_in if name.startswith("train-")]
    named = [name for name in CONDITIONS if name not in trained_in]
    yield Table(
        ("name", "what"),
        rows_of(CONDITIONS, lambda name: (CONDITIONS[name].conditions.description,), names=named),
        "Conditions (rans list NAME prints every number and its source)",
        f"Robust agents were trained in {', '.join(trained_in)}.",
    )


def all_controllers() -> Iterable[str | Table]:
    """Names of the controllers."""
    yield _in_a_line("Controllers (NAME:TASK-2d)", CONTROLLERS)


def all_agents() -> Iterable[str | Table]:
    """Installed agents with spacecraft and share solved, and how to install the others."""
    rows = []
    for card in map(pretrained_card, pretrained_names()):
        # Of a multi-task agent those of its worst and its best task.
        shares = sorted(values["solved"][0] for values in card["evaluation"]["own"].values())
        ends = dict.fromkeys(f"{share:.4g}" for share in (shares[0], shares[-1]))
        rows.append((card["name"], card["spacecraft"], f"{' to '.join(ends)} %"))
    yield Table(("name", "spacecraft", "solved"), rows, "Agents (pretrained:NAME)")
    if missing := missing_agents():
        yield f"{counted(len(missing), 'more agent')}: {installing(EXTRAS[PACKAGE])}"


def everything() -> Iterable[str | Table]:
    """All of all kinds."""
    for part in (all_spacecraft, _all_tasks, all_conditions, all_controllers):
        yield from part()
    for what, registry in SMALL:
        yield _in_a_line(what, registry)
    yield from all_agents()


SMALL: tuple[tuple[str, Registry[Any]], ...] = (
    ("Learners (rans train --set algorithm=NAME)", LEARNERS),
    ("Effectors (tables of a spacecraft's file)", EFFECTORS),
    ("Files of spacecraft (rans init mine.toml --from FILE.NAME)", IMPORTERS),
    ("Export formats (rans export RUN --format NAME)", FORMATS),
    ("Films (rans view RUN --save FILE.NAME)", FILMS),
    ("Files of policies (NAME:FILE:TASK-2d)", POLICIES),
    ("Files of flights (rans compare RUN FILE.NAME)", FLIGHTS),
)
"""What is listed by name alone, with the commands that take the names."""


def entry(name: str) -> Iterable[str]:
    """What a name of `SMALL` is, and which command takes it."""
    for what, registry in SMALL:
        if name in registry:
            yield f"{_named(registry, name)}: {registry.summary(name)}"
            yield what


def _in_a_line(what: str, registry: Registry[Any]) -> str:
    return f"{what}: {', '.join(_named(registry, name) for name in registry)}"


def _named(registry: Registry[Any], name: str) -> str:
    """Name, with its package if that is not RANS."""
    return f"{name} (of {package})" if (package := registry.package(name)) else name


def rows_of(
    registry: Registry[Any],
    cells: Callable[[str], tuple[str, ...]],
    width: int = 1,
    names: Iterable[str] | None = None,
) -> list[tuple[str, ...]]:
    """A row of each name, with its package and its cells; for an invalid object the last one is the reason.

    Args:
        registry: where the names are.
        cells: of a name.
        width: number of the cells.
        names: those of the rows; None: all.
    """
    rows: list[tuple[str, ...]] = []
    for name in registry if names is None else names:
        try:
            found = cells(name)
        except ConfigError as error:
            found = (*[""] * (width - 1), str(error))
        rows.append((_named(registry, name), *found))
    return rows
