"""The package's front door: names, examples, and what is refused there."""

from __future__ import annotations

import ast
import doctest
import importlib
import tempfile
from pathlib import Path
from typing import Any

import gymnasium
import pytest

import rans
from rans.errors import ConfigError
from tests.test_imports import loaded

MODULES = ("rans", "rans.api", "rans.model.spacecraft", "rans.model.spacecraft_file", "rans.tasks",
           "rans.tasks.formula", "rans.evaluation.fly.pilot")


def examples() -> list[doctest.DocTest]:
    known = {"rans": rans, "tempfile": tempfile, "gymnasium": gymnasium}
    found = []
    for name in MODULES:
        module = importlib.import_module(name)
        found += [one for one in doctest.DocTestFinder().find(module, globs=vars(module) | known)
                  if one.examples]
    return found


@pytest.mark.parametrize("example", examples(), ids=lambda one: one.name)
def test_examples_in_docstrings(example: doctest.DocTest) -> None:
    said: list[str] = []
    outcome = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example, out=said.append)
    assert outcome.failed == 0, "".join(said)
    assert outcome.attempted > 0


def test_every_function_at_the_top_has_an_example() -> None:
    functions = [name for name in rans.__all__ if name in vars(importlib.import_module("rans.api"))
                 and callable(getattr(rans, name)) and getattr(rans, name).__module__ == "rans.api"]
    assert len(functions) == 7
    names = {one.name.rpartition(".")[2] for one in examples()}
    assert set(functions) <= names


def test_the_top_lists_what_it_has_and_loads_it_when_asked() -> None:
    assert set(rans.__all__) <= set(dir(rans))
    for name in rans.__all__:
        assert getattr(rans, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Engin'"):
        getattr(rans, "Engin")  # noqa: B009


def test_type_checkers_see_what_is_loaded_later() -> None:
    tree = ast.parse(Path(rans.__file__).read_text("utf-8"))
    block, = (node for node in tree.body if isinstance(node, ast.If))
    told = {alias.name: node.module for node in block.body if isinstance(node, ast.ImportFrom)
            for alias in node.names}
    assert told == rans._LAZY


def test_importing_loads_neither_torch_nor_drake_casadi_scipy() -> None:
    heavy = {"torch", "pydrake", "casadi", "scipy", "numba", "matplotlib", "rich", "tyro", "cattrs"}
    assert loaded("import rans; dir(rans); rans.load_spacecraft('free-flyer')") & heavy <= {"cattrs"}


SLIDER = [((-0.2, 0.1), (2.0, 0.0), 1.0), ((-0.2, -0.1), (1.0, 0.0), 1.0), ((0.2, 0.1), (-1.0, 0.0), 1.0),
          ((0.2, -0.1), (-1.0, 0.0), 1.0), ((0.0, -0.2), (0.0, 1.0), 0.5), ((0.0, 0.2), (0.0, -1.0), 0.5)]


def test_a_planar_spacecraft_from_two_vectors() -> None:
    craft = rans.Spacecraft.planar("slider", 5.0, 0.1, SLIDER, centre_of_mass=(0.01, 0.0))
    # 1 N along x at y = 0.1 m turns by -0.1 N m; 0.5 N along y at x = -0.01 m from the centre by -0.005.
    assert craft.wrench_map[0] == pytest.approx((1.0, 0.0, -0.1), abs=1e-15)
    assert craft.wrench_map[4] == pytest.approx((0.0, 0.5, -0.005), abs=1e-15)
    assert repr(craft) == "<Spacecraft slider: 5 kg in the plane, thrusters 6 x 0.5 to 1 N>"
    assert rans.Engine(craft, "go-to-pose", 2).observation_width == 10


@pytest.mark.parametrize("rows", [[((0.0, 0.0, 0.0), (1.0, 0.0), 1.0)], [(1.0, 2.0)], 3, [rans.GoToPose()]])
def test_planar_thrusters_that_are_none(rows: Any) -> None:
    with pytest.raises(ConfigError, match=r"thrusters are \(\(x, y\), \(x, y\), force\) each"):
        rans.Spacecraft.planar("slider", 5.0, 0.1, rows)


def test_a_direction_needs_a_length() -> None:
    with pytest.raises(ConfigError, match="a zero direction has none"):
        rans.Spacecraft.planar("slider", 5.0, 0.1, [((0.0, 0.0), (0.0, 0.0), 1.0)])


def test_names_do_where_objects_do() -> None:
    engine = rans.Engine("atmos", "track-velocity", 3, conditions="lab")
    assert (engine.craft, engine.task) == (rans.load_spacecraft("atmos"), rans.TrackVelocity())
    env = gymnasium.make("rans/GoToPose2D-v0", conditions="lab")
    assert env.reset(seed=1)[0].shape == (10,)


@pytest.mark.parametrize(("ask", "said"), [
    (lambda: rans.Engine("floating-platform", {"thrust_weight": 1.0}, 2),  # type: ignore[arg-type]
     "task, unless it is a name or a file, takes an object, no dict: rans.Task"),
    (lambda: rans.Engine("floating-platform", rans.GoToPose(), 2, {"episode_steps": 9}),  # type: ignore[arg-type]
     r"timing takes an object, no dict: rans.Timing\(episode_steps=9\)"),
    (lambda: rans.Engine("floating-platform", rans.GoToPose(), 2, conditions={"body": 1}),  # type: ignore[arg-type]
     r"conditions, .*no dict: rans.Conditions\(body=1\)"),
    (lambda: gymnasium.make("rans/GoToPose2D-v0", task={"thrust_weight": 1.0}),
     r"no dict: rans.GoToPose\(thrust_weight=1.0\)"),
    (lambda: gymnasium.make("rans/GoToPose2D-v0", timing={"episode_steps": 5}), "no dict: rans.Timing"),
    (lambda: rans.train("go-to-pose", ppo={"n_steps": 32}, run="x"),  # type: ignore[arg-type]
     r"ppo takes an object, no dict: rans.PPOSettings\(n_steps=32\)"),
    (lambda: rans.load_spacecraft(3), "spacecraft, unless it is a name or a file, must be a rans.Spacecraft"),  # type: ignore[arg-type]
    (lambda: rans.evaluate("nobody"), "nobody is not a run folder"),
    (lambda: rans.evaluate("go-to-pose-2d", episodes=0), "episodes must be a whole number >= 1"),
    (lambda: rans.evaluate("multi-task-2d"), "knows several tasks: pick one, as in multi-task-2d#go-to"),
    (lambda: rans.train("go-to-poze"), r"named 'go-to-poze' \(did you mean go-to-pose\?\)"),
    (lambda: rans.compare(), "name at least one contestant"),
    (lambda: rans.optimal_trajectory(objective="tim"), "objective must be one of fuel, time"),  # type: ignore[arg-type]
    (lambda: rans.certify(kind="settling", horizon=4.0), "bounded for arrival only"),
])
def test_mistakes_are_sentences(ask: Any, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        ask()


def test_training_a_spacecraft_of_ones_own_leaves_a_run_that_can_be_repeated(tmp_path: Path) -> None:
    craft, rows = rans.Spacecraft.planar("slider", 5.0, 0.1, SLIDER), list[dict[str, Any]]()
    settings = rans.PPOSettings(n_envs=4, n_steps=4, batch_size=8, n_epochs=1, layers=(8,))
    run = rans.train(rans.GoToPose(thrust_weight=0.07), craft, ppo=settings, total_timesteps=32, seed=3,
                     run=tmp_path / "mine", report=rows.append)
    assert rows[-1]["steps"] == 32
    assert (run.craft, run.task) == (craft, rans.GoToPose(thrust_weight=0.07))
    again = rans.fast.learn.run_folder.read_config(tmp_path / "mine" / "config.json")
    assert (again.seed, again.ppo) == (3, settings)
    assert rans.load_spacecraft(again.spacecraft) == craft


def test_texts_and_notebooks_show_what_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    assert repr(rans.GoToPose(thrust_weight=0.5)) == "GoToPose(thrust_weight=0.5)"
    assert eval(repr(rans.load_conditions("lab")), dict(vars(rans))) == rans.load_conditions("lab")
    craft = rans.Spacecraft.planar("<b>slider", 5.0, 0.1, SLIDER)
    shown = craft._repr_html_()
    assert "&lt;b&gt;slider" in shown
    assert "<b>slider" not in shown
    assert shown.count("<tr>") == 8 + 7  # seven properties and six thrusters, with headings
    assert "data:image/svg+xml;base64," in shown
    assert "<td" in rans.GoToPose()._repr_html_()
    assert "0.5 exp(-position / 1.5)" in rans.GoToPose()._repr_html_()
    assert "thrusters.latency" in rans.load_conditions("lab")._repr_html_()
    assert "a perfect world" in rans.Conditions()._repr_html_()
    found = rans.evaluate("go-to-pose-2d", episodes=4)
    assert repr(found).startswith("<go-to-pose-2d: 4 episodes of 25 s with floating-platform (fast engine): ")
    assert f"{found['duty'].value:.3g} %" in found._repr_html_()
