"""The pages under docs/reference, written from the code before Sphinx reads: never edited, never committed."""

from __future__ import annotations

import dataclasses
import inspect
import json
import re
import sys
import types
import typing
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from leaderboard import leaderboard_page
from markdown_tables import table
from rans_assurance.functions import FAULT_COLUMNS
from search_words import WORDS
from states import states_page
from task_pictures import save_task_picture

import rans
from rans.base.display import default, meanings
from rans.base.pretrained import RECIPE_FOLDER, pretrained_card, pretrained_names
from rans.base.table import Table
from rans.cli.commands import COMMANDS
from rans.cli.options import EVERYWHERE, is_in_help, option_name, texts_of
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.fast.learn.config import (
    ExplorationSettings,
    FilterSettings,
    MemorySettings,
    PPOSettings,
    ScheduleSettings,
    TrainConfig,
)
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import SPACECRAFT, spacecraft_names
from rans.model.timing import Timing
from rans.randomization.conditions_file import CONDITIONS
from rans.show.figures.layout_figure import draw_layout
from rans.show.figures.picture_file import save_picture
from rans.show.tables.listing import (
    spacecraft_listing,
    task_listings,
    thruster_listing,
)
from rans.tasks import TASKS, gymnasium_ids, load_task

if TYPE_CHECKING:
    from sphinx.application import Sphinx

API = {
    "Agents and commands": (
        "train tune load_agent Agent evaluate compare stress assure follow faults identify "
        "init_spacecraft join_spacecraft validate benchmark view report export "
        "optimal_trajectory certify state"
    ),
    "Spacecraft": "Spacecraft Thruster Slosh load_spacecraft",
    "Tasks": (
        "TASKS GoToPosition GoToPose GoToAttitude GoToPosePriced TrackVelocity TrackTwist TrackVelocityHeading "
        "MultiTask Avoid DockPort Dock FinalApproach Hold Rendezvous Inspect Land RestReward TargetOrbit load_task"
    ),
    "Domain randomization": (
        "Conditions BodyConditions ThrusterConditions FaultConditions DisturbanceConditions SensorConditions "
        "SensorsConditions load_conditions"
    ),
    "Controllers": (
        "LQR Switching MPC MissionGuidance ConvexGuidance Corridor "
        "Circumnavigation PassiveApproach Pilot"
    ),
    "Flights": "Timing scenarios fly passive_safety write_ccsds read_opm relative_state trust_files run_on",
    "Engine and learner": "Engine PPOSettings SB3VecEnv SpacecraftEnv SpacecraftVectorEnv",
    "Errors": "RansError ConfigError RansWarning",
}
"""Public names by what they are for; `check_api` compares them with `dir(rans)`."""

PICTURES = Path(__file__).parents[1] / "_pictures"
"""Folder of the pictures of spacecraft and tasks, which are made once and never committed."""

SETTLED = ("solved", "settling time", "impulse", "position error", "attitude error", "duty at rest")
"""Metrics of a card that are in the table of agents, as far as the card has them."""


def pages() -> dict[str, str]:
    """Every page of the reference: its path below docs/reference, and its text."""
    made = {
        "commands.md": commands_page(),
        "spacecraft.md": spacecraft_page(),
        "tasks.md": tasks_page(),
        "settings.md": settings_page(),
        "conditions.md": conditions_page(),
        "recipes.md": recipes_page(),
        "agents.md": agents_page(),
        "leaderboard.md": leaderboard_page(),
        "states.md": states_page(),
        "terms.md": terms_page(),
        "controllers.md": controllers_page(),
        "api.md": api_page(),
    }
    for name in filter(TASKS.comes_with_rans, TASKS):
        made[f"tasks/{name}.md"] = task_page(name)
    for title, names in API.items():
        made[f"api/{slug(title)}.rst"] = api_group_page(title, names.split())
    return made


def commands_page() -> str:
    """Every command with its options and examples."""
    lines = [
        "# Commands",
        "",
        "`rans COMMAND --help` prints the same in the terminal. Most commands have a function of the same "
        "name in [Python](../python.md). Every command also takes:",
        "",
        table(("option", "meaning"), [(f"`{name}`", text) for name, text in EVERYWHERE.items()]),
    ]
    for title in dict.fromkeys(command.group for command in COMMANDS.values()):
        lines += ["", f"## {title}"]
        for name, command in COMMANDS.items():
            if command.group == title:
                lines += ["", *_command(name)]
    return "\n".join(lines) + "\n"


def _command(name: str) -> Iterable[str]:
    command: Any = COMMANDS[name]
    yield f"### rans {name}"
    yield ""
    yield inspect.cleandoc(command.__doc__ or "")
    yield from ("", "```", *command.examples, "```")
    hints = typing.get_type_hints(command, include_extras=True)
    texts = texts_of(command)
    rows = []
    for field in dataclasses.fields(command):
        if not is_in_help(hints[field.name]):
            continue
        given, positional = _value(field.name, hints[field.name])
        option = (
            given
            if positional
            else f"{option_name(field.name, hints[field.name])} {given}".rstrip()
        )
        value = default(field)
        text = texts.get(field.name, "")
        if value not in (None, False, "", (), dataclasses.MISSING):
            text += f" Default: `{_plain(value)}`."
        rows.append((f"`{option}`", text))
    yield ""
    yield table(("option", "meaning"), rows)
    page = command.guide.removeprefix("docs/")
    yield f"Guide: [{page.removesuffix('.md')}](../{page})"


def _value(name: str, hint: Any) -> tuple[str, bool]:
    """What stands for an option's value, and whether it is written without the option's name."""
    own: tuple[Any, ...] = ()
    plain = hint
    if typing.get_origin(hint) is typing.Annotated:
        plain, *rest = typing.get_args(hint)
        own = tuple(rest)
    positional = "Positional" in repr(own) or "positional" in repr(own)
    named = next((one.metavar for one in own if getattr(one, "metavar", None)), None)
    if named:
        return named, positional
    if plain is bool:
        return "", positional
    choices = typing.get_args(plain) if typing.get_origin(plain) is typing.Literal else ()
    return f"{{{','.join(map(str, choices))}}}" if choices else "VALUE", positional


def terms_page() -> str:
    """The page for each word of the field, as the search has it."""
    docs = Path(__file__).parents[1]
    rows = []
    for page, words in WORDS.items():
        title = re.search(r"^# (.*)$", (docs / f"{page}.md").read_text("utf-8"), re.MULTILINE)
        assert title, page
        rows += [(word, f"[{title[1]}](../{page}.md)") for word in words]
    lines = ["# Terms of the field", "", "Where RANS has what the literature calls by these names."]
    return "\n".join([*lines, "", table(("term", "page"), sorted(rows))]) + "\n"


def spacecraft_page() -> str:
    """A gallery of the spacecraft that come with RANS, and the keys of the file."""
    lines = [
        "# Spacecraft that come with RANS",
        "",
        "`rans list NAME --picture craft.svg` prints and draws the same; how to describe your own is in "
        "[Spacecraft](../spacecraft.md). Authority is the largest force and torque that thrusters give "
        "along an axis, both ways; arrows in the pictures are forces on the spacecraft.",
        "",
        table(
            ("name", "moves in", "mass, kg", "thrusters", "thrust sharing"),
            [
                (
                    f"[{name}](#{name})",
                    "plane" if craft.dimension == 2 else "space",
                    f"{craft.mass:g}",
                    craft.thrust,
                    craft.thrust_sharing,
                )
                for name, craft in ((name, SPACECRAFT[name].craft) for name in spacecraft_names())
            ],
        ),
    ]
    for name in spacecraft_names():
        craft = SPACECRAFT[name].craft
        lines += [
            "",
            f"## {name}",
            "",
            f"```{{image}} ../_pictures/{name}.svg\n:alt: Forces of the thrusters of {name}\n"
            ":width: 24em\n:class: craft\n```",
            "",
            listing(spacecraft_listing(craft)),
            listing(_authority(craft)),
            listing(thruster_listing(craft)),
            *_faults(craft),
        ]
    return "\n".join(lines) + "\n"


def _faults(craft: Spacecraft) -> Iterable[str]:
    """Which thrusters may fail while every force and torque stays possible, as `rans faults` prints it."""
    if len(craft.thrusters) > 1:
        yield listing(Table(FAULT_COLUMNS, rans.faults(craft).rows(), "Recoverable faults"))


def _authority(craft: Spacecraft) -> Table:
    """Largest force and torque each way; of shared thrust that of the best thruster alone."""
    planar = craft.dimension == 2
    names = (
        ("force x", "force y", "torque z")
        if planar
        else ("force x", "force y", "force z", "torque x", "torque y", "torque z")
    )
    together = max if craft.thrust_sharing == "split" else sum
    rows = []
    for k, name in enumerate(names):
        column = [row[k] for row in craft.wrench_map]
        unit = "N m" if "torque" in name else "N"
        ahead = together(max(x, 0.0) for x in column)
        back = together(max(-x, 0.0) for x in column)
        rows.append((f"{name}, {unit}", f"{ahead:.4g}", f"{back:.4g}"))
    return Table(("axis", "positive", "negative"), rows, "Authority")


def tasks_page() -> str:
    """All tasks, and a page each."""
    rows = [
        (
            f"[{name}](tasks/{name}.md)",
            _first_line(TASKS[name]),
            "<br>".join(f"`{id}`" for id in gymnasium_ids(name).values()),
        )
        for name in filter(TASKS.comes_with_rans, TASKS)
    ]
    body = table(("task", "purpose", "Gymnasium"), rows)
    toc = "\n".join(
        [
            "```{toctree}",
            ":hidden:",
            "",
            *(f"tasks/{n}" for n in filter(TASKS.comes_with_rans, TASKS)),
            "```",
        ]
    )
    return (
        "# Tasks\n\nRewards, ends, settings and observations of every task, as `rans list TASK` prints "
        f"them. How to write your own is in [Tasks](../tasks.md).\n\n{body}\n{toc}\n"
    )


def task_page(name: str) -> str:
    """One task: its reward, ends, settings and observations."""
    task = load_task(name)
    registered = ", ".join(f"`{id}`" for id in gymnasium_ids(name).values())
    parts = "\n".join(listing(part) for part in task_listings(task, "settings."))
    caption = _task_picture(name)
    picture = f"```{{figure}} ../../_pictures/task-{name}.svg\n:width: 30em\n\n{caption}\n```\n\n"
    return (
        f"# {name}\n\n{_first_line(type(task))}\n\nGymnasium: {registered}. Class: "
        f"[rans.{type(task).__name__}](../api/tasks.rst).\n\n{picture if caption else ''}{parts}"
    )


def _task_picture(name: str) -> str:
    """The caption of a task's picture, which is drawn once; "" where there is none."""
    file = PICTURES / f"task-{name}.svg"
    caption = file.with_suffix(".txt")
    if not caption.exists():
        PICTURES.mkdir(exist_ok=True)
        caption.write_text(save_task_picture(name, file), "utf-8")
    return caption.read_text("utf-8")


def settings_page() -> str:
    """Keys of a training's config and of recipes."""
    parts = [
        ("Training", "", TrainConfig),
        ("PPO", "ppo.", PPOSettings),
        ("Step size", "ppo.schedule.", ScheduleSettings),
        ("Exploration", "ppo.exploration.", ExplorationSettings),
        ("Memory", "ppo.memory.", MemorySettings),
        ("Kalman filters", "ppo.filters.", FilterSettings),
        ("Time", "timing.", Timing),
    ]
    lines = [
        "# Settings of a training",
        "",
        "Keys of `config.json`, of recipes, of `rans train --set KEY=VALUE` and of keywords of "
        "`rans.train`. Settings of a task (`settings.*`) are on [its page](tasks.md). Values are those "
        "before a task's preset; `rans list TRAINING` prints them. Guide: [Training](../training.md).",
    ]
    for title, prefix, described in parts:
        lines += ["", f"## {title}", "", _keys(described, prefix)]
    return "\n".join(lines) + "\n"


def conditions_page() -> str:
    """Keys of the file of domain randomization, and the files that come with RANS."""
    lines = [
        "# Keys of domain randomization",
        "",
        "Every key of the TOML file for `--conditions`, with its default. A range is a number or "
        "`[least, largest]`. Guide: [Domain randomization](../conditions.md).",
        "",
        table(("key", "default", "meaning"), list(_nested(rans.Conditions()))),
        "## Files that come with RANS",
    ]
    for name in CONDITIONS.built_in:
        lines += ["", f"### {name}", "", "```toml", CONDITIONS[name].text.rstrip(), "```"]
    return "\n".join(lines) + "\n"


def recipes_page() -> str:
    """The files of recipes."""
    lines = [
        "# Recipes",
        "",
        "`rans train NAME` trains by the recipe of this name; `base-*` and `preset-*` are shared by "
        "others. Guide: [Training](../training.md).",
    ]
    for file in sorted(RECIPE_FOLDER.glob("*.toml")):
        lines += ["", f"## {file.stem}", "", "```toml", file.read_text("utf-8").rstrip(), "```"]
    return "\n".join(lines) + "\n"


def agents_page() -> str:
    """The agents that come with RANS, from their cards."""
    rows = []
    for name in pretrained_names():
        card = pretrained_card(name)
        own = card["evaluation"]["own"]
        for part, values in own.items():
            cells = [_metric(values, metric) for metric in SETTLED]
            shown = f"{name}#{part}" if part and len(own) > 1 else name
            rows.append((f"`{shown}`", card["task"], card["spacecraft"], *cells))
    used = [k for k, _ in enumerate(SETTLED) if any(row[3 + k] for row in rows)]
    columns = ("agent", "task", "spacecraft", *(SETTLED[k] for k in used))
    kept = [(*row[:3], *(row[3 + k] for k in used)) for row in rows]
    return (
        "# Agents that come with RANS\n\nEach flies as `pretrained:NAME`. Values are those of its card "
        "(`rans list NAME` prints all of them with 95 % intervals): its own task, without randomization or "
        "with that of its training. What they are for: [Agents](../agents.md).\n\n"
        + table(columns, kept)
    )


def _metric(values: dict[str, Any], name: str) -> str:
    if name not in values:
        return ""
    value, *_, unit = values[name]
    return f"{float(value):.4g} {unit}".rstrip()


def controllers_page() -> str:
    """Controllers that need no training."""
    rows = [
        (f"`{name}`", _first_line(CONTROLLERS[name]))
        for name in filter(CONTROLLERS.comes_with_rans, CONTROLLERS)
    ]
    return (
        "# Controllers\n\nControllers that need no training fly as `NAME:TASK-2d@SPACECRAFT` in every "
        "command, and as classes in [Python](api/controllers.rst). Guide: "
        "[Controllers](../controllers.md).\n\n" + table(("name", "what it is"), rows)
    )


def api_page() -> str:
    """Index of the Python API."""
    lines = [
        "# Python API",
        "",
        "All names of `import rans`. Internal modules are described in "
        "[Architecture](../architecture.md), and `help(rans.NAME)` prints what is here.",
        "",
        "```{toctree}",
        ":maxdepth: 1",
        "",
        *(f"api/{slug(title)}" for title in API),
        "```",
    ]
    for title, names in API.items():
        rows = [(f"`rans.{name}`", _summary(name)) for name in names.split()]
        lines += ["", f"## {title}", "", table(("name", "purpose"), rows)]
    return "\n".join(lines) + "\n"


def api_group_page(title: str, names: list[str]) -> str:
    """Signatures and docstrings of one group."""
    lines = [title, "=" * len(title), "", ".. currentmodule:: rans", ""]
    for name in names:
        thing = getattr(rans, name)
        if inspect.isclass(thing):
            lines += [f".. autoclass:: rans.{name}", "   :members:", ""]
        elif isinstance(thing, types.FunctionType):
            lines += [f".. autofunction:: rans.{name}", ""]
        else:
            lines += [f".. autodata:: rans.{name}", "   :no-value:", ""]
    return "\n".join(lines)


def check_api() -> None:
    """Every public name is in one group of the API.

    Raises:
        ValueError: one is missing, or in two groups, or no longer public.
    """
    grouped = [name for names in API.values() for name in names.split()]
    public = [name for name in dir(rans) if name != "__version__"]
    if sorted(grouped) != sorted(public):
        wrong = sorted(set(grouped) ^ set(public)) or "a name is in two groups"
        raise ValueError(f"docs/_ext/reference.py: API and dir(rans) differ: {wrong}.")


def _keys(described: type, prefix: str) -> str:
    """Fields of a dataclass with defaults and meanings."""
    texts = meanings(described)
    rows = []
    for field in dataclasses.fields(described):
        value = default(field)
        usual = (
            "" if value is dataclasses.MISSING or dataclasses.is_dataclass(value) else _plain(value)
        )
        rows.append((f"`{prefix}{field.name}`", usual and f"`{usual}`", texts.get(field.name, "")))
    return table(("key", "default", "meaning"), rows)


def _nested(given: Any, prefix: str = "") -> Iterable[tuple[str, str, str]]:
    """Keys of a dataclass of dataclasses, by their dotted names."""
    texts = meanings(type(given))
    for field in dataclasses.fields(given):
        value = getattr(given, field.name)
        if dataclasses.is_dataclass(value):
            yield from _nested(value, f"{prefix}{field.name}.")
        else:
            usual = "" if value is None else f"`{_plain(value)}`"
            yield f"`{prefix}{field.name}`", usual, texts.get(field.name, "")


def _plain(value: Any) -> str:
    """A value as TOML and JSON have it, as far as they can."""
    try:
        return json.dumps(value, ensure_ascii=False)
    except TypeError:
        return str(value)


def listing(given: Table) -> str:
    """A listing as a heading, a table and a note."""
    note = f"\n{given.note}\n" if given.note else ""
    return f"**{given.title}**\n\n{table(given.columns, given.rows)}{note}"


def _first_line(thing: Any) -> str:
    return next(iter((inspect.getdoc(thing) or "").splitlines()), "")


def _summary(name: str) -> str:
    """The first sentence of a docstring."""
    text = inspect.getdoc(getattr(rans, name)) or ""
    first = " ".join(text.partition("\n\n")[0].split())
    return re.split(r"(?<=[a-z)`])\. ", first, maxsplit=1)[0]


def slug(title: str) -> str:
    """A file's name for a title.

    >>> slug("Engine and learner")
    'engine-and-learner'
    """
    return "-".join(title.lower().split())


def _write(app: Sphinx) -> None:
    """Write what has changed, and remove what is no longer made."""
    check_api()
    PICTURES.mkdir(exist_ok=True)
    folder = Path(app.srcdir) / "reference"
    made = pages()
    for name, text in made.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        if not file.exists() or file.read_text("utf-8") != text:
            file.write_text(text, "utf-8")
    for file in folder.rglob("*.*"):
        if file.is_file() and file.relative_to(folder).as_posix() not in made:
            file.unlink()
    for name in spacecraft_names():
        if not (PICTURES / f"{name}.svg").exists():
            save_picture(draw_layout(SPACECRAFT[name].craft), PICTURES / f"{name}.svg")


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the pages before Sphinx looks for them."""
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    for _name, _text in pages().items():
        sys.stdout.write(f"{_name}: {len(_text):,} characters\n")
