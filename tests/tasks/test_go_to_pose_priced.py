"""A trade-off's prices by hand; and at every position it is go-to-pose with that price."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from rans_optimal.arrival import residual

from rans import ConfigError
from rans.episode.scenario import scenarios
from rans.model.fields import leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import GoToPose, GoToPosePriced, observation, observation_columns
from rans.tasks.rewards import Transition
from tests.support.crafts import random_states

TASK = GoToPosePriced(thrust_weight=0.1, spin_weight=0.2, misaligned_weight=1.0, price=(0.5, 8.0))


@pytest.mark.parametrize(
    ("trade_off", "thrust"), [(0.0, 0.05), (0.25, 0.1), (0.5, 0.2), (0.75, 0.4), (1.0, 0.8)]
)
def test_the_price_doubles_by_quarters(trade_off, thrust):
    """From 0.5 to 8 are four doublings; weights of 0.1, 0.2 and 1 keep their proportions."""
    plain = TASK.parts()[f"{trade_off:g}"].plain()
    assert type(plain) is GoToPose
    assert plain.thrust_weight == pytest.approx(thrust)
    assert plain.spin_weight == pytest.approx(2 * thrust)
    assert plain.misaligned_weight == pytest.approx(10 * thrust)
    assert plain.arrived == TASK.arrived


@pytest.mark.parametrize("spacecraft", ["floating-platform", "free-flyer"])
def test_every_episode_is_go_to_pose_at_its_own_price(spacecraft):
    craft = load_spacecraft(spacecraft)
    priced, plain = (scenarios(task, craft, seed=3, count=200) for task in (TASK, GoToPose()))
    *same, trade_off = leaves(priced.goal)
    np.testing.assert_array_equal(leaves(priced.start), leaves(plain.start))
    np.testing.assert_array_equal(same, leaves(plain.goal))
    # 200 draws leave out a tenth at an end once in 1e9 seeds; a mean of 200 has a deviation of 0.02
    assert 0.0 <= trade_off.min() < 0.1
    assert 0.9 < trade_off.max() < 1.0
    assert abs(trade_off.mean() - 0.5) < 0.1
    states = random_states(craft.dimension, 200, seed=1)
    command, before = (
        np.random.default_rng(3).integers(0, 2, (2, len(craft.thrusters), 200)).astype(float)
    )
    terms = TASK.reward(Transition(states, priced.goal, tuple(command), tuple(before)))
    price = np.exp2(4.0 * trade_off - 1.0)  # from 1/2 to 8
    np.testing.assert_allclose(
        terms["thrust"], -0.1 * price * command.sum(axis=0), rtol=1e-12
    )  # rounding
    unpriced = GoToPose().reward(Transition(states, plain.goal, tuple(command), tuple(before)))
    np.testing.assert_array_equal(terms["approach"], unpriced["approach"])
    weighed = GoToPose(spin_weight=0.2, misaligned_weight=1.0).reward(
        Transition(states, plain.goal, tuple(command), tuple(before))
    )
    for name in ("misaligned", "spin"):
        np.testing.assert_allclose(terms[name], price * weighed[name], rtol=1e-12)
    seen = observation(TASK, states, priced.goal)
    np.testing.assert_array_equal(seen[:-1], observation(GoToPose(), states, plain.goal))
    np.testing.assert_array_equal(seen[-1], trade_off)
    assert observation_columns(TASK, craft.dimension)[-1].name == "trade-off"
    assert not residual(TASK, states, priced.goal)[-1].any()  # nothing that a controller could mend


def test_a_trade_off_that_is_held_has_one_price():
    held = TASK.parts()["0.3"]
    assert list(held.parts()) == [""]
    assert held.for_evaluation() == replace(held, spawn_distance=(3.0, 4.0))
    goals = scenarios(held, load_spacecraft("floating-platform"), seed=3, count=10).goal
    assert (goals.notes.trade_off == 0.3).all()
    assert [part.trade_off[1] for part in TASK.parts().values()] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert len(TASK.parts()) == 5


def test_a_trade_off_is_drawn_or_held_or_not_there():
    open_, held, plain = TASK, TASK.with_trade_off(0.0), GoToPose(thrust_weight=0.2)
    assert [task.draws_trade_off for task in (open_, held, plain)] == [True, False, False]
    assert [task.held_trade_off for task in (open_, held, plain)] == [None, 0.0, None]
    assert plain.plain() == plain
    for task, trade_off in ((plain, 0.5), (open_, 1.5)):
        with pytest.raises(ConfigError, match=r"trade.off"):
            task.with_trade_off(trade_off)


def test_a_compiler_can_follow_the_price():
    """Engines compile it; half, twice and eight times at the ends and in the middle of 0.5 to 8."""
    price = torch.compile(
        GoToPosePriced(price=(0.5, 8.0)).price_at, backend="eager", fullgraph=True
    )
    torch.testing.assert_close(price(torch.tensor([0.0, 0.5, 1.0])), torch.tensor([0.5, 2.0, 8.0]))
