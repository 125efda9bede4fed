"""Scan of pickles for calls of dangerous functions, without opening them."""

from __future__ import annotations

import base64
import io
import pickletools
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

from rans.archives import content, opened
from rans.errors import ConfigError
from rans.files import parse_json

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
"""Modules of Python's library that ordinary pickles name."""
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
"""Built-in classes that ordinary pickles name; `bytearray` is not among them, as it may allocate any memory."""


def foul(archive: zipfile.ZipFile, where: object) -> str | None:
    """First function of Python's library that the pickles in a file of SB3 or torch would call; None: none found.

    An example is ``posix.system``. A file in which nothing is found is not therefore safe; the scan only rejects
    files that are certainly dangerous.

    Args:
        archive: archive from `rans.archives.opened`; archives within it are opened too.
        where: name of the archive in messages.

    Raises:
        ConfigError: an archive within it would unpack to too much.
    """
    names = (name for pickle in _pickles(archive, where) for name in names_in_pickle(pickle))
    return next(filter(_is_foul, names), None)


def refuse(file: Path, name: str) -> NoReturn:
    """Raise the `ConfigError` of a file whose code would call a function of this name."""
    raise ConfigError(
        f"{file} holds code that would run {name} wherever the file is unpickled, which no "
        "regular agent does; no code was run. Delete it."
    )


def names_in_pickle(pickle: bytes) -> Iterator[str]:
    """Yield functions and classes that a pickle names, as ``module.name``, as far as it can be read."""
    words: list[str] = []
    try:
        for code, value, _ in pickletools.genops(pickle):
            if code.name in ("GLOBAL", "INST"):
                yield str(value).replace(" ", ".")
            elif code.name == "STACK_GLOBAL" and len(words) > 1:
                yield ".".join(words[-2:])
            elif isinstance(value, str):
                words.append(value)
    except Exception:  # damaged content may raise anything; its reader will report it
        return


def _is_foul(name: str) -> bool:
    module = name.partition(".")[0]
    if module in ("builtins", "__builtin__"):  # the name in Python 2, which pickles of torch use
        return name.partition(".")[2] not in _VALUES
    return module in sys.stdlib_module_names - _HARMLESS


def _pickles(archive: zipfile.ZipFile, where: object, within: bool = False) -> Iterator[bytes]:
    """Yield every pickle of an archive and of torch's archives within it."""
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
    """Yield the values that SB3 pickled because JSON cannot represent them."""
    try:
        table = parse_json(data, "data")
        for value in table.values():
            if isinstance(value, dict) and ":serialized:" in value:
                yield base64.b64decode(value[":serialized:"])
    except (ConfigError, ValueError, TypeError, AttributeError):
        return
