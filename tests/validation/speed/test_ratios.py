from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from validation.peers.runner import Peer, PeerResult
from validation.speed import ratios
from validation.speed.measurement import Measurement
from validation.speed.ratios import bounds, compare_peers, over_trainer, until_solved
from validation.speed.suite import effort
from validation.speed.training import Success


def test_shares_of_bounds() -> None:
    """Figures without a value or a bound have no share."""
    measured = [
        Measurement("engine", "x", 50.0, "M steps/s", bound=200.0, bound_name="y"),
        Measurement("engine", "z", None, "M", bound=1.0),
        Measurement("engine", "w", 1.0, "M"),
    ]
    (share,) = bounds(measured)
    assert (share.name, share.value, share.note) == ("x: share of y", 0.25, "50 of 200 M steps/s")


def test_ratios_over_a_trainer() -> None:
    """Steps are ours over theirs, seconds theirs over ours: more is better in both."""
    peer = PeerResult(
        "sb3",
        "command",
        figures={
            "same_task": True,
            "trained_steps_per_s": 2e4,
            "solved": False,
            "seconds_to_success": 300.0,
            "steps_to_success": 10**6,
        },
    )
    faster = over_trainer(peer, 1e5, "cpu")
    assert (faster.name, faster.value) == ("trained steps/s, over sb3", 5.0)
    assert "aimed at: 5 or more" in faster.note
    assert "aimed at: 100 or more" in over_trainer(peer, 1e5, "cuda:0").note
    sooner = until_solved(peer, Success(True, seconds=15.0, warm_up=1.0, steps=2000))
    assert (sooner.name, sooner.value) == ("seconds until solved, of sb3 over ours", 20.0)
    assert "300.0 s of 1,000,000 steps over 15.0 s of 2,000" in sooner.note
    assert "lower bound" in sooner.note
    peer.figures["solved"] = True
    assert "lower bound" not in until_solved(peer, Success(True, 15.0, 1.0, 2000)).note


def test_a_trainer_on_another_task_has_no_aim() -> None:
    peer = PeerResult("other", "command", figures={"trained_steps_per_s": 4e5, "task": "pendulum"})
    ratio = over_trainer(peer, 1e5, "cpu")
    assert (ratio.value, "aimed at" in ratio.note) == (0.25, False)
    assert "another task: pendulum" in ratio.note


@pytest.fixture
def ours(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """8 and 2 M steps/s of the engine, in the plane and in space, and 0.1 M of the trainer."""
    sizes: list[int] = []

    def engine_rate(
        craft: Any, _task: Any, num_envs: int, _clock: Any, compiled: Any
    ) -> Measurement:
        sizes.append(num_envs)
        return Measurement("engine", "", 8.0 if craft.dimension == 2 else 2.0, "M steps/s")

    monkeypatch.setattr(ratios, "engine_rate", engine_rate)
    monkeypatch.setattr(
        ratios, "trainer_rate", lambda *_: Measurement("training", "", 0.1, "M steps/s")
    )
    monkeypatch.setattr(ratios, "train_until_solved", lambda *_: Success(True, 4.0, 0.0, 5000))
    return sizes


def compared(monkeypatch: pytest.MonkeyPatch, asked: str, **figures: Any) -> dict[str, float]:
    """Ratios over one peer, by name."""
    monkeypatch.setattr(ratios, "PEERS", (Peer("other", "other", "other.py", ()),))
    monkeypatch.setattr(
        ratios, "measure_peer", lambda *_: PeerResult("other", "command", figures=figures)
    )
    said: list[str] = []
    [(result, found)] = compare_peers(effort(asked, quick=True), Path(), True, said.append)
    assert said == [result.package] == ["other"]
    return {ratio.name: ratio.value for ratio in found}


def test_a_simulator_is_compared_with_as_many_environments(
    monkeypatch: pytest.MonkeyPatch, ours: list[int]
) -> None:
    found = compared(monkeypatch, "cpu", device="cpu", num_envs=512, steps_per_s=1e6, task="t")
    assert found == {
        "environment steps/s, floating-platform over other": 8.0,
        "environment steps/s, free-flyer over other": 2.0,
    }
    assert ours == [512, 512]


@pytest.mark.usefixtures("ours")
def test_a_trainer_is_compared_by_rate_and_by_time(monkeypatch: pytest.MonkeyPatch) -> None:
    found = compared(
        monkeypatch,
        "cpu",
        device="cpu",
        same_task=True,
        trained_steps_per_s=2e4,
        solved=True,
        seconds_to_success=12.0,
        steps_to_success=9,
    )
    assert found == {
        "trained steps/s, over other": 5.0,
        "seconds until solved, of other over ours": 3.0,
    }
    assert compared(monkeypatch, "cpu", device="cpu", trained_steps_per_s=1e5, task="t") == {
        "trained steps/s, over other": 1.0
    }


@pytest.mark.usefixtures("ours")
@pytest.mark.parametrize(
    "figures", [{}, {"device": "cpu", "num_envs": 1, "steps_per_s": 1.0, "task": "t"}]
)
def test_who_failed_or_ran_elsewhere_has_no_ratio(
    monkeypatch: pytest.MonkeyPatch, figures: Any
) -> None:
    """JAX falls back to a CPU silently."""
    assert compared(monkeypatch, "cuda:0", **figures) == {}
