"""Reading of a program for a Cortex-M7, and the count of its instructions."""

from __future__ import annotations

import struct

import pytest

from campaigns import cortex
from rans.errors import ConfigError


def elf() -> bytes:
    """A file by the ELF specification: 6 bytes of code at 0x100, the symbol ``act`` at 0x101, and names."""
    names = b"\0act\0"
    code = bytes.fromhex("00f001f87047")
    symbols = bytes(16) + struct.pack("<IIIBBH", 1, 0x101, 6, 0x12, 0, 1)
    at = {"code": 84, "symbols": 90, "names": 122}
    sections = [
        (0,) * 10,
        (0, 1, 0b110, 0x100, at["code"], len(code), 0, 0, 2, 0),
        (0, 2, 0, 0, at["symbols"], len(symbols), 3, 0, 4, 16),
        (0, 3, 0, 0, at["names"], len(names), 0, 0, 1, 0),
    ]
    end = at["names"] + len(names)
    header = b"\x7fELF\x01\x01\x01" + bytes(9)
    header += struct.pack("<HHIIIIIHHHHHH", 2, 40, 1, 0x101, 52, end, 0, 52, 32, 1, 40, 4, 3)
    segment = struct.pack("<8I", 1, at["code"], 0x100, 0x100, 6, 6, 5, 4)
    table = b"".join(struct.pack("<10I", *section) for section in sections)
    return header + segment + code + symbols + names + table


def test_a_program_is_read() -> None:
    program = cortex.Elf(elf())
    assert program.loaded() == [(0x100, bytes.fromhex("00f001f87047"))]
    assert program.symbols()["act"] == 0x101
    assert program.allocated() == 6
    with pytest.raises(ConfigError, match="no 32-bit"):
        cortex.Elf(b"\x7fELF\x02\x01" + bytes(60))


@pytest.mark.parametrize(
    ("code", "count"),
    [
        ("7047", 1),  # bx lr
        ("00f001f8", 1),  # bl
        ("b0ee400a", 1),  # vmov.f32 s0, s0
        ("00bf00f001f87047", 3),  # nop, bl, bx lr
        ("fee7", 1),  # b to itself: 0b11100 is still of two bytes
    ],
)
def test_instructions_have_two_or_four_bytes(code: str, count: int) -> None:
    assert cortex.instructions(bytes.fromhex(code)) == count


def test_a_row_states_times_at_the_clock() -> None:
    row = cortex.Row(9_700, 52, 1_700, (216_000, 432_000, 216_000), 3)
    assert row.cells() == ["9.7", "52", "1,700", "216,000, 432,000", "1.00", "3 of 3"]


def test_missing_packages_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cortex, "is_installed", lambda name: name != "unicorn")
    with pytest.raises(ConfigError, match="pip install ziglang unicorn"):
        cortex.Cortex().run()
