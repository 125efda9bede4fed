"""What a pickle would run if it were opened, told without opening it."""

from __future__ import annotations

import base64
import io
import json
import pickletools
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import torch

from rans.errors import ConfigError, RansError
from rans.files import first_line, regular

_HARMLESS = {"__future__", "_codecs", "abc", "array", "builtins", "collections", "copyreg", "dataclasses",
             "datetime", "enum", "functools", "typing"}
"""Modules of Python's own library that honest pickles name."""
_VALUES = {"bool", "bytearray", "bytes", "complex", "dict", "float", "frozenset", "int", "list", "object",
           "range", "set", "slice", "str", "tuple", "type"}
"""What they name among the built-in functions."""


def foul(archive: zipfile.ZipFile) -> str | None:
    """The first function of Python's own library that the pickles in a file of SB3 or torch would call.

    Such as ``posix.system``; None: there is none. What pickles do is up to whoever wrote them, so nothing is
    safe because this finds nothing: it only says why what is dangerous for certain is refused.
    """
    return next((name for content in _pickles(archive) for name in named(content) if _is_foul(name)), None)


def read_tensors(file: Path, device: str) -> Any:
    """What torch saved in a file, if it is tensors, numbers and texts only.

    Raises:
        ConfigError: it cannot be read, is damaged, or holds anything else, which is not run.
    """
    regular(file)
    try:
        with zipfile.ZipFile(file) as archive:
            name = foul(archive)
        if name is not None:
            refuse(file, name)
        return torch.load(file, map_location=device, weights_only=True)
    except RansError:
        raise
    except Exception as error:  # a damaged pickle raises anything
        raise ConfigError(f"{file} is damaged: {first_line(error)}.") from error


def refuse(file: Path, name: str) -> NoReturn:
    """Say, with a ConfigError, that a file holds code that calls a function of this name."""
    raise ConfigError(f"{file} holds code that would run {name} wherever the file is unpickled, which no "
                      "honest agent does; nothing of it was run. Delete it.")


def named(content: bytes) -> Iterator[str]:
    """Functions and classes that a pickle names, ``module.name``, as far as it can be read."""
    words: list[str] = []
    try:
        for code, value, _ in pickletools.genops(content):
            if code.name in ("GLOBAL", "INST"):
                yield str(value).replace(" ", ".")
            elif code.name == "STACK_GLOBAL" and len(words) > 1:
                yield ".".join(words[-2:])
            elif isinstance(value, str):
                words.append(value)
    except Exception:  # damaged content raises anything; whoever needs it will say so
        return


def _is_foul(name: str) -> bool:
    module = name.partition(".")[0]
    if module == "builtins":
        return name.removeprefix("builtins.") not in _VALUES
    return module in sys.stdlib_module_names - _HARMLESS


def _pickles(archive: zipfile.ZipFile) -> Iterator[bytes]:
    for name in archive.namelist():
        if name == "data":
            yield from _serialised(archive.read(name))
        elif name.endswith(".pkl"):
            yield archive.read(name)
        elif name.endswith(".pth"):
            content = io.BytesIO(archive.read(name))
            if zipfile.is_zipfile(content):
                with zipfile.ZipFile(content) as inner:
                    yield from _pickles(inner)
            else:
                yield content.getvalue()  # as torch wrote before 1.6


def _serialised(data: bytes) -> Iterator[bytes]:
    """What SB3 pickled because JSON has no word for it."""
    try:
        table = json.loads(data)
        for value in table.values():
            if isinstance(value, dict) and ":serialized:" in value:
                yield base64.b64decode(value[":serialized:"])
    except (ValueError, TypeError, AttributeError, RecursionError):
        return
