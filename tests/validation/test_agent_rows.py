from __future__ import annotations

import re

from rans.tasks import TASKS
from validation.agent_rows import ROWS


def test_every_row_names_a_task_and_its_dimension() -> None:
    for row in ROWS:
        task, dimension, _ = re.split(r"-(2d|3d)", row.agent)
        assert TASKS[task]
        assert dimension in ("2d", "3d")
        assert row.title.startswith({"2d": "3DoF", "3d": "6DoF"}[dimension])
