"""Zip archives of strangers: how much they unpack to is bounded before anything is in memory."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from rans.errors import ConfigError, brief

_LARGEST = 2**28
"""Bytes that an archive may unpack to, hundreds of times an agent, unless it is as large itself."""
_LARGEST_STORED = 2**31
"""Bytes that one may be at all."""
_LARGEST_TEXT = 2**24
"""Bytes of a member of JSON or pickles, whose objects in Python take many times as much."""

_TEXTS = (".pkl", ".json")
_METHODS = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}
"""Those that SB3, torch and RANS write, or zip programs; others unpack without bounds."""
_CHUNK = 2**20


@contextmanager
def opened(file: Path | IO[bytes], where: object) -> Iterator[zipfile.ZipFile]:
    """An archive none of whose members is too large, nor all together; of one within another too.

    Args:
        file: the archive, or a stream of it.
        where: its name for sentences.

    Raises:
        ConfigError: it would unpack to too much, or is packed by other methods than deflation.
        zipfile.BadZipFile: it is none, or damaged.
    """
    with zipfile.ZipFile(file) as archive:
        assert archive.fp is not None
        most = _bound(archive.fp)
        for member in archive.infolist():
            if member.compress_type not in _METHODS:
                raise ConfigError(
                    f"{where} was not opened: its member {brief(member.filename)} is packed by "
                    "another method than deflation, which no agent is."
                )
            is_text = member.filename == "data" or member.filename.endswith(_TEXTS)
            _refuse_beyond(
                _LARGEST_TEXT if is_text else most,
                member.file_size,
                where,
                f"its member {brief(member.filename)}",
            )
        total = sum(member.file_size for member in archive.infolist())
        _refuse_beyond(most, total, where, f"its {len(archive.infolist()):,} members together")
        yield archive


def _bound(stream: IO[bytes]) -> int:
    """Bytes that the archive in a stream may unpack to: those it has, or a usual number of them."""
    return min(max(_LARGEST, stream.seek(0, io.SEEK_END)), _LARGEST_STORED)


def content(archive: zipfile.ZipFile, name: str) -> bytes:
    """The bytes of a member of an `opened` archive: never more than it says.

    Raises:
        KeyError: it has no such member.
        zipfile.BadZipFile: the member is not what it says.
    """
    with archive.open(name) as stream:  # which without a size unpacks all before it counts
        return b"".join(iter(lambda: stream.read(_CHUNK), b""))


def _refuse_beyond(most: int, size: int, where: object, what: str) -> None:
    if size > most:
        raise ConfigError(
            f"{where} was not opened: {what} would unpack to {size:,} bytes, and at most {most:,} "
            "are read; no agent takes so much, so it is damaged or meant to fill the memory."
        )
