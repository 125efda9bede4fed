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
from typing import IO, Any, NoReturn

import torch
from torch import Tensor

from rans.errors import ConfigError, RansError
from rans.fast.archives import bound, content, opened
from rans.files import first_line, regular

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
        archive: of `rans.fast.archives.opened`; archives within it are opened too.
        where: its name for sentences.

    Raises:
        ConfigError: an archive within it would unpack to too much.
    """
    names = (name for pickle in _pickles(archive, where) for name in named(pickle))
    return next(filter(_is_foul, names), None)


def read_tensors(file: Path, device: str) -> Any:
    """What torch saved in a file, if it is tensors, numbers and texts only.

    Raises:
        ConfigError: it cannot be read, is damaged, would take too much memory, or holds anything
            else, which is not run.
    """
    regular(file)
    try:
        with file.open("rb") as stream:
            with opened(stream, file) as archive:
                name = foul(archive, file)
            if name is not None:
                refuse(file, name)
            stream.seek(0)
            return load_tensors(stream, file, device)
    except RansError:
        raise
    except Exception as error:  # a damaged pickle raises anything
        raise ConfigError(f"{file} is damaged: {first_line(error)}.") from error


def load_tensors(stream: IO[bytes], where: object, device: str = "cpu") -> Any:
    """What torch saved in an archive that was `opened`, if it is tensors, numbers and texts only.

    Raises:
        ConfigError: its tensors claim to be larger than an archive may be: a view may show one
            number as often as it likes.
        Exception: whatever torch raises on a damaged file, or one that holds anything else.
    """
    most = bound(stream)
    stream.seek(0)
    if not zipfile.is_zipfile(stream):  # torch's older format takes as much memory as it is told
        raise ValueError("its arrays are not those of an agent")
    stream.seek(0)
    tree = torch.load(stream, map_location=device, weights_only=True)
    size = sum(x.numel() * x.element_size() for x in _tensors(tree))
    if size > most:
        raise ConfigError(
            f"{where} was not opened: its tensors claim {size:,} bytes, and at most "
            f"{most:,} are read; it is damaged or meant to fill the memory."
        )
    return tree


def _tensors(tree: Any) -> Iterator[Tensor]:
    if isinstance(tree, Tensor):
        yield tree
    elif isinstance(tree, dict | list | tuple):
        for inner in tree.values() if isinstance(tree, dict) else tree:
            yield from _tensors(inner)


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
