"""Options and words that a command does not have: a sentence leads to the nearest that it has.

Nothing here imports torch, so that the answer comes at once.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from itertools import takewhile
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from tyro.conf import Positional

from rans.cli.options import option_name
from rans.errors import ConfigError, brief, meant
from rans.files import read_text
from rans.structure import LARGEST_TOML, read_toml

_YES_OR_NO = ("yes", "no", "true", "false", "on", "off", "1", "0")
"""Values that people give to switches, in lower case."""
_TASK = "the task follows the command without an option, as in `rans {command} go-to-pose`"


def check_options(name: str, command: type, words: Sequence[str]) -> None:
    """Raise ConfigError with a sentence if a word is an option that the command does not have.

    Args:
        name: of the command.
        command: its class.
        words: that follow the name of the command.
    """
    flags = dict(_flags(command))
    _check_words(name, command, words)
    if name in _TAKE_A_TASK and words:
        _check_is_task(name, words[0])
    _check_is_spacecraft(name, words)
    for k, word in enumerate(words):
        flag, _, value = word.partition("=")
        flag = flag.replace("_", "-")
        if word == "--":
            return
        value = value or next(iter(words[k + 1 : k + 2]), "")
        if flag in flags and flags[flag] and value not in flags[flag]:
            raise ConfigError(
                f"{flag} must be {' or '.join(flags[flag])}, got {brief(value)}{meant(value, flags[flag])}."
            )
        second = next(iter(words[k + 2 : k + 3]), "")
        if flag in flags and second in flags[flag] and word == flag:
            raise ConfigError(f"{flag} takes one value, got {value} and {second}: run it for each.")
        if not flag.startswith("--") or flag in flags or flag.startswith("--tyro-"):
            continue
        hint = _hint(name, flag.removeprefix("--"), value, flags)
        raise ConfigError(
            f"`rans {name}` has no option {brief(word.partition('=')[0])[1:-1]}{hint}; "
            f"`rans {name} --help` prints all."
        )


def _check_words(name: str, command: type, words: Sequence[str]) -> None:
    """Raise ConfigError with a sentence if a word stands where the command takes none."""
    hints = get_type_hints(command, include_extras=True)
    # Words between the command and its first option.
    begun = list(takewhile(lambda word: not word.startswith("-"), words))
    positional = [hints[f.name] for f in fields(command) if _is_positional(hints[f.name])]
    takes_many = any(get_origin(get_args(hint)[0]) is tuple for hint in positional)
    if not takes_many and len(begun) > len(positional):
        extra = brief(" ".join(begun[len(positional) :]))
        takes = f"only {brief(begun[0])}, got also" if positional else "options only, got"
        raise ConfigError(f"`rans {name}` takes {takes} {extra}; `rans {name} --help` prints all.")
    # A word after the value of an option may be the one that the command takes, as in --set seed=1 go-to-pose.
    is_complete = not takes_many and len(begun) == len(positional)
    # Values of options that take none, and second values of --set.
    switches = {option_name(f, hint) for f, hint in hints.items() if _plain(hint) is bool}
    for k, word in enumerate(words):
        flag, equals, value = word.partition("=")
        if equals and flag in switches and value.lower() in _YES_OR_NO:
            raise ConfigError(
                f"{flag} takes no value: write {flag} for yes, and leave it out for no."
            )
        number = next(iter(words[k + 1 : k + 2]), "")
        if word in switches and re.fullmatch(r"[\d.]+(e-?\d+)?", number):
            options = (option_name(f, hint) for f, hint in hints.items())
            own = [one for one in options if one.startswith(f"{word}-") and one not in switches]
            write = f": write {word} {own[0]} {number}" if own else ""
            raise ConfigError(f"{word} takes no number, got {number}{write}.")
        following = words[k + 2] if is_complete and word == "--set" and k + 2 < len(words) else ""
        if following and not following.startswith("-") and "=" not in following:
            raise ConfigError(
                f"--set takes one KEY=VALUE, got also {brief(following)}: "
                + (
                    f"values of a sweep are divided by commas, as in --set {words[k + 1]},{following}."
                    if name == "sweep"
                    else "write --set before each change."
                )
            )


_TAKE_A_TASK = {
    "train": "--spacecraft {}",
    "sweep": "--set spacecraft={}",
    "optimal": "--spacecraft {}",
    "improve": "--spacecraft {}",
}
"""Commands whose word is a task, with their option for the spacecraft."""


def _check_is_task(name: str, word: str) -> None:
    """Raise ConfigError with what to write for a word such as lqr:go-to-pose-2d@mine.toml, a contestant's name."""
    from rans.tasks import TASKS

    before, at, craft = word.partition("@")
    _check_is_no_agent(name, before.removeprefix("pretrained:"), craft)
    bare = re.sub(r"-[23]d(-.*)?$", "", before)
    task = bare.rpartition(":")[2]
    is_known = task in TASKS
    if (not is_known and ":" not in bare) or not (at or (is_known and ":" in before)):
        return
    option = f" {_TAKE_A_TASK[name].format(shlex.quote(craft))}" if at else ""
    raise ConfigError(
        f"`rans {name}` takes a task, and {word} names {'its spacecraft' if at else 'who flies it'} too: write "
        f"rans {name} {task if is_known else bare}{option}."
    )


def _check_is_no_agent(name: str, agent: str, craft: str) -> None:
    """Raise ConfigError with what to write for an agent for any craft, from which the training of one may begin."""
    from rans.files import read_json
    from rans.pretrained import pretrained_folder, pretrained_names

    if not craft or not agent.startswith("any-craft-") or agent not in pretrained_names():
        return  # names of other agents are those of their recipes too
    words = ["rans", name, read_json(pretrained_folder(agent) / "config.json")["task"]]
    words += shlex.split(_TAKE_A_TASK[name].format(shlex.quote(craft)))
    begins = "write "
    if name == "train":
        begins = "a training begins from it by "
        words += ["--quality", "good", "--set", f"begin_from=pretrained:{agent}"]
        words += ["--set", "curriculum=[]"]
    raise ConfigError(
        f"`rans {name}` takes a task, and {agent} is an agent: {begins}{shlex.join(words)}."
    )


_TAKE_A_SPACECRAFT = ("benchmark", "faults", "twin")
"""Commands whose first word is a spacecraft."""
_OF_A_SPACECRAFT = ("--spacecraft", "--excite")
"""Options whose value is a spacecraft."""


def _check_is_spacecraft(name: str, words: Sequence[str]) -> None:
    """Raise ConfigError, with the whole command, where an agent, who flies a task or a task stands for a craft."""
    for k, word in enumerate(words):
        flag, equals, value = word.partition("=")
        if k == 0 and name in _TAKE_A_SPACECRAFT:
            asks, before, value = f"`rans {name}`", "", word
        elif k > 0 and words[k - 1] in _OF_A_SPACECRAFT:
            asks, before, value = words[k - 1], "", word
        elif flag in _OF_A_SPACECRAFT and equals:
            asks, before = flag, f"{flag}="
        else:
            continue
        value, comma, side = value.partition(",")
        kind, craft = _craft_of(value)
        if kind:
            right = ["rans", name, *words[:k], f"{before}{craft}{comma}{side}", *words[k + 1 :]]
            write = f"write {shlex.join(right)}" if craft else "`rans list SPACECRAFT` prints some"
            raise ConfigError(f"{asks} takes a spacecraft, and {value} is {kind}: {write}.")


def _craft_of(text: str) -> tuple[str, str]:
    """What a text names in place of a spacecraft, and the spacecraft of that; each is empty if it is not known."""
    from rans.pretrained import missing_agents, pretrained_folder, pretrained_names
    from rans.tasks import TASKS

    whole = text.partition("#")[0]
    before, _, craft = whole.partition("@")
    first, _, last = before.rpartition(":")
    if first in ("", "pretrained", "adaptive"):
        if last in pretrained_names():
            file = pretrained_folder(last) / "spacecraft.toml"
            return "an agent", craft or read_toml(read_text(file, LARGEST_TOML))["name"]
        if last in missing_agents():
            return "an agent", craft
    if re.sub("-[23]d$", "", last) in TASKS:
        return "the name of who flies a task" if first else "a task", craft
    return "", ""


def _plain(hint: Any) -> Any:
    """A type without its annotations."""
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def _is_positional(hint: Any) -> bool:
    """Whether a field is a word without an option, by its type hint."""
    return get_origin(hint) is Annotated and Positional in get_args(hint)


def _flags(command: type) -> Iterable[tuple[str, tuple[str, ...]]]:
    """Options of a command in all their spellings, with their values if these are words of a list."""
    yield "--help", ()
    hints = get_type_hints(command, include_extras=True)
    for field in fields(command):
        kind = hints[field.name]
        annotations: list[Any] = []
        if get_origin(kind) is Annotated:
            kind, *annotations = get_args(kind)
        parts = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
        words = [word for part in parts if get_origin(part) is Literal for word in get_args(part)]
        named = getattr(command, "choices", {}).get(field.name)
        choices = named() if named else tuple(map(str, words))
        if Positional in annotations:
            continue
        names = [name for metadata in annotations if (name := getattr(metadata, "name", None))]
        others = [
            alias for metadata in annotations for alias in getattr(metadata, "aliases", None) or ()
        ]
        for name in (f"--{(names or [field.name])[0]}", *others):
            yield name.replace("_", "-"), choices
        if kind is bool:
            yield f"--no-{field.name}".replace("_", "-"), ()


def _hint(command: str, flag: str, value: str, options: Mapping[str, tuple[str, ...]]) -> str:
    """What to write in its place, as the middle of a sentence; empty if that is not known."""
    if flag in ("task", "env", "env-id") and command in ("train", "sweep", "optimal"):
        return f": {_TASK.format(command=command)}"
    key = flag.replace("-", "_")
    given = value if value and not value.startswith("--") else "VALUE"
    if command == "init":
        from rans.cli.init import KINDS

        if key in KINDS:
            return f": write --set {key}={given}"
    elif "--set" in options and (setting := _setting(key)):
        own = f"--{setting}".replace("_", "-")
        if own in options:
            return f": it is {own} {given}"
        return f": it is a setting, --set {setting}={given}"
    for option, choices in options.items():
        if flag in choices:
            return f" (did you mean {option} {flag}?)"
    if command == "list":
        return f" (did you mean `rans list {flag.upper()}`?)"
    longer = [candidate for candidate in sorted(options) if candidate.endswith(f"-{flag}")]
    return f" (did you mean {longer[0]}?)" if longer else meant(f"--{flag}", sorted(options))


def _setting(name: str) -> str:
    """Entry of a training's config that the name has here, or in another library; else an empty text."""
    from rans.fast.learn.changes import OTHERS_NAMES
    from rans.fast.learn.config import PPOSettings, TrainConfig

    setting = OTHERS_NAMES.get(name, name).rpartition(".")[2]
    entries = {field.name for kind in (PPOSettings, TrainConfig) for field in fields(kind)}
    return setting if setting in entries else ""
