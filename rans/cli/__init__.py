"""Command line ``rans COMMAND``: every command is a dataclass with the name of its module and options as fields."""

from __future__ import annotations

import errno
import io
import json
import os
import shlex
import shutil
import sys
import time
import unicodedata
import warnings
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from rans.base.errors import (
    EXTRAS,
    UNSET,
    ConfigError,
    MissingPackage,
    RansError,
    brief,
    counted,
    legible,
    meant,
    of_user_code,
    where_raised,
)
from rans.base.executors import jobs_sent, run_on, without_executor
from rans.base.files import as_command, first_line, has_written, why_unwritten
from rans.base.registry import trust_files
from rans.cli.commands import COMMANDS, divides_work

STARTED = time.monotonic()
"""Start of this process, s, from which commands report their wall time."""
_NARROWEST = 20
"""Columns that help has at least: the layout of options has no end in less than six."""
_LONGEST = 5000
"""Characters of a sentence; ours leave out what would make them longer."""
_ELSEWHERE = {
    "--lr": "--set learning_rate=1e-3",
    "--algo": "--set algorithm=ppo",
    "--gpu": "--device cuda",
}
"""Options of other trainers, and what is typed for them here."""
_ABOUT = """Train agents that fly thruster-driven spacecraft, check them in Drake, and compare them with
optimal control. `rans COMMAND --help` explains a command, `rans --version` prints the version."""


_MEANT = {
    "check": "validate for a spacecraft, or dossier for an agent",
    "verify": "validate for a spacecraft, prove or dossier for an agent",
    "film": "view RUN --save film.mp4",
    "play": "view RUN --play",
    "plot": "report RUN",
    "show": "list NAME, or view RUN",
    "simulate": "evaluate RUN, or view RUN",
    "sweep": "train in a loop, docs/many_gpus.md",
}
"""Words of other programs, and what does the same here."""


def main(arguments: list[str] | None = None) -> int:
    """Run one command and return its exit code: 0 for success, 1 if a check or a run failed.

    A wrong input ends with one sentence and exit code 2, an interrupt with one sentence and 130 (the command
    ``rans`` makes that 143 if the signal was SIGTERM). The code is 1 if
    the reader of the output has closed it, as in ``rans list | head -1``.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    if sys.stdout is None:  # the standard output was closed before the start
        with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
            return main(arguments)
    if isinstance(
        sys.stdout, io.TextIOWrapper
    ):  # its encoding may lack characters of tables, as ASCII does
        sys.stdout.reconfigure(errors="replace")
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _warnings_once()
            code = _run(arguments)
            sys.stdout.flush()
            return code
    # Mistakes of the user, then what is missing, interrupts and limits of the machine: a sentence each.
    except RansError as error:
        return _end(f"rans: {error}{where_raised(error)}", 2)
    except ModuleNotFoundError as error:
        module = (error.name or "").partition(".")[0]
        if module not in EXTRAS:
            raise
        return _end(f"rans: {MissingPackage(module)}", 2)
    except KeyboardInterrupt:
        written = "what was written is kept" if has_written() else "nothing was written"
        return _end(f"\nrans: interrupted; {written}.", 130)
    except BrokenPipeError:
        # Python would flush once more at exit and report an error.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        return _end(f"rans: {_of_system(error)}.", 2)
    except UnicodeEncodeError as error:  # a file name with bytes that are not characters
        return _end(
            f"rans: {brief(error.object)} cannot be written in {error.encoding}; rename the file or "
            "the folder of this name.",
            2,
        )
    except OverflowError as error:
        return _end(f"rans: a number is too large to compute with: {error}.", 2)
    except (
        MemoryError,
        RuntimeError,
    ) as error:  # torch raises its own class on a GPU, and a RuntimeError on a CPU
        name = type(error).__name__
        line = first_line(error)
        if isinstance(error, MemoryError):  # of Python or NumPy, where nothing need be a batch
            return _end(f"rans: out of memory: {line}.", 2)
        if name == "OutOfMemoryError" or "DefaultCPUAllocator: can't allocate memory" in str(error):
            return _end(f"rans: out of memory, a smaller batch may fit: {line}.", 2)
        if name == "InductorError" and line.startswith("ImportError: "):
            return _end(
                f"rans: torch's compiler cannot load a file of its cache: {line}. The usual cause is a "
                "process that is writing it, or was ended while it did: try again, or delete that file.",
                2,
            )
        return _end_of_user_code(error)
    except Exception as error:
        return _end_of_user_code(error)


def _of_system(error: OSError) -> str:
    """What the system refused and why; an error of writing on to an open file does not name it."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        what = error.filename or "the output, or a file that was being written"
        return f"cannot write {what}: {why_unwritten(error)}"
    reason = error.strerror or str(error)
    return f"the system refuses {error.filename}: {reason}" if error.filename else reason


def _end_of_user_code(error: Exception) -> int:
    """Exit code after the message of an exception of a user's function; others are raised again."""
    text = of_user_code(error)
    if not text or os.environ.get("RANS_TRACEBACK"):
        raise error
    return _end(f"rans: {text}\nRANS_TRACEBACK=1 prints the whole traceback.", 2)


def _run(arguments: list[str]) -> int:
    """Read the arguments, run the command here or on an executor, and return its exit code."""
    if arguments in (["--version"], ["-V"], ["-v"], ["version"]):
        from rans.base.files import package_version

        print(f"rans {package_version('rans')}")
        return 0
    for word in arguments:
        if any(
            unicodedata.category(c) == "Cc" and c not in "\n\t" for c in word
        ):  # tyro would print them
            raise ConfigError(f"an option has control characters: {brief(word)}.")
        if not word or (word.startswith("--") and word.endswith("=")):
            raise ConfigError(f"{brief(word)} is no value of an option; {UNSET}.")
    if shutil.get_terminal_size().columns < _NARROWEST:
        os.environ["COLUMNS"] = str(_NARROWEST)
    # Options that every command has are taken off before its own run.
    command = _parse(arguments or ["--help"])
    arguments, executor = without_executor(arguments)
    if executor is not None and not divides_work(command):
        divided = [name for name, each in COMMANDS.items() if divides_work(each)]
        raise ConfigError(
            f"rans {arguments[0]} does not divide its work, so that --executor is not for it; it is for "
            f"{', '.join(divided)}."
        )
    if "--trust" in arguments:
        trust_files()
    if getattr(command, "guard", False):  # the safety filter knows them
        warnings.filterwarnings("ignore", ".* does not know the constraints of")
    try:
        if executor is None:
            return _followed(command)
        before = jobs_sent()
        with run_on(executor):
            code = _followed(command)
        count = jobs_sent() - before
        _tell(
            f"rans: {counted(count, 'job')} ran on {executor}."
            if count
            else f"rans: nothing ran on {executor}: all work was one job, which this process did."
        )
        return code
    except SystemExit as error:  # of a plug-in or a policy; commands themselves return a code
        raise ConfigError(
            f"code that is not of RANS ended the command (sys.exit({error.code!r})){where_raised(error)}; "
            "a plug-in or a policy must not."
        ) from error


def _followed(command: Any) -> int:
    """Run a command; after success print what to run next, unless the command has done so itself."""
    from rans.base.terminal import Terminal

    Terminal.has_suggested = False
    with as_command():
        code = command.run()
    is_first = os.environ.get("RANK", "0") == "0"  # of the processes of torchrun
    if code == 0 and is_first and not Terminal.has_suggested and (following := next_of(command)):
        Terminal().suggest(*following)
    return code


def next_of(command: Any) -> list[str]:
    """Commands that follow a command; code that it trusts, those that ask trust too.

    Of several words of an option the first stands in a command.
    """
    following = command.following
    if callable(following):
        following = following()
    else:
        firsts = {
            name: value[0] if isinstance(value, tuple) and value else value
            for name, value in vars(command).items()
        }
        words = {name: shlex.quote(str(value)) for name, value in firsts.items()}
        following = [line.format_map(words) for line in following]
    following = [*following]
    if getattr(command, "trust", False):
        for k, line in enumerate(following):
            if hasattr(COMMANDS[line.split()[1]], "trust"):
                following[k] = f"{line} --trust"
    return following


def _parse(arguments: list[str]) -> Any:
    """Parse the arguments and import only the module of the command: ``rans train`` does not load Drake."""
    import tyro

    arguments = without_executor(arguments)[0] or ["--help"]
    if "--trust" in arguments:
        command = _parse([word for word in arguments if word != "--trust"] or ["--help"])
        return replace(command, trust=True) if hasattr(command, "trust") else command
    from rans.cli.help import overview, print_above, print_below
    from rans.cli.numbers import registry

    if arguments[0] == "help":
        arguments = [*arguments[1:], "--help"]
    name, *words = arguments
    if name in ("-h", "--help"):
        print(overview(_ABOUT, {command: COMMANDS[command] for command in COMMANDS}))
        raise SystemExit(0)
    if name.startswith("--tyro-"):  # completion has all commands
        commands: dict[str, Any] = {command: COMMANDS[command] for command in COMMANDS}
        return tyro.extras.subcommand_cli_from_dict(
            commands, args=arguments, prog="rans", description=_ABOUT, registry=registry()
        )
    if name not in COMMANDS:
        word = name.removeprefix("--")
        near = f" (did you mean {_MEANT[word]}?)" if word in _MEANT else meant(word, COMMANDS)
        raise ConfigError(
            f"there is no command {brief(name)}{near}; commands are {', '.join(COMMANDS)}."
        )
    command = COMMANDS[name]
    asks_help = not {"-h", "--help"}.isdisjoint(words)
    if asks_help:
        print_above(command)
    parse = partial(
        tyro.cli,
        command,
        args=words,
        prog=f"rans {name}",
        description="",
        config=(tyro.conf.FlagCreatePairsOff, tyro.conf.DisallowNone),
        registry=registry(),
    )
    appended = {"--set"} if "set" in getattr(command, "__annotations__", {}) else set()
    options = [word.partition("=")[0] for word in words if word.startswith("--")]
    if twice := [name for name in options if options.count(name) > 1 and name not in appended]:
        raise ConfigError(
            f"{twice[0]} is given twice: give it once, with all of its values where it takes several."
        )
    try:
        parsed, further = parse(return_unknown_args=True)
        if further and not further[0].startswith("-"):
            before = words[: words.index(further[0])]
            option = next((word for word in reversed(before) if word.startswith("-")), name)
            raise ConfigError(
                f"there is no place for {brief(further[0])}: {option} takes no further value in one command "
                f"(rans {name} --help). A name with spaces stands in quotes."
            )
        if further and further[0] in _ELSEWHERE and appended:
            raise ConfigError(f"{further[0]} is here {_ELSEWHERE[further[0]]}.")
        return parse() if further else parsed
    finally:
        if asks_help:
            print_below(command)


def _end(sentence: str, code: int) -> int:
    _tell(sentence)
    # torchrun ends with what a process has written there, else with "no error file" below its own traceback.
    if file := os.environ.get("TORCHELASTIC_ERROR_FILE"):
        error = {"message": sentence, "timestamp": int(time.time())}
        Path(file).write_text(json.dumps(error), "utf-8")
    return code


def _tell(sentence: str) -> None:
    """Print a sentence to standard error; on a terminal lines are broken between words."""
    if sys.stderr.isatty():
        from rans.base.terminal import Terminal

        Terminal(stderr=True).print(sentence)
    else:
        print(legible(sentence, _LONGEST), file=sys.stderr)


def _warnings_once() -> Callable[..., None]:
    """A function that prints the message of a warning without its line of code, each message once."""
    printed: set[str] = set()

    def show(message: Warning | str, *_: object, **__: object) -> None:
        sentence = " ".join(str(message).split())
        if sentence not in printed:
            printed.add(sentence)
            _tell(f"rans: warning: {sentence}")

    return show
