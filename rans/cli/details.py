"""Details of one spacecraft, task, agent, controller or set of conditions, and of all tasks, for ``rans list``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from rans.api.names import conditions_if_named, load_conditions, load_spacecraft, load_task
from rans.base.errors import ConfigError, legible
from rans.base.files import number, read_text
from rans.base.pretrained import RECIPE_FOLDER, pretrained_card, pretrained_folder
from rans.base.registry import resolve_typed, typed
from rans.base.structure import LARGEST_TOML
from rans.base.table import Table
from rans.base.terminal import doing
from rans.cli.overview import rows_of
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.model.pace import misfits
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.randomization.conditions_file import CONDITIONS
from rans.show.tables.listing import (
    settings_listing,
    spacecraft_listing,
    task_listings,
    thruster_listing,
)
from rans.tasks import TASKS, Task, gymnasium_ids
from rans.tasks.derived import dimensions


def kind_of_object(reference: str) -> str:
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


def all_tasks() -> Iterable[Table]:
    """All tasks with their Gymnasium names; a task that cannot be loaded has its reason in its row."""

    def cells(name: str) -> tuple[str, ...]:
        return "\n".join(_environments(name)), _flag(TASKS[name]), _summary(TASKS[name])

    yield Table(("name", "Gymnasium ids", "flag", "what"), rows_of(TASKS, cells, 3), "Tasks")


def agent(name: str) -> Iterable[str | Table]:
    """What a pretrained agent is, and the figures on its card, which were measured when it was made."""
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
            yield Table(("metric", "value", "95 % interval"), rows, title)


def spacecraft(name: str, conditions: str | None = None) -> Iterable[str | Table]:
    """A spacecraft with its thrusters; of a file, or under conditions, also whether it can settle."""
    craft = load_spacecraft(name)
    yield spacecraft_listing(craft)
    if not craft.thrusters:
        return
    yield thruster_listing(craft)
    if name.endswith(".toml") or conditions:
        yield from prospects(craft, name, conditions_if_named(conditions))


def prospects(craft: Spacecraft, name: str, conditions: Conditions | None = None) -> Iterator[str]:
    """How the agent for any craft flies a craft, which thrusters it can lose, and which may be mistaken."""
    from rans.base.pretrained import FOR_ANY_CRAFT, pretrained_folder
    from rans.evaluation.fly.agent import load_policy
    from rans.evaluation.fly.choice import NO_VALUE, chosen
    from rans.policy.backbones import any_craft

    agent = FOR_ANY_CRAFT[craft.dimension]
    try:
        with doing(f"flying {craft.name} by {agent}"):
            own = load_policy(pretrained_folder(agent))
            choice = chosen(own, craft, conditions=conditions)
        yield any_craft().prospect(craft, choice.period).text(choice.period)
        why = "" if conditions is None else NO_VALUE
        yield choice.doubt(agent, craft, name, why) or choice.text(agent, name)
        # Nothing is promised where the sizes of the file are doubted.
        if choice.is_enough and not misfits(craft):
            yield any_craft().spared(craft, choice.period)
    except ConfigError as error:
        yield f"Nothing brings it to rest at a pose: {error}"
    yield from any_craft().slips(craft)


def task(name: str) -> Iterable[str | Table]:
    """A task by name: its observation, rewards, ends and settings, and the commands that change them."""
    task = load_task(name)
    yield f"{name}: {_summary(type(task))}"
    own = " or ".join(
        f"rans.SpacecraftEnv({name!r}, {dimension})" for dimension in dimensions(task)
    )
    yield f"Gymnasium: {', '.join(_environments(name)) or own}; task flag: {_flag(task)}"
    yield from task_listings(task, "settings.")
    yield "Any of these: rans train --set settings.NAME=VALUE. Those of every training: rans list TRAINING."


def training() -> Iterable[Table]:
    """Settings of every training."""
    from rans.fast.learn.config import PPOSettings

    yield settings_listing(PPOSettings(), "ppo.", "Settings of the learner, before a task's preset")
    yield settings_listing(Timing(), "timing.", "Time")


def conditions(name: str) -> Iterable[str]:
    """Text of a set of conditions, by name or file."""
    load_conditions(name)  # raises an error if they are not valid
    if name.endswith(".toml"):
        text = legible(read_text(Path(name), LARGEST_TOML), 20_000)
    else:
        text = CONDITIONS[name].text
    yield from text.rstrip().splitlines()


def controller(name: str) -> Iterable[str]:
    """What a controller is, and how it is named."""
    yield f"{name}: {_summary(CONTROLLERS[name])}"
    yield f"As a contestant {name}:go-to-pose-2d, or {name} after a first one."


def _flag(task: object) -> str:
    flag = getattr(task, "flag", None)
    return "sampled" if flag is None else f"{flag:g}"


def _environments(task: str) -> tuple[str, ...]:
    """Gymnasium ids of a task; none for MODULE:NAME, which is not registered."""
    return () if ":" in task else tuple(gymnasium_ids(task).values())


def _summary(described: object) -> str:
    text = (described.__doc__ or "").strip()
    if text.startswith(f"{getattr(described, '__name__', '')}("):  # a signature, by `dataclass`
        text = ""
    return next(iter(text.splitlines()), "no docstring")
