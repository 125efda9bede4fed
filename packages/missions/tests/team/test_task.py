"""A team shares what it has seen and ends together: against craft that inspect alone, and in both libraries."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from rans_missions.tasks import Inspect
from rans_missions.team.task import InspectTeam

from rans import ConfigError, Engine
from rans.episode.scenario import scenarios
from rans.model.fields import leaves
from rans.model.spacecraft_file import load_spacecraft

DEPUTY = load_spacecraft("afrl-deputy")
pytestmark = pytest.mark.filterwarnings("ignore:this engine steps slower")


def random_actions(size: int, steps: int) -> torch.Tensor:
    return torch.rand(steps, size, 6, generator=torch.Generator().manual_seed(3))


@pytest.mark.parametrize("plain", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_team_has_seen_what_any_of_its_deputies_has(plain):
    """Three teams of three beside nine craft alone, for 20 periods without an end, from the same starts."""
    far = {"fail_distance": 1e6, "keep_out": 11.0}
    team = Engine(DEPUTY, InspectTeam(**far, keep_apart=1e-3), 9, seed=4, plain=plain)
    alone = Engine(DEPUTY, Inspect(**far), 9, seed=4, plain=plain)
    for mine, theirs in zip(leaves(alone.goal.notes), leaves(team.goal.notes), strict=True):
        torch.as_tensor(mine)[:] = torch.as_tensor(theirs)
    for mine, theirs in zip(leaves(alone.state), leaves(team.state), strict=True):
        if not isinstance(mine, float):
            torch.as_tensor(mine)[:] = torch.as_tensor(theirs)
    for action in random_actions(9, 20):
        assert not team.step(action).terminated.any()
        assert not alone.step(action).terminated.any()
    words = torch.stack([torch.as_tensor(word) for word in team.goal.notes.words]).int()
    theirs = torch.stack([torch.as_tensor(word) for word in alone.goal.notes.words]).int()
    each = theirs.reshape(-1, 3, 3)
    union = each[..., 0] | each[..., 1] | each[..., 2]
    assert torch.equal(words, union.repeat_interleave(3, dim=1))
    assert not torch.equal(words, theirs)


def test_one_deputy_that_fails_ends_its_team_alone():
    """Deputy 4 is carried to 5 m from deputy 3: both of its mates end, and the other teams go on."""
    engine = Engine(DEPUTY, InspectTeam(), 9, seed=4)
    for axis in (0, 1, 2):
        column = torch.as_tensor(engine.state.p.columns()[axis])
        column[4] = column[3] + (5.0 if axis == 0 else 0.0)
    step = engine.step(torch.zeros(9, 6))
    assert step.terminated.tolist() == [False] * 3 + [True] * 3 + [False] * 3
    assert engine.elapsed().tolist() == [1, 1, 1, 0, 0, 0, 1, 1, 1]
    sun = torch.as_tensor(engine.goal.notes.sun).reshape(3, 3)
    assert torch.equal(sun, sun[:, :1].expand(3, 3))


def test_deputies_start_apart_and_within_the_range():
    """10 m apart, from 50 to 100 m away; one deputy starts as a craft alone."""
    starts = scenarios(InspectTeam(), DEPUTY, seed=1, count=3_000).start
    p = np.array(starts.p.columns()).T.reshape(-1, 3, 3)
    assert np.linalg.norm(p[:, [0, 1, 2]] - p[:, [1, 2, 0]], axis=2).min() >= 10.0
    assert np.linalg.norm(p, axis=2).min() >= 50.0
    assert np.linalg.norm(p, axis=2).max() <= 100.0
    one, other = (
        scenarios(task, DEPUTY, seed=1, count=5) for task in (InspectTeam(deputies=1), Inspect())
    )
    assert np.array_equal(leaves(one.start), leaves(other.start))


def test_what_is_no_team_is_refused():
    with pytest.raises(ConfigError, match="from 1 to 3, got 4"):
        InspectTeam(deputies=4)
    with pytest.raises(ConfigError, match="lower keep_apart"):
        InspectTeam(keep_apart=25.0)
    for rows in (1, 8):
        with pytest.raises(ConfigError, match=f"whole teams of 3 deputies, got {rows} rows"):
            Engine(DEPUTY, InspectTeam(), rows)
