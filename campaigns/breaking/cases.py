"""What is tried: files, command lines and run folders, each from its number alone."""

from __future__ import annotations

import dataclasses
import importlib
import json
import os
import random
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from campaigns.breaking.damage import damaged_bytes, damaged_text
from campaigns.breaking.trial import Command, apart
from rans.fast.learn.config import MemorySettings, PPOSettings, TrainConfig, to_table
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer
from rans.model.timing import Timing
from rans.pretrained import pretrained_names
from rans.randomization.conditions_file import load_conditions
from rans.tasks import TASKS, GoToPose

TINY = TrainConfig(
    "go-to-pose",
    GoToPose(),
    "floating-platform",
    PPOSettings(n_envs=16, n_steps=8, batch_size=64, n_epochs=2, layers=(16, 16)),
    Timing(episode_steps=20),
    total_timesteps=1024,
    report_interval=2,
    solved_share=None,
)
"""A training of a second."""
_HISTORY = dataclasses.replace(TINY.ppo, memory=MemorySettings("history", 2, (0.5,)))
Prepare = Callable[[int, Path], Sequence[Command]]
"""Puts the files of a case of this number into a folder and says which commands to run there."""


def tiny(conditions: str = "") -> TrainConfig:
    """`TINY`; under conditions of this name, with a memory and a critic that is told of them."""
    if not conditions:
        return TINY
    return dataclasses.replace(
        TINY,
        conditions=load_conditions(conditions),
        ppo=dataclasses.replace(_HISTORY, privileged_critic=True),
    )


def under(conditions: str, commands: Sequence[Command]) -> Sequence[Command]:
    """The same commands under conditions of this name, where they take any and have none."""

    def changed(words: Command) -> Command:
        name = words[0] if words and words[0] in _commands() else "list"
        takes = "conditions" in (option for option, _ in _options(_described(name)))
        if not takes or {"--resume", "--conditions"} & set(words):
            return words
        return (*words, "--conditions", conditions)

    return [changed(words) for words in commands] if conditions else commands


def trained(folder: Path, config: TrainConfig = TINY) -> None:
    """Make a run folder by a short training that is stopped before its end."""
    run = RunFolder(folder)
    run.begin(config, "rans train")
    asked = iter(range(10**9))
    Trainer([config], run.spacecraft(), run).train(lambda _: None, lambda: next(asked) >= 3)


def _shipped(kind: str) -> list[str]:
    folder = resources.files("rans") / "data" / kind
    return [
        file.read_text("utf-8") for file in sorted(folder.iterdir(), key=lambda file: file.name)
    ]


def file_case(number: int, folder: Path) -> Sequence[Command]:
    """A damaged file of a spacecraft, of conditions, or of a training."""
    chance = random.Random(f"file {number}")
    kind = ("spacecraft", "spacecraft", "conditions", "config")[number % 4]
    if kind == "config":
        text = json.dumps(to_table(TINY))
        if chance.random() < 0.3:
            settings = TASKS["multi-task"]()
            text = json.dumps(
                to_table(dataclasses.replace(TINY, task="multi-task", settings=settings))
            )
        _write(folder / "config.json", damaged_text(text, chance), chance)
        return [("train", "config.json", "--output", "run", "--set", "total_timesteps=512")]
    _write(folder / "odd.toml", damaged_text(chance.choice(_shipped(kind)), chance), chance)
    if kind == "conditions":
        return [
            (
                "evaluate",
                "pretrained:go-to-pose-2d-fast",
                "--episodes",
                "2",
                "--conditions",
                "odd.toml",
            )
        ]
    task = chance.choice(["go-to-pose", "track-velocity"])
    return [
        ("list", "odd.toml"),
        *(
            ("evaluate", f"lqr:{task}-{dimension}d@odd.toml", "--episodes", "2")
            for dimension in (2, 3)
        ),
    ]


def _write(file: Path, text: str, chance: random.Random) -> None:
    content = text.encode("utf-8", "surrogatepass")
    file.write_bytes(damaged_bytes(content, chance) if chance.random() < 0.15 else content)


_WORDS = (
    "",
    "-",
    "--",
    "x",
    "../..",
    "/dev/null",
    "/dev/zero",
    "/dev/full",
    ".",
    "run",
    "run/policy.zip",
    "no/such",
    "run/config.json",
    "💥",
    "\x1b[31m",
    "[/red]",
    "a' * 500",
    "go-to-pose",
    "go-to-pose-2d",
    "lqr",
    "lab",
    "mpc",
    "lqr:go-to-pose-2d",
    "lqr:go-to-pose-2d@run/spacecraft.toml",
    "pretrained:go-to-pose-2d-fast",
    "free-flyer",
    "pretrained:nobody",
    "sb3:run/policy.zip",
    "sb3:run/config.json",
    "onnx:run/policy.zip",
    "python:os:getcwd",
    "python:this:s",
    "floating-platform",
    "none",
    "None",
    "odd.toml",
    "$HOME",
    "~",
    "*",
    "a\nb",
    "multi-task-2d#nobody",
    "pretrained:multi-task-2d#go-to-pose",
    "run#x",
    ":",
    "::",
    "@",
    "#",
    "=",
    "ppo.n_steps=",
    "ppo=1",
    "=1",
    "seed=[1]",
    "settings.thrust_weight=-1",
    "timing.control_period=1e-300",
    "ppo.layers=[]",
    "spacecraft=[]",
    "task=null",
    "curriculum=[{}]",
    "conditions.body=1",
    "device=tpu",
)
_NUMBERS = (
    "0",
    "1",
    "2",
    "-1",
    "3",
    "1e3",
    "nan",
    "inf",
    "-inf",
    "1.5",
    "9' * 3",
    "2147483648",
    "0x10",
    "1e-320",
    "one",
)
_NEVER = {"peers", "peer_folder", "view"}
"""Options that install packages or show something until they are stopped."""


def line_case(number: int, folder: Path, run: Path) -> Sequence[Command]:
    """A command with options of its own and values of anybody's, in a folder with a trained agent."""
    chance = random.Random(f"line {number}")
    shutil.copytree(run, folder / "run")
    names = list(_commands())
    name = names[number % len(names)]
    words = [name]
    for field, kind in _options(_described(name)):
        positional = "POSITIONAL" in str(get_args(kind)[1:]).upper()
        if field in _NEVER or (not positional and chance.random() > 0.25):
            continue
        words += [] if positional else [f"--{_option(field, kind).replace('_', '-')}"]
        if kind is not bool:
            words += [_argument(field, kind, chance) for _ in range(chance.choice((1,) * 9 + (2,)))]
    if chance.random() < 0.1:
        words.insert(chance.randrange(len(words) + 1), chance.choice(_WORDS))
    return [_within_reason(words)]


def _commands() -> Mapping[str, Any]:
    """Every installed command by its name; from above, as everybody who types them."""
    return importlib.import_module("rans.cli").COMMANDS


def _described(name: str) -> Any:
    """The class whose fields are the command's options."""
    return _commands()[name]


def _options(described: Any) -> Iterator[tuple[str, Any]]:
    hints = get_type_hints(described, include_extras=True)
    return ((field.name, hints[field.name]) for field in dataclasses.fields(described))


def _option(field: str, kind: Any) -> str:
    """The option's name, which a command may have changed."""
    named = [one.name for one in getattr(kind, "__metadata__", ()) if getattr(one, "name", None)]
    return named[0] if named else field


def _argument(field: str, kind: Any, chance: random.Random) -> str:
    """A value that suits the option mostly, and anybody's in the other cases."""
    kinds = set(_leaves(kind))
    if chance.random() < 0.15:
        return chance.choice((*_WORDS, *_NUMBERS))
    if get_origin(kind) is Literal:
        return chance.choice(get_args(kind))
    if kinds & {int, float}:
        return chance.choice(_NUMBERS)
    return chance.choice((*_WORDS, *_suited(field)))


def _leaves(kind: Any) -> Iterator[Any]:
    """The types that an option's type is made of."""
    if get_origin(kind) is Annotated:
        yield from _leaves(get_args(kind)[0])
    elif get_args(kind):
        for inner in get_args(kind):
            yield from _leaves(inner)
    elif isinstance(kind, type):
        yield kind


def _suited(field: str) -> Sequence[str]:
    """What the option is for."""
    shipped = tuple(f"pretrained:{name}" for name in pretrained_names())
    return {
        "task": tuple(TASKS) * 20,
        "controller": ("lqr", "switching") * 20,
        "contestant": shipped * 4,
        "contestants": ("run", "lqr:go-to-pose-2d", "pretrained:go-to-pose-2d-fast") * 20,
        "run_folder": ("run",) * 20,
        "spacecraft": ("floating-platform", "free-flyer") * 10,
        "output": ("out", "run", "run/policy.zip", "/proc/x") * 5,
        "device": ("cpu",) * 30,
        "conditions": ("lab", "perfect", "harsh") * 8,
    }.get(field, ())


def _within_reason(words: Sequence[str]) -> Command:
    """Trainings and searches are cut to seconds by what is not tried here: they would only be long."""
    name = words[0]
    if name in ("train", "sweep") and not any(
        word.startswith("total_timesteps=") for word in words
    ):
        return (*words, "--set", "total_timesteps=512")
    return tuple(words)


def folder_case(number: int, folder: Path, runs: Sequence[Path]) -> Sequence[Command]:
    """A damaged run folder, and a command that opens it."""
    chance = random.Random(f"folder {number}")
    whole, other = chance.sample(list(runs), 2)
    run = Path(shutil.copytree(whole, folder / "run"))
    for _ in range(chance.choice((1, 1, 2))):
        files = sorted(file for file in run.iterdir() if file.is_file() and not file.is_symlink())
        if files:
            _hurt(chance.choice(files), other, chance)
    every = (
        ("evaluate", "run", "--episodes", "2"),
        ("train", "--resume", "run"),
        ("export", "run", "--output", "out", "--episodes", "2"),
        ("export", "run", "--output", "out", "--episodes", "2", "--format", "numpy"),
        ("report", "run"),
        ("view", "run", "--save", "page.html"),
        (
            "compare",
            "run",
            "sb3:run/policy.zip",
            "--with",
            "lqr",
            "--episodes",
            "2",
            "--certified",
            "0",
        ),
    )
    return chance.sample(every, 2)


def _hurt(file: Path, other: Path, chance: random.Random) -> None:
    """Damage a file, or put something else in its place."""
    content = file.read_bytes()
    way = chance.randrange(10)
    text = file.suffix in (".json", ".jsonl", ".toml")
    if way < 5:
        if text and chance.random() < 0.7:
            changed = damaged_text(content.decode("utf-8", "replace"), chance)
            file.write_bytes(changed.encode("utf-8", "surrogatepass"))
        else:
            file.write_bytes(damaged_bytes(content, chance))
        return
    file.unlink()
    if way == 6:
        file.mkdir()
    elif way == 7:
        os.mkfifo(file)
    elif way == 8:
        file.symlink_to(chance.choice((file.name, "/dev/zero", "/etc/passwd", "..")))
    elif way == 9 and (other / file.name).exists():
        shutil.copy(other / file.name, file)


def runs_to_damage(folder: Path, conditions: str = "") -> list[Path]:
    """A run in the plane, and one in space with a memory."""
    plane = tiny(conditions)
    space = dataclasses.replace(
        plane, spacecraft="free-flyer", ppo=plane.ppo if conditions else _HISTORY
    )
    runs = {folder / "plane": plane, folder / "space": space}
    for run, config in runs.items():
        apart(trained, run, config)
    return list(runs)
