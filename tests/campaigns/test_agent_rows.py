from __future__ import annotations

import re

from campaigns.agent_rows import ROWS
from rans.tasks import TASKS


def test_every_row_names_a_task_and_its_dimension() -> None:
    for row in ROWS:
        task, dimension, _ = re.split(r"-(2d|3d)", row.agent)
        assert TASKS[task]
        assert dimension in ("2d", "3d")
        assert row.title.startswith({"2d": "3DoF", "3d": "6DoF"}[dimension])


def test_shares_of_good_episodes_are_floors_and_all_else_are_ceilings() -> None:
    """Precision and success may be higher, errors, times and thrust lower."""
    shares = r"[PO]T\d|reach|settled|solved"
    for row in ROWS:
        for goal in row.goals:
            found = {
                bool(re.match(shares, name)) and name != "settling time" for name in goal.metrics
            }
            assert found == {goal.at_least}, (row.title, goal)


def test_every_goal_has_a_target_a_figure_or_takes_it_from_the_optimum() -> None:
    for row in ROWS:
        for goal in row.goals:
            assert len(goal.targets) == (0 if goal.slack else len(goal.metrics)), (row.title, goal)
            assert all(0.0 < target <= 100.0 for target in goal.targets)
            assert goal.unit in ("%", "s", "m/s", "rad/s", "cm", "deg", "m", "N s")
