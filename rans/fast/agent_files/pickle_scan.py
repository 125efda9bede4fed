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
from typing import NoReturn

from rans.errors import ConfigError
from rans.fast.agent_files.archives import content, opened

_HARMLESS = {
    "__future__",
    "_codecs",
    "abc",
    "array",
    "builtins",
    "collections",
    "copyreg",
    "dataclasses",
    "datetime",
    "enum",
    "functools",
    "typing",
}
"""Modules of Python's own library that honest pickles name."""
_VALUES = {
    "bool",
    "bytes",
    "complex",
    "dict",
    "float",
    "frozenset",
    "int",
    "list",
    "object",
    "range",
    "set",
    "slice",
    "str",
    "tuple",
    "type",
}
"""What they name among the built-in functions; `bytearray` would take as much memory as it is told."""


def foul(archive: zipfile.ZipFile, where: object) -> str | None:
    """The first function of Python's own library that the pickles in a file of SB3 or torch would call.

    Such as ``posix.system``; None: there is none. What pickles do is up to whoever wrote them, so nothing is
    safe because this finds nothing: it only says why what is dangerous for certain is refused.

    Args:
        archive: of `rans.fast.agent_files.archives.opened`; archives within it are opened too.
        where: its name for sentences.

    Raises:
        ConfigError: an archive within it would unpack to too much.
    """
    names = (name for pickle in _pickles(archive, where) for name in named(pickle))
    return next(filter(_is_foul, names), None)


def refuse(file: Path, name: str) -> NoReturn:
    """Say, with a ConfigError, that a file holds code that calls a function of this name."""
    raise ConfigError(
        f"{file} holds code that would run {name} wherever the file is unpickled, which no "
        "honest agent does; nothing of it was run. Delete it."
    )


def named(pickle: bytes) -> Iterator[str]:
    """Functions and classes that a pickle names, ``module.name``, as far as it can be read."""
    words: list[str] = []
    try:
        for code, value, _ in pickletools.genops(pickle):
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
    if module in ("builtins", "__builtin__"):  # its name in Python 2, which pickles of torch use
        return name.partition(".")[2] not in _VALUES
    return module in sys.stdlib_module_names - _HARMLESS


def _pickles(archive: zipfile.ZipFile, where: object, within: bool = False) -> Iterator[bytes]:
    """Every pickle of an archive, and of torch's archives in it, which hold no others."""
    for name in archive.namelist():
        if name == "data":
            yield from _serialised(content(archive, name))
        elif name.endswith(".pkl"):
            yield content(archive, name)
        elif name.endswith(".pth") and not within:
            stream = io.BytesIO(content(archive, name))
            if zipfile.is_zipfile(stream):
                with opened(stream, f"{where}/{name}") as inner:
                    yield from _pickles(inner, where, within=True)
            else:
                yield stream.getvalue()  # as torch wrote before 1.6


def _serialised(data: bytes) -> Iterator[bytes]:
    """What SB3 pickled because JSON has no word for it."""
    try:
        table = json.loads(data)
        for value in table.values():
            if isinstance(value, dict) and ":serialized:" in value:
                yield base64.b64decode(value[":serialized:"])
    except (ValueError, TypeError, AttributeError, RecursionError):
        return
