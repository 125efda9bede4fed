"""Registry of objects by name: built in, from installed packages, or from any module as MODULE:NAME.

Names come from files of strangers and from installed packages: nothing is imported before it is asked for, and
every failure is a sentence.
"""

from __future__ import annotations

import ast
import contextlib
import importlib
import importlib.util
import inspect
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, wraps
from importlib import resources
from importlib.metadata import Distribution, EntryPoint, distribution, distributions
from pathlib import Path
from types import ModuleType
from typing import Any, Concatenate, ParamSpec, TypeVar

from rans.base.errors import (
    EXTRAS,
    ConfigError,
    MissingPackage,
    NoSuchKey,
    RansWarning,
    brief,
    checked,
    is_installed,
    meant,
    meant_file,
    of_user_code,
    one_line,
)
from rans.base.files import first_line

T = TypeVar("T")
Given = TypeVar("Given")
More = ParamSpec("More")

_RANS = "rans"
"""Distribution whose names are those of RANS, also of its packages."""

TRUST_VARIABLE = "RANS_TRUST"
"""Environment variable, inherited by child processes, that allows files to name code."""


def trust_files() -> None:
    """Allow files to name objects as MODULE:NAME, whose code then runs, as ``--trust`` does.

    It applies to this process and those that it starts from now on. Use it only for run folders and configs whose
    authors you trust.

    >>> rans.trust_files()
    >>> agent = rans.load_agent("go-to-pose-2d")
    """
    os.environ[TRUST_VARIABLE] = "1"


def are_files_trusted() -> bool:
    """Whether files may name code: `trust_files` was called, or the user has set RANS_TRUST=1."""
    return os.environ.get(TRUST_VARIABLE) == "1"


_typed: set[str] = set()
"""Every MODULE:NAME that the user, or the user's program, has named in this process."""


def typed(name: Given) -> Given:
    """The value, after which every `Registry` of this process may run it if it is MODULE:NAME.

    Call it where a name comes from the user: a word of the command line, an argument in Python, or a class of the
    user's program. Never call it with a text of a file.
    """
    if isinstance(name, str) and ":" in name:
        _typed.add(name)
    return name


def by_user(load: Callable[Concatenate[Given, More], T]) -> Callable[Concatenate[Given, More], T]:
    """Decorator of a function of a name: every name that it is given counts as `typed`."""

    @wraps(load)
    def load_typed(name: Given, *more: More.args, **named: More.kwargs) -> T:
        return load(typed(name), *more, **named)

    return load_typed


@dataclass(eq=False, repr=False)
class Registry(Mapping[str, T]):
    """Mapping of names to objects, each loaded on first use; listing names imports nothing.

    Names are built in, entry points of installed packages, or added by `register`. ``MODULE:NAME`` is an object of
    any module, which may be in the current folder. To load it runs code, so it is refused unless the user has
    `typed` it or trusts files (`trust_files`); whether the module is already loaded makes no difference.

    Raises:
        NoSuchKey: by ``registry[name]``: there is no such object.
        ConfigError: it is not valid (the message names its package), or it is a MODULE:NAME that only a file has
            named.
    """

    kind: str
    """Kind of the objects in messages, such as "task"."""
    group: str
    """Group of the entry points; those of the groups GROUP.WORD belong to it too (`subgroup`)."""
    built_in: Mapping[str, str] = field(default_factory=dict)
    """"module:Name" of each built-in name, or "package" for the text of its file NAME.toml. Packages cannot replace
    them."""
    checked: Callable[[Any], T] | type[T] | str | None = None
    """Converts and checks a loaded object, or the class that it must be an object of; "module:name" of either where
    it is loaded with the first object. None: any object."""
    or_else: str = ""
    """Other forms that a user may give, for messages."""
    elsewhere: Mapping[str, str] = field(default_factory=dict)
    """Names by what such objects are called elsewhere, for messages."""
    files: Callable[[str], str] = field(default=lambda file: "")
    """What to write in place of a file of other software, with {name} and {stem}; empty: it is not known."""
    own: dict[str, T] = field(default_factory=dict, init=False)
    """What `register` has added in this process, by name."""
    announce: Callable[[str], object] = field(default=str, init=False)
    """Callback with every name that `register` adds, for other registries; by default nothing."""
    _loaded: dict[str, T] = field(default_factory=dict, init=False)

    def __repr__(self) -> str:
        return f"<{self.kind} by name: {', '.join(self)}>"

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys((*self.built_in, *self._offered, *self.own)))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __contains__(self, name: object) -> bool:
        return name in list(iter(self))

    def __getitem__(self, name: str) -> T:
        self._check_trust(name)
        if name in self.own:
            return self.own[name]
        if name not in self._loaded:
            self._loaded[name] = self._load(name)
        return self._loaded[name]

    def each(self) -> Iterator[tuple[str, T]]:
        """Every object with its name, where a name only says what an object is of and several packages may use it.

        Raises:
            ConfigError: an object is not valid; the message names its package.
        """
        for name in self:
            entries = () if name in self.built_in else self._offered.get(name, ())
            if len(entries) < 2:
                yield name, self[name]
            for entry in entries if len(entries) > 1 else ():
                with self.of_package(name, entry.dist.name if entry.dist else "unknown"):
                    found = self._checked(resolve(entry.value, name))
                yield name, found

    def register(self, name: str) -> Callable[[T], T]:
        """Decorator that registers an object under a name in this process; other processes do not know it.

        Raises:
            ConfigError: the name is taken or not valid, or the object is not valid.
        """
        one_line(f"the name of a {self.kind}", name)
        if name in self.built_in or name in self._offered or ":" in name:
            raise ConfigError(
                f"the {self.kind} {brief(name)} exists already, or is not a valid name; choose another one."
            )

        def keep(result: T) -> T:
            self.own[name] = self._checked(result)
            self.announce(name)
            return result

        return keep

    def _checked(self, found: Any) -> T:
        """A loaded object, converted and checked; a class that lacks methods is refused here."""
        if isinstance(found, type) and inspect.isabstract(found):
            missing = ", ".join(sorted(found.__abstractmethods__))  # pyrefly: ignore[missing-attribute]
            raise ConfigError(
                f"{found.__name__} has no {missing}, which every {self.kind} must have."
            )
        check: Any = resolve(self.checked) if isinstance(self.checked, str) else self.checked
        if isinstance(check, type):
            return checked("it", found, check)
        return found if check is None else check(found)

    def _check_trust(self, name: object) -> None:
        """Reject MODULE:NAME that the user has not typed, because loading it would run code of a file's choice."""
        if not isinstance(name, str):
            raise NoSuchKey(f"the {self.kind} must be a name, got {brief(name)}.")
        if ":" not in name or name in self._offered or name in _typed or are_files_trusted():
            return
        raise ConfigError(
            f"a file names the {self.kind} {brief(name)}, and to use it would run that "
            "module's code. If you trust its author, add --trust; from Python, call "
            "rans.trust_files() first."
        )

    def meant(self, name: str, others: Iterable[str] = ()) -> str:
        """Suggestion " (did you mean ...?)" by the name elsewhere or a similar name; else an empty text.

        Args:
            name: that the user wrote.
            others: names of other objects that the user may have meant.
        """
        known = self.elsewhere.get(name.lower())
        return f" (did you mean {known}?)" if known else meant(name, (*self, *others))

    def package(self, name: str) -> str:
        """Installed package that provides a name; empty for names of RANS and of `register`."""
        offered = () if name in self.built_in else self._offered.get(name, ())
        names = [entry.dist.name if entry.dist else "unknown" for entry in offered]
        return "" if _RANS in names else " and ".join(names)

    def subgroup(self, name: str) -> str:
        """Last word of the group of a name's entry point, as "space" of GROUP.space; empty where that is GROUP."""
        entries = () if name in self.built_in else self._offered.get(name, ())
        return next((e.group.removeprefix(self.group).strip(".") for e in entries), "")

    def comes_with_rans(self, name: str) -> bool:
        """Whether a name is built in, or of a package in the distribution of RANS."""
        return name in self.built_in or (name in self._offered and not self.package(name))

    def summary(self, name: str) -> str:
        """First line of an object's docstring, read from its module's text where that says it.

        Nothing is imported for it. An object that its module imports or makes is loaded.

        Raises:
            ConfigError: there is no such object, or it has to be loaded and cannot be.
        """
        reference = self.built_in.get(name) or next(
            (entry.value for entry in self._offered.get(name, ())), ""
        )
        found = _docstring(reference) or getattr(self[name], "__doc__", None) or ""
        return next(iter(found.strip().splitlines()), "no docstring")

    @cached_property
    def _offered(self) -> dict[str, list[EntryPoint]]:
        result: dict[str, list[EntryPoint]] = {}
        for entry in sorted(_entry_points(self.group)):
            result.setdefault(entry.name, []).append(entry)
        # As those built in, names of RANS's own packages cannot be replaced.
        return {
            name: [e for e in several if e.dist is not None and e.dist.name == _RANS] or several
            for name, several in result.items()
        }

    def _load(self, name: str) -> T:
        """Import and check the object of a name; for an unknown one the error has the nearest names."""
        if name not in self and ":" not in name:
            near = self.meant(name) or (
                _of_file(name, self.kind, self.files) if self.or_else else ""
            )
            if self.or_else and "=" in name:
                near = " (write the line into a file, such as mine.toml, and name that)"
            raise NoSuchKey(
                f"there is no {self.kind} named {brief(name)}{near}; known are "
                f"{', '.join(self)}; your own is MODULE:NAME{self.or_else}."
            )
        with self.of_package(name):
            return self._checked(self._resolve(name))

    @contextlib.contextmanager
    def of_package(self, name: str, package: str = "") -> Iterator[None]:
        """Context whose errors say which object of which package (by default that of its name) cannot be used.

        Raises:
            ConfigError: code of a package has raised any exception, or an object is not valid.
        """
        try:
            yield
        except Exception as error:  # code of packages may raise anything as it is checked
            package = package or self.package(name)
            ours = not isinstance(error, ConfigError) and name in self.built_in
            if ours or (isinstance(error, MissingPackage) and not package):
                raise  # what to install it says itself, and Python's `except ImportError` finds it
            of = f" of the package {package}" if package else ""
            reason = error if isinstance(error, ConfigError) else _raised(error)
            raise ConfigError(
                f"the {self.kind} {brief(name)}{of} cannot be used: {reason}"
            ) from error

    def _resolve(self, name: str) -> Any:
        """Object of a name as its module defines it, unchecked; modules of packages are imported only here.

        A name that is none of the two others may run code: `typed` has allowed it.
        """
        if name in self.built_in:
            return resolve(self.built_in[name], name)
        if name not in self._offered:
            return resolve_typed(name)
        first, *others = self._offered[name]
        if others:
            raise ConfigError("two packages have this name; uninstall one of them.")
        return resolve(first.value, name)


def _docstring(reference: str) -> str:
    """Docstring of the class or function "module:name" by the text of its module; empty if that does not tell."""
    module, _, attribute = reference.partition(":")
    top, *parts = module.split(".")
    spec = importlib.util.find_spec(top) if top else None  # which imports nothing
    for place in (spec and spec.submodule_search_locations) or ():
        stem = Path(place, *parts)
        for file in (stem.with_suffix(".py"), stem / "__init__.py"):
            with contextlib.suppress(OSError, SyntaxError, ValueError):
                for node in ast.parse(file.read_text("utf-8")).body:
                    is_it = isinstance(node, ast.ClassDef | ast.FunctionDef)
                    if is_it and node.name == attribute:
                        return ast.get_docstring(node) or ""
    return ""


def _of_file(name: str, kind: str, files: Callable[[str], str]) -> str:
    """What to write for a name that is a file or a folder, or nearly one; else an empty text."""
    path = Path(name)
    try:
        is_folder = path.is_dir()
        is_file = path.is_file()
    except OSError:  # longer than names of files may be
        return ""
    if is_folder:
        own = path / f"{kind}.toml"
        return f" (it is a folder{f'; did you mean {own}?' if own.exists() else ''})"
    if not is_file:
        return meant_file(name)
    if path.suffix.lower() == ".toml":
        return f" (it is a file; rename it to {path.with_suffix('.toml').name}, in small letters)"
    if hint := files(name):
        return f" ({hint.format(name=name, stem=path.stem)})"
    return " (it is a file, but its name does not end in .toml)"


def _entry_points(group: str) -> list[EntryPoint]:
    """Entry points of a group and of GROUP.WORD; a package whose list cannot be read is left out, with a warning.

    Python's own `entry_points` fails for all packages if one of them has a line without "=". Names are one line, as
    those of spacecraft are.
    """

    def chosen(package: Distribution) -> list[EntryPoint]:
        own = [one for one in package.entry_points if f"{one.group}.".startswith(f"{group}.")]
        for name in [package.name, *(point.name for point in own)] if own else []:
            one_line("a name", name)
        return own

    points: dict[str, list[EntryPoint]] = {}
    for package in distributions():
        try:
            if chosen(package):  # to read the name of every package takes ten times as long
                # A stale one further on the path counts for nothing.
                first = distribution(package.name)
                points[first.name] = chosen(first)
        except Exception as error:  # metadata of other packages may hold anything
            points.setdefault(package.name, [])
            if f"[{group}" in (package.read_text("entry_points.txt") or ""):
                warnings.warn(
                    f"the entry points of the package {package.name} cannot be read, and nothing of it is "
                    f"registered: {first_line(error)}; the usual cause is a line without '='.",
                    RansWarning,
                    stacklevel=2,
                )
    return [entry for several in points.values() for entry in several]


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


def resolve(reference: str, file: str = "") -> Any:
    """Object of "module:Name", or text of a file of "package", as entry points name both.

    Args:
        reference: of the object, or of the package; folders in it follow points.
        file: name of the file in the package, without .toml.

    Raises:
        ConfigError: there is no such object, it belongs to another imported module ("module:os.abort"), or its
            module fails.
        MissingPackage: its module needs a package of `rans.base.errors.EXTRAS` that is not installed.
    """
    module, _, name = reference.partition(":")
    try:
        # A name of a file is what hatchling takes, and setuptools does not.
        if (file and not name) or name.endswith(".toml"):
            return (resources.files(module) / (name or f"{file}.toml")).read_text("utf-8")
        result: Any = importlib.import_module(module)
        if "<locals>" in name:
            raise ConfigError(
                f"{name} is defined inside a function, where nobody finds it by its name: define it at the "
                "top of its module."
            )
        # Only objects that the module itself names: no module within it.
        for part in name.split("."):
            if not hasattr(result, part):
                raise ConfigError(f"{module} has no {brief(part)}{meant(part, dir(result))}.")
            result = getattr(result, part)
            if isinstance(result, ModuleType):
                raise ConfigError(
                    f"{brief(part)} is a module there; name its objects by its own name, "
                    "as in PACKAGE.MODULE:NAME."
                )
        return result
    except ConfigError:
        raise
    except KeyboardInterrupt:
        raise
    except (
        BaseException
    ) as error:  # the top level of a module may raise anything, or end the process
        if isinstance(error, SystemExit):
            raise ConfigError(
                f"{module} ends the process when it is imported (sys.exit({error.code!r})); a module that is "
                "imported must not."
            ) from error
        if module.endswith(".py") and isinstance(error, ModuleNotFoundError):
            raise ConfigError(
                f"a module is named without .py: write {module.removesuffix('.py')}:{name}."
            ) from error
        missing = str(getattr(error, "name", "")).partition(".")[0]
        if (
            isinstance(error, ModuleNotFoundError)
            and missing in EXTRAS
            and not is_installed(missing)
        ):
            raise MissingPackage(missing) from error
        raise ConfigError(_raised(error)) from error


def _raised(error: BaseException) -> str:
    """An exception of somebody else's code as a sentence, with file and line where they tell."""
    return of_user_code(error) or f"{type(error).__name__}: {first_line(error)}."
