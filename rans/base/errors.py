"""Exceptions of RANS, whose messages are sentences that a user can act on, and helpers to write them.

A sentence names the thing, its value and the bound; nearly every module raises them, and tests quote them.
"""

import difflib
import importlib
import importlib.util
import inspect
import math
import os
import re
import shlex
import sys
import traceback
from collections.abc import Callable, Iterable
from dataclasses import is_dataclass
from importlib import metadata
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from typing import Any, Self, TypeVar, get_type_hints

T = TypeVar("T")
UNSET = "the usual cause is a variable of the shell that is not set"
"""What an empty name means."""
_LINE = 100
"""Largest number of characters of a name that is written into files."""


def legible(text: str, longest: int = 2000) -> str:
    """Text with control characters escaped, which could control a terminal, and truncated if it is too long."""
    shortened = text if len(text) <= longest else f"{text[:longest]} ... ({len(text):,} characters)"
    return "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in shortened)


def brief(value: object) -> str:
    """`repr` of a value for the middle of a sentence, truncated if it is long."""
    text = repr(value)
    return text if len(text) <= 120 else f"{text[:80]} ... ({len(text):,} characters)"


def counted(count: int, noun: str) -> str:
    """Number with a noun, such as "1 start" or "1,024 starts"."""
    return f"{count:,} {noun}{'s' * (count != 1)}"


_LONGEST_NAME = 1000


def meant(name: str, known: Iterable[str]) -> str:
    """Suggestion " (did you mean ...?)" of a similar known name, or an empty text.

    Of names that begin with the given one, such as those of agents of a task, the three shortest are suggested; and
    of those that have it as a word, as "more mass" has mass.
    """
    if len(name) > _LONGEST_NAME:  # the comparison would take too long
        return ""
    names = list(known)
    if (plain := _plain(name)) != name and plain in names:
        return f" (did you mean {plain}?)"
    longer = sorted(
        (one for one in names if one.startswith(f"{name}-") or name in one.split(" ")), key=len
    )[:3]
    alike = 0.6 if len(name) <= 3 else 0.7  # of three letters, one slip leaves two thirds
    near = (
        longer
        or difflib.get_close_matches(name, names, 1, alike)
        or difflib.get_close_matches(plain, names, 1, alike)
    )
    return f" (did you mean {' or '.join(near)}?)" if near else ""


def _plain(name: str) -> str:
    """A class or an id of Gymnasium as a name: rans/GoToPose2D-v0 is go-to-pose-2d, LQR is lqr."""
    bare = re.sub(r"^rans/|-v\d+$", "", name.strip())
    return re.sub(r"(?<=[a-z])(?=[A-Z0-9])", "-", bare).lower().replace("_", "-")


def meant_file(name: str | Path) -> str:
    """Suggestion " (did you mean ...?)" of a file or folder beside the named one, or an empty text.

    That is the same name with .toml, or a similar one in the same folder.
    """
    path = Path(name)
    try:
        neighbours = [name for name in sorted(os.listdir(path.parent)) if name != path.name]
    except (OSError, ValueError):
        return ""
    if f"{path.name}.toml" in neighbours:
        return f" (did you mean {path}.toml?)"
    if path.suffix and (right := path.with_suffix(".toml").name) in neighbours:  # mine.tml
        return f" (did you mean {path.with_suffix('.toml')}?)" if right != path.name else ""
    alike = [
        neighbour
        for neighbour in neighbours
        if not path.suffix or Path(neighbour).suffix == path.suffix
    ]
    near = difflib.get_close_matches(path.name, alike, 1, 0.75)
    if not near and not path.suffix:
        stems = {neighbour.removesuffix(".toml"): neighbour for neighbour in neighbours}
        near = [stems[stem] for stem in difflib.get_close_matches(path.name, stems, 1, 0.75)]
    return f" (did you mean {path.parent / near[0]}?)" if near else ""


def checked(what: str, value: object, kind: type[T]) -> T:
    """The value, checked to be of a class.

    Raises:
        ConfigError: it is not; for a dict the message says what to write instead.
    """
    if isinstance(value, kind):
        return value
    top = kind.__name__ in getattr(sys.modules.get("rans"), "__all__", ())
    module = "rans." if top else "" if kind.__module__ == "builtins" else f"{kind.__module__}."
    name = f"{module}{kind.__name__}"
    if isinstance(value, dict):
        raise ConfigError(f"{what} takes an object, not a dict: {_as_object(name, kind, value)}.")
    raise ConfigError(f"{what} must be a {name}, got {brief(value)}.")


def _as_object(name: str, kind: type, table: dict[Any, Any]) -> str:
    """The call that makes an object of a table, with the objects within it.

    A key that is not the object's but of one within it, such as the latency of conditions, goes there.
    """
    hints = get_type_hints(kind) if is_dataclass(kind) else {}
    inner: dict[str, Any] = {key: hint for key, hint in hints.items() if is_dataclass(hint)}
    moved: dict[Any, Any] = {}
    for key, value in table.items():
        owners = [name for name, hint in inner.items() if key in get_type_hints(hint)]
        if key not in hints and len(owners) == 1:
            moved.setdefault(owners[0], {})[key] = value
        else:
            moved[key] = value
    arguments = [
        f"{key}={_as_object(f'rans.{inner[key].__name__}', inner[key], value)}"
        if key in inner and isinstance(value, dict)
        else f"{key}={brief(value)}"
        for key, value in moved.items()
    ]
    return f"{name}({', '.join(arguments)})"


class NamedArguments:
    """Base of classes that refuse an unknown keyword argument in a sentence (`WrongArgument`).

    An argument that belongs to an object within, such as the latency of conditions, is written where it goes.
    """

    def __new__(cls, *_: Any, **named: Any) -> Self:
        """Refuse names that ``__init__`` lacks, naming the nearest; it checks positional arguments itself."""
        parameters = inspect.signature(cls.__init__).parameters
        # A derived class may hand arguments on by **; the class that reads them is not known here.
        if any(one.kind is inspect.Parameter.VAR_KEYWORD for one in parameters.values()):
            return super().__new__(cls)
        known = [name for name in parameters if name != "self"]
        for name in (name for name in named if name not in known):
            hints = get_type_hints(cls) if is_dataclass(cls) else {}
            if any(name in get_type_hints(hint) for hint in hints.values() if is_dataclass(hint)):
                written = _as_object(f"rans.{cls.__name__}", cls, named)
                raise WrongArgument(f"{cls.__name__} has no argument {name}: write {written}.")
            raise WrongArgument(
                f"{cls.__name__} got an unexpected keyword argument '{name}'{meant(name, known)}; it has "
                f"{', '.join(known)}."
            )
        return super().__new__(cls)


def one_of(what: str, value: object, known: Iterable[str]) -> None:
    """Reject (`ConfigError`) a value that is none of these names."""
    names = list(known)
    if value not in names:
        near = meant(value, names) if isinstance(value, str) else ""
        raise ConfigError(f"{what} must be one of {', '.join(names)}, got {brief(value)}{near}.")


def whole(what: str, value: Any, least: int = 1, bits: int = 31) -> int:
    """The value, checked to be a whole number >= ``least`` and < 2^``bits``; 1e6 is one.

    Raises:
        ConfigError: it is not.
    """
    if (
        isinstance(value, bool)
        or not (isinstance(value, Integral) or (is_finite(value) and float(value).is_integer()))
        or not least <= int(value) < 2**bits
    ):
        raise ConfigError(
            f"{what} must be a whole number >= {least} and < 2^{bits}, got {brief(value)}."
        )
    return int(value)


def is_finite(value: Any) -> bool:
    """Whether a value is a finite real number, also of NumPy.

    Booleans are not, nor whole numbers too large for a float.
    """
    if not isinstance(value, Real) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def finite(what: str, value: Any) -> float:
    """The value as a float; `ConfigError` if it is no finite number."""
    if not is_finite(value):
        raise ConfigError(f"{what} must be a finite number, got {brief(value)}.")
    return float(value)


def positive(what: str, value: Any) -> float:
    """The value as a float; `ConfigError` if it is no finite number above 0."""
    if not (is_finite(value) and value > 0):
        raise ConfigError(f"{what} must be a finite number above 0, got {brief(value)}.")
    return float(value)


def fits(value: object, condition: Callable[[Any], bool]) -> bool:
    """Whether a condition is true for a value; False if it raises a TypeError."""
    try:
        return bool(condition(value))
    except TypeError:
        return False


def text_of_name(what: str, value: object, kind: type) -> str:
    """Text of a name or a path.

    Raises:
        ConfigError: it is neither, or empty; the message says that an object of ``kind`` is accepted too.
    """
    if value == "":
        raise ConfigError(f"the name of {what} is empty; {UNSET}.")
    return str(
        value
        if isinstance(value, str | PathLike)
        else checked(f"{what}, unless it is a name or a file,", value, kind)
    )


def one_line(what: str, value: object) -> str:
    """A name that goes into files and pages: one printable line of at most `_LINE` characters.

    Raises:
        ConfigError: it is not; the message begins with ``what``.
    """
    if not isinstance(value, str) or not value.strip():
        raise ConfigError(f"{what} must be a non-empty text, got {brief(value)}.")
    if len(value) > _LINE or not value.isprintable():
        raise ConfigError(
            f"{what} must be one line of at most {_LINE} printable characters, got {brief(value)}."
        )
    return value


def where_raised(error: BaseException) -> str:
    """File and line of user code that raised an exception, as " (my_file.py, line 12, in act)".

    Frames of this package and of installed ones are skipped; the text is empty if there are no others.
    """
    frame = _user_frame(error)
    return "" if frame is None else f" ({_placed(frame)})"


def _user_frame(error: BaseException) -> traceback.FrameSummary | None:
    """Innermost frame of neither this package nor an installed one."""
    root = re.escape(str(Path(__file__).absolute().parents[2]))
    library = re.escape(os.path.dirname(os.__file__))
    own = re.compile(
        rf".*site-packages|{library}\W|{root}\W(rans|validation|campaigns|packages\W\w+\Wrans_\w+)\W"
    )
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        file = os.path.abspath(frame.filename)
        if not own.match(file) and os.path.exists(file):
            return frame
    return None


def _placed(frame: traceback.FrameSummary) -> str:
    return f"{os.path.basename(frame.filename)}, line {frame.lineno}, in {frame.name}"


_BRANCHES = ("truth value of an array", "Boolean value of Tensor", "no value to branch on")
"""Parts of the messages of NumPy, torch and traced programs for `if` on a field."""


def of_user_code(error: BaseException) -> str:
    """An exception of a user's function as text: file, line and message first, then the line itself.

    It is empty if no frame of the traceback is of user code.
    """
    frame = _user_frame(error)
    if frame is None:
        return ""
    message = " ".join(str(error).split())
    text = f"{_placed(frame)}: {type(error).__name__}: {message.rstrip('.')}."
    if any(part in message for part in _BRANCHES):
        text += (
            " A field has a value for each of many episodes: write where(condition, a, b) in place of `if`, "
            "`and` or `or`, and at_least(x, bound) in place of max (rans.model.fields)."
        )
    if "inherit non-frozen dataclass" in message:
        text += " Write @dataclass(frozen=True) above the class."
    owner = getattr(error, "obj", None)
    if isinstance(error, AttributeError) and type(owner).__module__.startswith("rans."):
        names = [name for name in dir(owner) if not name.startswith("_")]
        text += f" It has{meant(error.name or '', names)} {', '.join(names)}."
    return text + (f"\n    {frame.line}" if frame.line else "")


_LONGEST = 4000
"""Largest number of characters of a message, above that of any message with names of usual length."""


class RansError(Exception):
    """Base class of the errors that RANS raises on purpose; the message is one sentence for the user.

    The middle of a very long message is left out.
    """

    def __init__(self, *arguments: object) -> None:
        super().__init__(
            *(
                _readable(argument) if isinstance(argument, str) else argument
                for argument in arguments
            )
        )


def _readable(sentence: str) -> str:
    if len(sentence) <= _LONGEST:
        return sentence
    half = _LONGEST // 2
    return f"{sentence[:half]} ... ({len(sentence):,} characters) ... {sentence[-half:]}"


class ConfigError(RansError):
    """A value from the user is invalid; the message names the value, its bound and the usual cause."""


class WrongArgument(ConfigError, TypeError):
    """A call has an argument that its function lacks; a `TypeError`, for libraries that try arguments out."""


class NoSuchKey(ConfigError, KeyError):
    """A mapping of RANS has no such name; a `KeyError`, for Python's ``mapping.get(name)``."""

    __str__ = RansError.__str__  # a KeyError's is the repr of its message


EXTRAS = {
    "pydrake": "verify",
    "casadi": "optimal",
    "clarabel": "missions",
    "numba": "optimal",
    "stable_baselines3": "sb3",
    "matplotlib": "plots",
    "PIL": "plots",
    "tensorboard": "plots",
    "llvmlite": "fast",
    "onnx": "onnx",
    "onnxruntime": "onnx",
    "flint": "proof",
    "imageio_ffmpeg": "video",
    "moviepy": "record",
    "cyclonedds": "robot",
    "zenoh": "robot",
    "mcap": "robot",
    "rosbags": "robot",
    "rans_agents": "agents",
}
"""Modules that only some commands or agents need, and the extra of RANS that installs each."""
CHECKOUT = Path(__file__).parents[2]
"""Folder of the repository, where RANS runs from one; else that in which packages are installed."""

_PIP = "python", "-m", "pip", "install"
"""Not the first pip on the path, which may be that of another Python."""


def installing(extra: str) -> str:
    """Command that installs the packages of an extra of RANS into this environment.

    RANS is on no index, and anybody could take its name there: the command has the path of the checkout, or the
    names of third parties alone.

    >>> rans.base.errors.installing("fast").startswith("python -m pip install ")
    True

    Args:
        extra: name in ``pyproject.toml``, a value of `EXTRAS`.
    """
    if extra == "agents":
        return installing_folder("agents", "rans_agents-*.whl")
    if (CHECKOUT / "pyproject.toml").is_file():
        return shlex.join([*_PIP, "-e", f"{CHECKOUT}[{extra}]"])
    own = re.compile(rf"""(?:\band )?\bextra == ["']{extra}["']""")
    needed = [line for line in metadata.requires("rans") or () if own.search(line)]
    return shlex.join([*_PIP, *(own.sub("", line).strip("; ") for line in needed)])


def installing_folder(folder: str, elsewhere: str = "") -> str:
    """Command that installs a distribution of the repository, or a sentence where there is no checkout.

    Args:
        folder: of the distribution, as a path in the repository.
        elsewhere: what a user of wheels installs; empty: the folder of the repository.
    """
    if (CHECKOUT / folder).is_dir():
        return shlex.join([*_PIP, str(CHECKOUT / folder)])
    return f"{' '.join(_PIP)} {elsewhere or f'the folder {folder} of the repository of RANS'}"


class MissingPackage(ConfigError, ImportError):
    """A package that only some commands need is not installed; the message has the command that installs it.

    >>> str(rans.base.errors.MissingPackage("casadi")).partition(": ")[0]
    'This needs the package casadi, which is not installed'

    Args:
        module: name of the module, one of `EXTRAS`.
        user: what needs it, as the subject of the sentence.
    """

    def __init__(self, module: str, user: str = "This") -> None:
        command = installing(EXTRAS[module])
        super().__init__(f"{user} needs the package {module}, which is not installed: {command}")
        self.module = module
        self.user = user

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.module, self.user)


def is_installed(module: str) -> bool:
    """Whether a module of this name could be imported; it is not imported."""
    try:
        return importlib.util.find_spec(module) is not None
    except (ModuleNotFoundError, ValueError):  # ValueError: its place in sys.modules is blocked
        return False


def require(module: str) -> Any:
    """Import a module of `EXTRAS`.

    Raises:
        MissingPackage: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise MissingPackage(module) from error


class Late:
    """A module of `EXTRAS` that is imported when one of its names is first used.

    What needs it for a part of its work does the rest without it.

    Args:
        module: name of the module.

    Raises:
        MissingPackage: by ``late.name``: it is not installed.
    """

    def __init__(self, module: str) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # Python asks for names such as __wrapped__
            raise AttributeError(name)
        value = getattr(require(self._module), name)
        vars(self)[name] = value
        return value


class RansWarning(UserWarning):
    """Base class of the warnings of RANS, for ``warnings.filterwarnings("error", category=rans.RansWarning)``."""


class NonFiniteState(RansError):
    """A state, reward or weight became NaN or infinite; the message names the file with its dump."""


class WorkerLost(RansError):
    """A training on several processes lost one of them; the message says how to continue."""
