"""Any campaign on an executor: ``python -m campaigns [--executor TEXT] NAME OPTIONS``.

A campaign is one of `campaigns.table`, or a module of this package that is a command of its own. With
``--executor MODULE:NAME`` its jobs run on the executor that this function makes (`rans.base.executors.run_on`).
"""

from __future__ import annotations

import runpy
import sys
from contextlib import nullcontext
from pathlib import Path

from campaigns.command import ended
from campaigns.runner import command
from campaigns.table import CAMPAIGNS
from rans.base.errors import ConfigError, meant
from rans.base.executors import run_on, without_executor
from rans.base.files import read_text


def main(arguments: list[str]) -> int:
    """Run one campaign; ConfigError if there is none of this name."""
    arguments, executor = without_executor(arguments)
    # Modules that are commands of their own.
    names = sorted(
        file.stem
        for file in Path(__file__).parent.glob("[a-z]*.py")
        if '__name__ == "__main__"' in read_text(file)
    )
    measured = {name.replace(" ", "-"): one for name, one in CAMPAIGNS.items() if one.measure}
    name = arguments[0] if arguments else ""
    module = name.replace("-", "_")
    with nullcontext() if executor is None else run_on(executor):
        if name in measured:
            return command(name, measured[name], arguments[1:])
        if module not in names:
            known = [*measured, *names]
            raise ConfigError(
                f"there is no campaign {name!r}{meant(name, known)}; campaigns are {', '.join(known)}."
            )
        sys.argv = [f"campaigns.{module}", *arguments[1:]]
        runpy.run_module(f"campaigns.{module}", run_name="__main__", alter_sys=True)
    return 0


if __name__ == "__main__":
    sys.exit(ended("python -m campaigns", lambda: main(sys.argv[1:])))
