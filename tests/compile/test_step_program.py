"""Which part of a step only an episode's end needs."""

import pytest

from rans import TASKS, Engine
from rans.compile.step_program import trace_step
from rans.model.trace import Symbol, ordered
from tests.support.crafts import ANY_CRAFT
from tests.support.engines import both_crafts


@pytest.mark.parametrize("task", ANY_CRAFT)
@both_crafts
def test_draws_are_for_an_episodes_end_only(craft, task):
    """Whatever is made of the seed is rare, up to where the end of the episode chooses it.

    A kernel that drew for everybody would give the same numbers, in twice the time.
    """
    engine = Engine(craft, TASKS[task](), 2)
    program = trace_step(engine._world, engine.episode, engine.dtype)
    rare = program.rare()
    random = set[Symbol]()
    chosen = set[Symbol]()
    for symbol in ordered(store.value for store in (*program.always, *program.at_end)):
        if symbol.value in ("low", "high") or not random.isdisjoint(symbol.args):
            random.add(symbol)
        by_end = symbol.operation == "where" and symbol.args[0] is program.ended
        if by_end or not chosen.isdisjoint(symbol.args):
            chosen.add(symbol)
    assert len(random - chosen) > 20
    assert random - chosen <= rare
    assert not rare & chosen
