"""Bags and agents of flights with random damage: each is read as it is, or refused in a sentence."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from rans_robot.bag import BagMessage, bag_entries
from rans_robot.messages import TEXT, text_message
from rans_robot.node import FLIGHT_TOPIC, replay_bag
from rans_robot.pilot import MessagePilot

from rans import ConfigError, GoToPose
from tests.support.damage import check
from tests.support.robots import AWAY, bag_of, plan


@pytest.fixture
def mine(agent, tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("RANS_TRUST", "1")
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copytree(agent, tmp_path / "mine"))


def test_bags(mine):
    pytest.importorskip("mcap")
    pilot = MessagePilot(plan(mine), GoToPose())
    about = json.dumps({"folder": str(mine), "task": {"name": "go-to-pose", "settings": {}}})
    rows = [BagMessage(1, FLIGHT_TOPIC, TEXT, text_message(about))]
    for k in range(1, 6):
        now = k * 200_000_000
        for message in pilot.interface.state(AWAY, now):
            pilot.receive(message.topic, message.data, now)
            rows.append(BagMessage(now, *message))
        given = pilot.messages(pilot.decide(now + 1), now + 1)
        rows += [BagMessage(now + 1, *message) for message in given]
    bag = bag_of(Path(), rows)
    assert replay_bag(bag).decisions == 5
    check([bag], lambda: [*bag_entries(bag)], 12)
    check([bag], lambda: replay_bag(bag), 0.5)
    bag.unlink()
    rows[0] = rows[0]._replace(data=text_message(about.replace("{}", '{"position_tolerance": -1}')))
    with pytest.raises(ConfigError, match=rf"{bag}.*position_tolerance"):
        replay_bag(bag_of(Path(), rows))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_agents(mine):
    # NumPy leaves a damaged agent.npz open, which Python warns of.
    names = "contract.json", "golden.json", "spacecraft.toml", "agent.npz"
    check([mine / name for name in names], lambda: MessagePilot(plan(mine), GoToPose()), 0.5)
