"""PettingZoo's own tests of its interface, where it is installed."""

import numpy as np
import pytest

pettingzoo_test = pytest.importorskip(
    "pettingzoo.test", reason="PettingZoo is not installed: pip install pettingzoo"
)


@pytest.mark.parametrize("deputies", [1, 3])
def test_pettingzoo_accepts_the_team(deputies):
    from rans_missions.team.parallel_env import TeamEnv
    from rans_missions.team.task import InspectTeam

    task = InspectTeam(deputies=deputies)
    pettingzoo_test.parallel_api_test(TeamEnv(task), num_cycles=20)
    pettingzoo_test.parallel_seed_test(lambda: TeamEnv(task), num_cycles=8)


def test_a_team_ends_together_and_says_how():
    from rans_missions.team.parallel_env import TeamEnv

    env = TeamEnv()
    env.reset(seed=2)
    fast = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    still = np.zeros(6)
    for _ in range(100):
        agents = list(env.agents)
        result = env.step({agent: fast if agent == "deputy_1" else still for agent in agents})
        if not env.agents:
            break
    assert result[2] == dict.fromkeys(agents, True)
    assert result[4] == {agent: {"is_success": False} for agent in agents}
