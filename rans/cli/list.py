"""``rans list``: available spacecraft, tasks, agents, controllers and conditions, and their details."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

from tyro import conf

from rans.api.names import load_conditions, load_spacecraft, load_task
from rans.errors import EXTRAS, ConfigError, brief, counted, legible
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.files import number, plain, read_text
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import SPACECRAFT, spacecraft_names
from rans.model.timing import Timing
from rans.policy.any_craft import AGENTS
from rans.pretrained import (
    PACKAGE,
    RECIPE_FOLDER,
    missing_agents,
    pretrained_card,
    pretrained_folder,
    pretrained_names,
)
from rans.randomization.conditions import Conditions
from rans.randomization.conditions_file import CONDITIONS
from rans.registry import Registry, resolve_typed, typed
from rans.show.tables.layout_text import AWAY, TOWARDS, layout_text
from rans.show.tables.listing import (
    Listing,
    settings_listing,
    spacecraft_listing,
    task_listings,
    thruster_listing,
)
from rans.structure import LARGEST_TOML, kind_of_file, read_toml
from rans.tasks import TASKS, Task, gymnasium_ids, observation_columns
from rans.tasks.derived import dimensions
from rans.tasks.formula import reward_formulas
from rans.terminal import Terminal


@dataclass(frozen=True)
class List:
    """List spacecraft, tasks, agents, controllers and conditions, or show one of them in detail."""

    group = "Check"
    guide = "docs/terminal.md"
    examples = (
        "rans list",
        "rans list go-to-pose",
        "rans list mine.toml --picture craft.svg",
    )

    name: Annotated[str | None, conf.Positional, conf.arg(metavar="[NAME]")] = None
    """A spacecraft, task, agent, controller or set of conditions, by name, TOML file or MODULE:NAME.
    SPACECRAFT, TASKS, AGENTS, CONTROLLERS and CONDITIONS list all of a kind; TRAINING lists the settings of a
    training."""
    picture: Annotated[Path | None, conf.arg(metavar="FILE")] = None
    """Save a drawing of the spacecraft's thrusters to this file (.png, .svg or .pdf)."""
    json: bool = False
    """Print JSON for other programs."""

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`; what is for programs, or is a file of conditions, has none."""
        kind = self._kind()
        if self.json or kind == "conditions":
            return ()
        name = shlex.quote(self._named)
        if kind == "spacecraft":
            agent = AGENTS[load_spacecraft(self._named).dimension]
            return (f"rans evaluate {agent}@{name}", f"rans train go-to-pose --spacecraft {name}")
        if kind == "agent":
            return (f"rans evaluate {name}",)
        if kind == "task":
            return (f"rans train {name}",)
        return ("rans evaluate go-to-pose-2d", "rans train go-to-pose")

    def run(self) -> int:
        """Print the list or the details.

        Raises:
            ConfigError: the name or the file of the drawing is wrong.
        """
        kind = self._kind()
        if self.picture is not None and kind != "spacecraft":
            raise ConfigError(
                f"--picture {self.picture} draws one spacecraft: name it, for example "
                f"rans list floating-platform --picture {self.picture}."
            )
        if self.picture is not None:
            from rans.drawing import draw_layout, save_picture

            save_picture(draw_layout(load_spacecraft(self._named)), self.picture)
        if self.json:
            print(json.dumps(plain(_FACTS[kind](self._named)), indent=2, ensure_ascii=False))
        else:
            console = Terminal()
            for part in _PARTS[kind](self._named):
                if isinstance(part, Listing):
                    console.print(part.table())
                else:
                    console.say(part)
        if self.picture is not None and not self.json:
            Terminal().say(f"Picture: {self.picture}")
        return 0

    @property
    def _named(self) -> str:
        return (self.name or "").removeprefix("pretrained:")

    def _kind(self) -> str:
        """Kind of the named object, a key of `_PARTS`."""
        name = self._named
        if self.name is None:
            return "everything"
        name = {"pretrained": "agents", "crafts": "spacecraft", "missions": "tasks"}.get(name, name)
        if (every := f"all {name.lower()}") in _PARTS:
            return every
        names_of: dict[str, Iterable[str]] = {
            "conditions": CONDITIONS,
            "task": TASKS,
            "agent": [*pretrained_names(), *missing_agents()],
            "controller": CONTROLLERS,
            "spacecraft": spacecraft_names(),
        }
        for kind, names in names_of.items():
            if name in names:
                return kind
        if name.endswith(".toml"):
            return _kind_of_file(Path(name))
        if ":" in name:
            return _kind_of_object(name)
        near = CONTROLLERS.meant(name, [c for names in names_of.values() for c in names])
        raise ConfigError(
            "there is no spacecraft, task, agent, controller or set of conditions named "
            f"{brief(name)}{near}; `rans list` prints all; your own file of a spacecraft or of conditions "
            "must end in .toml."
        )


def _kind_of_file(file: Path) -> str:
    """Kind of a TOML file: conditions if its keys are those of conditions, else spacecraft."""
    try:
        table = read_toml(read_text(file, LARGEST_TOML))
    except ConfigError:
        return "spacecraft"
    kind = kind_of_file(table)
    return "conditions" if kind == "conditions" or (not kind and "base" in table) else "spacecraft"


def _kind_of_object(reference: str) -> str:
    """Kind of the object of MODULE:NAME; anything else is treated as a spacecraft, whose reader rejects it."""
    try:
        result = resolve_typed(typed(reference))
    except ConfigError as error:
        raise ConfigError(f"{reference} cannot be shown: {error}") from error
    if isinstance(result, Conditions):
        return "conditions"
    if isinstance(result, type) and issubclass(result, Task):
        return "task"
    return "controller" if hasattr(result, "act") else "spacecraft"


def _everything(_: str) -> Iterable[str | Listing]:
    yield _all_spacecraft()
    yield _all_tasks()
    yield _all_conditions()
    yield _all_controllers()
    yield from _all_agents()


def _all_spacecraft() -> Listing:
    def row(name: str) -> tuple[str, ...]:
        c = SPACECRAFT[name].craft
        return _PLACES[c.dimension], f"{c.mass:g} kg", c.thrust, c.thrust_sharing

    return Listing(
        "Spacecraft",
        ("name", "in", "mass", "thrusters", "sharing"),
        [_filled((_named(SPACECRAFT, name), *_or_why_not(row, name)), 5) for name in SPACECRAFT],
    )


_PLACES = {2: "plane", 3: "space"}
"""Where a spacecraft of a dimension moves."""


def _all_tasks() -> Listing:
    def row(name: str) -> tuple[str, ...]:
        return _flag(TASKS[name]), _summary(TASKS[name])

    return Listing(
        "Tasks",
        ("name, Gymnasium ids", "flag", "what"),
        [("\n  ".join((_named(TASKS, n), *_environments(n))), *_or_why_not(row, n)) for n in TASKS],
    )


def _all_conditions() -> Listing:
    def row(name: str) -> tuple[str, ...]:
        return (CONDITIONS[name].conditions.description,)

    trained_in = [name for name in CONDITIONS.built_in if name.startswith("train-")]
    return Listing(
        "Conditions (rans list NAME prints every number and its source)",
        ("name", "what"),
        [
            (_named(CONDITIONS, name), *_or_why_not(row, name)[-1:])
            for name in CONDITIONS
            if name not in trained_in
        ],
        f"Robust agents were trained in {', '.join(trained_in)}.",
    )


def _all_controllers() -> str:
    return f"Controllers (NAME:TASK-2d): {', '.join(_named(CONTROLLERS, name) for name in CONTROLLERS)}"


def _filled(row: tuple[str, ...], count: int) -> tuple[str, ...]:
    return (*row, *("",) * (count - len(row)))


def _named(registry: Registry[Any], name: str) -> str:
    """Name, with its package if that is not RANS."""
    return f"{name} (of {package})" if (package := registry.package(name)) else name


def _or_why_not(row: Callable[[str], tuple[str, ...]], name: str) -> tuple[str, ...]:
    """Cells of one name; for an invalid object the second one is the reason."""
    try:
        return row(name)
    except ConfigError as error:
        return "", str(error)


def _all_agents() -> Iterable[str | Listing]:
    """Installed agents, and how to install the others."""
    cards = map(pretrained_card, pretrained_names())
    yield Listing(
        "Agents (pretrained:NAME)",
        ("name", "spacecraft", "solved"),
        [(card["name"], card["spacecraft"], _solved(card)) for card in cards],
    )
    if missing := missing_agents():
        yield f"{counted(len(missing), 'more agent')}: pip install 'rans[{EXTRAS[PACKAGE]}]'"


def _solved(card: dict[str, Any]) -> str:
    """Share of solved episodes; for a multi-task agent those of its worst and its best task."""
    rates = [values["solved"][0] for values in card["evaluation"]["own"].values()]
    low = min(rates)
    high = max(rates)
    return f"{low:.4g} %" if low == high else f"{low:.4g} to {high:.4g} %"


def _agent_details(name: str) -> Iterable[str | Listing]:
    from rans.evaluation.measure.statistics import interval, quantity

    card = pretrained_card(name)
    training = card["training"]
    yield f"{name}: {card['task']} with {card['spacecraft']}, in {pretrained_folder(name)}"
    judged = card.get("evaluation_environment", {}).get("revision", "")
    trained = training.get("environment", {}).get("revision", "")
    yield (
        f"Trained with seed {training['seed']} for {training['steps']:,} steps in "
        f"{training['seconds']:.1f} s on {training['device']}"
        f"{f', at revision {trained}' if trained else ''}; judged on {card['episodes']:,} episodes of "
        f"seed {card['evaluation_seed']}{f', at revision {judged}' if judged else ''}."
    )
    if (recipe := RECIPE_FOLDER / f"{name}.toml").exists():
        yield f"rans train {name} trains it again, by the recipe {recipe}."
    for protocol, parts in card["evaluation"].items():
        for part, values in parts.items():
            rows = [
                (metric, quantity(value, unit), interval(low, high))
                for metric, (*three, unit) in values.items()
                for value, low, high in [map(number, three)]
            ]
            title = f"Protocol {protocol} {part}".rstrip()
            yield Listing(title, ("metric", "value", "95 % interval"), rows)


def _spacecraft_details(name: str) -> Iterable[str | Listing]:
    craft = load_spacecraft(name)
    yield spacecraft_listing(craft)
    if not craft.thrusters:
        return
    yield thruster_listing(craft)
    yield f"\n{layout_text(craft)}\n"
    yield f"x to the right, y up; arrows are forces on the craft; {TOWARDS} towards you, {AWAY} away."
    if name.endswith(".toml"):
        yield from prospects(craft)


def prospects(craft: Spacecraft) -> Iterator[str]:
    """Whether a craft can come to rest within the tolerances of go-to-pose, and which thrusters it can lose."""
    from rans.policy.prospects import Prospect, doubt, spared
    from rans.policy.timing import timing_for

    try:
        period = timing_for(craft, Timing()).control_period
        yield Prospect.of(craft, period).text(period)
        yield doubt(craft, period) or spared(craft, period)
    except ConfigError as error:
        yield f"Nothing brings it to rest at a pose: {error}"


def _task_details(name: str) -> Iterable[str | Listing]:
    task = load_task(name)
    yield f"{name}: {_summary(type(task))}"
    own = " or ".join(
        f"rans.SpacecraftEnv({name!r}, {dimension})" for dimension in dimensions(task)
    )
    yield f"Gymnasium: {', '.join(_environments(name)) or own}; task flag: {_flag(task)}"
    yield from task_listings(task, "settings.")
    yield "Any of these: rans train --set settings.NAME=VALUE. Those of every training: rans list TRAINING."


def _training_details(_: str) -> list[Listing]:
    from rans.fast.learn.config import PPOSettings

    return [
        settings_listing(PPOSettings(), "ppo.", "Settings of the learner, before a task's preset"),
        settings_listing(Timing(), "timing.", "Time"),
    ]


def _conditions_details(name: str) -> Iterable[str]:
    load_conditions(name)  # raises an error if they are not valid
    if name.endswith(".toml"):
        text = legible(read_text(Path(name), LARGEST_TOML), 20_000)
    else:
        text = CONDITIONS[name].text
    yield from text.rstrip().splitlines()


def _controller_details(name: str) -> Iterable[str]:
    yield f"{name}: {_summary(CONTROLLERS[name])}"
    yield f"As a contestant {name}:go-to-pose-2d, or {name} after a first one."


_PARTS: dict[str, Callable[[str], Iterable[str | Listing]]] = {
    "everything": _everything,
    "spacecraft": _spacecraft_details,
    "task": _task_details,
    "all spacecraft": lambda _: [_all_spacecraft()],
    "all tasks": lambda _: [_all_tasks()],
    "all agents": lambda _: _all_agents(),
    "all controllers": lambda _: [_all_controllers()],
    "all conditions": lambda _: [_all_conditions()],
    "conditions": _conditions_details,
    "all training": _training_details,
    "controller": _controller_details,
    "agent": _agent_details,
}
"""Printed parts of an object, by its kind."""


def _flag(task: object) -> str:
    flag = getattr(task, "flag", None)
    return "sampled" if flag is None else f"{flag:g}"


def _environments(task: str) -> tuple[str, ...]:
    """Gymnasium ids of a task; none for MODULE:NAME, which is not registered."""
    if ":" in task:
        return ()
    pair = gymnasium_ids(task)
    possible = TASKS[task].dimensions if task in TASKS.built_in else (2, 3)
    return tuple(pair[dimension - 2] for dimension in possible)


def _task_facts(name: str) -> dict[str, Any]:
    task: Any = load_task(name)
    parts = task.parts()
    works = dimensions(task)
    return {
        "summary": _summary(type(task)),
        "gymnasium": _environments(name),
        "settings": asdict(task),
        "flag": getattr(task, "flag", None),
        "reward": {
            part or name: reward_formulas(subtask, works[0]) for part, subtask in parts.items()
        },
        "tolerances": {part or name: subtask.tolerances() for part, subtask in parts.items()},
        "observation": {str(work): observation_columns(task, work) for work in works},
    }


def _spacecraft_facts(name: str) -> dict[str, Any]:
    craft = load_spacecraft(name)
    return asdict(craft) | {
        "actuators": {"kind": craft.actuators.kind, **asdict(craft.actuators)},
        "wrench_map": craft.wrench_map,
        "commands": [command._asdict() for command in craft.commands],
        "stores": [store._asdict() for store in craft.stores],
    }


_FACTS: dict[str, Callable[[str], Any]] = {
    "spacecraft": _spacecraft_facts,
    "task": _task_facts,
    "agent": pretrained_card,
    "conditions": lambda name: asdict(load_conditions(name)),
    "controller": lambda name: {"summary": _summary(CONTROLLERS[name])},
    "all spacecraft": lambda _: list(SPACECRAFT),
    "all tasks": lambda _: list(TASKS),
    "all agents": lambda _: pretrained_names(),
    "all controllers": lambda _: list(CONTROLLERS),
    "all conditions": lambda _: {
        name: CONDITIONS[name].conditions.description for name in CONDITIONS
    },
    "all training": lambda _: {part.title: part.to_json() for part in _training_details("")},
    "everything": lambda _: {
        "spacecraft": list(SPACECRAFT),
        "tasks": list(TASKS),
        "agents": pretrained_names(),
        "conditions": list(CONDITIONS),
        "controllers": list(CONTROLLERS),
    },
}
"""Plain values of an object for JSON, by its kind."""


def _summary(described: object) -> str:
    text = (described.__doc__ or "").strip()
    if text.startswith(f"{getattr(described, '__name__', '')}("):  # a signature, by `dataclass`
        text = ""
    return next(iter(text.splitlines()), "no docstring")
