"""What can be had by name: built in, from packages that are installed, or from any module as MODULE:NAME."""

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
"""In the environment, so that processes started from here know too: files may name code."""


def trust_files() -> None:
    """Let files name any module's object as MODULE:NAME, whose code then runs, as ``--trust`` does.

    For this process and those that it starts, from now on. Only for run folders, configs and sweeps whose
    authors you know.

    >>> rans.trust_files()
    >>> agent = rans.load_agent("go-to-pose-2d")
    """
    os.environ[TRUST_VARIABLE] = "1"


class Registry(Mapping[str, T]):
    """Objects by name, each loaded when it is first asked for: names alone import nothing.

    Names are those built in, the entry points that installed packages declare, and what `register` added.
    Besides, ``MODULE:NAME`` finds an object of any module, also in the current folder. Whoever takes
    that from a file, which may be a stranger's, asks `check_file` first.

    Those built in are where "module:Name" or, for the text of a file, "package:file.toml" says; no package
    replaces them. ``checked``, called with what was loaded, gives the object to hand out. Messages tell what
    the objects are, and what else a user may name (``or_else``).

    Raises:
        ConfigError: by ``registry[name]``: there is no such object, or it does not work; the sentence names
            the package it is of.
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
        """Called with every name that `register` adds: who keeps names elsewhere too sets it."""

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
        """A decorator that gives an object a name for this process; another process does not know it.

        Raises:
            ConfigError: the name is taken by somebody else, or the object does not work.
        """
        if name in self.built_in or name in self._offered or ":" in name:
            raise ConfigError(
                f"the {self._kind} {brief(name)} exists already, or is no name; choose another one."
            )

        def keep(found: T) -> T:
            self._own[name] = self._checked(found)
            self.announce(name)
            return found

        return keep

    def vouch_for(self, name: str) -> None:
        """Let files name this MODULE:NAME in this process, whose program named or gave the object itself."""
        self._vouched.add(name)

    def check_file(self, name: object, file: object) -> None:
        """Refuse (`ConfigError`) what a file that may be a stranger's names as MODULE:NAME.

        To look for it would run code: the module's, that of an attribute, or the object itself, which may be
        a function. Whether the module is loaded already makes no difference: somebody else loaded it.
        Names without a colon are of RANS, of installed packages or of `register`, and are never refused.
        """
        if not isinstance(name, str) or ":" not in name:
            return
        if os.environ.get(TRUST_VARIABLE) or name in self._vouched:
            return
        raise ConfigError(
            f"{file} names the {self._kind} {brief(name)}, and to use it would run that "
            "module's code. If you know who made it, add --trust; from Python, call "
            "rans.trust_files() first."
        )

    def package(self, name: str) -> str:
        """The installed package that offers this name; nothing for what comes with RANS or was registered."""
        offered = () if name in self.built_in else self._offered.get(name, ())
        return " and ".join(entry.dist.name if entry.dist else "unknown" for entry in offered)

    @cached_property
    def _offered(self) -> dict[str, list[EntryPoint]]:
        found: dict[str, list[EntryPoint]] = {}
        for entry in sorted(entry_points(group=self._group)):
            found.setdefault(entry.name, []).append(entry)
        return found

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
        """What a name stands for, as its module has it."""
        if name in self.built_in:
            return resolve(self.built_in[name])
        if name not in self._offered:
            return resolve_typed(name)
        first, *others = self._offered[name]
        if others:
            raise ConfigError("there are two of this name; uninstall one of the packages.")
        return resolve(first.value)


def allow_current_folder() -> None:
    """Let modules of the current folder be imported, where no other one has their name.

    Only where the user typed MODULE:NAME. The folder is looked through last: a file in it that has the name
    of a module of Python's or of an installed package takes nobody's place. Worker processes take over where
    this one looks.
    """
    if (folder := str(Path.cwd())) not in sys.path:
        sys.path.append(folder)


def resolve_typed(reference: str) -> Any:
    """The object behind "module:Name" that a user typed, also of a module of the current folder.

    Raises:
        ConfigError: there is no such object, its module fails, or that is of Python's own library.
    """
    if reference.partition(":")[0].partition(".")[0] in sys.stdlib_module_names:
        raise ConfigError("it is of Python's own library, where nothing of RANS is.")
    allow_current_folder()
    return resolve(reference)


def resolve(reference: str) -> Any:
    """The object behind "module:Name", or the text of "package:file.toml".

    Raises:
        ConfigError: there is no such object, it belongs to another module that this one has imported as
            such ("module:os.abort"), or its module fails.
    """
    module, _, name = reference.partition(":")
    try:
        if name.endswith(".toml"):
            return (resources.files(module) / name).read_text("utf-8")
        found: Any = importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
            if isinstance(found, ModuleType):
                raise ConfigError(
                    f"{brief(part)} is a module there; name what is in it by its own name, "
                    "as in PACKAGE.MODULE:NAME."
                )
        return found
    except ConfigError:
        raise
    except Exception as error:  # a module's top level raises anything
        raise ConfigError(f"{type(error).__name__}: {first_line(error)}.") from error
