"""Random damage to files."""

from __future__ import annotations

import random


def damaged(content: bytes, chance: random.Random) -> bytes:
    """Bytes with a few of them changed, missing, repeated or of others' kinds."""
    result = bytearray(content)
    for _ in range(chance.choice([1, 1, 2, 8])):
        at = chance.randrange(len(result)) if result else 0
        length = chance.choice([1, 1, 2, 4, 8, 100])
        what = chance.randrange(5)
        if what == 0:
            result[at : at + length] = chance.randbytes(length)
        elif what == 1:
            del result[at : at + length]
        elif what == 2:
            result[at:at] = result[at : at + length]
        elif what == 3:
            result[at : at + length] = chance.choice([b"\xff", b"\0", b"9"]) * length
        else:
            del result[at:]
    return bytes(result)
