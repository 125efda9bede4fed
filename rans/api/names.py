"""Names that a user gives become values here, once; MODULE:NAME may run code (`rans.base.registry.typed`)."""

from __future__ import annotations

from pathlib import Path

from rans.base.registry import by_user
from rans.model import spacecraft_file
from rans.randomization import conditions_file
from rans.randomization.conditions import Conditions
from rans.tasks import load_task as _load_task

load_spacecraft = by_user(spacecraft_file.load_spacecraft)
load_conditions = by_user(conditions_file.load_conditions)
load_task = by_user(_load_task)


def conditions_if_named(name: str | Path | Conditions | None) -> Conditions | None:
    """Conditions of a name, a TOML file or as such; None for None, which leaves an agent under its own."""
    return None if name is None else load_conditions(name)
