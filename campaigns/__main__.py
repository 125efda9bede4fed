"""Any campaign on an executor: ``python -m campaigns [--executor TEXT] NAME OPTIONS``.

``python -m campaigns --executor dask:tcp://head:8786 optimality`` is ``python -m campaigns.optimality`` whose
jobs run on the workers of a Dask scheduler. See `rans.executors.run_on` for the texts.
"""

from __future__ import annotations

import runpy
import sys
from contextlib import nullcontext
from pathlib import Path

from campaigns.command import ended
from rans.errors import ConfigError, meant
from rans.executors import run_on, without_executor


def main(arguments: list[str]) -> int:
    """Run one campaign; ConfigError if there is none of this name."""
    arguments, executor = without_executor(arguments)
    names = sorted(
        file.stem for file in Path(__file__).parent.glob("*.py") if not file.stem.startswith("_")
    )
    name = arguments[0].replace("-", "_") if arguments else ""
    if name not in names:
        raise ConfigError(
            f"there is no campaign {name!r}{meant(name, names)}; campaigns are {', '.join(names)}."
        )
    sys.argv = [f"campaigns.{name}", *arguments[1:]]
    with nullcontext() if executor is None else run_on(executor):
        runpy.run_module(f"campaigns.{name}", run_name="__main__", alter_sys=True)
    return 0


if __name__ == "__main__":
    sys.exit(ended("python -m campaigns", lambda: main(sys.argv[1:])))
