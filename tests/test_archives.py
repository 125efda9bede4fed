"""Archives of arrays."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from numpy.lib import format as npy

from rans.archives import read_arrays
from rans.errors import ConfigError


def header_only(shape: tuple[int, ...], descr: str = "<f8") -> bytes:
    """A .npy file that says what it does not have."""
    stream = io.BytesIO()
    npy.write_array_header_1_0(stream, {"shape": shape, "fortran_order": False, "descr": descr})
    return stream.getvalue()


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (header_only((10**12,)), "another size than its header says"),
        (header_only((2**40, 2**40)), "another size than its header says"),
        (header_only((1,), "|O"), "and not of numbers"),
        (b"no array", "magic string is not correct"),
        (bytes(2**20 + 1), "would unpack to"),
    ],
)
def test_arrays_take_no_more_memory_than_their_file_has(
    content: bytes, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rans.archives._LARGEST", 2**20)  # so that making it takes no time
    file = tmp_path / "x.npz"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("commands.npy", content)
    with pytest.raises(ConfigError, match=reason):
        read_arrays(file, "commands")
    with pytest.raises(ConfigError, match=r"has no array|would unpack to"):
        read_arrays(file, "starts")


def test_arrays_are_those_that_were_saved(tmp_path: Path) -> None:
    file = tmp_path / "x.npz"
    saved = np.arange(6.0).reshape(2, 3), np.asfortranarray(np.arange(6).reshape(2, 3)), np.eye(0)
    np.savez_compressed(file, a=saved[0], b=saved[1], c=saved[2])
    for one, other in zip(read_arrays(file, "a", "b", "c"), saved, strict=True):
        np.testing.assert_array_equal(one, other)
        assert one.dtype == other.dtype
