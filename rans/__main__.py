"""``python -m rans``: the same as the command ``rans``."""

from __future__ import annotations

from rans_command import run

if __name__ == "__main__":
    run()
