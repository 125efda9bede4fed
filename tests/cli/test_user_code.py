"""Mistakes in a user's task are said with its file and line first, in the words of fields."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from rans.cli import main
from rans.model.fields import Vec2, Vec3

TASK = """
from dataclasses import dataclass
from rans.tasks import GoToPose
from rans.tasks.rewards import nearness

@dataclass(frozen=True)
class Gate(GoToPose):
    def reward(self, transition):
        error = (transition.goal.p - transition.state.p).norm()
        way = transition.goal.p - transition.state.p
        {line}
"""
LINE = 11
"""Number of the line with the planted mistake."""


_numbers = itertools.count()


def written(line: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Name of a new module with this line; tasks are loaded once by their names."""
    name = f"gate_task_{next(_numbers)}"
    (folder / f"{name}.py").write_text(TASK.replace("{line}", line))
    monkeypatch.syspath_prepend(folder)
    return name


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('return {"position": {}["positon"]}', "KeyError: 'positon'"),
        ('return {"position": 1.0 if error < 0.5 else 0.0}', "where(condition, a, b)"),
        ('return {"position": (way * 2.0).norm()}', "v.scale(s)"),
        ('return {"position": (2.0 * way).norm()}', "v.scale(s)"),
        ('return {"position": (way + 1.0).norm()}', "a vector and float cannot be added"),
        ('return {"position": way.lenght()}', "norm"),
        ('return {"position": transition.state.attitude.rotate_back(way)}', "did you mean rotate"),
    ],
)
def test_file_and_line_are_first(line, said, tmp_path, monkeypatch, ran):
    module = written(line, tmp_path, monkeypatch)
    command = f"train {module}:Gate --total-timesteps 1"
    printed = ran(command, code=2)
    assert printed.startswith(f"rans: {module}.py, line {LINE}, in reward: ")
    assert said in printed
    assert line in printed
    monkeypatch.setenv("RANS_TRACEBACK", "1")
    with pytest.raises((LookupError, TypeError, ValueError, AttributeError)):
        main(command.split())


def test_a_reward_that_is_no_dict_is_named(tmp_path, monkeypatch, refused):
    module = written("return error", tmp_path, monkeypatch)
    assert "Gate.reward must return a dict" in refused(f"list {module}:Gate")


def test_its_own_refusal_has_its_line(tmp_path, monkeypatch, refused):
    module = written("raise __import__('rans').ConfigError('shut')", tmp_path, monkeypatch)
    said = refused(f"evaluate lqr:{module}:Gate --episodes 1")
    assert f"shut ({module}.py, line {LINE}, in reward)" in said


@pytest.mark.parametrize(
    ("function", "said"),
    [
        ("def done(self, state, goal): return {'won': state.p.x}", "got dict"),
        (
            "def errors(self, state, goal): e = {'position': 1.0}",
            "errors must return a dict of errors",
        ),
        ("def sample(self, random): return random.around(1.0, 2.0)", "start and goal"),
        (
            "def sample(self, random): return random.around(1.0, 2.0), random.direction()",
            "a tuple of PlanarState and Vec2",
        ),
        ("def reward(self, transition): return {'p': transition.state.p}", "'p' with a Vec2"),
        ("def constraints(self, state, goal): return [state.p.x]", "dict of margins"),
        ("def failed(self, state, goal): pass", "as it has no `return`"),
        ("def observation_terms(self, state, goal): return (state.p,)", "VectorInW("),
    ],
)
def test_results_of_another_kind(function, said, tmp_path, monkeypatch, refused):
    module = written(f"return {{}}\n    {function}", tmp_path, monkeypatch)
    printed = refused(f"train {module}:Gate --total-timesteps 1")
    name = function.split("(")[0].removeprefix("def ")
    assert f"{module}.py, line {LINE + 1}: Gate.{name} must return" in printed
    assert said in printed


def test_a_module_that_cannot_be_imported(here, monkeypatch, refused, ran):
    module = written("return {}", here, monkeypatch)
    assert f"without .py: write {module}:Gate" in refused(f"train {module}.py:Gate")
    assert "(did you mean Gate?)" in refused(f"train {module}:Gat")
    assert f"did you mean {module}:CLASS" in refused(f"train {module}")
    (here / "gate_unfrozen.py").write_text(TASK.replace("(frozen=True)", ""))
    printed = ran("list gate_unfrozen:Gate", code=2)
    assert "gate_unfrozen.py, line 6, in <module>" in printed
    assert "@dataclass(frozen=True)" in printed


@pytest.mark.parametrize("vector", [Vec2(1.0, 2.0), Vec3(1.0, 2.0, 3.0)])
def test_arithmetic_that_vectors_do_not_have(vector):
    for factor in (2.0, np.ones(3)):
        with pytest.raises(TypeError, match=r"v\.scale"):
            vector * factor
    with pytest.raises(TypeError, match=r"v\.scale"):
        vector / 2.0
    with pytest.raises(TypeError, match="cannot be added"):
        vector - 1.0
