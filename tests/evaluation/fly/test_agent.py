from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from rans import ConfigError
from rans.evaluation.fly.agent import load_policy
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer
from rans.model.actuators import Throttle
from rans.model.spacecraft_file import spacecraft_text, to_toml
from tests.support.training import CONFIG, seen


@pytest.fixture(scope="module", params=["floating-platform", "free-flyer"])
def trained(request, tmp_path_factory) -> Path:
    """A run folder with a briefly trained agent."""
    path = tmp_path_factory.mktemp("runs") / "first"
    run = RunFolder(path)
    config = replace(CONFIG, spacecraft=request.param)
    run.begin(config, "rans train")
    Trainer(config, run.spacecraft(), run).train(lambda _: None)
    return path


@pytest.fixture
def run_folder(trained, tmp_path) -> Path:
    """A copy that a test may spoil."""
    return Path(shutil.copytree(trained, tmp_path / "run"))


def test_the_agent_is_the_policy(trained):
    """Agent and SB3's own PPO open the same thrusters."""
    loaded = load_policy(trained)
    craft = loaded.craft
    config = RunFolder(trained).config()
    assert (craft.name, loaded.task, loaded.timing) == (
        config.spacecraft,
        config.settings,
        config.timing,
    )
    observations = seen(craft, 300).numpy()
    actions = loaded.controller.act(None, None, observations)
    assert actions.shape == (300, len(craft.thrusters))
    assert 0.05 < actions.mean() < 0.95


@pytest.mark.filterwarnings("ignore:.*is not the file of the training")
def test_an_agent_for_another_spacecraft(run_folder):
    config = json.loads((run_folder / "config.json").read_text())
    other = {"floating-platform": "free-flyer", "free-flyer": "floating-platform"}[
        config["spacecraft"]
    ]
    (run_folder / "spacecraft.toml").write_text(spacecraft_text(other))
    with pytest.raises(ConfigError, match="they are of different runs"):
        load_policy(run_folder)


@pytest.mark.filterwarnings("ignore:.*is not the file of the training")
def test_an_on_off_agent_for_throttles_is_refused(run_folder):
    """Same columns, same thrusters, other commands; the reverse is in `tests.fast.learn.test_duties`."""
    craft = RunFolder(run_folder).spacecraft()
    (run_folder / "spacecraft.toml").write_text(to_toml(replace(craft, actuators=Throttle())))
    with pytest.raises(
        ConfigError, match=r"does not command the throttle actuators of .* different runs"
    ):
        load_policy(run_folder)


def test_one_substep_is_what_trainings_make_do_with_and_more_were_asked_for(run_folder):
    loaded = load_policy(run_folder)
    for given, judged in ((1, None), (50, 50)):
        timing = replace(loaded.timing, substeps=given)
        assert loaded._replace(timing=timing).judged.timing.substeps == judged
