from __future__ import annotations

import subprocess
from types import SimpleNamespace
from typing import Any

import pytest

from campaigns import scaling
from campaigns.scaling import Scaling
from rans.fast.distributed import Processes


def test_ratios_over_one_and_over_what_would_be_perfect(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rates = {1: 10e6, 2: 19e6, 4: 36e6}
    monkeypatch.setattr(Scaling, "_measure_on", lambda _, count: rates[count])
    Scaling().run()
    assert capsys.readouterr().out.splitlines() == [
        "1 x cuda: 10.00 M steps/s (median), 1.00 x one (100% of perfect)",
        "2 x cuda: 19.00 M steps/s (median), 1.90 x one (95% of perfect)",
        "4 x cuda: 36.00 M steps/s (median), 3.60 x one (90% of perfect)",
    ]


def test_without_one_gpu_the_first_number_is_taken_for_perfect(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """20 M of two are 10 M of one: 30 M of four are three of these."""
    monkeypatch.setattr(Scaling, "_measure_on", lambda _, count: {2: 20e6, 4: 30e6}[count])
    Scaling(processes=(2, 4)).run()
    assert "30.00 M steps/s (median), 3.00 x one (75% of perfect)" in capsys.readouterr().out


def test_the_first_process_tells_the_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Torch and its libraries print as well."""
    commands: list[list[str]] = []

    def run(command: list[str], **_: Any) -> Any:
        commands.append(command)
        return SimpleNamespace(stdout="a warning\nmeasured: 2500000.0\ngoodbye\n")

    monkeypatch.setattr(subprocess, "run", run)
    monkeypatch.setattr("sys.argv", ["scaling", "--n-envs", "64"])
    assert Scaling()._measure_on(3) == 2.5e6
    [command] = commands
    assert command[command.index("--nproc-per-node") + 1] == "3"
    assert command[-3:] == ["campaigns.scaling", "--n-envs", "64"]


def test_steps_of_all_processes_over_the_median_repeat(monkeypatch: pytest.MonkeyPatch) -> None:
    """Warm-up, then repeats of 3, 1, 9, 2 and 4 s: 2 processes x 8 x 4 steps x 10 iterations in 3 s."""
    took = iter([0.0, 50.0, *(t for s in (3.0, 1.0, 9.0, 2.0, 4.0) for t in (100.0, 100.0 + s))])
    done: list[str] = []
    learner = SimpleNamespace(
        collect=lambda: done.append("collect"), update=lambda: done.append("update")
    )
    monkeypatch.setattr(scaling, "Engine", lambda *_, **more: more["processes"])
    monkeypatch.setattr(scaling, "begin", lambda _engine, settings, _seeds: settings and learner)
    monkeypatch.setattr(scaling.time, "perf_counter", lambda: next(took))
    study = Scaling(n_envs=8, n_steps=4, iterations=10, device="cpu")
    assert study._rate(Processes(0, 2)) == pytest.approx(2 * 8 * 4 * 10 / 3.0)
    assert done == ["collect", "update"] * (5 + 5 * 10)


@pytest.mark.parametrize(("rank", "said"), [(0, "measured: 7.5\n"), (1, "")])
def test_only_the_first_process_speaks(
    rank: int, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(scaling, "join", lambda _: Processes(rank, 2))
    monkeypatch.setattr(Scaling, "_rate", lambda *_: 7.5)
    Scaling().measure()
    assert capsys.readouterr().out == said
