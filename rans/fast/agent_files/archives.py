"""Untrusted zip archives, whose unpacked size is checked before they are read."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from rans.errors import ConfigError, brief

_LARGEST = 2**28
"""Largest unpacked size of an archive that is smaller itself, bytes."""
_LARGEST_STORED = 2**31
"""Largest unpacked size of any archive, bytes."""
_LARGEST_TEXT = 2**24
"""Largest size of a member with JSON or pickles, bytes; its Python objects take many times as much."""

_TEXTS = (".pkl", ".json")
_METHODS = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}
"""Accepted compression methods, those of SB3, torch and RANS; others may unpack without bounds."""
_CHUNK = 2**20


@contextmanager
def opened(file: Path | IO[bytes], where: object) -> Iterator[zipfile.ZipFile]:
    """Context with an opened archive whose unpacked sizes have been checked.

    Args:
        file: archive, or a stream of it.
        where: name of the archive in messages.

    Raises:
        ConfigError: it would unpack to too much, or uses another method than deflation.
        zipfile.BadZipFile: it is not an archive, or damaged.
    """
    with zipfile.ZipFile(file) as archive:
        assert archive.fp is not None
        most = _bound(archive.fp)
        for member in archive.infolist():
            if member.compress_type not in _METHODS:
                raise ConfigError(
                    f"{where} was not opened: its member {brief(member.filename)} is compressed by "
                    "another method than deflation, which agents do not use."
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
    """Largest unpacked size of the archive in a stream, bytes."""
    return min(max(_LARGEST, stream.seek(0, io.SEEK_END)), _LARGEST_STORED)


def content(archive: zipfile.ZipFile, name: str) -> bytes:
    """Bytes of a member of an `opened` archive, at most its declared size.

    Raises:
        KeyError: there is no such member.
        zipfile.BadZipFile: the member does not match its header.
    """
    with archive.open(name) as stream:  # without a size it would unpack everything at once
        return b"".join(iter(lambda: stream.read(_CHUNK), b""))


def _refuse_beyond(most: int, size: int, where: object, what: str) -> None:
    if size > most:
        raise ConfigError(
            f"{where} was not opened: {what} would unpack to {size:,} bytes, and at most {most:,} "
            "are read; no agent needs this much, so it is damaged or malicious."
        )
