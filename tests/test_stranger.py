"""What a stranger's package adds is judged, listed and compared as what comes with RANS."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rans
from rans import GoToPose
from rans.cli.next_commands import with_spacecraft
from rans.cli.train import trust_option
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.fast.learn.algorithms import LEARNERS
from rans.fast.learn.config import TrainConfig
from rans.model.spacecraft import CommandRange
from rans.model.spacecraft_file import EFFECTORS, load_spacecraft, to_toml
from rans.show.tables.listing import spacecraft_listing
from tests.support.torquer import Torquer
from validation.study.checks import Skipped
from validation.study.oracles import oracle_checks


class Fan(Torquer):
    """Turns the craft, and has no store."""

    @property
    def commands(self) -> tuple[CommandRange, ...]:
        return (CommandRange("fan", "fan", 0.0, 1.0),)

    @property
    def stores(self) -> tuple[Any, ...]:
        return ()

    def begin(self, begun: Any) -> Any:
        (command,) = begun.command
        return super().begin(begun._replace(stores=(0.0 * command + begun.period,)))


CRAFT = replace(
    load_spacecraft("floating-platform"),
    name="blown",
    further_effectors=(Fan((0.0, 0.0, 1.0), 0.01, 1.0),),
)


class Still:
    """A controller whose commands are all 0."""

    name = "still"

    def __init__(self, craft: Any, task: Any, timing: Any) -> None:
        self._count = craft.command_count

    def reset(self, *_: Any) -> None: ...

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        return np.zeros((len(observation), self._count))


@pytest.fixture
def installed(monkeypatch) -> None:
    """The stranger's kind of effector and controller have names."""
    added: list[Any] = [(EFFECTORS, "fan", Fan), (CONTROLLERS, "still", Still)]
    for registry, name, value in added:
        monkeypatch.setattr(registry, "own", {})
        registry.register(name)(value)


def test_an_effector_without_a_store_is_left_out_of_an_oracle_that_cannot_have_it():
    *_, last = oracle_checks(CRAFT, 1, 4)
    assert isinstance(last, Skipped)
    assert last.name == "DOP853"


@pytest.mark.usefixtures("installed")
def test_its_commands_kind_and_learner_are_listed(monkeypatch, ran):
    rows = {row[0]: row[1] for row in spacecraft_listing(CRAFT).rows}
    assert rows["command 8"] == "fan, from 0 to 1"
    assert "thrusters alone" in rows["1 m from rest to rest, at the quickest"]
    monkeypatch.setattr(LEARNERS, "own", {"reinforce": LEARNERS["ppo"]})
    text = ran("list")
    assert "fan" in text
    assert "reinforce" in text
    assert not [line for line in with_spacecraft(CRAFT, "blown.toml") if "lqr" in line]


def test_trust_is_asked_for_what_no_package_has(request):
    config = TrainConfig("go-to-pose", GoToPose(), "floating-platform")
    assert trust_option(config, CRAFT) == ["--trust"]
    request.getfixturevalue("installed")
    assert trust_option(config, CRAFT) == []


@pytest.mark.usefixtures("installed")
def test_rivals_that_nobody_asked_for_and_cannot_fly_are_one_sentence(tmp_path):
    file = tmp_path / "blown.toml"
    file.write_text(to_toml(CRAFT), "utf-8")
    who = f"still:go-to-pose-2d@{file}"
    found = rans.compare(who, episodes=1, certified=0)
    assert found.failures == []
    assert [entry.name for entry in found.entries] == ["still"]
    (sentence,) = found.notes  # and none about bounds, of which none is asked
    assert "lqr and switching and mpc" in sentence
    assert rans.compare(who, beside=["lqr"], episodes=1, certified=0).failures
