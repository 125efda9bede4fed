"""Registry of objects by name: built in, from installed packages, or from any module as MODULE:NAME."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from importlib import resources
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from rans.errors import ConfigError, brief, meant
from rans.files import first_line

T = TypeVar("T")

TRUST_VARIABLE = "RANS_TRUST"
"""Environment variable, inherited by child processes, that allows files to name code."""


def trust_files() -> None:
    """Allow files to name objects as MODULE:NAME, whose code then runs, as ``--trust`` does.

    It applies to this process and those that it starts from now on. Use it only for run folders, configs and sweeps
    whose authors you trust.

    >>> rans.trust_files()
    >>> agent = rans.load_agent("go-to-pose-2d")
    """
    os.environ[TRUST_VARIABLE] = "1"


class Registry(Mapping[str, T]):
    """Mapping of names to objects, each loaded on first use; listing names imports nothing.

    Names are built in, entry points of installed packages, or added by `register`. ``MODULE:NAME`` is an object of
    any module, which may be in the current folder; for names from untrusted files call `check_file` first.

    Args:
        kind: kind of the objects in messages, such as "task".
        group: group of the entry points.
        built_in: "module:Name" of each built-in name, or "package:file.toml" for the text of a file. Packages
            cannot replace them.
        checked: converts and checks a loaded object.
        or_else: other forms that a user may give, for messages.

    Raises:
        ConfigError: by ``registry[name]``: there is no such object, or it is not valid; the message names its
            package.
    """

    def __init__(
        self,
        kind: str,
        group: str,
        built_in: Mapping[str, str],
        checked: Callable[[Any], T],
        or_else: str = "",
    ) -> None:
        self._kind = kind
        self._group = group
        self.built_in = built_in
        self._checked = checked
        self._or_else = or_else
        self._loaded: dict[str, T] = {}
        self._own: dict[str, T] = {}
        self._vouched: set[str] = set()
        self.announce: Callable[[str], object] = lambda _: None
        """Callback with every name that `register` adds, for other registries."""

    def __repr__(self) -> str:
        return f"<{self._kind} by name: {', '.join(self)}>"

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys((*self.built_in, *self._offered, *self._own)))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __contains__(self, name: object) -> bool:
        return name in list(iter(self))

    def __getitem__(self, name: str) -> T:
        if name in self._own:
            return self._own[name]
        if name not in self._loaded:
            self._loaded[name] = self._load(name)
        return self._loaded[name]

    def register(self, name: str) -> Callable[[T], T]:
        """Decorator that registers an object under a name in this process; other processes do not know it.

        Raises:
            ConfigError: the name is taken or not valid, or the object is not valid.
        """
        if name in self.built_in or name in self._offered or ":" in name:
            raise ConfigError(
                f"the {self._kind} {brief(name)} exists already, or is not a valid name; choose another one."
            )

        def keep(result: T) -> T:
            self._own[name] = self._checked(result)
            self.announce(name)
            return result

        return keep

    def vouch_for(self, name: str) -> None:
        """Allow files to name this MODULE:NAME in this process, whose program has named the object itself."""
        self._vouched.add(name)

    def check_file(self, name: object, file: object) -> None:
        """Reject MODULE:NAME from an untrusted file, because loading it would run code.

        It makes no difference whether the module is already loaded. Names without a colon belong to RANS, to
        installed packages or to `register`, and are always accepted.

        Args:
            name: name in the file.
            file: file, for the message.

        Raises:
            ConfigError: the name has a colon, and neither `trust_files` nor `vouch_for` allows it.
        """
        if not isinstance(name, str) or ":" not in name:
            return
        if os.environ.get(TRUST_VARIABLE) or name in self._vouched:
            return
        raise ConfigError(
            f"{file} names the {self._kind} {brief(name)}, and to use it would run that "
            "module's code. If you trust its author, add --trust; from Python, call "
            "rans.trust_files() first."
        )

    def package(self, name: str) -> str:
        """Installed package that provides a name; empty for names of RANS and of `register`."""
        offered = () if name in self.built_in else self._offered.get(name, ())
        return " and ".join(entry.dist.name if entry.dist else "unknown" for entry in offered)

    @cached_property
    def _offered(self) -> dict[str, list[EntryPoint]]:
        result: dict[str, list[EntryPoint]] = {}
        for entry in sorted(entry_points(group=self._group)):
            result.setdefault(entry.name, []).append(entry)
        return result

    def _load(self, name: str) -> T:
        package = self.package(name)
        if name not in self and ":" not in name:
            raise ConfigError(
                f"there is no {self._kind} named {brief(name)}{meant(name, self)}; known are "
                f"{', '.join(self)}; your own is MODULE:NAME{self._or_else}."
            )
        try:
            return self._checked(self._resolve(name))
        except ConfigError as error:
            of = f" of the package {package}" if package else ""
            raise ConfigError(
                f"the {self._kind} {brief(name)}{of} cannot be used: {error}"
            ) from error

    def _resolve(self, name: str) -> Any:
        """Object of a name as its module defines it."""
        if name in self.built_in:
            return resolve(self.built_in[name])
        if name not in self._offered:
            return resolve_typed(name)
        first, *others = self._offered[name]
        if others:
            raise ConfigError("two packages have this name; uninstall one of them.")
        return resolve(first.value)


def allow_current_folder() -> None:
    """Allow imports from the current folder, after a user typed MODULE:NAME.

    The folder is searched last, so that its files cannot replace modules of Python or of installed packages. Worker
    processes inherit the search path.
    """
    if (folder := str(Path.cwd())) not in sys.path:
        sys.path.append(folder)


def resolve_typed(reference: str) -> Any:
    """Object of "module:Name" that a user typed, whose module may be in the current folder.

    Raises:
        ConfigError: there is no such object, its module fails, or the module belongs to Python's library.
    """
    if reference.partition(":")[0].partition(".")[0] in sys.stdlib_module_names:
        raise ConfigError("it belongs to Python's library, which has no objects for RANS.")
    allow_current_folder()
    return resolve(reference)


def resolve(reference: str) -> Any:
    """Object of "module:Name", or text of "package:file.toml".

    Raises:
        ConfigError: there is no such object, it belongs to another imported module ("module:os.abort"), or its
            module fails.
    """
    module, _, name = reference.partition(":")
    try:
        if name.endswith(".toml"):
            return (resources.files(module) / name).read_text("utf-8")
        result: Any = importlib.import_module(module)
        for part in name.split("."):
            result = getattr(result, part)
            if isinstance(result, ModuleType):
                raise ConfigError(
                    f"{brief(part)} is a module there; name its objects by its own name, "
                    "as in PACKAGE.MODULE:NAME."
                )
        return result
    except ConfigError:
        raise
    except Exception as error:  # the top level of a module may raise anything
        raise ConfigError(f"{type(error).__name__}: {first_line(error)}.") from error
