from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import validation.peers.runner as runner
from rans.evaluation.fly.agent import Agent
from rans.fast.engine import Engine
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.member import begin
from rans.tasks import TASKS, GoToPose, GoToPosition
from tests.fast.engines import FLYER, PLATFORM, both_crafts
from tests.fast.test_policy import seen
from tests.fast.training import scatter
from validation.peers.runner import Peer, PeerResult, measure_peer
from validation.speed.engine import engine_rate
from validation.speed.latency import numpy_policy, onnx_policy
from validation.speed.measurement import Clock, Measurement
from validation.speed.ratios import bounds, over_trainer, until_solved
from validation.speed.roofline import Traffic, main, step_work
from validation.speed.solving import solver_rate
from validation.speed.training import Success

DOCS = Path(__file__).parents[2] / "docs"


# What a step asks of the machine.

def test_bytes_of_a_step_in_the_plane() -> None:
    """Counted by hand: six numbers of state, one heading as goal, eight thrusters, ten columns seen."""
    terms = len(Engine(PLATFORM, GoToPose(), 1).term_names)
    assert step_work(Engine(PLATFORM, GoToPose(), 1)).traffic == (
        Traffic("state", 24, 24), Traffic("goal", 4, 0), Traffic("clock", 4, 4),
        Traffic("action", 8, 0), Traffic("observation", 0, 40), Traffic("reward terms", 0, 4 * terms),
        Traffic("reward", 0, 4), Traffic("flags", 0, 3))


def test_reals_of_twice_the_size_move_twice_the_bytes() -> None:
    single, double = (step_work(Engine(FLYER, GoToPose(), 1, dtype=dtype))
                      for dtype in (torch.float32, torch.float64))
    others = {"clock", "action", "flags"}
    for one, two in zip(single.traffic, double.traffic, strict=True):
        factor = 1 if one.name in others else 2
        assert (two.read, two.written) == (factor * one.read, factor * one.written)


def test_operations_of_a_step_in_the_plane() -> None:
    """Four quadrature nodes and the heading that is seen, none of them used twice."""
    operations = step_work(Engine(PLATFORM, GoToPosition(), 1)).operations
    assert operations["sin"] == operations["cos"] == 4 + 1


@pytest.mark.parametrize("name", TASKS)
@both_crafts
def test_every_task_is_counted(craft: Any, name: str) -> None:
    work = step_work(Engine(craft, TASKS[name](), 1))
    assert work.bytes_moved > 100
    assert work.operations.total() > work.special > 0


def test_documentation_has_todays_table(capsys: pytest.CaptureFixture[str]) -> None:
    main()
    assert capsys.readouterr().out in (DOCS / "speed.md").read_text("utf-8")


# Agents without torch.

@pytest.mark.parametrize("activation", ["tanh", "elu", "relu"])
@both_crafts
def test_numpy_answers_as_torch_does(craft: Any, activation: Any) -> None:
    settings = PPOSettings(n_envs=1, n_steps=2, batch_size=2, layers=(16, 24), activation=activation)
    policy = scatter(begin(Engine(craft, GoToPose(), 1), [settings], [0]).network)
    policy.update_statistics(policy.look(seen(craft, 500))[0][None])
    observation = seen(craft, 200, seed=4).float().numpy()
    expected = Agent(policy, "").act(None, None, observation)
    assert 0.2 < expected.mean() < 0.8  # of both kinds
    np.testing.assert_array_equal(numpy_policy(policy)(observation), expected)


def test_onnx_answers_as_torch_does() -> None:
    for package in ("onnxruntime", "onnxscript"):
        pytest.importorskip(package)
    settings = PPOSettings(n_envs=1, n_steps=2, batch_size=2)
    policy = scatter(begin(Engine(PLATFORM, GoToPose(), 1), [settings], [0]).network)
    act = onnx_policy(policy)
    for row in seen(PLATFORM, 20).float().numpy():
        np.testing.assert_array_equal(act(row[None]), Agent(policy, "").act(None, None, row[None]))


# Optimal control.

def test_solves_per_second_are_those_of_their_milliseconds() -> None:
    each, rate = solver_rate(PLATFORM, GoToPosition(), starts=1)
    assert each.value is not None
    assert rate.value == pytest.approx(1e3 / each.value)  # with one start median and mean are the same
    assert "1 of 1 solved" in rate.note


def test_a_task_without_an_optimum_is_a_row_that_says_so() -> None:
    [row] = solver_rate(PLATFORM, TASKS["multi-task"](), starts=1)
    assert row.value is None
    assert row.note


# Engine.

@pytest.mark.slow  # compiles
@pytest.mark.filterwarnings("ignore:.*torch.jit.script_method:DeprecationWarning")  # torch's own
def test_compiling_is_warm_up() -> None:
    clock = Clock("cpu", repeats=2, seconds=0.01)
    m = engine_rate(PLATFORM, GoToPose(), 64, clock, bandwidth=27.0)
    assert m.value is not None
    assert m.bound == pytest.approx(1e3 * 27.0 / 135)  # 27 GB/s, 135 bytes a step
    assert m.warm_up > 100 * 64 / (1e6 * m.value)  # one step of 64 takes microseconds, compiling it seconds
    assert "not compiled" not in m.note


# Clock and ratios.

def test_warm_up_is_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock that the function itself moves: 5 s of compiling once, 2 s a call."""
    now, calls = [0.0], []

    def work() -> None:
        now[0] += 2.0 if calls else 7.0
        calls.append(1)

    monkeypatch.setattr("validation.speed.measurement.time.perf_counter", lambda: now[0])
    seconds, warm_up = Clock("cpu", repeats=3, seconds=10.0).time(work)
    assert seconds == 2.0
    assert warm_up == pytest.approx(7.0 + 3 * 2.0)
    assert len(calls) == 4 + 1 + 3 * 5


def test_shares_of_bounds() -> None:
    rows = [Measurement("engine", "a", 3.0, "M", bound=4.0, bound_name="b"),
            Measurement("engine", "c", 3.0, "M"), Measurement("policy", "d", None, "us", bound=1.0)]
    assert [(r.name, r.value) for r in bounds(rows)] == [("a: share of b", 0.75)]


def test_ratios_over_a_trainer() -> None:
    figures = {"trained_steps_per_s": 2e4, "solved": False, "seconds_to_success": 300.0,
               "steps_to_success": 10}
    peer = PeerResult("sb3", "command", figures=figures)
    assert over_trainer(peer, 1e5, "cpu").value == 5.0
    assert "100 or more" in over_trainer(peer, 1e5, "cuda:0").note
    ratio = until_solved(peer, Success(True, seconds=15.0, warm_up=0.0, steps=4))
    assert ratio.value == 20.0
    assert "lower bound" in ratio.note


# Peers.

SCRIPT = """import json, sys
print("said before")
print(json.dumps({"arguments": sys.argv[1:], "device": "cpu"}))
"""


def peer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> Peer:
    """A script in a folder of its own, for a module that is always there."""
    monkeypatch.setattr(runner, "_FOLDER", tmp_path)
    (tmp_path / "script.py").write_text(script)
    return Peer("package", "json", "script.py", ("package==1",))


def test_a_peers_last_line_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = measure_peer(peer(tmp_path, monkeypatch, SCRIPT), "cpu", tmp_path, quick=True)
    assert result.figures == {"arguments": ["--device", "cpu", "--quick"], "device": "cpu"}
    assert result.command.endswith("script.py --device cpu --quick")
    assert (result.installed_by, result.reason) == ("", "")


@pytest.mark.parametrize(("script", "reason"), [
    ("raise ValueError('no luck')", "ValueError: no luck"),
    ("import sys; sys.exit(3)", "exit code 3"),
    ("print('no JSON')", "Expecting value"),
    ("", "list index out of range"),
    ("import time; time.sleep(60)", "not done after 0 s"),
])
def test_a_peer_cannot_break_the_benchmark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str,
                                           reason: str) -> None:
    if "sleep" in script:
        monkeypatch.setattr(runner, "_RUN_SECONDS", 0.3)
    result = measure_peer(peer(tmp_path, monkeypatch, script), "cpu", tmp_path)
    assert result.figures == {}
    assert reason in result.reason


def test_the_reason_is_the_error_and_not_pips_excuse() -> None:
    text = "Collecting x\n  urllib.error.URLError: <no network>\n  [end]\n\nnote: not pip's fault.\n"
    assert runner._last_error(text) == "urllib.error.URLError: <no network>"
    assert runner._last_error("something\nelse\n\n") == "else"


def test_an_environment_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[Any] = []
    monkeypatch.setattr(runner, "_output", lambda command, *_: done.append(command) or "{}\n")
    monkeypatch.setattr(runner.venv, "create", lambda home, **_: home.mkdir(parents=True, exist_ok=True))
    for version in ("1", "1", "2"):
        absent = Peer("package", "no_such_module", "script.py", (f"package=={version}", "jax==3"))
        measure_peer(absent, "cuda", tmp_path)
    installed = [command[-2:] for command in done if "pip" in command]
    assert installed == [["package==1", "jax[cuda12]==3"], ["package==2", "jax[cuda12]==3"]]


def test_every_peer_has_its_script_and_versions() -> None:
    for given in runner.PEERS:
        assert (Path(runner.__file__).parent / given.script).is_file()
        assert all("==" in requirement for requirement in given.requirements)
        assert Path(given.script).stem != given.module  # it would be imported in the module's place
