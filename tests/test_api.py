"""The package's front door: names, examples, and what is refused there."""

from __future__ import annotations

import ast
import dataclasses
import doctest
import importlib
import inspect
import itertools
import sys
import tempfile
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

import rans
from rans.base.abilities import PUBLIC
from validation.speed.suite import measurements

MODULES = sorted(
    {
        "rans",
        "rans.api",
        # Of classes and functions that scripts reach through their modules.
        "rans.model.actuators",
        "rans.model.spacecraft_file",
        "rans.base.pretrained",
        "rans.randomization.conditions_file",
        *(
            module
            for module in (getattr(getattr(rans, name), "__module__", "") for name in dir(rans))
            if module.startswith(("rans.", "rans_", "validation."))
        ),
    }
)
"""Where the names at the top and further examples are from."""


def examples() -> list[doctest.DocTest]:
    """Which know nothing but these, as whoever copies them into a script."""
    known = {
        "rans": rans,
        "tempfile": tempfile,
        "gymnasium": gymnasium,
        "dataclasses": dataclasses,
        "torch": torch,
    }
    found = []
    for name in MODULES:
        module = importlib.import_module(name)
        found += [
            one for one in doctest.DocTestFinder().find(module, globs=dict(known)) if one.examples
        ]
    return found


SLOW_EXAMPLES = {
    "rans_optimal.functions.certify",
    "validation.functions.benchmark",
    "rans_assurance.functions.stress",
}
"""Which take seconds, and whose commands have quick tests."""


@pytest.mark.parametrize(
    "example",
    [
        pytest.param(one, id=one.name, marks=pytest.mark.slow if one.name in SLOW_EXAMPLES else ())
        for one in examples()
    ],
)
def test_examples_in_docstrings(example, monkeypatch):
    monkeypatch.setenv("RANS_TRUST", "")  # one of them sets it for the rest of the process
    # The first figures of a benchmark, of which all take 40 s.
    monkeypatch.setattr(
        "validation.speed.suite.measurements",
        lambda *given: itertools.islice(measurements(*given), 4),
    )
    said = []
    outcome = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example, out=said.append)
    assert outcome.failed == 0, "".join(said)
    assert outcome.attempted > 0


def test_every_name_at_the_top_has_an_example():
    """But errors, the tables of names, and the parts of conditions and trainings, which others' show."""
    parts = {
        "BodyConditions",
        "ThrusterConditions",
        "FaultConditions",
        "DisturbanceConditions",
        "SensorConditions",
        "SensorsConditions",
        "PPOSettings",
        "TASKS",
        "__version__",
    }
    wanted = {
        name
        for name in {*dir(rans)} - parts
        if not (isinstance(found := getattr(rans, name), type) and issubclass(found, Exception))
    }
    assert len(wanted) > 35
    assert wanted <= {part for one in examples() for part in one.name.split(".")}


def test_the_top_lists_what_it_has_and_loads_what_it_can(monkeypatch):
    """What a name needs that is missing is said, also by an import of the name."""
    monkeypatch.setitem(sys.modules, "casadi", None)
    for name in [module for module in sys.modules if module.startswith("rans_optimal.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(PUBLIC._loaded, "MPC", raising=False)
    members = {name for name, _ in inspect.getmembers(rans)}
    assert set(rans.__all__) <= members
    assert {*dir(rans)} - members == {"MPC"}
    for line, error, said in (
        ("rans.MPC", AttributeError, "needs the package casadi"),
        ("from rans import MPC", ImportError, "needs the package casadi"),
        ("rans.Engin", AttributeError, "no attribute 'Engin'"),
    ):
        with pytest.raises(error, match=said):
            exec(line, {"rans": rans})


@pytest.mark.parametrize("package", [rans, rans.tasks], ids=lambda package: package.__name__)
def test_type_checkers_see_what_is_loaded_later(package):
    """Both read one block of imports; one without ``as`` is private to type checkers, and would be lost."""
    tree = ast.parse(Path(package.__file__).read_text("utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    for node in (one for one in block.body if isinstance(one, ast.ImportFrom)):
        for alias in node.names:
            assert package._LAZY[alias.name] == node.module
            assert alias.asname == alias.name


SLIDER = [
    ((-0.2, 0.1), (2.0, 0.0), 1.0),
    ((-0.2, -0.1), (1.0, 0.0), 1.0),
    ((0.2, 0.1), (-1.0, 0.0), 1.0),
    ((0.2, -0.1), (-1.0, 0.0), 1.0),
    ((0.0, -0.2), (0.0, 1.0), 0.5),
    ((0.0, 0.2), (0.0, -1.0), 0.5),
]


def test_a_planar_spacecraft_from_two_vectors():
    craft = rans.Spacecraft.planar("slider", 5.0, 0.1, SLIDER, centre_of_mass=(0.01, 0.0))
    # 1 N along x at y = 0.1 m turns by -0.1 N m; 0.5 N along y at x = -0.01 m from the centre by -0.005.
    assert craft.wrench_map[0] == pytest.approx((1.0, 0.0, -0.1), abs=1e-15)
    assert craft.wrench_map[4] == pytest.approx((0.0, 0.5, -0.005), abs=1e-15)
    assert repr(craft) == "<Spacecraft slider: 5 kg in the plane, thrusters 6 x 0.5 to 1 N>"
    assert rans.Engine(craft, "go-to-pose", 2).observation_width == 10


def test_names_do_where_objects_do():
    engine = rans.Engine("atmos", "track-velocity", 3, conditions="lab")
    assert (engine.craft, engine.task) == (rans.load_spacecraft("atmos"), rans.TrackVelocity())
    env = gymnasium.make("rans/GoToPose2D-v0", conditions="lab")
    assert env.reset(seed=1)[0].shape == (10,)


def test_a_derived_class_hands_its_arguments_on():
    class Playground(rans.SpacecraftVectorEnv):
        def __init__(self, colour: str, **others: Any) -> None:
            super().__init__(2, "go-to-pose", 2, **others)
            self.colour = colour

    envs = Playground(colour="red", spacecraft="atmos")
    assert (envs.colour, envs.num_envs) == ("red", 2)


def test_training_a_spacecraft_of_ones_own_leaves_a_run_that_can_be_repeated(tmp_path):
    craft = rans.Spacecraft.planar("slider", 5.0, 0.1, SLIDER)
    rows = list[dict[str, Any]]()
    settings = rans.PPOSettings(n_envs=4, n_steps=4, batch_size=8, n_epochs=1, layers=(8,))
    run = rans.train(
        rans.GoToPose(thrust_weight=0.07),
        craft,
        ppo=settings,
        total_timesteps=32,
        seed=3,
        output=tmp_path / "mine",
        report=rows.append,
    )
    assert rows[-1]["steps"] == 32
    assert (run.craft, run.task) == (craft, rans.GoToPose(thrust_weight=0.07))
    again = rans.fast.learn.run_folder.read_config(tmp_path / "mine" / "config.json")
    assert (again.seed, again.ppo) == (3, settings)
    assert rans.load_spacecraft(again.spacecraft) == craft


def test_texts_and_notebooks_show_what_is_there(monkeypatch):
    assert repr(rans.GoToPose(thrust_weight=0.5)) == "GoToPose(thrust_weight=0.5)"
    public = {name: getattr(rans, name) for name in rans.__all__}
    assert eval(repr(rans.load_conditions("lab")), public) == rans.load_conditions("lab")
    craft = rans.Spacecraft.planar("<b>slider", 5.0, 0.1, SLIDER)
    shown = craft._repr_html_()
    assert "&lt;b&gt;slider" in shown
    assert "<b>slider" not in shown
    assert shown.count("<tr>") == 10 + 7  # nine properties and six thrusters, with headings
    assert "data:image/svg+xml;base64," in shown
    assert "<td" in rans.GoToPose()._repr_html_()
    assert "exp(-distance / scale)" in rans.GoToPose()._repr_html_()
    assert "thrusters.latency" in rans.load_conditions("lab")._repr_html_()
    assert "nominal conditions" in rans.Conditions()._repr_html_()
    found = rans.evaluate("go-to-pose-2d", episodes=4)
    assert repr(found).startswith(
        "<go-to-pose-2d: 4 episodes of 25 s with floating-platform (fast engine): "
    )
    assert f"{found['duty'].value:.3g} %" in found._repr_html_()


def test_a_protocol_changes_what_a_loaded_agent_flies_in():
    """It was left out without a word."""
    agent = rans.load_agent("go-to-pose-2d")
    assert rans.evaluate(agent, episodes=2, protocol="paper").steps == 250  # 50 s at 5 Hz
    assert rans.evaluate(agent, episodes=2).steps == 125


@pytest.mark.slow
def test_one_name_beside_is_one_controller():
    """Of a text, no letter is one."""
    found = rans.compare("go-to-pose-2d", beside="switching", episodes=2)
    assert [entry.name for entry in found.entries] == ["go-to-pose-2d", "switching"]


def test_numbers_of_numpy_are_numbers():
    engine = rans.Engine("atmos", "go-to-pose", np.int64(3), seed=np.int64(5))  # type: ignore[arg-type]
    assert torch.equal(
        engine.reset(np.int64(5)),  # type: ignore[arg-type]
        rans.Engine("atmos", "go-to-pose", 3, seed=5).reset(5),  # type: ignore[arg-type]
    )
