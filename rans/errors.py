"""What can go wrong, as sentences a user can act on."""

import difflib
import math
import os
import sys
import traceback
from collections.abc import Callable, Iterable
from numbers import Integral
from os import PathLike
from typing import Any, TypeVar

T = TypeVar("T")


def legible(text: str, longest: int = 2000) -> str:
    """A text without control characters, which could command a terminal, and cut where it is too long."""
    shown = text if len(text) <= longest else f"{text[:longest]} ... ({len(text):,} characters)"
    return "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in shown)


def brief(value: object) -> str:
    """A wrong value for the middle of a sentence: as Python spells it, cut where that is long."""
    text = repr(value)
    return text if len(text) <= 120 else f"{text[:80]} ... ({len(text):,} characters)"


def counted(count: int, noun: str) -> str:
    """How many there are, such as "1 start" or "1,024 starts"."""
    return f"{count:,} {noun}{'s' * (count != 1)}"


_LONGEST_NAME = 1000


def meant(name: str, known: Iterable[str]) -> str:
    """Where a known name is near, " (did you mean ...?)" for the middle of a sentence."""
    if len(name) > _LONGEST_NAME:  # comparing takes as long as it is
        return ""
    near = difflib.get_close_matches(name, list(known), 1)
    return f" (did you mean {near[0]}?)" if near else ""


def checked(what: str, value: object, kind: type[T]) -> T:
    """The value, if it is of this class; else a `ConfigError`, which tells who gave a dict what to write."""
    if isinstance(value, kind):
        return value
    top = kind.__name__ in getattr(sys.modules.get("rans"), "__all__", ())
    module = "rans." if top else "" if kind.__module__ == "builtins" else f"{kind.__module__}."
    name = f"{module}{kind.__name__}"
    if isinstance(value, dict):
        given = ", ".join(f"{key}={brief(inner)}" for key, inner in value.items())
        raise ConfigError(f"{what} takes an object, no dict: {name}({given}).")
    raise ConfigError(f"{what} must be a {name}, got {brief(value)}.")


def one_of(what: str, value: object, known: Iterable[str]) -> None:
    """Refuse (`ConfigError`) what is none of these names."""
    names = list(known)
    if value not in names:
        near = meant(value, names) if isinstance(value, str) else ""
        raise ConfigError(f"{what} must be one of {', '.join(names)}, got {brief(value)}{near}.")


def whole(what: str, value: object, least: int = 1) -> int:
    """The value, if it is a whole number from the least one to 2^31; else a `ConfigError`."""
    if (
        isinstance(value, bool)
        or not isinstance(value, Integral)
        or not least <= int(value) < 2**31
    ):
        raise ConfigError(
            f"{what} must be a whole number >= {least} and < 2^31, got {brief(value)}."
        )
    return int(value)


def is_finite(value: object) -> bool:
    """Whether this is a finite real number; a truth value is none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def fits(value: object, condition: Callable[[Any], bool]) -> bool:
    """Whether the condition holds; it does not where it cannot be asked of such a value."""
    try:
        return bool(condition(value))
    except TypeError:
        return False


def named(what: str, value: object, kind: type) -> str:
    """The text of a name or a path, where an object of this class was taken already; else `ConfigError`."""
    return str(
        value
        if isinstance(value, str | PathLike)
        else checked(f"{what}, unless it is a name or a file,", value, kind)
    )


def where_raised(error: BaseException) -> str:
    """File and line of a user's code that an exception came from, as " (my_file.py, line 12, in act)".

    Frames of this package and of installed ones do not count; empty where there are no others.
    """
    own = os.path.dirname(os.path.abspath(__file__))
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        file = os.path.abspath(frame.filename)
        installed = "site-packages" in file or file.startswith((own, os.path.dirname(os.__file__)))
        if not installed:
            return f" ({os.path.basename(file)}, line {frame.lineno}, in {frame.name})"
    return ""


_LONGEST = 4000
"""Characters of a sentence: more than any of ours has, whose names and values are of usual length."""


class RansError(Exception):
    """Base of every error RANS raises on purpose; its text is one sentence for the user.

    Where something in it is so long that nobody could read it, the middle is left out.
    """

    def __init__(self, *given: object) -> None:
        super().__init__(*(_readable(one) if isinstance(one, str) else one for one in given))


def _readable(sentence: str) -> str:
    if len(sentence) <= _LONGEST:
        return sentence
    half = _LONGEST // 2
    return f"{sentence[:half]} ... ({len(sentence):,} characters) ... {sentence[-half:]}"


class ConfigError(RansError):
    """A value the user gave cannot work: the message names it, its bound and the usual cause."""


class NonFiniteState(RansError):
    """A state, reward or weight became NaN or infinite; the message says where it was dumped."""


class SolverFailed(RansError):
    """An optimal control problem ended without a solution; the message gives the solver's status."""


class WorkerLost(RansError):
    """A training on several processes lost one of them; the message says how to go on."""
