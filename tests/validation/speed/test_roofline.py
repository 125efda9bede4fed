from pathlib import Path

import pytest
import torch

from rans import TASKS, Engine, GoToPose, GoToPosition
from tests.support.crafts import ANY_CRAFT
from tests.support.engines import FLYER, PLATFORM, both_crafts
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


def test_reals_of_twice_the_size_move_twice_the_bytes():
    single, double = (
        step_work(Engine(FLYER, GoToPose(), 1, dtype=dtype))
        for dtype in (torch.float32, torch.float64)
    )
    others = {"clock", "action", "flags"}
    for one, two in zip(single.traffic, double.traffic, strict=True):
        factor = 1 if one.name in others else 2
        assert (two.read, two.written) == (factor * one.read, factor * one.written)


def test_operations_of_a_step_in_the_plane():
    """Four quadrature nodes and the heading that is seen, none of them used twice."""
    operations = step_work(Engine(PLATFORM, GoToPosition(), 1)).operations
    assert operations["sin"] == operations["cos"] == 4 + 1


@pytest.mark.parametrize("name", ANY_CRAFT)
@both_crafts
def test_every_task_is_counted(craft, name):
    work = step_work(Engine(craft, TASKS[name](), 1))
    assert work.bytes_moved > 100
    assert work.operations.total() > work.special > 0


def test_documentation_has_todays_table(capsys):
    main()
    assert capsys.readouterr().out in (DOCS / "speed.md").read_text("utf-8")
