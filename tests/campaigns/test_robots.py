"""The campaign of robots, in short: a loop between two processes, and a kill of either side."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from campaigns.robots import PERIOD, agent_at, kill, long_flight


@pytest.fixture(scope="module")
def agent(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rans_robot.pilot._RANGE_FLIGHTS", 64)
        return agent_at(tmp_path_factory.mktemp("agent") / "agent", PERIOD)


@pytest.mark.slow
def test_a_short_loop_keeps_going_and_replays(
    agent: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of its rate nothing is asked here: the machine may be busy."""
    monkeypatch.setenv("RANS_TRUST", "1")
    loop = long_flight(agent, "udp", 4.0, tmp_path / "flight.mcap")
    assert loop.decisions >= 10
    assert loop.replayed == loop.decisions


@pytest.mark.slow
@pytest.mark.parametrize("side", ["node", "twin"])
def test_valves_shut_when_a_side_is_killed(agent: Path, side: str) -> None:
    found = kill(agent, "udp", side, 0.3, {"node": 71, "twin": 72}[side])
    assert found.shut is not None
