"""Untrusted zip archives and arrays in them, whose unpacked size is checked before they are read."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from rans.errors import ConfigError, brief
from rans.files import first_line, open_regular

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


def read_arrays(file: Path, *names: str) -> list[np.ndarray]:
    """Arrays of numbers, which may be NaN or infinite, from a file of `numpy.savez`.

    Args:
        file: the file, whose name ends in ``.npz``.
        names: names of the arrays; others are not read.

    Raises:
        ConfigError: the file cannot be read, is damaged, would unpack to too much, or has no such array of numbers.
    """
    try:
        with opened(file) as archive:
            return [_array(content(archive, f"{name}.npy"), name) for name in names]
    except ConfigError:
        raise
    except KeyError as error:
        raise ConfigError(f"{file} is damaged: it has no array {error}.") from error
    except Exception as error:  # a damaged archive may raise anything
        raise ConfigError(f"{file} is damaged: {first_line(error)}.") from error


def _array(data: bytes, name: str) -> np.ndarray:
    """Array of numbers from the bytes of a ``.npy`` file; ValueError if they are none or not as many as it says.

    Nothing is unpickled, and no memory is reserved by what a header says before it is compared with the bytes.
    """
    stream = io.BytesIO(data)
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    version = npy.read_magic(stream)
    if version not in readers:
        raise ValueError(f"its array {name!r} is of version {version} of NumPy's format")
    shape, is_fortran, dtype = readers[version](stream)
    if dtype.kind not in "biuf":
        raise ValueError(f"its array {name!r} is of {dtype}, and not of numbers")
    if dtype.itemsize * math.prod(shape) != len(data) - stream.tell():
        raise ValueError(f"its array {name!r} has another size than its header says")
    flat = np.frombuffer(data, dtype, offset=stream.tell())
    return flat.reshape(shape, order="F" if is_fortran else "C")
