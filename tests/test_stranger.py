"""What a stranger's package adds is judged, listed and compared as what comes with RANS."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rans
from rans import GoToPose
from rans.base.files import write_text
from rans.base.registry import Registry
from rans.cli.next_commands import with_spacecraft
from rans.cli.train import trust_option
from rans.deploy.forms import FORMATS, Format
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.evaluation.fly.policy_text import FLIGHTS, POLICIES
from rans.fast.learn.config import TrainConfig
from rans.fast.learn.learners import LEARNERS
from rans.model.foreign import IMPORTERS
from rans.model.spacecraft_file import EFFECTORS, SPACECRAFT, load_spacecraft, to_toml
from rans.randomization.conditions_file import CONDITIONS
from rans.show.films import FILMS
from rans.show.tables.listing import spacecraft_listing
from rans.tasks import TASKS
from tests.support.torquer import Fan
from validation.study.checks import Skipped
from validation.study.oracles import oracle_checks

CRAFT = replace(
    load_spacecraft("floating-platform"),
    name="blown",
    further_effectors=(Fan(0.01, (0.1, 0.0, 0.0)),),
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


def of_box(path: Path, name: str, base: Any) -> tuple[Any, str, tuple[str, ...]]:
    """Boxes."""
    return replace(base, name=name, mass=float(path.read_text())), "a box", ()


def film(flights: Any, file: Path, progress: Any = None, check: bool = False) -> None:
    """Films of one line."""
    if not check:
        file.write_text(f"{len(flights)} flights")


def shut(given: Any, craft: Any, task: Any, trust: bool) -> Any:
    """Policies that open nothing."""
    return lambda seen, memory, starts: (np.zeros((len(seen), craft.command_count)), None)


def outlined(folder: Path, program: Any, *_: Any) -> None:
    """Names of inputs alone."""
    write_text(folder / "agent.outline", str(program))


STRANGERS: list[tuple[Registry[Any], str, Any]] = [
    (IMPORTERS, "box", of_box),
    (FILMS, "webm", film),
    (POLICIES, "jaxy", shut),
    (FLIGHTS, "flown", lambda file, setup: Still(*setup[:3])),
    (FORMATS, "outlined", Format(outlined)),
    (EFFECTORS, "fan", Fan),
    (LEARNERS, "reinforce", LEARNERS["ppo"]),
    (CONTROLLERS, "still", Still),
    (TASKS, "mine", GoToPose),
    (SPACECRAFT, "blown", CRAFT),
    (CONDITIONS, "calm", rans.Conditions()),
]
"""An entry of each group whose names a user types."""
ASKED_FOR = {
    *("backbones", "certificates", "commands", "drake_effectors", "drake_frames", "estimators"),
    *("exporters", "machine_code", "metrics", "problems", "public", "references"),
    *("report_sections", "safety_filters"),
}
"""Groups whose names say what an entry is of: nobody types them."""


@pytest.fixture
def strangers(monkeypatch) -> None:
    for registry, name, value in STRANGERS:
        monkeypatch.setattr(registry, "own", {})
        registry.register(name)(value)


def test_every_group_whose_names_a_user_types_lists_a_strangers_entry(strangers, ran):
    names = {
        match
        for file in Path(rans.__file__).parent.rglob("*.py")
        for match in re.findall(r"Registry\([^)]*?\"(rans\.\w+)\"", file.read_text("utf-8"))
    }
    known = {registry.group for registry, *_ in STRANGERS}
    assert names == known | {f"rans.{name}" for name in ASKED_FOR}
    listed = ran("list")
    for registry, name, _ in STRANGERS:
        assert re.search(rf"\b{name}\b", listed), registry.group
        assert ran("list", name)


def test_a_strangers_entry_works_where_its_name_is_typed(strangers, ran, here):
    Path("my.box").write_text("5.3")
    assert rans.init_spacecraft("b", base="my.box", dimension=2).spacecraft.mass == 5.3
    who = "jaxy:my.box:go-to-pose-2d"
    rans.view(who, save="f.webm")
    assert Path("f.webm").read_text() == "1 flights"
    setup = contestant(who).judged
    assert contestant("f.flown", default_setup=setup).controller.name == "still"
    assert rans.evaluate(who, episodes=2).episodes == 2
    rans.export("go-to-pose-2d", "out", format="outlined")
    assert Path("out/agent.outline").read_text()
