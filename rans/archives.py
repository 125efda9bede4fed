"""Untrusted zip archives, whose unpacked size is checked before they are read."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rans.errors import ConfigError, brief
from rans.files import open_regular

_LARGEST = 2**28
"""Largest unpacked size of an archive that is smaller itself, bytes."""
_LARGEST_STORED = 2**31
"""Largest unpacked size of any archive, bytes."""
_METHODS = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}
"""Accepted compression methods, those of SB3, torch and RANS; others may unpack without bounds."""
_CHUNK = 2**20


@contextmanager
def opened(file: Path) -> Iterator[zipfile.ZipFile]:
    """Context with an opened archive whose unpacked sizes have been checked.

    Raises:
        ConfigError: it would unpack to too much, or uses another method than deflation.
        zipfile.BadZipFile: it is not an archive, or damaged.
    """
    with open_regular(file) as stream, zipfile.ZipFile(stream) as archive:
        bound = min(max(_LARGEST, stream.seek(0, io.SEEK_END)), _LARGEST_STORED)
        for member in archive.infolist():
            if member.compress_type not in _METHODS:
                raise ConfigError(
                    f"{file} was not opened: its member {brief(member.filename)} is compressed by "
                    "another method than deflation, which agents do not use."
                )
        size = sum(member.file_size for member in archive.infolist())
        if size > bound:
            raise ConfigError(
                f"{file} was not opened: its {len(archive.infolist()):,} members would unpack to {size:,} bytes, "
                f"and at most {bound:,} are read; no agent needs this much, so it is damaged or malicious."
            )
        yield archive


def content(archive: zipfile.ZipFile, name: str) -> bytes:
    """Bytes of a member of an `opened` archive, at most its declared size.

    Raises:
        KeyError: there is no such member.
        zipfile.BadZipFile: the member does not match its header.
    """
    with archive.open(name) as stream:  # without a size it would unpack everything at once
        return b"".join(iter(lambda: stream.read(_CHUNK), b""))
