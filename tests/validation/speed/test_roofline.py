from pathlib import Path

import pytest

from rans import TASKS, Engine, GoToPose
from tests.support.crafts import ANY_CRAFT
from tests.support.engines import PLATFORM, both_crafts
from validation.speed.roofline import Traffic, main, step_work

DOCS = Path(__file__).parents[3] / "docs"


def test_bytes_of_a_step_in_the_plane():
    """Counted by hand: six numbers of state, one heading as goal, eight thrusters, ten columns seen."""
    terms = len(Engine(PLATFORM, GoToPose(), 1).term_names)
    assert step_work(Engine(PLATFORM, GoToPose(), 1)).traffic == (
        Traffic("state", 24, 24),
        Traffic("goal", 4, 0),
        Traffic("clock", 4, 4),
        Traffic("action", 8, 0),
        Traffic("observation", 0, 40),
        Traffic("reward terms", 0, 4 * terms),
        Traffic("reward", 0, 4),
        Traffic("flags", 0, 3),
    )


@pytest.mark.parametrize("name", ANY_CRAFT)
@both_crafts
def test_every_task_is_counted(craft, name):
    work = step_work(Engine(craft, TASKS[name](), 1))
    assert work.bytes_moved > 100
    assert work.operations.total() > work.special > 0


def test_documentation_has_todays_table(capsys):
    main()
    assert capsys.readouterr().out in (DOCS / "speed.md").read_text("utf-8")
